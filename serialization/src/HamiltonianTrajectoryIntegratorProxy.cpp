#include "openmmhelfrich/HamiltonianTrajectoryIntegratorProxy.h"
#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/HelfrichSerialization.h"
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const int VERSION = 1;

HamiltonianTrajectoryIntegratorProxy::HamiltonianTrajectoryIntegratorProxy()
        : SerializationProxy("HamiltonianTrajectoryIntegrator") {
}

void HamiltonianTrajectoryIntegratorProxy::serialize(const void* object, SerializationNode& node) const {
    node.setIntProperty("version", VERSION);
    const HamiltonianTrajectoryIntegrator& integrator =
            *reinterpret_cast<const HamiltonianTrajectoryIntegrator*>(object);
    node.setDoubleProperty("temperature", integrator.getTemperature());
    node.setDoubleProperty("stepSize", integrator.getStepSize());
    node.setIntProperty("stepsPerTrajectory", integrator.getStepsPerTrajectory());
    node.setStringProperty("forcePrecision", integrator.getForcePrecision());
    node.setDoubleProperty("trajectoryJitter", integrator.getTrajectoryJitter());
    node.setStringProperty("splitting", integrator.getSplitting());
    node.setIntProperty("tetherSubsteps", integrator.getTetherSubsteps());
    node.setDoubleProperty("momentumRefreshment", integrator.getMomentumRefreshment());
    node.setIntProperty("randomSeed", integrator.getRandomNumberSeed());
    node.setIntProperty("integrationForceGroups", integrator.getIntegrationForceGroups());
}

void* HamiltonianTrajectoryIntegratorProxy::deserialize(const SerializationNode& node) const {
    requireVersion(node, VERSION, getTypeName());
    unique_ptr<HamiltonianTrajectoryIntegrator> integrator(new HamiltonianTrajectoryIntegrator(
            node.getDoubleProperty("temperature"), node.getDoubleProperty("stepSize"),
            node.getIntProperty("stepsPerTrajectory")));
    integrator->setForcePrecision(node.getStringProperty("forcePrecision", "double"));
    integrator->setTrajectoryJitter(node.getDoubleProperty("trajectoryJitter", 0.0));
    integrator->setSplitting(node.getStringProperty("splitting", "leapfrog"));
    integrator->setTetherSubsteps(node.getIntProperty("tetherSubsteps", 1));
    integrator->setMomentumRefreshment(node.getDoubleProperty("momentumRefreshment", 1.0));
    integrator->setRandomNumberSeed(node.getIntProperty("randomSeed"));
    integrator->setIntegrationForceGroups(node.getIntProperty("integrationForceGroups", 0xFFFFFFFF));
    return integrator.release();
}
