#include "ReferenceHelfrichEnergy.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <cmath>

using namespace HelfrichPlugin;
using namespace std;
using Eigen::Vector3d;

ReferenceHelfrichEnergy::ReferenceHelfrichEnergy(const HelfrichMesh& mesh, const Vectors& x) : mesh(mesh), x(x),
        triangleAreas(mesh.getNumTriangles()), dihedralAngles(mesh.getNumHalfedges()),
        vertexAreas(mesh.getNumVertices(), 0.0), vertexCurvatures(mesh.getNumVertices(), 0.0), normals(mesh.getNumTriangles()) {
    computeTriangles();
    computeEdges();
}

void ReferenceHelfrichEnergy::computeTriangles() {
    const Vector3d& origin = x[0];
    for (int t = 0; t < mesh.getNumTriangles(); t++) {
        int a = mesh.origin(3*t), b = mesh.origin(3*t+1), c = mesh.origin(3*t+2);
        Vector3d N = (x[b]-x[a]).cross(x[c]-x[a]);
        double area = N.norm()/2;
        triangleAreas[t] = area;
        normals[t] = (area == 0 ? Vector3d::Zero() : Vector3d(N/(2*area)));
        totals.area += area;
        totals.volume += (x[a]-origin).dot(N)/6;
        for (int v : {a, b, c})
            vertexAreas[v] += area/3;
    }
}

template <class Visitor>
void ReferenceHelfrichEnergy::forEachEdge(Visitor visit) const {
    for (int h = 0; h < mesh.getNumHalfedges(); h++)
        if (h < mesh.opposite(h))
            visit(h, mesh.origin(h), mesh.tip(h));
}

void ReferenceHelfrichEnergy::computeEdges() {
    forEachEdge([&] (int h, int i, int j) {
        const Vector3d& nf = normals[h/3];
        const Vector3d& ng = normals[mesh.opposite(h)/3];
        Vector3d edge = x[j]-x[i];
        double length = edge.norm();
        // A triangle without area has no angles, and an edge without length nothing to say.  Adding 0 makes -0 a 0: what is folded flat has the angle pi, and not -pi.
        bool isFlat = (length != 0 && (nf.isZero(0) || ng.isZero(0)));
        double angle = isFlat ? 0 : atan2(nf.cross(ng).dot(edge)/length+0.0, nf.dot(ng));
        dihedralAngles[h] = dihedralAngles[mesh.opposite(h)] = angle;
        vertexCurvatures[i] += length*angle/4;
        vertexCurvatures[j] += length*angle/4;
        totals.curvature += length*angle/2;
    });
}

void ReferenceHelfrichEnergy::getGeometry(HelfrichGeometry& geometry) const {
    geometry.area = totals.area;
    geometry.volume = totals.volume;
    geometry.integratedMeanCurvature = totals.curvature;
    geometry.vertexAreas = vertexAreas;
    geometry.vertexMeanCurvatures = vertexCurvatures;
}

double ReferenceHelfrichEnergy::getMeanCurvature(int vertex) const {
    return vertexAreas[vertex] == 0 ? 0 : vertexCurvatures[vertex]/vertexAreas[vertex];
}

template <class Visitor>
void ReferenceHelfrichEnergy::forEachRepellingPair(const HelfrichParameters& p, Visitor visit) const {
    if (p.repulsionModulus == 0)
        return;
    for (int i = 0; i < mesh.getNumVertices(); i++)
        for (int j = i+1; j < mesh.getNumVertices(); j++)
            if ((x[j]-x[i]).squaredNorm() < p.repulsionOnset*p.repulsionOnset && !mesh.areExcluded(i, j, p.repulsionExclusionLevel))
                visit(i, j, (x[j]-x[i]).norm());
}

HelfrichEnergyTerms ReferenceHelfrichEnergy::computeEnergy(const HelfrichParameters& p) const {
    HelfrichEnergyTerms terms;
    double slope;
    if (p.bendingModulus != 0)
        for (int i = 0; i < mesh.getNumVertices(); i++)
            terms.bending += 2*p.bendingModulus*vertexCurvatures[i]*getMeanCurvature(i);
    addPenalties(p, totals, terms);
    if (p.tetherModulus != 0)
        forEachEdge([&] (int h, int i, int j) {
            terms.tether += p.tetherModulus*tetherPotential(p, (x[j]-x[i]).norm(), slope);
        });
    forEachRepellingPair(p, [&] (int i, int j, double r) {
        terms.repulsion += 2*p.repulsionModulus*repulsionPotential(r, p.repulsionOnset, p.repulsionExponent, slope);
    });
    return terms;
}

