#ifndef OPENMM_EDGEFLIPSWEEP_H_
#define OPENMM_EDGEFLIPSWEEP_H_

#include "EdgeFlipEvaluation.h"
#include "HelfrichMesh.h"
#include "HelfrichNeighborList.h"
#include "HelfrichParameters.h"
#include "openmm/Vec3.h"
#include <exception>
#include <functional>
#include <vector>

namespace HelfrichPlugin {

/**
 * The outcome of attempted edge flips.
 */
struct EdgeFlipStatistics {
    long long attempted = 0, accepted = 0, forbidden = 0;
};

/**
 * Metropolis sweeps of edge flips over a membrane whose vertices do not move.  The change of energy of a flip comes from the two triangles of the edge, the
 * four around them, and the totals of the surface.
 *
 * A sweep is by definition a sequential chain: attempt follows attempt.  It is computed in blocks, in three phases:
 *
 * - All attempts of a block are evaluated, by several threads and several to a vector, as if they were the first one.
 * - One thread decides them in their order, with the totals of the moment.  An attempt that has a vertex in common with a flip accepted earlier in the block is evaluated again
 *   at that time, and so is one whose repulsion depends on the neighbors of such a vertex; nothing else can have changed what was evaluated.
 * - The flips are carried out by the threads that evaluated them.  Those that wait for it have no vertex in common, so that their order does not matter, and the mesh is
 *   valid in between: before an attempt is evaluated again, the ones at its vertices are carried out.
 *
 * So the outcome is that of the sequential chain, to the last bit, for any number of threads and any size of blocks.
 */
class OPENMM_EXPORT_HELFRICH EdgeFlipSweep {
public:
    /**
     * This is called for each accepted flip, in their order, with the change of energy by which it was accepted.  The mesh has all of them after the sweep.
     */
    typedef std::function<void(double)> Observer;
    /**
     * Create an EdgeFlipSweep.
     *
     * @param mesh        the connectivity
     * @param numThreads  the number of threads
     */
    explicit EdgeFlipSweep(HelfrichMesh& mesh, int numThreads=1);
    /**
     * Set where the vertices are.  This must be called before a sweep if they have moved since the last one.
     *
     * @param positions  the position of each particle
     * @param geometry   the areas, volume and curvatures of the membrane at these positions
     * @param neighbors  the partners at these positions if needsNeighborList(), else NULL.  Sweeps divide them as the flipped mesh does
     */
    void setPositions(const std::vector<OpenMM::Vec3>& positions, const HelfrichGeometry& geometry, HelfrichNeighborList* neighbors);
    /**
     * Get whether a sweep needs to know which vertices are close to each other.
     */
    static bool needsNeighborList(const HelfrichParameters& parameters) {
        return parameters.repulsionModulus != 0 && parameters.repulsionExclusionLevel == 2;
    }
    /**
     * Make one sweep.
     *
     * @param parameters   the moduli and targets
     * @param kT           the temperature, measured in kJ/mol
     * @param numAttempts  the number of flips to attempt
     * @param random       the source of random numbers
     * @param sweep        the number of the sweep, which with that of the attempt is the counter of the random numbers
     * @param observer     called for each accepted flip, unless empty
     */
    EdgeFlipStatistics execute(const HelfrichParameters& parameters, double kT, long long numAttempts, const Philox& random, long long sweep,
                               const Observer& observer=Observer());
    /**
     * Get the area, volume and integrated mean curvature of the surface, as the flips since setPositions() have changed them.
     */
    const HelfrichTotals& getTotals() const {
        return totals;
    }
private:
    /**
     * The energy that holds a total to its target.
     */
    struct Penalty {
        double modulus, inverseTarget, deviation;
        double change(double difference) const;
    };
    void prepare(EdgeFlipBatch& batch, long long firstAttempt) const;
    void findTriangles(EdgeFlipBatch& batch) const;
    void findStencil(EdgeFlipBatch& batch, int n) const;
    void findForbidden(EdgeFlipBatch& batch, int first, int last) const;
    void evaluate(EdgeFlipBatch& batch, int first, int last) const;
    EdgeFlipAttempt& getAttempt(int index) {
        return batches[index/EdgeFlipBatch::SIZE].attempts[index%EdgeFlipBatch::SIZE];
    }
    void updatePenalties();
    void decideBlock(int numBatches);
    void decide(int index);
    bool isStale(const EdgeFlipAttempt& attempt) const;
    bool isPartnerFlipped(const EdgeFlipAttempt& attempt) const;
    void renew(EdgeFlipBatch& batch, int n);
    void accept(int index, double energy);
    void carryOut(EdgeFlipBatch& batch);
    void carryOut(const EdgeFlipBatch& batch, int n);
    bool carryOutAt(int vertex);
    struct ClosePairs;
    void findRepulsion(EdgeFlipBatch& batch, int first, int last) const;
    void addRepulsion(EdgeFlipBatch& batch, ClosePairs& pairs) const;
    bool shareOtherNeighbor(int middle, int vertex1, int vertex2) const;
    double distance2(int vertex1, int vertex2) const;
    void findClosePartners(int vertex);
    void setBonded(int vertex, int other);
    void setApart(int vertex, int other);
    int* partnersOf(int vertex) const {
        return neighbors->partners.data()+vertices[vertex].firstPartner;
    }
    double pairEnergy(int vertex1, int vertex2) const;
    HelfrichMesh& mesh;
    const EdgeFlipEvaluation& evaluation;
    int numThreads, batchSize;
    HelfrichParameters p;
    double kT;
    long long sweep;
    Philox random;
    const Observer* observer;
    std::exception_ptr exception;
    HelfrichTotals totals;
    Penalty areaPenalty, volumePenalty, areaDifferencePenalty;
    EdgeFlipStatistics statistics;
    std::vector<EdgeFlipVertex> vertices;
    /// of the partners apart from a vertex, the close ones come first in these lists, in ascending order
    HelfrichNeighborList* neighbors;
    std::vector<EdgeFlipBatch> batches;
    /// the attempts of the block that were accepted, and for each vertex the last one that flipped an edge at it, or NONE
    std::vector<int> flips, lastFlips;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_EDGEFLIPSWEEP_H_*/
