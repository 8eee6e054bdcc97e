#ifndef OPENMM_HYBRIDMONTECARLOINTEGRATOR_H_
#define OPENMM_HYBRIDMONTECARLOINTEGRATOR_H_

#include "EdgeFlipIntegrator.h"
#include "MonteCarloMove.h"
#include "internal/windowsExportHelfrich.h"
#include "openmm/CompoundIntegrator.h"
#include <string>
#include <vector>

namespace HelfrichPlugin {

/**
 * This Integrator samples a System with fluid membranes at constant temperature.  Each step is one Monte Carlo step: at
 * random, with given probabilities, one of several moves.
 *
 * It is a CompoundIntegrator, and its moves are Integrators.  The first makes the trajectories of the particles: a
 * HamiltonianTrajectoryIntegrator, or the same algorithm as a CustomTrajectoryIntegrator.  Any other Integrator can
 * take its place: with a LangevinMiddleIntegrator, for instance, steps of dynamics alternate with sweeps.  The second,
 * in most cases, is an EdgeFlipIntegrator, and addMove() adds more.  The first move has the probability that the others
 * leave.
 *
 * Which move a step is follows from the seed and the Context's step count alone, so that a restarted simulation makes
 * the same choices.
 */
class OPENMM_EXPORT_HELFRICH HybridMonteCarloIntegrator : public OpenMM::CompoundIntegrator, public SeededMove {
public:
    /**
     * Create a HybridMonteCarloIntegrator.
     *
     * @param temperature         the temperature of trajectories and flips, in Kelvin
     * @param stepSize            the size of a leapfrog step, in ps
     * @param stepsPerTrajectory  the number of leapfrog steps in a trajectory
     * @param flipFraction        the number of attempts in a sweep, as a fraction of the number of edges
     * @param flipProbability     the probability that a step is a sweep of flips and not a trajectory
     * @param engine              "native" for a HamiltonianTrajectoryIntegrator, "custom" for a
     * CustomTrajectoryIntegrator
     */
    HybridMonteCarloIntegrator(double temperature, double stepSize, int stepsPerTrajectory = 100,
                               double flipFraction = 0.3, double flipProbability = 0.5,
                               const std::string& engine = "native");
    /**
     * Create a HybridMonteCarloIntegrator whose trajectories another Integrator makes.
     *
     * @param trajectory       the Integrator that makes the trajectories; this object takes over its ownership
     * @param flips            the Integrator that flips edges; this object takes over its ownership.  NULL for none.
     * @param flipProbability  the probability that a step is a sweep of flips and not one of the other Integrator
     */
    explicit HybridMonteCarloIntegrator(OpenMM::Integrator* trajectory, EdgeFlipIntegrator* flips = NULL,
                                        double flipProbability = 0.5);
    /**
     * Add a move.  All must be added before the Context is created.
     *
     * @param move         the Integrator of which a step is the move; this object takes over its ownership
     * @param probability  the probability that a step is this move; with those of all moves but the first it must not
     * add up to more than 1
     * @return the index of the move that was added
     */
    int addMove(OpenMM::Integrator* move, double probability);
    /**
     * Get the number of moves.
     */
    int getNumMoves() const {
        return probabilities.size();
    }
    /**
     * Get a move.
     *
     * @param index  the index of the move, 0 for the first
     */
    OpenMM::Integrator& getMove(int index);
    /**
     * Get a move.
     *
     * @param index  the index of the move, 0 for the first
     */
    const OpenMM::Integrator& getMove(int index) const;
    /**
     * Get the probability that a step is a given move.
     *
     * @param index  the index of the move, 0 for the first, which has what the others leave
     */
    double getMoveProbability(int index) const;
    /**
     * Set the probability that a step is a given move.
     *
     * @param index        the index of the move, which cannot be 0: the first has what the others leave
     * @param probability  the probability; with those of the others but the first it must not add up to more than 1
     */
    void setMoveProbability(int index, double probability);
    /**
     * Get the temperature, in Kelvin: that of the first move that has one.
     */
    double getTemperature() const;
    /**
     * Set the temperature of all moves, in Kelvin.  Integrators of other kinds than those of this library keep theirs.
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
     * Get the probability that a step is a sweep of flips: 0 if there is no Integrator for them.
     */
    double getFlipProbability() const;
    /**
     * Set the probability that a step is a sweep of flips.
     */
    void setFlipProbability(double probability);
    /**
     * Get the fraction of attempted flips that were accepted, or 0 if there was none.
     */
    double getFlipAcceptanceRate() const;
    /**
     * Get the Integrator that flips edges: the first of those that do.
     */
    const EdgeFlipIntegrator& getFlipIntegrator() const;
    /**
     * Set the random number seed of the choice of moves and of the moves.  If it is 0 (the default), a unique seed is
     * chosen when a Context is created.  Of moves of the same kind, and of mixtures in this one, each has another seed,
     * which follows from this one.
     */
    void setRandomNumberSeed(int seed) {
        setRandomNumberSeed(seed, true);
    }
    /**
     * Set the random number seed of the choice of moves, and of the moves if that is wanted.
     *
     * @param seed                the seed
     * @param alsoForIntegrators  whether to set the seeds of the moves too
     */
    void setRandomNumberSeed(int seed, bool alsoForIntegrators);
    /**
     * Get the number of trajectories, which are steps of the first move, made since the Context was created.
     */
    long long getNumAttempted() const;
    /**
     * Get the number of trajectories, which are steps of the first move, accepted since the Context was created.  An
     * Integrator of another kind than those of this library accepts every step.
     */
    long long getNumAccepted() const;
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
    void add(OpenMM::Integrator* move, double probability, const std::string& item);
    void checkProbability(int index, double probability, const std::string& item) const;
    void checkIndex(int index) const;
    int chooseMove() const;
    const MonteCarloMove* findMonteCarloMove(int index) const;
    int findFlips() const;
    int requireFlips() const;
    void loadIntegrators(std::istream& stream);
    // Of version 0.1.0, which had the counters of a CustomTrajectoryIntegrator here.
    void loadFirstCheckpoint(std::istream& stream);
    void setFirstCounters(long long numAccepted, long long numDiverged);
    /// of each move; that of the first is not used
    std::vector<double> probabilities;
    /// of the first move, which may be an Integrator that does not count
    long long& numTrajectories = addCounter("numTrajectories");
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HYBRIDMONTECARLOINTEGRATOR_H_*/
