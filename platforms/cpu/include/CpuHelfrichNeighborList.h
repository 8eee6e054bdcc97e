#ifndef OPENMM_HELFRICHNEIGHBORLIST_H_
#define OPENMM_HELFRICHNEIGHBORLIST_H_

#include "CpuRelaxed.h"
#include "openmm/Vec3.h"
#include <vector>

namespace HelfrichPlugin {

class HelfrichMesh;

/**
 * For each vertex its partners: all vertices that are closer to it than the repulsion's onset, and some farther away.
 * Those apart from it come before those bonded to it.
 */
struct HelfrichNeighborList {
    struct List {
        int start, numApart, numPartners;
    };
    std::vector<List> lists;
    std::vector<Relaxed<int>> partners;
    /// the revision of the mesh that tells who is bonded
    long long revision = -1;
    /// how often the partners were found anew
    long long numBuilds = 0;
    /**
     * Find the partners of all vertices: those that are closer than a cutoff.
     *
     * @param positions  the position of each vertex
     */
    void build(const std::vector<OpenMM::Vec3>& positions, double cutoff);
    /**
     * Divide the partners into those apart and those bonded as a mesh is now, unless they are.
     */
    void divide(const HelfrichMesh& mesh);
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHNEIGHBORLIST_H_*/
