#ifndef OPENMM_HELFRICH_EDGEFLIPEVALUATION_H_
#define OPENMM_HELFRICH_EDGEFLIPEVALUATION_H_

#include "Philox.h"
#include <cstdint>

namespace HelfrichPlugin {

struct HelfrichParameters;

/**
 * What a sweep knows of a vertex, on a cache line of its own: who needs one of these numbers nearly always needs the others.
 */
struct alignas(64) EdgeFlipVertex {
    double x, y, z, area, curvature;
    /// the list of its partners, and how many of those apart are closer than the repulsion's onset
    int firstPartner, numClose;
    /// as the mesh has it, too: there it is in another line, which in large membranes is in no near cache
    int valence;
};

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
 * Consecutive attempts to flip an edge, side by side.  The flip replaces the edge i-j of the triangles (i, j, k) and (j, i, l) by k-l.  Vertices 0 to 3 are i, j, k and l; 4 to 7
 * are those beyond the edges j-k, k-i, i-l and l-j around them.
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
};

/**
 * The evaluation of attempts, compiled for one instruction set.  What is computed of an attempt does not depend on the others in a batch, to the last bit.
 */
struct EdgeFlipEvaluation {
    /// draw the random numbers of a batch's attempts, beginning with that of a given number
    void (*draw)(const Philox& random, long long sweep, long long firstAttempt, int numHalfedges, EdgeFlipBatch& batch);
    /// compute what the flips from the first up to the last would change, except for the repulsion; attempts beside them may be computed again as well
    void (*evaluate)(const HelfrichParameters& parameters, const EdgeFlipVertex* vertices, EdgeFlipBatch& batch, int first, int last);
};

/**
 * Get the evaluation for the processor's instruction set.
 */
const EdgeFlipEvaluation& getEdgeFlipEvaluation();

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_EDGEFLIPEVALUATION_H_*/
