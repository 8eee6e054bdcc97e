#ifndef OPENMM_CPUCHOSENVERTICES_H_
#define OPENMM_CPUCHOSENVERTICES_H_

#include "CpuHelfrichLayout.h"
#include "CpuHelfrichLoops.h"
#include "CpuVertexGeometry.h"
#include <vector>

namespace HelfrichPlugin {

/**
 * The geometry of some vertices, by the loop that computes that of all, and so to the same bits: it gets copies of
 * their rings, as the only group of a layout.
 */
class CpuChosenVertices {
public:
    /**
     * @param loops       the loops
     * @param parameters  those with which the loop finds the geometry of all
     * @param layout      where the vertices are
     * @param positions   the position of each slot
     */
    CpuChosenVertices(const CpuHelfrichForceLoops<double>& loops, const HelfrichParameters& parameters,
                      const CpuHelfrichLayout& layout, const double* positions);
    /**
     * Get some slots in an order in which those with rings of the same length are together.
     */
    static std::vector<int> sort(const CpuHelfrichLayout& layout, const std::vector<int>& slots);
    /**
     * Compute the geometry of some slots.
     */
    void compute(const int* slots, int count, CpuVertexGeometry& geometry);
private:
    int getOrigin(int slot) const;
    void computeGroup(const int* slots, int count, CpuVertexGeometry& geometry);
    void copyRing(int slot, int lane);
    void copyPosition(int slot, int copy);
    void makeRoom(int length);
    const CpuHelfrichForceLoops<double>& loops;
    const HelfrichParameters& p;
    const CpuHelfrichLayout& layout;
    const double* positions;
    /// the layout of the copies: the vertices, then their first neighbors and so on, and the origin of their surface
    CpuHelfrichLayout copies;
    CpuVertexGeometry ofCopies;
    CpuVertexGeometry::Array copiedPositions, bendingSlopes, anglesPerLength;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUCHOSENVERTICES_H_*/
