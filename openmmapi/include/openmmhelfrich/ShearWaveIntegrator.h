#ifndef OPENMM_SHEARWAVEINTEGRATOR_H_
#define OPENMM_SHEARWAVEINTEGRATOR_H_

#include "internal/windowsExportHelfrich.h"
#include "openmm/Integrator.h"
#include "openmm/Vec3.h"
#include <string>
#include <vector>

namespace HelfrichPlugin {

/**
 * This Integrator samples the positions of the particles at constant temperature by Monte Carlo moves that bend a whole
 * membrane at once: shear waves,
 *
 * x -> x + a d sin(k.x + phi)
 *
 * for every particle, with a wave vector k of random direction, a random unit vector d perpendicular to it, a uniform
 * phase phi, and an amplitude a from a normal distribution.  Such a wave deforms space without a change of volume,
 * since its Jacobian is 1, and the wave of amplitude -a takes it back, since k.x does not change: with the Metropolis
 * probability min(1, exp(-dE/kT)) the sampling is exact.  A move costs one evaluation of the energy.  The wave number
 * |k| is uniform between two bounds, and the amplitude's standard deviation goes as 1/|k|, which gives all waves the
 * same strain.  The bounds must not follow the positions.
 *
 * A move whose energy is not finite is rejected.  Particles of mass 0 do not move.  Constraints and virtual sites are
 * not supported.
 *
 * The random numbers come from a counter-based generator whose whole state is the seed and the number of moves made.
 * Both are part of the checkpoint and of the State (as integrator parameters), so that a simulation continued from
 * either repeats exactly what an uninterrupted one does.
 */
class OPENMM_EXPORT_HELFRICH ShearWaveIntegrator : public OpenMM::Integrator {
public:
    /**
     * Create a ShearWaveIntegrator.
     *
     * @param temperature    the temperature of the Metropolis test, in Kelvin
     * @param amplitude      the standard deviation of the amplitude of the longest waves, in nm
     * @param minWaveNumber  the wave number of the longest waves, in 1/nm: 1/R for a membrane of radius R
     * @param maxWaveNumber  the wave number of the shortest waves, in 1/nm
     * @param movesPerStep   the number of moves in a step
     */
    ShearWaveIntegrator(double temperature, double amplitude, double minWaveNumber, double maxWaveNumber,
                        int movesPerStep = 10);
    /**
     * Get the temperature of the Metropolis test, in Kelvin.
     */
    double getTemperature() const {
        return temperature;
    }
    /**
     * Set the temperature of the Metropolis test, in Kelvin.
     */
    void setTemperature(double temperature);
    /**
     * Get the standard deviation of the amplitude of the longest waves, in nm.
     */
    double getAmplitude() const {
        return amplitude;
    }
    /**
     * Set the standard deviation of the amplitude of the longest waves, in nm.  Waves of the wave number k have that
     * times minWaveNumber/k.
     */
    void setAmplitude(double amplitude);
    /**
     * Get the wave number of the longest waves, in 1/nm.
     */
    double getMinWaveNumber() const {
        return minWaveNumber;
    }
    /**
     * Get the wave number of the shortest waves, in 1/nm.
     */
    double getMaxWaveNumber() const {
        return maxWaveNumber;
    }
    /**
     * Set the bounds of the wave number, in 1/nm.
     */
    void setWaveNumbers(double minWaveNumber, double maxWaveNumber);
    /**
     * Get the number of moves in a step.
     */
    int getMovesPerStep() const {
        return movesPerStep;
    }
    /**
     * Set the number of moves in a step.
     */
    void setMovesPerStep(int moves);
    /**
     * Get the random number seed.  See setRandomNumberSeed() for details.
     */
    int getRandomNumberSeed() const {
        return randomNumberSeed;
    }
    /**
     * Set the random number seed.  Two simulations with the same seed draw the same waves, whatever the platform and
     * the number of threads.  If the seed is 0 (the default), a unique one is chosen when a Context is created.
     */
    void setRandomNumberSeed(int seed);
    /**
     * Get the number of moves attempted since the Context was created: with the seed, the whole state of the random
     * number generator.
     */
    long long getNumAttempted() const {
        return numAttempted;
    }
    /**
     * Get the number of moves accepted since the Context was created.
     */
    long long getNumAccepted() const {
        return numAccepted;
    }
    /**
     * Get the number of moves since the Context was created that were rejected because the energy was not finite.
     */
    long long getNumDiverged() const {
        return numDiverged;
    }
    /**
     * Get the mean acceptance probability of the moves of the last step, or 0 before the first.
     */
    double getLastAcceptanceProbability() const {
        return lastAcceptanceProbability;
    }
    /**
     * Make Monte Carlo moves.
     *
     * @param steps  the number of steps, each of so many moves as getMovesPerStep() says
     */
    void step(int steps);
protected:
    void initialize(OpenMM::ContextImpl& context);
    void cleanup();
    std::vector<std::string> getKernelNames();
    double computeKineticEnergy();
    bool kineticEnergyRequiresForce() const;
    void createCheckpoint(std::ostream& stream) const;
    void loadCheckpoint(std::istream& stream);
    void serializeParameters(OpenMM::SerializationNode& node) const;
    void deserializeParameters(const OpenMM::SerializationNode& node);
private:
    void makeMoves();
    void displace();
    double computeTrialEnergy();
    double temperature, amplitude, minWaveNumber, maxWaveNumber;
    int movesPerStep;
    int randomNumberSeed = 0;
    unsigned int activeSeed = 0;
    long long numAttempted = 0, numAccepted = 0, numDiverged = 0;
    double lastAcceptanceProbability = 0;
    bool hasOnlyMembranes = false;
    std::vector<int> fixedParticles;
    std::vector<OpenMM::Vec3> positions, trialPositions;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_SHEARWAVEINTEGRATOR_H_*/
