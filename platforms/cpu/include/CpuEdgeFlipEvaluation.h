#ifndef OPENMM_HELFRICH_EDGEFLIPEVALUATION_H_
#define OPENMM_HELFRICH_EDGEFLIPEVALUATION_H_

#include "openmmhelfrich/internal/Philox.h"
#include "CpuRelaxed.h"
#include <cstddef>
#include <cstdint>

namespace HelfrichPlugin {

struct HelfrichParameters;

/**
 * What a sweep knows of a vertex, on a cache line of its own: who needs one of these numbers nearly always needs the
 * others.
 */
struct alignas(64) EdgeFlipVertex {
    // The first 32 bytes are loaded at once, and so must not change during a sweep.

    double x, y, z;
    /// where the list of its partners begins
    int firstPartner;
    Relaxed<double> area, curvature;
    /// how many of its partners apart are closer than the repulsion's onset
    Relaxed<int> numClose;
    /// as the mesh has it, too: there it is in another line, which in large membranes is in no near cache
    Relaxed<int> valence;
};

static_assert(offsetof(EdgeFlipVertex, area) == 32, "what a sweep changes must not be loaded with the positions");

/**
 * What the decision on an attempt needs, on a cache line of its own.
 */
struct alignas(64) EdgeFlipAttempt {
    /// the change of energy but for the penalties on the totals, and what a change above 0 must be less than
    double energy, threshold;
    /// the changes of the totals
    double area, volume, curvature;
    int vertex[4];
    /// true if the rules do not allow the flip
    bool isForbidden;
    /// true if the repulsion depends on the neighbors of the vertices that those of the flip are close to
    bool dependsOnPartners;
};

/**
 * What a flip changes, as far as it does not follow from the connectivity: its halfedge i-j, the vertices i, j, k and
 * l, and the changes at these.
 */
struct EdgeFlip {
    int halfedge, vertex[4];
    double area[4], curvature[4];
};

/**
 * Consecutive attempts to flip an edge, side by side.  The flip replaces the edge i-j of the triangles (i, j, k) and
 * (j, i, l) by k-l.  Vertices 0 to 3 are i, j, k and l; 4 to 7 are those beyond the edges j-k, k-i, i-l and l-j around
 * them.
 */
struct alignas(64) EdgeFlipBatch {
    static constexpr int SIZE = 64;
    EdgeFlipAttempt attempts[SIZE];
    /// the random number to compare with the probability
    double uniform[SIZE];
    /// the change of energy by bending and tether
    double energy[SIZE];
    /// the changes of the totals
    double area[SIZE], volume[SIZE], curvature[SIZE];
    /// the halfedge i-j
    int halfedge[SIZE];
    int vertex[8][SIZE];
    /// the changes at vertices 0 to 3
    double vertexArea[4][SIZE], vertexCurvature[4][SIZE];
    int numAttempts;
    EdgeFlip getFlip(int n) const {
        EdgeFlip flip;
        flip.halfedge = halfedge[n];
        for (int i = 0; i < 4; i++) {
            flip.vertex[i] = vertex[i][n];
            flip.area[i] = vertexArea[i][n];
            flip.curvature[i] = vertexCurvature[i][n];
        }
        return flip;
    }
};

/**
 * Some flips of a batch, one after the other.
 */
struct EdgeFlipList {
    EdgeFlip flips[EdgeFlipBatch::SIZE];
    int count;
    void add(const EdgeFlip& flip) {
        flips[count++] = flip;
    }
    const EdgeFlip* begin() const {
        return flips;
    }
    const EdgeFlip* end() const {
        return flips + count;
    }
};

/**
 * The evaluation of attempts, compiled for one instruction set.  What is computed of an attempt does not depend on the
 * others in a batch, to the last bit.
 */
struct EdgeFlipEvaluation {
    /// draw the random numbers of a batch's attempts, beginning with that of a given number
    void (*draw)(const Philox& random, long long sweep, long long firstAttempt, int numDirectedEdges,
                 EdgeFlipBatch& batch);
    /// compute what the flips from the first up to the last would change, except for the repulsion; attempts beside
    /// them may be computed again as well
    void (*evaluate)(const HelfrichParameters& parameters, const EdgeFlipVertex* vertices, EdgeFlipBatch& batch,
                     int first, int last);
};

/**
 * Get the evaluation for the processor's instruction set.
 */
const EdgeFlipEvaluation& getEdgeFlipEvaluation();

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_EDGEFLIPEVALUATION_H_*/
