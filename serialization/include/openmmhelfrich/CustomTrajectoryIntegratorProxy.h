#ifndef OPENMM_CUSTOMTRAJECTORYINTEGRATOR_PROXY_H_
#define OPENMM_CUSTOMTRAJECTORYINTEGRATOR_PROXY_H_

#include "MonteCarloIntegratorProxy.h"
#include "openmmhelfrich/CustomTrajectoryIntegrator.h"

namespace HelfrichPlugin {

/**
 * This is a proxy for serializing CustomTrajectoryIntegrator objects.
 */
class CustomTrajectoryIntegratorProxy : public MonteCarloIntegratorProxy<CustomTrajectoryIntegrator> {
public:
    CustomTrajectoryIntegratorProxy() : MonteCarloIntegratorProxy("CustomTrajectoryIntegrator") {
    }
protected:
    void storeSettings(const CustomTrajectoryIntegrator& move, OpenMM::SerializationNode& node) const {
        node.setDoubleProperty("stepSize", move.getStepSize());
        node.setIntProperty("stepsPerTrajectory", move.getStepsPerTrajectory());
    }
    CustomTrajectoryIntegrator* create(double temperature, const OpenMM::SerializationNode& node) const {
        return new CustomTrajectoryIntegrator(temperature, node.getDoubleProperty("stepSize"),
                                              node.getIntProperty("stepsPerTrajectory"));
    }
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CUSTOMTRAJECTORYINTEGRATOR_PROXY_H_*/
