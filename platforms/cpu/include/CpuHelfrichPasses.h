#ifndef OPENMM_CPUHELFRICHPASSES_H_
#define OPENMM_CPUHELFRICHPASSES_H_

#include "openmmhelfrich/internal/HelfrichParameters.h"

namespace HelfrichPlugin {

class CpuHelfrichLayout;

/**
 * The arrays that the passes over a membrane share.  Arrays of slots have an element a vertex, arrays of corners one for each neighbor of each vertex, in the order of
 * CpuHelfrichLayout.
 */
struct CpuHelfrichArrays {
    double* positions;              ///< of each slot: x, y, z, unused
    double* bendingSlopes;          ///< of each slot: 4 kappa_B M/A
    double* areas;                  ///< of each slot, or NULL if nobody wants them
    double* curvatures;             ///< of each slot, or NULL
    double* anglesPerLength;        ///< of each corner: the dihedral angle of the edge over its length
};

/**
 * Sums over some of the vertices.
 */
struct CpuHelfrichSums : HelfrichTotals {
    double bending = 0, tether = 0, repulsion = 0;
    /// of the components of the forces, which is finite if they are
    double force = 0;
    /// not 0 where the repulsion's list of pairs is
    double outdated = 0;
};

/**
 * The passes over the groups of a layout, compiled for one instruction set.
 */
struct CpuHelfrichPasses {
    /// the number of vertices in a group
    int width;
    /// compute energies, what of areas, volumes and curvatures they need, all of those if the areas are wanted, and what the second pass needs; the sum of the areas is finite
    /// if the positions are
    void (*computeEnergy)(const CpuHelfrichLayout& layout, const HelfrichParameters& parameters, const CpuHelfrichArrays& arrays, int firstGroup, int lastGroup,
                          CpuHelfrichSums& sums);
    /// compute the gradient (x, y, z, unused) of all terms but the repulsion by the position of each slot of the groups; slopes are the derivatives of the energy by
    /// the totals
    void (*computeGradient)(const CpuHelfrichLayout& layout, const HelfrichParameters& parameters, const HelfrichTotals& slopes, const CpuHelfrichArrays& arrays,
                            int firstGroup, int lastGroup, double* gradients);
};

/**
 * Get the passes for the best instruction set that the processor has, or for the one that the environment variable OPENMM_HELFRICH_SIMD names: Baseline, AVX2 or
 * AVX512.
 */
const CpuHelfrichPasses& getCpuHelfrichPasses();

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHPASSES_H_*/
