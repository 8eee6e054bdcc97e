#ifndef OPENMM_HAMILTONIANTRAJECTORYINTEGRATOR_PROXY_H_
#define OPENMM_HAMILTONIANTRAJECTORYINTEGRATOR_PROXY_H_

#include "MonteCarloIntegratorProxy.h"
#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"

namespace HelfrichPlugin {

/**
 * This is a proxy for serializing HamiltonianTrajectoryIntegrator objects.
 */
class HamiltonianTrajectoryIntegratorProxy : public MonteCarloIntegratorProxy<HamiltonianTrajectoryIntegrator> {
public:
    HamiltonianTrajectoryIntegratorProxy() : MonteCarloIntegratorProxy("HamiltonianTrajectoryIntegrator") {
    }
protected:
    void storeSettings(const HamiltonianTrajectoryIntegrator& move, OpenMM::SerializationNode& node) const {
        node.setDoubleProperty("stepSize", move.getStepSize());
        node.setIntProperty("stepsPerTrajectory", move.getStepsPerTrajectory());
        node.setStringProperty("forcePrecision", move.getForcePrecision());
        node.setDoubleProperty("trajectoryJitter", move.getTrajectoryJitter());
        node.setStringProperty("splitting", move.getSplitting());
        node.setIntProperty("tetherSubsteps", move.getTetherSubsteps());
        node.setDoubleProperty("momentumRefreshment", move.getMomentumRefreshment());
    }
    HamiltonianTrajectoryIntegrator* create(double temperature, const OpenMM::SerializationNode& node) const {
        std::unique_ptr<HamiltonianTrajectoryIntegrator> move(new HamiltonianTrajectoryIntegrator(
                temperature, node.getDoubleProperty("stepSize"), node.getIntProperty("stepsPerTrajectory")));
        move->setForcePrecision(node.getStringProperty("forcePrecision", "double"));
        move->setTrajectoryJitter(node.getDoubleProperty("trajectoryJitter", 0.0));
        move->setSplitting(node.getStringProperty("splitting", "leapfrog"));
        move->setTetherSubsteps(node.getIntProperty("tetherSubsteps", 1));
        move->setMomentumRefreshment(node.getDoubleProperty("momentumRefreshment", 1.0));
        return move.release();
    }
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HAMILTONIANTRAJECTORYINTEGRATOR_PROXY_H_*/
