#ifndef OPENMM_EDGEFLIPINTEGRATOR_H_
#define OPENMM_EDGEFLIPINTEGRATOR_H_

#include "internal/windowsExportHelfrich.h"
#include "openmm/Integrator.h"
#include <string>
#include <vector>

namespace HelfrichPlugin {

class HelfrichForceImpl;

/**
 * This Integrator changes the connectivity of the System's membranes and leaves the particles where they are.  One step
 * is one sweep of edge flips over each HelfrichForce of the System: a fraction of its number of edges of attempts, each
 * of which draws an edge uniformly, replaces it by the other diagonal of its two triangles, and accepts this with the
 * Metropolis probability min(1, exp(-dE/kT)).  An attempt is rejected by rule, whatever its energy, when it would
 * connect two vertices twice or leave a vertex with fewer than three neighbours, and when the edge is one that
 * HelfrichForce::addFixedEdge() marks.
 *
 * The random numbers come from a counter-based generator whose whole state is the seed and the number of sweeps made.
 * These and the live triangles are part of the checkpoint and of the State (as integrator parameters), so that a
 * simulation continued from either repeats exactly what an uninterrupted one does, and Context::reinitialize(true)
 * keeps the triangles.
 */
class OPENMM_EXPORT_HELFRICH EdgeFlipIntegrator : public OpenMM::Integrator {
public:
    /**
     * Create an EdgeFlipIntegrator.
     *
     * @param temperature  the temperature of the Metropolis test, in Kelvin; at 0 K only flips that do not raise the
     * energy are accepted
     * @param fraction     the number of attempts in a sweep, as a fraction of the number of edges
     */
    EdgeFlipIntegrator(double temperature, double fraction);
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
     * Get the number of attempts in a sweep, as a fraction of the number of edges.
     */
    double getFraction() const {
        return fraction;
    }
    /**
     * Set the number of attempts in a sweep, as a fraction of the number of edges.
     */
    void setFraction(double fraction);
    /**
     * Get the random number seed.  See setRandomNumberSeed() for details.
     */
    int getRandomNumberSeed() const {
        return randomNumberSeed;
    }
    /**
     * Set the random number seed.  Two simulations with the same seed make the same attempts, whatever the platform and
     * the number of threads.  If the seed is 0 (the default), a unique one is chosen when a Context is created.
     */
    void setRandomNumberSeed(int seed);
    /**
     * Get the number of flips attempted since the Context was created.
     */
    long long getNumAttempted() const {
        return numAttempted;
    }
    /**
     * Get the number of flips accepted since the Context was created.
     */
    long long getNumAccepted() const {
        return numAccepted;
    }
    /**
     * Get the number of attempts since the Context was created that were rejected by rule, because the flip would have
     * connected two vertices twice or left a vertex with fewer than three neighbours, or the edge is fixed.
     */
    long long getNumForbidden() const {
        return numForbidden;
    }
    /**
     * Get the number of sweeps made: with the seed, the whole state of the random number generator.
     */
    long long getNumSweeps() const {
        return numSweeps;
    }
    /**
     * Get the flip rate: the number of flips accepted per edge and sweep since the Context was created, or 0 before the
     * first sweep.  The edges are those of all membranes of the Context.
     */
    double getFlipRate() const;
    /**
     * Make sweeps of edge flips over every HelfrichForce of the System that is in the integration force groups.
     *
     * @param steps  the number of sweeps
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
    double temperature, fraction;
    int randomNumberSeed = 0;
    unsigned int activeSeed = 0;
    long long numSweeps = 0, numAttempted = 0, numAccepted = 0, numForbidden = 0;
    std::vector<HelfrichForceImpl*> membranes;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_EDGEFLIPINTEGRATOR_H_*/
