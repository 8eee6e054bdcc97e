#include "openmmhelfrich/ShearWaveIntegratorProxy.h"
#include "openmmhelfrich/HelfrichSerialization.h"
#include "openmmhelfrich/ShearWaveIntegrator.h"
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const int VERSION = 1;

ShearWaveIntegratorProxy::ShearWaveIntegratorProxy() : SerializationProxy("ShearWaveIntegrator") {
}

void ShearWaveIntegratorProxy::serialize(const void* object, SerializationNode& node) const {
    node.setIntProperty("version", VERSION);
    const ShearWaveIntegrator& integrator = *reinterpret_cast<const ShearWaveIntegrator*>(object);
    node.setDoubleProperty("temperature", integrator.getTemperature());
    node.setDoubleProperty("amplitude", integrator.getAmplitude());
    node.setDoubleProperty("minWaveNumber", integrator.getMinWaveNumber());
    node.setDoubleProperty("maxWaveNumber", integrator.getMaxWaveNumber());
    node.setIntProperty("movesPerStep", integrator.getMovesPerStep());
    node.setIntProperty("randomSeed", integrator.getRandomNumberSeed());
    node.setIntProperty("integrationForceGroups", integrator.getIntegrationForceGroups());
}

void* ShearWaveIntegratorProxy::deserialize(const SerializationNode& node) const {
    requireVersion(node, VERSION, getTypeName());
    unique_ptr<ShearWaveIntegrator> integrator(
            new ShearWaveIntegrator(node.getDoubleProperty("temperature"), node.getDoubleProperty("amplitude"),
                                    node.getDoubleProperty("minWaveNumber"), node.getDoubleProperty("maxWaveNumber"),
                                    node.getIntProperty("movesPerStep")));
    integrator->setRandomNumberSeed(node.getIntProperty("randomSeed"));
    integrator->setIntegrationForceGroups(node.getIntProperty("integrationForceGroups", 0xFFFFFFFF));
    return integrator.release();
}
