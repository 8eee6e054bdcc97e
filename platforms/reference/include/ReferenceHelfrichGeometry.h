#ifndef OPENMM_REFERENCEHELFRICHGEOMETRY_H_
#define OPENMM_REFERENCEHELFRICHGEOMETRY_H_

#include "openmmhelfrich/internal/HelfrichMesh.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include <Eigen/Dense>
#include <cmath>
#include <vector>

namespace HelfrichPlugin {

/**
 * The lengths, areas and angles of a surface, in extended precision.  Where a compiler's long double is a double, so is
 * this.
 */
class ReferenceHelfrichGeometry {
public:
    typedef long double Real;
    typedef Eigen::Matrix<Real, 3, 1> Vector;
    /**
     * The positions of the vertices or the gradient of an energy by them.
     */
    typedef std::vector<Vector> Vectors;
    /**
     * @param mesh  the connectivity
     * @param x     the position of each vertex
     * @param box   the periodic box, if there is one
     */
    ReferenceHelfrichGeometry(const HelfrichMesh& mesh, const Vectors& x, const PeriodicBox& box)
            : mesh(mesh), x(x), box(box) {
    }
    /**
     * Get the vector from a vertex to another, or to the nearest of its images if there is a periodic box.  No other
     * function takes the difference of two positions.
     */
    Vector displacement(int from, int to) const {
        Vector d = x[to] - x[from];
        for (int i = 0; i < 3 && box.exists(); i++)
            d[i] -= box.lengths[i] * std::round(d[i] / box.lengths[i]);
        return d;
    }
    /**
     * Get the vector along a halfedge.
     */
    Vector edge(int h) const {
        return displacement(mesh.origin(h), mesh.tip(h));
    }
    Real length(int h) const {
        return edge(h).norm();
    }
    /**
     * Get the normal of a triangle, which is twice its area long.
     */
    Vector areaNormal(int t) const {
        int a = mesh.origin(3 * t), b = mesh.origin(3 * t + 1), c = mesh.origin(3 * t + 2);
        return displacement(a, b).cross(displacement(a, c));
    }
    Real area(int t) const {
        return areaNormal(t).norm() / 2;
    }
    /**
     * Get the normal of length 1, and 0 for a triangle without area.
     */
    Vector normal(int t) const {
        Vector N = areaNormal(t);
        Real area = N.norm() / 2;
        return area == 0 ? Vector::Zero() : Vector(N / (2 * area));
    }
    /**
     * Get the part of a triangle of the volume that a closed surface encloses: 0 if it is periodic.
     */
    Real volume(int t) const {
        return box.exists() ? Real(0) : displacement(0, mesh.origin(3 * t)).dot(areaNormal(t)) / 6;
    }
    /**
     * Get the dihedral angle of a halfedge's edge.
     *
     * @param nf  the normal of the halfedge's triangle
     * @param ng  that of the opposite triangle
     */
    Real dihedralAngle(int h, const Vector& nf, const Vector& ng) const {
        // A triangle without area has no angles, and an edge without length nothing to say.  Adding 0 makes -0 a 0:
        // what is folded flat has the angle pi, and not -pi.
        bool isFlat = (length(h) != 0 && (nf.isZero(0) || ng.isZero(0)));
        return isFlat ? Real(0) : std::atan2(nf.cross(ng).dot(edge(h)) / length(h) + Real(0), nf.dot(ng));
    }
    /**
     * Get the angle of a halfedge's triangle at the vertex that the halfedge starts from.
     */
    Real angle(int h) const {
        Vector u = edge(h), w = displacement(mesh.origin(h), mesh.apex(h));
        return std::atan2(u.cross(w).norm(), u.dot(w));
    }
    /**
     * Get the vector from the middle of a halfedge's edge to the apex of its triangle.
     */
    Vector median(int h) const {
        return (displacement(mesh.origin(h), mesh.apex(h)) + displacement(mesh.tip(h), mesh.apex(h))) / 2;
    }
    HelfrichSpecies material(const HelfrichParameters& p, int vertex) const {
        return p.getMaterial(mesh.getSpecies(vertex));
    }
    /**
     * Get the bending energy of a vertex, and 0 if it has no area.
     */
    Real bendingEnergy(const HelfrichSpecies& material, Real area, Real curvature) const {
        Real excess = curvature - material.spontaneousCurvature * area / 2;
        return area == 0 ? Real(0) : 2 * material.bendingModulus * excess * (excess / area);
    }
    /**
     * Call a function with each piece of the boundaries between species in a triangle: a halfedge h, the line tension,
     * and whether the piece joins the middle of the edge to the centroid, and so is a third of the median long; else it
     * is parallel to the edge, and half as long.
     */
    template <class Visitor>
    void forEachLine(const HelfrichParameters& p, int t, Visitor visit) const {
        for (int h = 3 * t; h < 3 * t + 3; h++) {
            int i = mesh.getSpecies(mesh.origin(h)), j = mesh.getSpecies(mesh.tip(h)),
                k = mesh.getSpecies(mesh.apex(h));
            if (i == j && j != k)
                visit(h, p.getLineTension(i, k), false);
            if (i != j && j != k && k != i)
                visit(h, p.getLineTension(i, j), true);
        }
    }
    /**
     * Get the energy of the boundaries between species in a triangle.
     */
    Real lineEnergy(const HelfrichParameters& p, int t) const {
        Real energy = 0;
        forEachLine(p, t, [&](int h, double tension, bool isMedian) {
            energy += tension * (isMedian ? median(h).norm() / 3 : length(h) / 2);
        });
        return energy;
    }
protected:
    const HelfrichMesh& mesh;
    const Vectors& x;
    const PeriodicBox box;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_REFERENCEHELFRICHGEOMETRY_H_*/
