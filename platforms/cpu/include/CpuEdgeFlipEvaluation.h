#ifndef OPENMM_CPUEDGEFLIPEVALUATION_H_
#define OPENMM_CPUEDGEFLIPEVALUATION_H_

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
struct alignas(64) CpuEdgeFlipVertex {
    // The first 32 bytes are loaded at once, and so must not change during a sweep.

    double x, y, z;
    /// where the list of its neighbors begins
    int firstNeighbor;
    /// the number of its surface
    int surface;
    Relaxed<double> area, curvature;
    /// how many of its neighbors apart are closer than the repulsion's onset
    Relaxed<int> numClose;
    /// as the mesh has it, too: there it is in another line, which in large membranes is in no near cache
    Relaxed<int> valence;
    int species;
};

static_assert(offsetof(CpuEdgeFlipVertex, area) == 32, "what a sweep changes must not be loaded with the positions");

/**
 * What the decision on an attempt needs, on a cache line of its own.
 */
struct alignas(64) CpuEdgeFlipAttempt {
    /// the change of energy but for the penalties on the totals, and what a change above 0 must be less than
    double energy, threshold;
    /// the changes of the totals, and the number of the surface whose they are
    double area, volume, curvature;
    int surface;
    int vertex[4];
    /// true if the rules do not allow the flip
    bool isForbidden;
    /// true if the repulsion depends on the bonded neighbors of the vertices that those of the flip are close to
    bool dependsOnCloseNeighbors;
};

/**
 * What a flip changes, as far as it does not follow from the connectivity: its halfedge i-j, the vertices i, j, k and
 * l, and the changes at these.
 */
struct CpuEdgeFlip {
    int halfedge, vertex[4];
    double area[4], curvature[4];
};

/**
 * Consecutive attempts to flip an edge, side by side.  The flip replaces the edge i-j of the triangles (i, j, k) and
 * (j, i, l) by k-l.  Vertices 0 to 3 are i, j, k and l; 4 to 7 are those beyond the edges j-k, k-i, i-l and l-j around
 * them.
 */
struct alignas(64) CpuEdgeFlipBatch {
    static constexpr int SIZE = 64;
    CpuEdgeFlipAttempt attempts[SIZE];
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
    CpuEdgeFlip getFlip(int n) const {
        CpuEdgeFlip flip;
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
struct CpuEdgeFlipList {
    CpuEdgeFlip flips[CpuEdgeFlipBatch::SIZE];
    int count;
    void add(const CpuEdgeFlip& flip) {
        flips[count++] = flip;
    }
    const CpuEdgeFlip* begin() const {
        return flips;
    }
    const CpuEdgeFlip* end() const {
        return flips + count;
    }
};

/**
 * The evaluation of attempts, compiled for one instruction set.  What is computed of an attempt does not depend on the
 * others in a batch, to the last bit.
 */
struct CpuEdgeFlipEvaluation {
    /// draw the random numbers of a batch's attempts, beginning with that of a given number
    void (*draw)(const Philox& random, long long sweep, long long firstAttempt, int numDirectedEdges,
                 CpuEdgeFlipBatch& batch);
    /// compute what the flips from the first up to the last would change, except for the repulsion; attempts beside
    /// them may be computed again as well
    void (*evaluate)(const HelfrichParameters& parameters, const CpuEdgeFlipVertex* vertices, CpuEdgeFlipBatch& batch,
                     int first, int last);
};

/**
 * The same in a periodic box.
 */
struct CpuPeriodicEdgeFlipEvaluation : CpuEdgeFlipEvaluation {};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUEDGEFLIPEVALUATION_H_*/
