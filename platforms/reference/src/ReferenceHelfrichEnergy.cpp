#include "ReferenceHelfrichEnergy.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <cmath>

using namespace HelfrichPlugin;
using namespace std;
typedef ReferenceHelfrichEnergy::Real Real;
typedef ReferenceHelfrichEnergy::Vector Vector;

ReferenceHelfrichEnergy::ReferenceHelfrichEnergy(const HelfrichMesh& mesh, const Vectors& x)
        : mesh(mesh), x(x), triangleAreas(mesh.getNumTriangles()), dihedralAngles(mesh.getNumHalfedges()),
          vertexAreas(mesh.getNumVertices(), Real(0)), vertexCurvatures(mesh.getNumVertices(), Real(0)),
          normals(mesh.getNumTriangles()) {
    computeTriangles();
    computeEdges();
}

void ReferenceHelfrichEnergy::computeTriangles() {
    const Vector& origin = x[0];
    for (int t = 0; t < mesh.getNumTriangles(); t++) {
        int a = mesh.origin(3 * t), b = mesh.origin(3 * t + 1), c = mesh.origin(3 * t + 2);
        Vector N = (x[b] - x[a]).cross(x[c] - x[a]);
        Real area = N.norm() / 2;
        triangleAreas[t] = area;
        normals[t] = (area == 0 ? Vector::Zero() : Vector(N / (2 * area)));
        totals.area += area;
        totals.volume += (x[a] - origin).dot(N) / 6;
        for (int v : {a, b, c})
            vertexAreas[v] += area / 3;
    }
}

template <class Visitor>
void ReferenceHelfrichEnergy::forEachEdge(Visitor visit) const {
    for (int h = 0; h < mesh.getNumHalfedges(); h++)
        if (h < mesh.opposite(h))
            visit(h, mesh.origin(h), mesh.tip(h));
}

void ReferenceHelfrichEnergy::computeEdges() {
    forEachEdge([&](int h, int i, int j) {
        const Vector& nf = normals[h / 3];
        const Vector& ng = normals[mesh.opposite(h) / 3];
        Vector edge = x[j] - x[i];
        Real length = edge.norm();
        // A triangle without area has no angles, and an edge without length nothing to say.  Adding 0 makes -0 a 0:
        // what is folded flat has the angle pi, and not -pi.
        bool isFlat = (length != 0 && (nf.isZero(0) || ng.isZero(0)));
        Real angle = isFlat ? Real(0) : atan2(nf.cross(ng).dot(edge) / length + Real(0), nf.dot(ng));
        dihedralAngles[h] = dihedralAngles[mesh.opposite(h)] = angle;
        vertexCurvatures[i] += length * angle / 4;
        vertexCurvatures[j] += length * angle / 4;
        totals.curvature += length * angle / 2;
    });
}

void ReferenceHelfrichEnergy::getGeometry(HelfrichGeometry& geometry) const {
    geometry.area = totals.area;
    geometry.volume = totals.volume;
    geometry.integratedMeanCurvature = totals.curvature;
    geometry.vertexAreas.assign(vertexAreas.begin(), vertexAreas.end());
    geometry.vertexMeanCurvatures.assign(vertexCurvatures.begin(), vertexCurvatures.end());
}

Real ReferenceHelfrichEnergy::getMeanCurvature(int vertex) const {
    return vertexAreas[vertex] == 0 ? Real(0) : vertexCurvatures[vertex] / vertexAreas[vertex];
}

template <class Visitor>
void ReferenceHelfrichEnergy::forEachRepellingPair(const HelfrichParameters& p, Visitor visit) const {
    if (!p.has(Term::Repulsion))
        return;
    for (int i = 0; i < mesh.getNumVertices(); i++)
        for (int j = i + 1; j < mesh.getNumVertices(); j++)
            if ((x[j] - x[i]).squaredNorm() < Real(p.repulsionOnset) * p.repulsionOnset &&
                !mesh.areExcluded(i, j, p.repulsionExclusionLevel))
                visit(i, j, (x[j] - x[i]).norm());
}

HelfrichEnergyTerms ReferenceHelfrichEnergy::computeEnergy(const HelfrichParameters& p) const {
    HelfrichEnergyTerms terms;
    Real bending = 0, tether = 0, repulsion = 0, slope;
    if (p.has(Term::Bending))
        for (int i = 0; i < mesh.getNumVertices(); i++)
            bending += 2 * p.moduli[Term::Bending] * vertexCurvatures[i] * getMeanCurvature(i);
    if (p.has(Term::Tether))
        forEachEdge([&](int h, int i, int j) {
            tether += p.moduli[Term::Tether] * tetherPotential(p, (x[j] - x[i]).norm(), slope);
        });
    forEachRepellingPair(p, [&](int i, int j, Real r) {
        repulsion += 2 * p.moduli[Term::Repulsion] *
                     repulsionPotential<Real>(r, p.repulsionOnset, p.repulsionExponent, slope);
    });
    terms[Term::Bending] = bending;
    terms[Term::Tether] = tether;
    terms[Term::Repulsion] = repulsion;
    addTermsOfTotals(p, totals, terms);
    return terms;
}

