#ifndef OPENMM_REFERENCEEDGEFLIPS_H_
#define OPENMM_REFERENCEEDGEFLIPS_H_

#include "ReferenceHelfrichGeometry.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include <array>

namespace HelfrichPlugin {

/**
 * Metropolis sweeps of edge flips, written for reading: one attempt follows the other, and the change of energy is what
 * the equations of HelfrichForce say of the surface around the edge after the flip, less what they said before.
 *
 * The flip replaces the edge i-j of the triangles (i, j, k) and (j, i, l) by k-l.  This changes the two triangles, the
 * lengths and angles of the edge and of the four edges around it, and with them the areas and curvatures of the four
 * vertices and the totals of the surface; and who is bonded to whom, directly or by a common neighbor, in pairs of
 * which at least one is of the four.
 */
class ReferenceEdgeFlips : public ReferenceHelfrichGeometry {
public:
    /**
     * @param mesh        the connectivity, which the flips change
     * @param x           the position of each vertex
     * @param parameters  the moduli and targets
     * @param totals      the area, volume and curvature of each surface
     */
    ReferenceEdgeFlips(HelfrichMesh& mesh, const Vectors& x, const HelfrichParameters& parameters,
                       const std::vector<HelfrichTotalsOf<Real>>& totals);
    /**
     * Make a sweep.  See SweepEdgeFlipsKernel::execute() for the parameters.
     */
    EdgeFlipStatistics sweep(double kT, long long numAttempts, const Philox& random, long long sweep);
private:
    typedef std::array<int, 4> Corners;
    /**
     * What an edge, its two triangles and their corners contribute to the totals and to the energies of the terms that
     * do not depend on totals.
     */
    struct Part {
        HelfrichTotalsOf<Real> totals;
        Real energy = 0;
    };
    bool attempt(int h, double uniform, double kT);
    Part compute(int h, const Corners& corners) const;
    /**
     * Get whether the two triangles have area that a flip of halfedge h has made.
     */
    bool hasArea(int h) const;
    /**
     * Get whether neither the edge that a flip of halfedge h has taken, nor the one that it has made, is longer than
     * half a side of the periodic box.
     */
    bool fitsBox(int h, Real lengthBefore) const;
    Real edgeCurvature(int h) const;
    Real bending(int vertex) const;
    Real repulsion(const Corners& corners) const;
    void findClosePairs();
    HelfrichMesh& flipped;
    const HelfrichParameters p;
    std::vector<HelfrichTotalsOf<Real>> totals;
    /// for each vertex those that are closer than the onset of the repulsion
    std::vector<std::vector<int>> close;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_REFERENCEEDGEFLIPS_H_*/
