#ifndef OPENMM_HYBRIDMONTECARLOINTEGRATOR_H_
#define OPENMM_HYBRIDMONTECARLOINTEGRATOR_H_

#include "EdgeFlipIntegrator.h"
#include "HamiltonianTrajectoryIntegrator.h"
#include "ShearWaveIntegrator.h"
#include "internal/windowsExportHelfrich.h"
#include "openmm/CompoundIntegrator.h"
#include "openmm/CustomIntegrator.h"

namespace HelfrichPlugin {

/**
 * This Integrator samples a System with fluid membranes at constant temperature.  Each step is one Monte Carlo step: at
 * random, with a given probability, a sweep of edge flips, shear waves if there is an Integrator for them, and
 * otherwise a Hybrid Monte Carlo trajectory of the particles.
 *
 * It is a CompoundIntegrator: number 0 makes the trajectories, number 1 is an EdgeFlipIntegrator, and number 2, which
 * addShearWaves() adds, a ShearWaveIntegrator.  Number 0 is a HamiltonianTrajectoryIntegrator, or the same algorithm as
 * a CustomIntegrator, which is slower and draws its random numbers from OpenMM's own generator.  Any other Integrator
 * can take its place: with a LangevinMiddleIntegrator, for instance, steps of dynamics alternate with sweeps.
 *
 * A trajectory that diverges, so that an energy or a position is not finite any more, is a rejected move.
 *
 * Which kind a step is follows from the seed and the Context's step count alone, so that a restarted simulation makes
 * the same choices.
 */
class OPENMM_EXPORT_HELFRICH HybridMonteCarloIntegrator : public OpenMM::CompoundIntegrator {
public:
    /**
     * Create a HybridMonteCarloIntegrator.
     *
     * @param temperature         the temperature of trajectories and flips, in Kelvin
     * @param stepSize            the size of a leapfrog step, in ps
     * @param stepsPerTrajectory  the number of leapfrog steps in a trajectory
     * @param flipFraction        the number of attempts in a sweep, as a fraction of the number of edges
     * @param flipProbability     the probability that a step is a sweep of flips and not a trajectory
     * @param engine              "native" for a HamiltonianTrajectoryIntegrator, "custom" for a CustomIntegrator
     */
    HybridMonteCarloIntegrator(double temperature, double stepSize, int stepsPerTrajectory = 100,
                               double flipFraction = 0.1, double flipProbability = 0.5,
                               const std::string& engine = "native");
    /**
     * Create a HybridMonteCarloIntegrator whose trajectories another Integrator makes.
     *
     * @param trajectory       the Integrator that makes the trajectories; this object takes over its ownership
     * @param flips            the Integrator that flips edges; this object takes over its ownership
     * @param flipProbability  the probability that a step is a sweep of flips and not one of the other Integrator
     */
    HybridMonteCarloIntegrator(OpenMM::Integrator* trajectory, EdgeFlipIntegrator* flips, double flipProbability = 0.5);
    /**
     * Add an Integrator that makes shear waves.  There is none at first, and there can be one.
     *
     * @param shearWaves   the Integrator; this object takes over its ownership
     * @param probability  the probability that a step is one of shear waves; with that of a sweep of flips it must not
     * add up to more than 1
     */
    void addShearWaves(ShearWaveIntegrator* shearWaves, double probability);
    /**
     * Get the temperature, in Kelvin.
     */
    double getTemperature() const;
    /**
     * Set the temperature of all moves, in Kelvin.  If number 0 is an Integrator of another kind than this class
     * creates, its temperature stays as it is.
     */
    void setTemperature(double temperature);
    /**
     * Get the size of a leapfrog step, in ps.
     */
    double getStepSize() const;
    /**
     * Set the size of a leapfrog step, in ps.
     */
    void setStepSize(double size);
    /**
     * Get the number of leapfrog steps in a trajectory, or 1 if number 0 is an Integrator of another kind than this
     * class creates.
     */
    int getStepsPerTrajectory() const;
    /**
     * Set the number of leapfrog steps in a trajectory.
     */
    void setStepsPerTrajectory(int steps);
    /**
     * Get the precision in which trajectories compute forces.
     */
    std::string getForcePrecision() const;
    /**
     * Set the precision in which trajectories compute forces: "double" or "mixed".  See
     * HamiltonianTrajectoryIntegrator::setForcePrecision() for details; "mixed" requires that number 0 is of that
     * class.
     */
    void setForcePrecision(const std::string& precision);
    /**
     * Get the largest fraction by which the number of steps in a trajectory varies at random.
     */
    double getTrajectoryJitter() const;
    /**
     * Set the largest fraction by which the number of steps in a trajectory varies at random.  See
     * HamiltonianTrajectoryIntegrator::setTrajectoryJitter(); number 0 must be of that class if it is not 0.
     */
    void setTrajectoryJitter(double jitter);
    /**
     * Get the name of the splitting that trajectories follow.
     */
    std::string getSplitting() const;
    /**
     * Set the splitting that trajectories follow: "leapfrog", "bcss2" or "bcss3".  See
     * HamiltonianTrajectoryIntegrator::setSplitting(); number 0 must be of that class if it is not "leapfrog".
     */
    void setSplitting(const std::string& splitting);
    /**
     * Get how often the tether acts in a trajectory for each time that everything else does.
     */
    int getTetherSubsteps() const;
    /**
     * Set how often the tether acts in a trajectory for each time that everything else does.  See
     * HamiltonianTrajectoryIntegrator::setTetherSubsteps(); number 0 must be of that class if it is not 1.
     */
    void setTetherSubsteps(int substeps);
    /**
     * Get how much of the velocities a trajectory draws anew.
     */
    double getMomentumRefreshment() const;
    /**
     * Set how much of the velocities a trajectory draws anew.  See
     * HamiltonianTrajectoryIntegrator::setMomentumRefreshment(); number 0 must be of that class if it is not 1.
     */
    void setMomentumRefreshment(double refreshment);
    /**
     * Get the number of attempts in a sweep, as a fraction of the number of edges.
     */
    double getFlipFraction() const;
    /**
     * Set the number of attempts in a sweep, as a fraction of the number of edges.
     */
    void setFlipFraction(double fraction);
    /**
     * Get the probability that a step is a sweep of flips.
     */
    double getFlipProbability() const {
        return flipProbability;
    }
    /**
     * Set the probability that a step is a sweep of flips.
     */
    void setFlipProbability(double probability);
    /**
     * Get the probability that a step is one of shear waves: 0 if there is no Integrator for them.
     */
    double getShearWaveProbability() const {
        return shearWaveProbability;
    }
    /**
     * Set the probability that a step is one of shear waves.  With that of a sweep of flips it must not add up to more
     * than 1.
     */
    void setShearWaveProbability(double probability);
    /**
     * Get the random number seed.  See setRandomNumberSeed() for details.
     */
    int getRandomNumberSeed() const {
        return randomNumberSeed;
    }
    /**
     * Set the random number seed of the choice of moves and of the moves.  If it is 0 (the default), a unique seed is
     * chosen when a Context is created.
     *
     * @param seed                the seed
     * @param alsoForIntegrators  whether to set the seeds of the Integrators too
     */
    void setRandomNumberSeed(int seed, bool alsoForIntegrators = true);
    /**
     * Get the number of trajectories made since the Context was created.
     */
    long long getNumTrajectories() const;
    /**
     * Get the number of trajectories accepted since the Context was created.
     */
    long long getNumAcceptedTrajectories() const;
    /**
     * Get the number of trajectories since the Context was created that diverged, and were rejected.
     */
    long long getNumDivergedTrajectories() const;
    /**
     * Get the fraction of trajectories that were accepted, or 0 if there was none.  An Integrator of another kind than
     * this class creates accepts every step.
     */
    double getAcceptanceRate() const;
    /**
     * Get the fraction of attempted flips that were accepted, or 0 if there was none.
     */
    double getFlipAcceptanceRate() const;
    /**
     * Get the flip rate: the number of flips accepted per edge and sweep, or 0 before the first sweep.  See
     * EdgeFlipIntegrator::getFlipRate().
     */
    double getFlipRate() const;
    /**
     * Get the fraction of shear waves that were accepted, or 0 if there was none.
     */
    double getShearWaveAcceptanceRate() const;
    /**
     * Get the Integrator that flips edges.
     */
    const EdgeFlipIntegrator& getFlipIntegrator() const;
    /**
     * Get the Integrator that makes shear waves.
     */
    const ShearWaveIntegrator& getShearWaveIntegrator() const;
    /**
     * Make Monte Carlo steps.
     *
     * @param steps  the number of Monte Carlo steps
     */
    void step(int steps);
protected:
    void initialize(OpenMM::ContextImpl& context);
    void createCheckpoint(std::ostream& stream) const;
    void loadCheckpoint(std::istream& stream);
    void serializeParameters(OpenMM::SerializationNode& node) const;
    void deserializeParameters(const OpenMM::SerializationNode& node);
private:
    EdgeFlipIntegrator& getFlips();
    HamiltonianTrajectoryIntegrator* getNative() const;
    OpenMM::CustomIntegrator* getCustom() const;
    const ShearWaveIntegrator* findShearWaves() const;
    ShearWaveIntegrator& getShearWaves();
    void checkProbabilities(double flipProbability, double shearWaveProbability) const;
    void makeTrajectory();
    void abandonTrajectory(OpenMM::CustomIntegrator& custom);
    double flipProbability = 0, shearWaveProbability = 0;
    int randomNumberSeed = 0;
    unsigned int activeSeed = 0;
    long long numTrajectories = 0, numAccepted = 0, numDiverged = 0;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HYBRIDMONTECARLOINTEGRATOR_H_*/