ReferenceHelfrichEnergy::Vectors ReferenceHelfrichEnergy::computeGradient(const HelfrichParameters& p) const {
    HelfrichTotalsOf<Real> slopes = getSlopesByTotals(p, totals);
    vector<Real> byVertexArea(mesh.getNumVertices(), slopes.area),
            byVertexCurvature(mesh.getNumVertices(), slopes.curvature);
    if (p.has(Term::Bending))
        for (int i = 0; i < mesh.getNumVertices(); i++) {
            Real meanCurvature = getMeanCurvature(i);
            byVertexArea[i] -= 2 * p.moduli[Term::Bending] * meanCurvature * meanCurvature;
            byVertexCurvature[i] += 4 * p.moduli[Term::Bending] * meanCurvature;
        }
    Vectors gradient(mesh.getNumVertices(), Vector::Zero());
    addAreaAndVolumeGradient(byVertexArea, slopes.volume, gradient);
    if (p.needsCurvature())
        addCurvatureGradient(byVertexCurvature, gradient);
    addTetherGradient(p, gradient);
    addRepulsionGradient(p, gradient);
    return gradient;
}

void ReferenceHelfrichEnergy::addAreaAndVolumeGradient(const vector<Real>& byVertexArea, Real byVolume,
                                                       Vectors& gradient) const {
    for (int t = 0; t < mesh.getNumTriangles(); t++) {
        const Vector& n = normals[t];
        Real byArea = 0;
        for (int c = 0; c < 3; c++)
            byArea += byVertexArea[mesh.origin(3 * t + c)] / 3;
        for (int h = 3 * t; h < 3 * t + 3; h++) {
            Vector oppositeEdge = x[mesh.apex(h)] - x[mesh.tip(h)];
            gradient[mesh.origin(h)] += byArea * n.cross(oppositeEdge) / 2 + byVolume * n * triangleAreas[t] / 3;
        }
    }
}

void ReferenceHelfrichEnergy::addCurvatureGradient(const vector<Real>& byVertexCurvature, Vectors& gradient) const {
    // M_i+M_j holds l*phi/2 of the edge i-j: d(l*phi) = phi dl + l dphi.

    forEachEdge([&](int h, int i, int j) {
        Real byEdge = (byVertexCurvature[i] + byVertexCurvature[j]) / 4;
        Vector edge = x[j] - x[i];
        Real length = edge.norm();
        Vector byLength = byEdge * dihedralAngles[h] * edge / length;
        gradient[j] += byLength;
        gradient[i] -= byLength;
        addTurnOfTriangle(h, byEdge * length, gradient);
        addTurnOfTriangle(mesh.opposite(h), byEdge * length, gradient);
    });
}

void ReferenceHelfrichEnergy::addTurnOfTriangle(int h, Real factor, Vectors& gradient) const {
    int i = mesh.origin(h), j = mesh.tip(h), k = mesh.apex(h);
    if (triangleAreas[h / 3] == 0)
        return;
    Vector edge = x[j] - x[i];
    Real height = 2 * triangleAreas[h / 3] / edge.norm(), foot = (x[k] - x[i]).dot(edge) / edge.squaredNorm();
    Vector turn = factor * normals[h / 3] / height;
    gradient[k] -= turn;
    gradient[i] += (1 - foot) * turn;
    gradient[j] += foot * turn;
}

void ReferenceHelfrichEnergy::addTetherGradient(const HelfrichParameters& p, Vectors& gradient) const {
    if (!p.has(Term::Tether))
        return;
    forEachEdge([&](int h, int i, int j) {
        Vector edge = x[j] - x[i];
        Real length = edge.norm(), slope;
        tetherPotential(p, length, slope);
        Vector pull = p.moduli[Term::Tether] * slope * edge / length;
        gradient[j] += pull;
        gradient[i] -= pull;
    });
}

void ReferenceHelfrichEnergy::addRepulsionGradient(const HelfrichParameters& p, Vectors& gradient) const {
    forEachRepellingPair(p, [&](int i, int j, Real r) {
        Real slope;
        repulsionPotential<Real>(r, p.repulsionOnset, p.repulsionExponent, slope);
        Vector push = 2 * p.moduli[Term::Repulsion] * slope * (x[j] - x[i]) / r;
        gradient[j] += push;
        gradient[i] -= push;
    });
}
