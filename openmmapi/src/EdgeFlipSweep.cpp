#include "openmmhelfrich/internal/EdgeFlipSweep.h"
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static double length(const Vector3<double>& v) {
    return sqrt(dot(v, v));
}

EdgeFlipStatistics EdgeFlipSweep::execute(const vector<Vec3>& positions, const HelfrichParameters& parameters, double kT, long long numAttempts,
                                          const Philox& random, long long sweep, const Observer& observer) {
    prepare(positions, parameters);
    EdgeFlipStatistics statistics;
    Flip flip;
    for (long long attempt = 0; attempt < numAttempts; attempt++) {
        auto words = random(sweep, attempt);
        int h = Philox::index(words[0], words[1], mesh.getNumHalfedges());
        statistics.attempted++;
        if (!mesh.canFlip(h)) {
            statistics.forbidden++;
            continue;
        }
        evaluate(h, flip);
        if (flip.energy <= 0 || Philox::uniform(words[2], words[3]) < exp(-flip.energy/kT)) {
            accept(flip);
            statistics.accepted++;
            if (observer)
                observer(flip.energy);
        }
    }
    if (statistics.accepted > 0)
        mesh.markChanged();
    return statistics;
}

void EdgeFlipSweep::prepare(const vector<Vec3>& positions, const HelfrichParameters& parameters) {
    p = parameters;
    totals = HelfrichTotals();
    const vector<int>& particles = mesh.getParticles();
    x.resize(particles.size());
    for (size_t v = 0; v < particles.size(); v++) {
        const Vec3& position = positions[particles[v]];
        x[v] = {position[0], position[1], position[2]};
    }
    prepareTriangles();
    if (p.needsCurvature())
        prepareEdges();
}

void EdgeFlipSweep::prepareTriangles() {
    triangleAreas.resize(mesh.getNumTriangles());
    vertexAreas.assign(x.size(), 0);
    for (int t = 0; t < mesh.getNumTriangles(); t++) {
        int a = mesh.origin(3*t), b = mesh.origin(3*t+1), c = mesh.origin(3*t+2);
        Vector n = normal(a, b, c);
        double area = 0.5*length(n);
        triangleAreas[t] = area;
        for (int v : {a, b, c})
            vertexAreas[v] += area/3;
        totals.area += area;
        totals.volume += dot(n, x[a]-x[0])/6;
    }
}

void EdgeFlipSweep::prepareEdges() {
    edgeCurvatures.resize(mesh.getNumHalfedges());
    vertexCurvatures.assign(x.size(), 0);
    for (int h = 0; h < mesh.getNumHalfedges(); h++) {
        int o = mesh.opposite(h);
        if (h > o)
            continue;
        double curvature = curvatureOfEdge(h);
        edgeCurvatures[h] = edgeCurvatures[o] = curvature;
        vertexCurvatures[mesh.origin(h)] += 0.25*curvature;
        vertexCurvatures[mesh.tip(h)] += 0.25*curvature;
        totals.curvature += 0.5*curvature;
    }
}

Vector3<double> EdgeFlipSweep::normal(int a, int b, int c) const {
    return cross(x[b]-x[a], x[c]-x[a]);
}

double EdgeFlipSweep::curvatureOfEdge(int h) const {
    int i = mesh.origin(h), j = mesh.tip(h), k = mesh.apex(h), l = mesh.apex(mesh.opposite(h));
    double edge = length(x[j]-x[i]);
    return edge*dihedralAngle(edge, normal(i, j, k), normal(i, l, j), x[l]-x[i]);
}

void EdgeFlipSweep::evaluate(int h, Flip& flip) const {
    int o = mesh.opposite(h), hNext = mesh.next(h), hPrevious = mesh.previous(h), oNext = mesh.next(o), oPrevious = mesh.previous(o);
    flip.halfedge[0] = h;
    flip.halfedge[1] = o;
    flip.vertex[0] = mesh.origin(h);
    flip.vertex[1] = mesh.origin(o);
    flip.vertex[2] = mesh.origin(hPrevious);
    flip.vertex[3] = mesh.origin(oPrevious);
    flip.rim[0] = hNext;
    flip.rim[1] = hPrevious;
    flip.rim[2] = oNext;
    flip.rim[3] = oPrevious;
    evaluateAreas(flip);
    flip.totals.curvature = 0;
    if (p.needsCurvature())
        evaluateCurvatures(flip);
    flip.energy = bendingChange(flip)+penaltyChange(flip)+tetherChange(flip)+repulsionChange(flip);
}

