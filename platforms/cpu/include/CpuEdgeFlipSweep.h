#ifndef OPENMM_CPUEDGEFLIPSWEEP_H_
#define OPENMM_CPUEDGEFLIPSWEEP_H_

#include "CpuEdgeFlipState.h"
#include "CpuSweep.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include <atomic>
#include <exception>
#include <memory>
#include <vector>

namespace HelfrichPlugin {

/**
 * Metropolis sweeps of edge flips over a membrane whose vertices do not move.  The change of energy of a flip comes
 * from the two triangles of the edge, the four around them, and the totals of their surface.
 *
 * A sweep is by definition a sequential chain: attempt follows attempt.  It is computed as a pipeline of batches, in
 * two steps:
 *
 * - The attempts of a batch are evaluated, several to a vector, as if they were the next ones to be decided.
 * - One thread, the first, decides batch after batch, each attempt in its turn, with the totals of the moment, and
 * carries the flip out if it accepts it.  An attempt that has a vertex in common with a flip that its evaluation had
 * not seen is evaluated again at that time, and so is one whose repulsion depends on the bonded neighbors of such a
 * vertex; nothing else can have changed what was evaluated.
 *
 * Other threads evaluate batches ahead of the decisions, and none waits for the others but when the pipeline is full.
 * The first thread evaluates whenever the next batch to decide is not ready.
 *
 * Each of the others has a copy of the membrane, where it carries out flips as it hears of them, and no thread reads
 * what another one changes.  But a processor's cache has no room for copies of a large membrane.  There all threads
 * look at the same one, and what they evaluate may be wrong, for it may be from before and from after a flip that the
 * first thread carries out at that time.  Such an attempt is always evaluated again: whatever a flip changes
 * (triangles, what is opposite to their sides, lists of neighbors) belongs to one of its four vertices, and an
 * evaluation looks at what belongs to the attempt's vertices, or, if its repulsion depends on them, to their neighbors.
 * So both have a vertex in common, and the evaluation counts as not having seen the flip.
 *
 * So the outcome is that of the sequential chain, to the last bit, for any number of threads, whichever of them is
 * faster.
 */
class CpuEdgeFlipSweep : public CpuSweep {
public:
    /**
     * Create a CpuEdgeFlipSweep.
     *
     * @param mesh        the connectivity, with its fixed edges
     * @param numThreads  the number of threads
     * @param maxCopied   for at most so many vertices each thread has a copy of the membrane
     */
    explicit CpuEdgeFlipSweep(HelfrichMesh& mesh, int numThreads = 1, int maxCopied = MAX_COPIED);
    static constexpr int MAX_COPIED = 100000;
    /**
     * Set where the vertices are.  This must be called before a sweep if they have moved since the last one.
     *
     * @param positions  the position of each particle
     * @param geometry   the areas, volumes and curvatures of the membrane at these positions
     * @param neighborList  the neighbors at these positions if needsNeighborList(), else NULL.  Sweeps partition them
     * as the flipped mesh does
     */
    void setPositions(const std::vector<OpenMM::Vec3>& positions, const CpuVertexGeometry& geometry,
                      CpuHelfrichNeighborList* neighborList);
    /**
     * Get whether a sweep needs to know which vertices are close to each other.
     */
    static bool needsNeighborList(const HelfrichParameters& parameters) {
        return CpuEdgeFlipState::needsNeighborList(parameters);
    }
    /**
     * Make one sweep.
     *
     * @param parameters   the moduli and targets
     * @param kT           the temperature, measured in kJ/mol
     * @param numAttempts  the number of flips to attempt, at most SweepEdgeFlipsKernel::MAX_ATTEMPTS
     * @param random       the source of random numbers
     * @param sweep        the number of the sweep, which with that of the attempt is the counter of the random numbers
     * @param observer     called for each accepted flip, unless empty
     */
    EdgeFlipStatistics execute(const HelfrichParameters& parameters, double kT, long long numAttempts,
                               const Philox& random, long long sweep, const Observer& observer = Observer());
    /**
     * Get the area, volume and integrated mean curvature of each surface, as the flips since setPositions() have
     * changed them.
     */
    const std::vector<HelfrichTotals>& getTotals() const {
        return totals;
    }
private:
    /**
     * A place in the pipeline.
     */
    struct alignas(64) Place {
        CpuEdgeFlipBatch batch;
        /// the number of the first batch whose flips the evaluation has not seen
        int firstUnseen;
        /// the flips that seemed likely to be accepted when they were evaluated, a bit for each of their attempts, and
        /// those that are accepted
        CpuEdgeFlipList likelyFlips;
        uint64_t isLikely;
        CpuEdgeFlipList acceptedFlips;
        /// the number of the batch, as soon as it is evaluated
        std::atomic<int> evaluated;
    };
    /**
     * A copy of the membrane for a thread that evaluates ahead.  It stays up to date from sweep to sweep: copying a
     * mesh takes as long as many attempts.
     */
    struct alignas(64) Copy {
        explicit Copy(const HelfrichMesh& mesh) : mesh(mesh), state(this->mesh) {
            state.setNeighborList(&neighborList);
        }
        HelfrichMesh mesh;
        CpuHelfrichNeighborList neighborList;
        CpuEdgeFlipState state;
        /// the number of batches whose flips are carried out in its state, or NONE before its thread takes part in the
        /// sweep
        std::atomic<int> numSeen;
    };
    Place& getPlace(int batch) {
        return places[batch % places.size()];
    }
    void prepare(Copy& copy) const;
    void findCloseNeighbors();
    void decideAll();
    void help(Copy* copy);
    void carryOut(Copy& copy, int numDecided);
    void finish(Copy& copy);
    /**
     * Evaluate the next batch that no thread has begun with, unless the pipeline is full.
     *
     * @param numSeen   the number of batches whose flips are carried out in the state
     * @param upcoming  the batch that the thread has claimed beforehand, or NONE; it becomes that of the next time
     * @param isAhead   whether another thread than this one decides
     */
    bool evaluateNext(const CpuEdgeFlipState& state, int numSeen, int& upcoming, bool isAhead);
    /**
     * Get a batch for the thread that calls this to evaluate, with its random numbers drawn; or NONE.
     */
    int claimNext();
    /**
     * Get whether no thread needs the batch any more that had a batch's place before.
     */
    bool hasPlace(int batch);
    void decide(int batch);
    static void collectLikelyFlips(Place& place, bool isAhead);
    void decide(Place& place, int batch, int n);
    static CpuEdgeFlip getFlip(const Place& place, int n);
    void accept(Place& place, int batch, const CpuEdgeFlipAttempt& attempt, const CpuEdgeFlip& flip, double energy);
    bool isStale(const CpuEdgeFlipAttempt& attempt, int firstUnseen) const;
    bool isCloseNeighborFlipped(const CpuEdgeFlipAttempt& attempt, int firstUnseen) const;
    const CpuEdgeFlipEvaluation& evaluation;
    int batchSize, numBatches;
    const Observer* observer;
    /// what ended the sweep early, and whether something did
    std::exception_ptr exception;
    std::atomic<bool> isAbandoned;
    std::vector<HelfrichTotals> totals;
    /// the vertices of accepted flips
    std::vector<int> flippedVertices;
    /// what the energy would change by with the totals of each surface
    std::vector<ChangeByTotals> changes;
    EdgeFlipStatistics statistics;
    CpuHelfrichNeighborList* neighborList;
    CpuEdgeFlipState state;
    std::vector<Place> places;
    /// the evaluation of an attempt once more: in the batch it would take longer, for that may be in another thread's
    /// cache
    CpuEdgeFlipBatch renewed;
    std::vector<std::unique_ptr<Copy>> copies;
    /// the number of batches that some thread evaluates or has evaluated, and of those that are decided; on cache lines
    /// of their own, for all threads look at them often
    alignas(64) std::atomic<int> numClaimed;
    alignas(64) std::atomic<int> numDecided;
    /// for each vertex the last batch that flipped an edge at it, or NONE
    alignas(64) std::vector<int> lastFlips;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUEDGEFLIPSWEEP_H_*/
