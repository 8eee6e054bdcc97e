#include "openmmhelfrich/HybridMonteCarloIntegratorProxy.h"
#include "openmmhelfrich/HelfrichSerialization.h"
#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include "openmm/OpenMMException.h"
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const int VERSION = 1;

HybridMonteCarloIntegratorProxy::HybridMonteCarloIntegratorProxy() : SerializationProxy("HybridMonteCarloIntegrator") {
}

void HybridMonteCarloIntegratorProxy::serialize(const void* object, SerializationNode& node) const {
    node.setIntProperty("version", VERSION);
    const HybridMonteCarloIntegrator& integrator = *reinterpret_cast<const HybridMonteCarloIntegrator*>(object);
    node.setDoubleProperty("flipProbability", integrator.getFlipProbability());
    node.setIntProperty("randomSeed", integrator.getRandomNumberSeed());
    node.createChildNode("Trajectory", &integrator.getIntegrator(0));
    node.createChildNode("Flips", &integrator.getIntegrator(1));
    if (integrator.getNumIntegrators() > 2) {
        node.setDoubleProperty("shearWaveProbability", integrator.getShearWaveProbability());
        node.createChildNode("ShearWaves", &integrator.getIntegrator(2));
    }
}

static void addShearWaves(const SerializationNode& node, HybridMonteCarloIntegrator& integrator) {
    if (!node.hasProperty("shearWaveProbability"))
        return;
    unique_ptr<Integrator> third(node.getChildNode("ShearWaves").decodeObject<Integrator>());
    ShearWaveIntegrator* shearWaves = dynamic_cast<ShearWaveIntegrator*>(third.get());
    if (shearWaves == nullptr)
        throw OpenMMException(
                "HybridMonteCarloIntegrator: the node 'ShearWaves' does not describe a ShearWaveIntegrator");
    integrator.addShearWaves(shearWaves, node.getDoubleProperty("shearWaveProbability"));
    third.release();
}

void* HybridMonteCarloIntegratorProxy::deserialize(const SerializationNode& node) const {
    requireVersion(node, VERSION, getTypeName());
    unique_ptr<Integrator> trajectory(node.getChildNode("Trajectory").decodeObject<Integrator>());
    unique_ptr<Integrator> second(node.getChildNode("Flips").decodeObject<Integrator>());
    EdgeFlipIntegrator* flips = dynamic_cast<EdgeFlipIntegrator*>(second.get());
    if (flips == nullptr)
        throw OpenMMException(getTypeName() + ": the node 'Flips' does not describe an EdgeFlipIntegrator");
    unique_ptr<HybridMonteCarloIntegrator> integrator(
            new HybridMonteCarloIntegrator(trajectory.get(), flips, node.getDoubleProperty("flipProbability")));
    trajectory.release();
    second.release();
    addShearWaves(node, *integrator);
    integrator->setRandomNumberSeed(node.getIntProperty("randomSeed"), false);
    return integrator.release();
}
