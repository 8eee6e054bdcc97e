#include "openmmhelfrich/internal/EdgeFlipSweep.h"
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * The number of attempts whose random numbers are drawn, and whose data is fetched, together.
 */
static const int DRAWS_AHEAD = 16;

// A processor with wider vectors than the compiler may assume gets its own copy of a function.
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
#define HELFRICH_CLONES __attribute__((flatten, target_clones("default", "arch=haswell", "arch=skylake-avx512")))
#else
#define HELFRICH_CLONES
#endif

/**
 * The edges whose curvatures a flip needs, side by side: the flipped one before and after, and the four around it before and after.
 */
struct EdgeStencils {
    static const int NUM_EDGES = 10;
    double length2[NUM_EDGES], sine[NUM_EDGES], cosine[NUM_EDGES];
    void set(int n, double edge2, const Vector3<double>& normalF, const Vector3<double>& normalG, const Vector3<double>& toL) {
        length2[n] = edge2;
        dihedralSineCosine(1.0, normalF, normalG, toL, sine[n], cosine[n]);
    }
};

/**
 * Length times dihedral angle of each edge.
 */
HELFRICH_CLONES
static void computeCurvatures(const EdgeStencils& s, double* curvatures) {
    for (int n = 0; n < EdgeStencils::NUM_EDGES; n++) {
        double length = sqrt(s.length2[n]);
        curvatures[n] = length*angleOf<ScalarMath>(length*s.sine[n], s.cosine[n]);
    }
}

static double length(const Vector3<double>& v) {
    return sqrt(dot(v, v));
}

EdgeFlipStatistics EdgeFlipSweep::execute(const vector<Vec3>& positions, const HelfrichParameters& parameters, double kT, long long numAttempts,
                                          const Philox& random, long long sweep, const Observer& observer) {
    this->positions = positions.data();
    p = parameters;
    EdgeFlipStatistics statistics;
    Flip flip;
    Draw draws[DRAWS_AHEAD];
    for (long long attempt = 0; attempt < numAttempts; attempt++) {
        int n = attempt%DRAWS_AHEAD;
        if (n == 0) {
            for (int i = 0; i < DRAWS_AHEAD; i++) {
                auto words = random(sweep, attempt+i);
                draws[i] = {(int) Philox::index(words[0], words[1], mesh.getNumHalfedges()), Philox::uniform(words[2], words[3])};
            }
            prefetch(draws, DRAWS_AHEAD);
        }
        statistics.attempted++;
        if (!mesh.canFlip(draws[n].halfedge)) {
            statistics.forbidden++;
            continue;
        }
        findVertices(draws[n].halfedge, flip);
        evaluate(flip);
        double energy = flip.localEnergy+penaltyChange(flip);
        if (energy <= 0 || draws[n].uniform < exp(-energy/kT)) {
            accept(flip);
            statistics.accepted++;
            if (observer)
                observer(energy);
        }
    }
    if (statistics.accepted > 0)
        mesh.markChanged();
    return statistics;
}

void EdgeFlipSweep::prefetch(const Draw* draws, int numDraws) const {
    for (int i = 0; i < numDraws; i++)
        mesh.prefetch(draws[i].halfedge);
    for (int i = 0; i < numDraws; i++)
        mesh.prefetch(mesh.opposite(draws[i].halfedge));
    for (int i = 0; i < numDraws; i++) {
        int h = draws[i].halfedge, o = mesh.opposite(h);
        for (int rim : {mesh.next(h), mesh.previous(h), mesh.next(o), mesh.previous(o)}) {
            mesh.prefetch(mesh.opposite(rim));
            __builtin_prefetch(&positions[mesh.getParticles()[mesh.origin(rim)]]);
        }
    }
}

void EdgeFlipSweep::findVertices(int h, Flip& flip) const {
    int o = mesh.opposite(h);
    flip.halfedge = h;
    flip.vertex[0] = mesh.origin(h);
    flip.vertex[1] = mesh.origin(o);
    flip.vertex[2] = mesh.apex(h);
    flip.vertex[3] = mesh.apex(o);
}

void EdgeFlipSweep::evaluate(Flip& flip) const {
    Vector i = position(flip.vertex[0]), j = position(flip.vertex[1])-i, k = position(flip.vertex[2])-i, l = position(flip.vertex[3])-i;
    Patch patch = {{i, j, k, l}, {cross(j, k), cross(l, j), cross(j-l, k-l), cross(l, k)}};
    evaluateAreas(patch, flip);
    flip.totals.curvature = 0;
    if (p.needsCurvature())
        evaluateCurvatures(patch, flip);
    flip.localEnergy = bendingChange(flip)+tetherChange(patch)+repulsionChange(flip);
}

void EdgeFlipSweep::evaluateAreas(const Patch& patch, Flip& flip) const {
    double area[4];
    for (int n = 0; n < 4; n++)
        area[n] = 0.5*length(patch.normal[n]);
    double before = area[0]+area[1], after = area[2]+area[3];
    flip.vertexArea[0] = (area[3]-before)/3;
    flip.vertexArea[1] = (area[2]-before)/3;
    flip.vertexArea[2] = (after-area[0])/3;
    flip.vertexArea[3] = (after-area[1])/3;
    flip.totals.area = after-before;
    flip.totals.volume = dot(patch.normal[0], patch.corner[3])/6;
}

