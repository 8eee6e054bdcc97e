#ifndef OPENMM_CPUHALFEDGES_H_
#define OPENMM_CPUHALFEDGES_H_

#include "CpuRelaxed.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"

namespace HelfrichPlugin {

/**
 * Bring what a connectivity has of a halfedge's triangle, which may be on two lines, into the cache.
 */
inline void prefetchTriangle(const HalfedgeArrays& arrays, int h) {
    const HalfedgeArrays::Halfedge* first = &arrays.halfedges[h - unsigned(h) % 3];
    __builtin_prefetch(first);
    __builtin_prefetch(&first[2].oppositeApex);
}

/**
 * The connectivity of a mesh, in place, as several threads see it: they may look at it while one of them flips edges.
 * What they find at the vertices of a flip may be from before or after it, and not fit together; but every number is
 * that of a vertex or halfedge, and every search comes to an end.
 */
class CpuHalfedges : public HalfedgeConnectivity<RelaxedAccess, HalfedgeArrays&> {
public:
    explicit CpuHalfedges(HelfrichMesh& mesh) : HalfedgeConnectivity(mesh.getArrays()) {
    }
    void prefetch(int h) const {
        prefetchTriangle(arrays, h);
    }
    void prefetchVertex(int vertex) const {
        __builtin_prefetch(&arrays.vertices[vertex]);
    }
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHALFEDGES_H_*/
