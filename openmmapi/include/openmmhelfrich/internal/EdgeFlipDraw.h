#ifndef OPENMM_HELFRICH_EDGEFLIPDRAW_H_
#define OPENMM_HELFRICH_EDGEFLIPDRAW_H_

#include "Philox.h"

namespace HelfrichPlugin {

/**
 * The random numbers of an attempt to flip an edge.
 */
struct EdgeFlipDraw {
    /// the edge, as one of its two directions: see HelfrichMesh::halfedgeOf()
    int directedEdge;
    /// the number to compare with the probability
    double uniform;
};

/**
 * Draw the random numbers of an attempt.
 *
 * @param random            the source of random numbers
 * @param sweep             the number of the sweep
 * @param attempt           the number of the attempt in the sweep
 * @param numDirectedEdges  how many there are to choose from
 */
inline EdgeFlipDraw drawEdgeFlip(const Philox& random, long long sweep, long long attempt, int numDirectedEdges) {
    auto words = random(sweep, attempt);
    return {int(Philox::index(words[0], words[1], numDirectedEdges)), Philox::uniform(words[2], words[3])};
}

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_EDGEFLIPDRAW_H_*/