void EdgeFlipSweep::evaluateCurvatures(const Patch& patch, Flip& flip) const {
    const Vector& j = patch.corner[1], &k = patch.corner[2], &l = patch.corner[3];
    const Vector i = {0, 0, 0};
    EdgeStencils stencils;
    stencils.set(0, dot(j, j), patch.normal[0], patch.normal[1], l);
    stencils.set(1, dot(l-k, l-k), patch.normal[2], patch.normal[3], i-k);

    // Around the patch j-k, k-i, i-l and l-j belong to these triangles before and after the flip.

    const Vector from[4] = {j, k, i, l}, to[4] = {k, i, l, j};
    const int before[4] = {0, 0, 1, 1}, after[4] = {2, 3, 3, 2};
    int h = flip.halfedge, o = mesh.opposite(h);
    int rim[4] = {mesh.next(h), mesh.previous(h), mesh.next(o), mesh.previous(o)};
    for (int side = 0; side < 4; side++) {
        Vector edge = to[side]-from[side], outer = position(mesh.apex(mesh.opposite(rim[side])))-patch.corner[0]-from[side];
        Vector outerNormal = cross(outer, edge);
        double edge2 = dot(edge, edge);
        stencils.set(2+side, edge2, patch.normal[before[side]], outerNormal, outer);
        stencils.set(6+side, edge2, patch.normal[after[side]], outerNormal, outer);
    }
    double c[EdgeStencils::NUM_EDGES];
    computeCurvatures(stencils, c);
    double jk = c[6]-c[2], ki = c[7]-c[3], il = c[8]-c[4], lj = c[9]-c[5];
    flip.vertexCurvature[0] = 0.25*(ki+il-c[0]);
    flip.vertexCurvature[1] = 0.25*(jk+lj-c[0]);
    flip.vertexCurvature[2] = 0.25*(jk+ki+c[1]);
    flip.vertexCurvature[3] = 0.25*(il+lj+c[1]);
    flip.totals.curvature = 0.5*(jk+ki+il+lj+c[1]-c[0]);
}

double EdgeFlipSweep::bendingChange(const Flip& flip) const {
    if (p.bendingModulus == 0)
        return 0;
    double change = 0;
    for (int n = 0; n < 4; n++) {
        double area = geometry.vertexAreas[flip.vertex[n]], curvature = geometry.vertexMeanCurvatures[flip.vertex[n]];
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
    return change(p.areaModulus, geometry.area, flip.totals.area, p.targetArea)+
           change(p.volumeModulus, geometry.volume, flip.totals.volume, p.targetVolume)+
           change(p.areaDifferenceModulus, 2*h*geometry.integratedMeanCurvature, 2*h*flip.totals.curvature, p.targetAreaDifference);
}

double EdgeFlipSweep::tetherChange(const Patch& patch) const {
    if (p.tetherModulus == 0)
        return 0;
    auto potential = [&] (const Vector& edge) {
        double slope;
        return tetherPotential(length(edge), p.tetherMinLength, p.tetherMaxLength, p.tetherExponent, slope);
    };
    return p.tetherModulus*(potential(patch.corner[3]-patch.corner[2])-potential(patch.corner[1]));
}

double EdgeFlipSweep::repulsionChange(const Flip& flip) const {
    if (p.repulsionModulus == 0 || p.repulsionExclusionLevel == 0)
        return 0;
    int i = flip.vertex[0], j = flip.vertex[1], k = flip.vertex[2], l = flip.vertex[3];
    if (p.repulsionExclusionLevel == 1)
        return pairEnergy(i, j)-pairEnergy(k, l);
    int h = flip.halfedge, o = mesh.opposite(h);
    return repulsionOfPairsSeparated(h)+repulsionOfPairsSeparated(o)-repulsionOfPairsJoined(k, mesh.previous(o))-repulsionOfPairsJoined(l, mesh.previous(h));
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
    Vector d = position(vertex2)-position(vertex1);
    double r2 = dot(d, d), slope;
    if (r2 >= p.repulsionOnset*p.repulsionOnset)
        return 0;
    return 2*p.repulsionModulus*repulsionPotential(sqrt(r2), p.repulsionOnset, p.repulsionExponent, slope);
}

void EdgeFlipSweep::accept(const Flip& flip) {
    for (int n = 0; n < 4; n++)
        geometry.vertexAreas[flip.vertex[n]] += flip.vertexArea[n];
    if (p.needsCurvature())
        for (int n = 0; n < 4; n++)
            geometry.vertexMeanCurvatures[flip.vertex[n]] += flip.vertexCurvature[n];
    geometry.area += flip.totals.area;
    geometry.volume += flip.totals.volume;
    geometry.integratedMeanCurvature += flip.totals.curvature;
    mesh.flip(flip.halfedge);
}