void EdgeFlipSweep::evaluateAreas(Flip& flip) const {
    int i = flip.vertex[0], j = flip.vertex[1], k = flip.vertex[2], l = flip.vertex[3];
    flip.normal[0] = normal(l, j, k);
    flip.normal[1] = normal(k, i, l);
    flip.area[0] = 0.5*length(flip.normal[0]);
    flip.area[1] = 0.5*length(flip.normal[1]);
    double before[2] = {triangleAreas[flip.halfedge[0]/3], triangleAreas[flip.halfedge[1]/3]};
    double both = before[0]+before[1], bothAfter = flip.area[0]+flip.area[1];
    flip.vertexArea[0] = (flip.area[1]-both)/3;
    flip.vertexArea[1] = (flip.area[0]-both)/3;
    flip.vertexArea[2] = (bothAfter-before[0])/3;
    flip.vertexArea[3] = (bothAfter-before[1])/3;
    flip.totals.area = bothAfter-both;
    flip.totals.volume = dot(normal(i, j, k), x[l]-x[i])/6;
}

double EdgeFlipSweep::rimCurvature(const Flip& flip, int side) const {
    int h = flip.rim[side], a = mesh.origin(h), b = mesh.tip(h), outer = mesh.apex(mesh.opposite(h));
    double edge = length(x[b]-x[a]);
    const Vector& inner = flip.normal[side == 0 || side == 3 ? 0 : 1];
    return edge*dihedralAngle(edge, inner, normal(a, outer, b), x[outer]-x[a]);
}

void EdgeFlipSweep::evaluateCurvatures(Flip& flip) const {
    int k = flip.vertex[2], l = flip.vertex[3];
    double edge = length(x[l]-x[k]), change[4];
    flip.edgeCurvature = edge*dihedralAngle(edge, flip.normal[0], flip.normal[1], x[flip.vertex[0]]-x[k]);
    for (int side = 0; side < 4; side++) {
        flip.rimCurvature[side] = rimCurvature(flip, side);
        change[side] = flip.rimCurvature[side]-edgeCurvatures[flip.rim[side]];
    }
    double removed = edgeCurvatures[flip.halfedge[0]];
    flip.vertexCurvature[0] = 0.25*(change[1]+change[2]-removed);
    flip.vertexCurvature[1] = 0.25*(change[0]+change[3]-removed);
    flip.vertexCurvature[2] = 0.25*(change[0]+change[1]+flip.edgeCurvature);
    flip.vertexCurvature[3] = 0.25*(change[2]+change[3]+flip.edgeCurvature);
    flip.totals.curvature = flip.vertexCurvature[0]+flip.vertexCurvature[1]+flip.vertexCurvature[2]+flip.vertexCurvature[3];
}

double EdgeFlipSweep::bendingChange(const Flip& flip) const {
    if (p.bendingModulus == 0)
        return 0;
    double change = 0;
    for (int n = 0; n < 4; n++) {
        double area = vertexAreas[flip.vertex[n]], curvature = vertexCurvatures[flip.vertex[n]];
        double newArea = area+flip.vertexArea[n], newCurvature = curvature+flip.vertexCurvature[n];
        change += newCurvature*newCurvature/newArea-curvature*curvature/area;
    }
    return 2*p.bendingModulus*change;
}

double EdgeFlipSweep::penaltyChange(const Flip& flip) const {
    // (x+d)^2-x^2 = d (2x+d): the small change does not come from the difference of two large energies.

    auto change = [] (double modulus, double before, double difference, double target) {
        return modulus == 0 ? 0 : modulus*(difference/target)*(2*(before/target-1)+difference/target);
    };
    double h = p.leafletSeparation;
    return change(p.areaModulus, totals.area, flip.totals.area, p.targetArea)+
           change(p.volumeModulus, totals.volume, flip.totals.volume, p.targetVolume)+
           change(p.areaDifferenceModulus, 2*h*totals.curvature, 2*h*flip.totals.curvature, p.targetAreaDifference);
}

