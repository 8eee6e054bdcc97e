#ifndef OPENMM_CPUHELFRICHNEIGHBORLIST_H_
#define OPENMM_CPUHELFRICHNEIGHBORLIST_H_

#include "CpuRelaxed.h"
#include <vector>

namespace HelfrichPlugin {

class HelfrichMesh;

/**
 * For each vertex its neighbors in space: all vertices that are closer to it than the repulsion's onset, and some
 * farther away.  Those apart from it come before those bonded to it.
 */
struct CpuHelfrichNeighborList {
    struct List {
        int start, numApart, numNeighbors;
    };
    std::vector<List> lists;
    std::vector<Relaxed<int>> neighbors;
    /// the revision of the mesh that tells who is bonded
    long long revision = -1;
    /// how often the neighbors were found anew
    long long numBuilds = 0;
    /**
     * Partition the neighbors into those apart and those bonded as a mesh is now, unless they are.
     */
    void partition(const HelfrichMesh& mesh);
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHNEIGHBORLIST_H_*/
