#ifndef OPENMM_EDGEFLIPINTEGRATOR_H_
#define OPENMM_EDGEFLIPINTEGRATOR_H_

#include "MonteCarloIntegrator.h"
#include "internal/windowsExportHelfrich.h"

namespace HelfrichPlugin {

class HelfrichMesh;
struct EdgeFlipStatistics;

/**
 * This Integrator changes the connectivity of the System's membranes and leaves the particles where they are.  One step
 * is one sweep of edge flips over each HelfrichForce of the System: a fraction of its number of edges of attempts, each
 * of which draws an edge uniformly, replaces it by the other diagonal of its two triangles, and accepts this with the
 * Metropolis probability min(1, exp(-dE/kT)).  An attempt is rejected by rule, whatever its energy, when it would
 * connect two vertices twice or leave a vertex with fewer than three neighbors, and when the edge is one that
 * HelfrichForce::addFixedEdge() marks.
 */
class OPENMM_EXPORT_HELFRICH EdgeFlipIntegrator : public MonteCarloIntegrator {
public:
    /**
     * Create an EdgeFlipIntegrator.
     *
     * @param temperature  the temperature of the Metropolis test, in Kelvin; at 0 K only flips that do not raise the
     * energy are accepted
     * @param fraction     the number of attempts in a sweep, as a fraction of the number of edges; unless it is 0, a
     * sweep has at least one
     */
    EdgeFlipIntegrator(double temperature, double fraction);
    /**
     * Get the number of attempts in a sweep, as a fraction of the number of edges.
     */
    double getFraction() const {
        return fraction;
    }
    /**
     * Set the number of attempts in a sweep, as a fraction of the number of edges.  Unless it is 0, a sweep has at
     * least one.
     */
    void setFraction(double fraction);
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
     * connected two vertices twice or left a vertex with fewer than three neighbors, or the edge is fixed.
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
protected:
    std::vector<std::string> getKernelNames();
    void makeMove();
    void initialize(OpenMM::ContextImpl& context);
private:
    friend class HybridMonteCarloIntegrator;
    /**
     * Throw an OpenMMException if a sweep has attempts and a HelfrichForce of the Context is inside another Force, such
     * as a CustomCVForce: that one would keep the triangles that it began with.
     */
    void requireLiveMembranes() const;
    long long getNumAttempts(const HelfrichMesh& mesh) const;
    EdgeFlipStatistics sweep();
    /**
     * Make a long sweep, and leave the triangles as they were if it is interrupted.
     */
    EdgeFlipStatistics sweepOrRestore();
    double fraction;
    bool hasHiddenMembranes = false;
    long long &numSweeps = addCounter("numSweeps"), &numAttempted = addCounter("numAttempted"),
              &numAccepted = addCounter("numAccepted"), &numForbidden = addCounter("numForbidden");
};

} // namespace HelfrichPlugin

#endif /*OPENMM_EDGEFLIPINTEGRATOR_H_*/