double EdgeFlipSweep::tetherChange(const Flip& flip) const {
    if (p.tetherModulus == 0)
        return 0;
    auto potential = [&] (int a, int b) {
        double slope;
        return tetherPotential(length(x[b]-x[a]), p.tetherMinLength, p.tetherMaxLength, p.tetherExponent, slope);
    };
    return p.tetherModulus*(potential(flip.vertex[2], flip.vertex[3])-potential(flip.vertex[0], flip.vertex[1]));
}

double EdgeFlipSweep::repulsionChange(const Flip& flip) const {
    if (p.repulsionModulus == 0 || p.repulsionExclusionLevel == 0)
        return 0;
    int i = flip.vertex[0], j = flip.vertex[1], k = flip.vertex[2], l = flip.vertex[3];
    if (p.repulsionExclusionLevel == 1)
        return pairEnergy(i, j)-pairEnergy(k, l);
    return repulsionOfPairsSeparated(flip.halfedge[0])+repulsionOfPairsSeparated(flip.halfedge[1])-
           repulsionOfPairsJoined(k, flip.rim[3])-repulsionOfPairsJoined(l, flip.rim[1]);
}

double EdgeFlipSweep::repulsionOfPairsSeparated(int h) const {
    // The flip removes the edge i-j, and with it the path from i over j to each neighbor of j.

    int i = mesh.origin(h), j = mesh.tip(h), k = mesh.apex(h), l = mesh.apex(mesh.opposite(h));
    double sum = 0;
    int first = mesh.opposite(h);
    for (int g = mesh.rotate(first); g != first; g = mesh.rotate(g)) {
        int other = mesh.tip(g);
        if (other == k || other == l)
            continue;
        double energy = pairEnergy(i, other);
        if (energy != 0 && !isExcludedWithout(i, other, j))
            sum += energy;
    }
    return sum;
}

double EdgeFlipSweep::repulsionOfPairsJoined(int vertex, int outgoing) const {
    // The flip bonds the vertex to the origin of the outgoing halfedge, and so makes a path from it to each neighbor of that origin.

    double sum = 0;
    int g = outgoing;
    do {
        int other = mesh.tip(g);
        double energy = pairEnergy(vertex, other);
        if (energy != 0 && !mesh.areExcluded(vertex, other, 2))
            sum += energy;
        g = mesh.rotate(g);
    } while (g != outgoing);
    return sum;
}

bool EdgeFlipSweep::isExcludedWithout(int vertex, int other, int removedNeighbor) const {
    int first = mesh.outgoing(vertex), h = first;
    do {
        int neighbor = mesh.tip(h);
        if (neighbor == other || (neighbor != removedNeighbor && mesh.areBonded(neighbor, other)))
            return true;
        h = mesh.rotate(h);
    } while (h != first);
    return false;
}

double EdgeFlipSweep::pairEnergy(int vertex1, int vertex2) const {
    Vector d = x[vertex2]-x[vertex1];
    double r2 = dot(d, d), slope;
    if (r2 >= p.repulsionOnset*p.repulsionOnset)
        return 0;
    return 2*p.repulsionModulus*repulsionPotential(sqrt(r2), p.repulsionOnset, p.repulsionExponent, slope);
}

void EdgeFlipSweep::accept(const Flip& flip) {
    int h = flip.halfedge[0], o = flip.halfedge[1];
    triangleAreas[h/3] = flip.area[0];
    triangleAreas[o/3] = flip.area[1];
    for (int n = 0; n < 4; n++)
        vertexAreas[flip.vertex[n]] += flip.vertexArea[n];
    totals += flip.totals;
    mesh.flip(h);
    if (!p.needsCurvature())
        return;
    for (int n = 0; n < 4; n++)
        vertexCurvatures[flip.vertex[n]] += flip.vertexCurvature[n];
    int inner[2] = {flip.rim[1], flip.rim[3]};
    int rim[4] = {flip.rim[0], o, flip.rim[2], h};
    for (int side : inner)
        edgeCurvatures[side] = flip.edgeCurvature;
    for (int side = 0; side < 4; side++)
        edgeCurvatures[rim[side]] = edgeCurvatures[mesh.opposite(rim[side])] = flip.rimCurvature[side];
}
