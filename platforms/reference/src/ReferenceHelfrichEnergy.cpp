#include "ReferenceHelfrichEnergy.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <cmath>

using namespace HelfrichPlugin;
using namespace std;
typedef ReferenceHelfrichEnergy::Real Real;
typedef ReferenceHelfrichEnergy::Vector Vector;

static const Real PI = 3.14159265358979323846264338327950288L;

ReferenceHelfrichEnergy::ReferenceHelfrichEnergy(const HelfrichMesh& mesh, const Vectors& x, const PeriodicBox& box)
        : ReferenceHelfrichGeometry(mesh, x, box), totals(mesh.getNumSurfaces()), triangleAreas(mesh.getNumTriangles()),
          dihedralAngles(mesh.getNumHalfedges()), vertexAreas(mesh.getNumVertices(), Real(0)),
          vertexCurvatures(mesh.getNumVertices(), Real(0)), normals(mesh.getNumTriangles(), Vector::Zero()) {
    computeTriangles();
    computeEdges();
}

void ReferenceHelfrichEnergy::computeTriangles() {
    for (int t = 0; t < mesh.getNumTriangles(); t++) {
        if (mesh.isExterior(3 * t))
            continue;
        triangleAreas[t] = area(t);
        normals[t] = normal(t);
        HelfrichTotalsOf<Real>& ofSurface = totals[mesh.getSurface(mesh.origin(3 * t))];
        ofSurface.area += triangleAreas[t];
        ofSurface.volume += volume(t);
        for (int h = 3 * t; h < 3 * t + 3; h++)
            vertexAreas[mesh.origin(h)] += triangleAreas[t] / 3;
    }
}

template <class Visitor>
void ReferenceHelfrichEnergy::forEachEdge(Visitor visit) const {
    for (int h = 0; h < mesh.getNumHalfedges(); h++) {
        int o = mesh.opposite(h);
        if (h < o && !(mesh.isExterior(h) && mesh.isExterior(o)))
            visit(h, mesh.origin(h), mesh.tip(h));
    }
}

void ReferenceHelfrichEnergy::computeEdges() {
    forEachEdge([&](int h, int i, int j) {
        Real angle = dihedralAngle(h, normals[h / 3], normals[mesh.opposite(h) / 3]);
        dihedralAngles[h] = dihedralAngles[mesh.opposite(h)] = angle;
        vertexCurvatures[i] += length(h) * angle / 4;
        vertexCurvatures[j] += length(h) * angle / 4;
        totals[mesh.getSurface(i)].curvature += length(h) * angle / 2;
    });
}

void ReferenceHelfrichEnergy::getGeometry(HelfrichGeometry& geometry) const {
    geometry.setTotals(totals);
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
            if (displacement(i, j).squaredNorm() < Real(p.repulsionOnset) * p.repulsionOnset &&
                !mesh.areExcluded(i, j, p.repulsionExclusionLevel))
                visit(i, j, displacement(i, j).norm());
}

HelfrichEnergyTerms ReferenceHelfrichEnergy::computeEnergy(const HelfrichParameters& p) const {
    HelfrichEnergyTerms terms;
    Real bending = 0, tether = 0, repulsion = 0, gaussian = 0, line = 0, slope;
    if (p.has(Term::Bending))
        for (int i = 0; i < mesh.getNumVertices(); i++)
            bending += bendingEnergy(material(p, i), vertexAreas[i], vertexCurvatures[i]);
    if (p.hasGaussianForces()) {
        for (int i = 0; i < mesh.getNumVertices(); i++)
            gaussian += material(p, i).gaussianModulus * 2 * PI;
        for (int h = 0; h < mesh.getNumHalfedges(); h++)
            gaussian -= material(p, mesh.origin(h)).gaussianModulus * angle(h);
    }
    if (p.has(Term::Line))
        for (int t = 0; t < mesh.getNumTriangles(); t++)
            line += lineEnergy(p, t);
    if (p.has(Term::Tether))
        forEachEdge(
                [&](int h, int i, int j) { tether += p.moduli[Term::Tether] * tetherPotential(p, length(h), slope); });
    forEachRepellingPair(p, [&](int i, int j, Real r) {
        repulsion += 2 * p.moduli[Term::Repulsion] * repulsionPotential<Real>(p, r, slope);
    });
    terms[Term::Bending] = bending;
    terms[Term::Tether] = tether;
    terms[Term::Repulsion] = repulsion;
    terms[Term::Gaussian] = gaussian;
    terms[Term::Line] = line;
    for (int surface = 0; surface < mesh.getNumSurfaces(); surface++)
        addTermsOfTotals(p, surface, totals[surface], terms);
    return terms;
}

