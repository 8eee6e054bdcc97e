#include "openmmhelfrich/EdgeFlipIntegratorProxy.h"
#include "openmmhelfrich/EdgeFlipIntegrator.h"
#include "openmmhelfrich/HelfrichSerialization.h"
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const int VERSION = 1;

EdgeFlipIntegratorProxy::EdgeFlipIntegratorProxy() : SerializationProxy("EdgeFlipIntegrator") {
}

void EdgeFlipIntegratorProxy::serialize(const void* object, SerializationNode& node) const {
    node.setIntProperty("version", VERSION);
    const EdgeFlipIntegrator& integrator = *reinterpret_cast<const EdgeFlipIntegrator*>(object);
    node.setDoubleProperty("temperature", integrator.getTemperature());
    node.setDoubleProperty("fraction", integrator.getFraction());
    node.setIntProperty("randomSeed", integrator.getRandomNumberSeed());
    node.setIntProperty("integrationForceGroups", integrator.getIntegrationForceGroups());
}

void* EdgeFlipIntegratorProxy::deserialize(const SerializationNode& node) const {
    requireVersion(node, VERSION, getTypeName());
    unique_ptr<EdgeFlipIntegrator> integrator(
            new EdgeFlipIntegrator(node.getDoubleProperty("temperature"), node.getDoubleProperty("fraction")));
    integrator->setRandomNumberSeed(node.getIntProperty("randomSeed"));
    integrator->setIntegrationForceGroups(node.getIntProperty("integrationForceGroups", 0xFFFFFFFF));
    return integrator.release();
}
