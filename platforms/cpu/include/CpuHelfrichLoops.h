#ifndef OPENMM_CPUHELFRICHLOOPS_H_
#define OPENMM_CPUHELFRICHLOOPS_H_

#include "openmmhelfrich/internal/HelfrichParameters.h"
#include <cstdint>
#include <type_traits>

namespace HelfrichPlugin {

class CpuHelfrichLayout;

/**
 * The arrays that the loops over a membrane share.  Arrays of slots have an element a vertex, arrays of corners one
 * for each neighbor of each vertex, in the order of CpuHelfrichLayout.  Real is the type in which the loops compute.
 */
template <class Real>
struct CpuHelfrichArrays {
    /// of each slot: x, y, z, unused
    double* positions;
    /// of each slot: the derivative of the bending energy by its curvature, 4 kappa_B M/A
    Real* bendingSlopes;
    /// of each slot, or NULL if nobody wants them
    Real* areas;
    Real* curvatures;
    /// of each corner: the dihedral angle of the edge over its length
    Real* anglesPerLength;
    /// what loops in single precision read in place of the positions; see CpuHelfrichLoops::roundPositions()
    int* fixedPositions;
    /// the length of which fixedPositions are multiples
    float fixedUnit;
    /// of each slot, where moduli differ from vertex to vertex: those of bending, and the derivative of the bending
    /// energy by the slot's area
    const Real* bendingModuli = nullptr;
    const Real* spontaneousCurvatures = nullptr;
    Real* areaSlopes = nullptr;
    /// of each slot, or NULL if it does not act
    const Real* gaussianModuli = nullptr;
    /// of each corner: the energy of the boundaries beside the edge over its length; or NULL if there is none
    const Real* lineTensions = nullptr;
    /// of each group: whether neighbors differ in what the last two arrays are of
    const char* areMixed = nullptr;
    /// the periodic box of periodic loops; and its sides as multiples of fixedUnit, of which the bits that an integer
    /// has are enough for differences
    PeriodicBox box;
    uint32_t fixedBox[3] = {};
};

/**
 * A box around some of the vertices.  It is not finite if one of their positions is not.
 */
struct CpuHelfrichBox {
    double lower[3], upper[3];
};

/**
 * Sums over some of the vertices of a surface.
 */
struct CpuHelfrichSums : HelfrichTotals {
    double bending = 0, tether = 0, repulsion = 0, gaussian = 0, line = 0;
    /// of the components of the forces, which is finite if they are
    double force = 0;
    /// not 0 where the repulsion's list of pairs is
    double outdated = 0;
};

/**
 * The loops over groups of one surface in a layout, whose width must be a multiple of theirs.  Real is the type in
 * which they compute what concerns a vertex; sums over vertices are in double precision.  The layout's width does not
 * change the result.
 */
template <class Real>
struct CpuHelfrichForceLoops {
    /// the number of vertices beside each other in a vector
    int width;
    /// compute energies, what of areas, volumes and curvatures they need, and what the second loop needs; the sum of
    /// the areas is finite if the positions are
    void (*computeEnergy)(const CpuHelfrichLayout& layout, const HelfrichParameters& parameters,
                          const CpuHelfrichArrays<Real>& arrays, int firstGroup, int lastGroup, CpuHelfrichSums& sums);
    /// compute the gradient (x, y, z, unused) of all terms but the repulsion by the position of each slot of the
    /// groups; slopes are the derivatives of the energy by the totals of the surface
    void (*computeGradient)(const CpuHelfrichLayout& layout, const HelfrichParameters& parameters,
                            const HelfrichTotals& slopes, const CpuHelfrichArrays<Real>& arrays, int firstGroup,
                            int lastGroup, double* gradients);
    /// the same where moduli differ from vertex to vertex
    void (*computeEnergyOfMaterials)(const CpuHelfrichLayout& layout, const HelfrichParameters& parameters,
                                     const CpuHelfrichArrays<Real>& arrays, int firstGroup, int lastGroup,
                                     CpuHelfrichSums& sums);
    void (*computeGradientOfMaterials)(const CpuHelfrichLayout& layout, const HelfrichParameters& parameters,
                                       const HelfrichTotals& slopes, const CpuHelfrichArrays<Real>& arrays,
                                       int firstGroup, int lastGroup, double* gradients);
};

/**
 * The loops over vertices, compiled for one instruction set.
 */
struct CpuHelfrichLoops {
    CpuHelfrichForceLoops<double> inDouble;
    CpuHelfrichForceLoops<float> inSingle;
    template <class Real>
    const CpuHelfrichForceLoops<Real>& in() const {
        if constexpr (std::is_same<Real, double>::value)
            return inDouble;
        else
            return inSingle;
    }
    /// find the smallest box around the vertices of a range of slots
    CpuHelfrichBox (*findBox)(const double* positions, int firstSlot, int lastSlot);
    /// compute the fixed point numbers (x, y, z, unused) that are positions relative to the corner of a box, times a
    /// scale.  Differences between them are exact, which those between numbers in single precision are not.
    void (*roundPositions)(const double* positions, int firstSlot, int lastSlot, const double* corner, double scale,
                           int* fixedPositions);
};

/**
 * The same loops in a periodic box.
 */
struct CpuPeriodicHelfrichLoops : CpuHelfrichLoops {};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHLOOPS_H_*/