ReferenceHelfrichEnergy::Vectors ReferenceHelfrichEnergy::computeGradient(const HelfrichParameters& p) const {
    vector<HelfrichTotalsOf<Real>> slopes;
    for (int surface = 0; surface < mesh.getNumSurfaces(); surface++)
        slopes.push_back(getSlopesByTotals(p, surface, totals[surface]));
    vector<Real> byVertexArea, byVertexCurvature;
    for (int i = 0; i < mesh.getNumVertices(); i++) {
        byVertexArea.push_back(slopes[mesh.getSurface(i)].area);
        byVertexCurvature.push_back(slopes[mesh.getSurface(i)].curvature);
    }
    if (p.has(Term::Bending))
        for (int i = 0; i < mesh.getNumVertices(); i++) {
            // The energy is 2 kappa (M-CA/2)^2/A.
            HelfrichSpecies ofVertex = material(p, i);
            Real meanCurvature = getMeanCurvature(i), half = ofVertex.spontaneousCurvature / 2;
            byVertexArea[i] -= 2 * ofVertex.bendingModulus * (meanCurvature - half) * (meanCurvature + half);
            byVertexCurvature[i] += 4 * ofVertex.bendingModulus * (meanCurvature - half);
        }
    Vectors gradient(mesh.getNumVertices(), Vector::Zero());
    addAreaAndVolumeGradient(byVertexArea, slopes, gradient);
    if (p.needsCurvature())
        addCurvatureGradient(byVertexCurvature, gradient);
    addTetherGradient(p, gradient);
    addRepulsionGradient(p, gradient);
    if (p.has(Term::Line))
        addLineGradient(p, gradient);
    if (p.hasGaussianForces())
        addGaussianGradient(p, gradient);
    return gradient;
}

void ReferenceHelfrichEnergy::addAreaAndVolumeGradient(const vector<Real>& byVertexArea,
                                                       const vector<HelfrichTotalsOf<Real>>& slopes,
                                                       Vectors& gradient) const {
    for (int t = 0; t < mesh.getNumTriangles(); t++) {
        const Vector& n = normals[t];
        Real byArea = 0, byVolume = slopes[mesh.getSurface(mesh.origin(3 * t))].volume;
        for (int c = 0; c < 3; c++)
            byArea += byVertexArea[mesh.origin(3 * t + c)] / 3;
        for (int h = 3 * t; h < 3 * t + 3; h++) {
            Vector oppositeEdge = edge(mesh.next(h));
            gradient[mesh.origin(h)] += byArea * n.cross(oppositeEdge) / 2 + byVolume * n * triangleAreas[t] / 3;
        }
    }
}

void ReferenceHelfrichEnergy::addCurvatureGradient(const vector<Real>& byVertexCurvature, Vectors& gradient) const {
    // M_i+M_j holds l*phi/2 of the edge i-j: d(l*phi) = phi dl + l dphi.

    forEachEdge([&](int h, int i, int j) {
        Real byEdge = (byVertexCurvature[i] + byVertexCurvature[j]) / 4;
        Vector byLength = byEdge * dihedralAngles[h] * edge(h) / length(h);
        gradient[j] += byLength;
        gradient[i] -= byLength;
        addTurnOfTriangle(h, byEdge * length(h), gradient);
        addTurnOfTriangle(mesh.opposite(h), byEdge * length(h), gradient);
    });
}

void ReferenceHelfrichEnergy::addTurnOfTriangle(int h, Real factor, Vectors& gradient) const {
    int i = mesh.origin(h), j = mesh.tip(h), k = mesh.apex(h);
    if (triangleAreas[h / 3] == 0)
        return;
    Real height = 2 * triangleAreas[h / 3] / length(h), foot = displacement(i, k).dot(edge(h)) / edge(h).squaredNorm();
    Vector turn = factor * normals[h / 3] / height;
    gradient[k] -= turn;
    gradient[i] += (1 - foot) * turn;
    gradient[j] += foot * turn;
}

void ReferenceHelfrichEnergy::addTetherGradient(const HelfrichParameters& p, Vectors& gradient) const {
    if (!p.has(Term::Tether))
        return;
    forEachEdge([&](int h, int i, int j) {
        Real slope;
        tetherPotential(p, length(h), slope);
        Vector pull = p.moduli[Term::Tether] * slope * edge(h) / length(h);
        gradient[j] += pull;
        gradient[i] -= pull;
    });
}

void ReferenceHelfrichEnergy::addRepulsionGradient(const HelfrichParameters& p, Vectors& gradient) const {
    forEachRepellingPair(p, [&](int i, int j, Real r) {
        Real slope;
        repulsionPotential<Real>(p, r, slope);
        Vector push = 2 * p.moduli[Term::Repulsion] * slope * displacement(i, j) / r;
        gradient[j] += push;
        gradient[i] -= push;
    });
}

void ReferenceHelfrichEnergy::addLineGradient(const HelfrichParameters& p, Vectors& gradient) const {
    for (int t = 0; t < mesh.getNumTriangles(); t++)
        forEachLine(p, t, [&](int h, double tension, bool isMedian) {
            Vector along = tension * (isMedian ? median(h).normalized() / 3 : edge(h).normalized() / 2);
            int i = mesh.origin(h), j = mesh.tip(h);
            if (isMedian) {
                gradient[mesh.apex(h)] += along;
                gradient[i] -= along / 2;
                gradient[j] -= along / 2;
            }
            else {
                gradient[j] += along;
                gradient[i] -= along;
            }
        });
}

void ReferenceHelfrichEnergy::addGaussianGradient(const HelfrichParameters& p, Vectors& gradient) const {
    for (int h = 0; h < mesh.getNumHalfedges(); h++) {
        int a = mesh.origin(h), b = mesh.tip(h), c = mesh.apex(h);
        Real modulus = material(p, a).gaussianModulus;
        Vector u = edge(h), w = displacement(a, c), n = normals[h / 3];
        Vector byB = -n.cross(u) / u.squaredNorm(), byC = n.cross(w) / w.squaredNorm();
        gradient[b] -= modulus * byB;
        gradient[c] -= modulus * byC;
        gradient[a] += modulus * (byB + byC);
    }
}
