#ifndef OPENMM_CUSTOMTRAJECTORYINTEGRATOR_H_
#define OPENMM_CUSTOMTRAJECTORYINTEGRATOR_H_

#include "TrajectoryMove.h"
#include "internal/windowsExportHelfrich.h"
#include "openmm/CustomIntegrator.h"

namespace HelfrichPlugin {

/**
 * This Integrator is a HamiltonianTrajectoryIntegrator as a CustomIntegrator: one step is one trajectory of Hybrid
 * Monte Carlo with leapfrog steps.  It is slower, has no settings but the step size and the number of steps, and draws
 * its random numbers from OpenMM's own generator.
 *
 * A trajectory that diverges, so that an energy or a position is not finite any more, is rejected.
 *
 * Particles of mass 0 do not move.  Constraints and virtual sites are not supported.
 */
class OPENMM_EXPORT_HELFRICH CustomTrajectoryIntegrator : public OpenMM::CustomIntegrator, public TrajectoryMove {
public:
    /**
     * Create a CustomTrajectoryIntegrator.
     *
     * @param temperature         the temperature, in Kelvin
     * @param stepSize            the size of a leapfrog step, in ps
     * @param stepsPerTrajectory  the number of leapfrog steps in a trajectory
     */
    CustomTrajectoryIntegrator(double temperature, double stepSize, int stepsPerTrajectory = 100);
    /**
     * Get the temperature, in Kelvin.
     */
    double getTemperature() const;
    /**
     * Set the temperature, in Kelvin.
     */
    void setTemperature(double temperature);
    /**
     * Set the size of a leapfrog step, in ps.
     */
    void setStepSize(double size);
    /**
     * Get the number of leapfrog steps in a trajectory.
     */
    int getStepsPerTrajectory() const;
    /**
     * Set the number of leapfrog steps in a trajectory.
     */
    void setStepsPerTrajectory(int steps);
    /**
     * Get the random number seed.
     */
    int getRandomNumberSeed() const {
        return CustomIntegrator::getRandomNumberSeed();
    }
    /**
     * Set the random number seed.  If it is 0 (the default), a unique one is chosen when a Context is created.
     */
    void setRandomNumberSeed(int seed) {
        CustomIntegrator::setRandomNumberSeed(seed);
    }
    /**
     * Make trajectories.
     *
     * @param steps  the number of trajectories
     */
    void step(int steps);
protected:
    void initialize(OpenMM::ContextImpl& context);
    void createCheckpoint(std::ostream& stream) const;
    void loadCheckpoint(std::istream& stream);
    void serializeParameters(OpenMM::SerializationNode& node) const;
    void deserializeParameters(const OpenMM::SerializationNode& node);
private:
    void addSteps();
    void makeTrajectory();
    void abandonTrajectory();
    double temperature;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CUSTOMTRAJECTORYINTEGRATOR_H_*/
