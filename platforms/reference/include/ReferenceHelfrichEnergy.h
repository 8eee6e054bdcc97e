#ifndef OPENMM_REFERENCEHELFRICHENERGY_H_
#define OPENMM_REFERENCEHELFRICHENERGY_H_

#include "ReferenceHelfrichGeometry.h"
#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include <vector>

namespace HelfrichPlugin {

/**
 * The energy of a membrane and its gradient, written for reading: every line is one of the equations of HelfrichForce
 * or a derivative of one.
 *
 * Gradients use these derivatives.  For a triangle of area A, unit normal n and edge e opposite to the vertex a, dA/da
 * = n x e/2 and, on a closed surface, dV/da = sum of n A/3 over the triangles.  For the dihedral angle of the edge e =
 * j-i of length l between (i, j, k) and (j, i, l), whose apexes have the heights h_f, h_g over the edge and their foot
 * points at the fractions s_f, s_g of the way from i to j,
 *
 *     dphi/dk = -n_f/h_f,  dphi/dl = -n_g/h_g,  dphi/dj = s_f n_f/h_f + s_g n_g/h_g,  dphi/di = (1-s_f) n_f/h_f +
 * (1-s_g) n_g/h_g.
 *
 * For the angle theta of a triangle at the vertex a, with u = b-a and w = c-a, dtheta/db = -n x u/u^2 and
 * dtheta/dc = n x w/w^2.
 *
 * The normal of a triangle without area is zero, and so is what depends on it.
 *
 * Everything is computed in extended precision and rounded once, at the end, so that a comparison with another platform
 * tells the errors of that platform alone.
 */
class ReferenceHelfrichEnergy : public ReferenceHelfrichGeometry {
public:
    /**
     * Compute areas, curvatures and totals.
     *
     * @param mesh  the connectivity
     * @param x     the position of each vertex
     * @param box   the periodic box, if there is one
     */
    ReferenceHelfrichEnergy(const HelfrichMesh& mesh, const Vectors& x, const PeriodicBox& box);
    void getGeometry(HelfrichGeometry& geometry) const;
    /**
     * Get the totals of each surface.
     */
    const std::vector<HelfrichTotalsOf<Real>>& getTotals() const {
        return totals;
    }
    /**
     * Compute the energy.
     */
    HelfrichEnergyTerms computeEnergy(const HelfrichParameters& parameters) const;
    /**
     * Compute the gradient of the energy by the position of each vertex.
     */
    Vectors computeGradient(const HelfrichParameters& parameters) const;
private:
    void computeTriangles();
    void computeEdges();
    /// M/A of a vertex, and 0 if it has no area
    Real getMeanCurvature(int vertex) const;
    template <class Visitor>
    void forEachEdge(Visitor visit) const;
    template <class Visitor>
    void forEachRepellingPair(const HelfrichParameters& parameters, Visitor visit) const;
    void addAreaAndVolumeGradient(const std::vector<Real>& byVertexArea,
                                  const std::vector<HelfrichTotalsOf<Real>>& slopes, Vectors& gradient) const;
    void addCurvatureGradient(const std::vector<Real>& byVertexCurvature, Vectors& gradient) const;
    void addTurnOfTriangle(int halfedge, Real factor, Vectors& gradient) const;
    void addLineGradient(const HelfrichParameters& parameters, Vectors& gradient) const;
    void addGaussianGradient(const HelfrichParameters& parameters, Vectors& gradient) const;
    void addTetherGradient(const HelfrichParameters& parameters, Vectors& gradient) const;
    void addRepulsionGradient(const HelfrichParameters& parameters, Vectors& gradient) const;
    std::vector<HelfrichTotalsOf<Real>> totals;
    std::vector<Real> triangleAreas, dihedralAngles;
    std::vector<Real> vertexAreas, vertexCurvatures;
    Vectors normals;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_REFERENCEHELFRICHENERGY_H_*/
