#ifndef OPENMM_SHEARWAVEINTEGRATOR_H_
#define OPENMM_SHEARWAVEINTEGRATOR_H_

#include "MonteCarloIntegrator.h"
#include "internal/windowsExportHelfrich.h"
#include "openmm/Vec3.h"
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
 * probability min(1, exp(-dE/kT)) the sampling is exact.  A move costs one evaluation of the energy, and a
 * step makes several.  The wave number
 * |k| is uniform between two bounds, and the amplitude's standard deviation goes as 1/|k|, which gives all waves the
 * same strain.  The bounds must not follow the positions.
 *
 * A move whose energy is not finite is rejected.  Particles of mass 0 do not move.  Constraints and virtual sites are
 * not supported.
 */
class OPENMM_EXPORT_HELFRICH ShearWaveIntegrator : public MonteCarloIntegrator {
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
     * Get the number of moves attempted since the Context was created.
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
protected:
    void makeMove();
    void initialize(OpenMM::ContextImpl& context);
private:
    void makeMoves(double energy);
    /**
     * Make the moves of a long step, and leave everything as it was if it is interrupted.
     */
    void makeMovesOrRestore(double energy);
    void displace();
    double computeTrialEnergy();
    double amplitude, minWaveNumber, maxWaveNumber;
    int movesPerStep;
    long long &numAttempted = addCounter("numAttempted"), &numAccepted = addCounter("numAccepted"),
              &numDiverged = addCounter("numDiverged");
    double lastAcceptanceProbability = 0;
    std::vector<int> fixedParticles;
    std::vector<OpenMM::Vec3> positions, trialPositions;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_SHEARWAVEINTEGRATOR_H_*/