ReferenceHelfrichEnergy::Vectors ReferenceHelfrichEnergy::computeGradient(const HelfrichParameters& p) const {
    HelfrichTotals slopes = penaltySlopes(p, totals);
    vector<double> byVertexArea(mesh.getNumVertices(), slopes.area), byVertexCurvature(mesh.getNumVertices(), slopes.curvature);
    if (p.bendingModulus != 0)
        for (int i = 0; i < mesh.getNumVertices(); i++) {
            double meanCurvature = getMeanCurvature(i);
            byVertexArea[i] -= 2*p.bendingModulus*meanCurvature*meanCurvature;
            byVertexCurvature[i] += 4*p.bendingModulus*meanCurvature;
        }
    Vectors gradient(mesh.getNumVertices(), Vector3d::Zero());
    addAreaAndVolumeGradient(byVertexArea, slopes.volume, gradient);
    if (p.needsCurvature())
        addCurvatureGradient(byVertexCurvature, gradient);
    addTetherGradient(p, gradient);
    addRepulsionGradient(p, gradient);
    return gradient;
}

void ReferenceHelfrichEnergy::addAreaAndVolumeGradient(const vector<double>& byVertexArea, double byVolume, Vectors& gradient) const {
    for (int t = 0; t < mesh.getNumTriangles(); t++) {
        const Vector3d& n = normals[t];
        double byArea = 0;
        for (int c = 0; c < 3; c++)
            byArea += byVertexArea[mesh.origin(3*t+c)]/3;
        for (int h = 3*t; h < 3*t+3; h++) {
            Vector3d oppositeEdge = x[mesh.apex(h)]-x[mesh.tip(h)];
            gradient[mesh.origin(h)] += byArea*n.cross(oppositeEdge)/2+byVolume*n*triangleAreas[t]/3;
        }
    }
}

void ReferenceHelfrichEnergy::addCurvatureGradient(const vector<double>& byVertexCurvature, Vectors& gradient) const {
    // M_i+M_j holds l*phi/2 of the edge i-j: d(l*phi) = phi dl + l dphi.

    forEachEdge([&] (int h, int i, int j) {
        double byEdge = (byVertexCurvature[i]+byVertexCurvature[j])/4;
        Vector3d edge = x[j]-x[i];
        double length = edge.norm();
        Vector3d byLength = byEdge*dihedralAngles[h]*edge/length;
        gradient[j] += byLength;
        gradient[i] -= byLength;
        addTurnOfTriangle(h, byEdge*length, gradient);
        addTurnOfTriangle(mesh.opposite(h), byEdge*length, gradient);
    });
}

void ReferenceHelfrichEnergy::addTurnOfTriangle(int h, double factor, Vectors& gradient) const {
    int i = mesh.origin(h), j = mesh.tip(h), k = mesh.apex(h);
    if (triangleAreas[h/3] == 0)
        return;
    Vector3d edge = x[j]-x[i];
    double height = 2*triangleAreas[h/3]/edge.norm(), foot = (x[k]-x[i]).dot(edge)/edge.squaredNorm();
    Vector3d turn = factor*normals[h/3]/height;
    gradient[k] -= turn;
    gradient[i] += (1-foot)*turn;
    gradient[j] += foot*turn;
}

void ReferenceHelfrichEnergy::addTetherGradient(const HelfrichParameters& p, Vectors& gradient) const {
    if (p.tetherModulus == 0)
        return;
    forEachEdge([&] (int h, int i, int j) {
        Vector3d edge = x[j]-x[i];
        double length = edge.norm(), slope;
        tetherPotential(p, length, slope);
        Vector3d pull = p.tetherModulus*slope*edge/length;
        gradient[j] += pull;
        gradient[i] -= pull;
    });
}

void ReferenceHelfrichEnergy::addRepulsionGradient(const HelfrichParameters& p, Vectors& gradient) const {
    forEachRepellingPair(p, [&] (int i, int j, double r) {
        double slope;
        repulsionPotential(r, p.repulsionOnset, p.repulsionExponent, slope);
        Vector3d push = 2*p.repulsionModulus*slope*(x[j]-x[i])/r;
        gradient[j] += push;
        gradient[i] -= push;
    });
}
