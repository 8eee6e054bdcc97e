// This file is compiled once for each instruction set, whose name is HELFRICH_SIMD, and once more with HELFRICH_SPACE
// as Periodic, for flips in a periodic box.

#include "CpuEdgeFlipEvaluation.h"
#include "openmmhelfrich/internal/EdgeFlipDraw.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include "CpuInstructionSet.h"
#include "CpuSimd.h"

#include <type_traits>

#ifndef HELFRICH_SPACE
#define HELFRICH_SPACE Open
#endif

using namespace HelfrichPlugin;

namespace {

namespace Open {
typedef CpuEdgeFlipEvaluation Evaluation;
}

namespace Periodic {
typedef CpuPeriodicEdgeFlipEvaluation Evaluation;
}

typedef HELFRICH_SPACE::Evaluation Evaluation;
constexpr bool IS_PERIODIC = std::is_same<Evaluation, CpuPeriodicEdgeFlipEvaluation>::value;

typedef Vector3<Simd> Point;

/**
 * The nearest image of a vector, if there is a periodic box.
 */
inline Point inBox(const Point& d, const HelfrichParameters& p) {
    if constexpr (IS_PERIODIC)
        return nearestImage(d, p.box);
    else
        return d;
}

/**
 * The attempts beside each other in one vector.
 */
class Attempts {
public:
    Attempts(const CpuEdgeFlipVertex* vertices, CpuEdgeFlipBatch& batch, int first)
            : vertices(vertices), batch(batch), first(first), origin(position(0)) {
    }
    /**
     * Get the vectors from vertices 0 to those of another number.
     */
    Point displacement(int n) const {
        return HelfrichPlugin::displacement(origin, position(n));
    }
    Simd area(int n) const {
        Simd result;
        for (int lane = 0; lane < WIDTH; lane++)
            result[lane] = vertices[batch.vertex[n][first + lane]].area;
        return result;
    }
    Simd curvature(int n) const {
        Simd result;
        for (int lane = 0; lane < WIDTH; lane++)
            result[lane] = vertices[batch.vertex[n][first + lane]].curvature;
        return result;
    }
    /// the species of vertices of a number
    int species(int n, int lane) const {
        return vertices[batch.vertex[n][first + lane]].species;
    }
    void set(double (&results)[CpuEdgeFlipBatch::SIZE], Simd values) const {
        store(results + first, values);
    }
private:
    Point position(int n) const {
        int offsets[WIDTH];
        for (int lane = 0; lane < WIDTH; lane++)
            offsets[lane] = batch.vertex[n][first + lane] * int(sizeof(CpuEdgeFlipVertex) / sizeof(double));
        Point x;
        loadPoints(&vertices[0].x, offsets, x.x, x.y, x.z);
        return x;
    }
    const CpuEdgeFlipVertex* vertices;
    CpuEdgeFlipBatch& batch;
    int first;
    Point origin;
};

/**
 * The two triangles of an edge: the vectors from i that a flip's geometry needs, and the normals, twice the triangles'
 * areas long, of (i, j, k), (j, i, l) before and of (l, j, k), (k, i, l) after it.
 */
struct Diamond {
    Point corner[4] = {}, normal[4];
    Diamond(const Attempts& attempts, const HelfrichParameters& p) {
        for (int n = 1; n < 4; n++)
            corner[n] = inBox(attempts.displacement(n), p);
        const Point &j = corner[1], &k = corner[2], &l = corner[3];
        normal[0] = cross(j, k);
        normal[1] = cross(l, j);
        normal[2] = cross(j - l, k - l);
        normal[3] = cross(l, k);
    }
};

inline Simd rootOf(Simd x) {
    return choose(x > 0.0, x * inverseSqrt(x), Simd{});
}

/**
 * The changes at the four vertices.
 */
struct VertexChanges {
    Simd area[4], curvature[4];
};

/**
 * Compute the changes of areas.
 *
 * @param[out] area    the change of the area of all
 * @param[out] energy  0, or infinity where the flip would make a triangle without area
 */
inline void computeAreas(const Diamond& diamond, VertexChanges& changes, Simd& area, Simd& energy) {
    Simd areas[4];
    for (int n = 0; n < 4; n++)
        areas[n] = 0.5 * rootOf(dot(diamond.normal[n], diamond.normal[n]));
    Simd before = areas[0] + areas[1], after = areas[2] + areas[3];
    const double third = 1.0 / 3.0;
    changes.area[0] = third * (areas[3] - before);
    changes.area[1] = third * (areas[2] - before);
    changes.area[2] = third * (after - areas[0]);
    changes.area[3] = third * (after - areas[1]);
    area = after - before;
    Point edge = diamond.corner[3] - diamond.corner[2];
    Simd least = FLAT_TRIANGLE * dot(edge, edge);
    energy = choose((areas[2] < least) | (areas[3] < least), broadcast<double>(INFINITY), Simd{});
}

/**
 * Forbid what would take or make an edge that is longer than half a side of the periodic box.
 */
inline Simd forbidAcrossBox(const Diamond& diamond, const HelfrichParameters& p, Simd energy) {
    Point taken = diamond.corner[1], made = diamond.corner[3] - diamond.corner[2];
    double limit = 0.5 * p.box.shortest();
    return choose((dot(taken, taken) > limit * limit) | (dot(made, made) > limit * limit), broadcast<double>(INFINITY),
                  energy);
}

/**
 * Length times dihedral angle of an edge.  See dihedralSineCosine() for the parameters.
 */
inline Simd computeCurvature(Simd length, const Point& normalF, const Point& normalG, const Point& toL) {
    Simd sine, cosine;
    dihedralSineCosine(length, normalF, normalG, toL, sine, cosine);
    return length * angleOf<SimdMath>(sine, cosine);
}

inline void computeCurvatures(const Attempts& attempts, const Diamond& diamond, const HelfrichParameters& p,
                              VertexChanges& changes, Simd& curvature) {
    const Point &j = diamond.corner[1], &k = diamond.corner[2], &l = diamond.corner[3], i = {};
    Simd removed = computeCurvature(rootOf(dot(j, j)), diamond.normal[0], diamond.normal[1], l);
    Simd added = computeCurvature(rootOf(dot(l - k, l - k)), diamond.normal[2], diamond.normal[3], i - k);

    // Around the diamond j-k, k-i, i-l and l-j belong to these triangles before and after the flip.

    const Point from[4] = {j, k, i, l}, to[4] = {k, i, l, j};
    const int before[4] = {0, 0, 1, 1}, after[4] = {2, 3, 3, 2};
    Simd rim[4];
    for (int side = 0; side < 4; side++) {
        Point edge = to[side] - from[side], beyond = inBox(attempts.displacement(4 + side) - from[side], p),
              normalBeyond = cross(beyond, edge);
        Simd length = rootOf(dot(edge, edge));
        rim[side] = computeCurvature(length, diamond.normal[after[side]], normalBeyond, beyond) -
                    computeCurvature(length, diamond.normal[before[side]], normalBeyond, beyond);
    }
    changes.curvature[0] = 0.25 * (rim[1] + rim[2] - removed);
    changes.curvature[1] = 0.25 * (rim[0] + rim[3] - removed);
    changes.curvature[2] = 0.25 * (rim[0] + rim[1] + added);
    changes.curvature[3] = 0.25 * (rim[2] + rim[3] + added);
    curvature = 0.5 * (rim[0] + rim[1] + rim[2] + rim[3] + added - removed);
}

inline Simd bendingOf(Simd curvature, Simd area) {
    return choose(area > 0.0, divide(curvature * curvature, area), Simd{});
}

/**
 * The moduli of the materials around vertices 0 to 3.
 */
struct Materials {
    Simd bendingModulus[4], spontaneousCurvature[4], gaussianModulus[4];
    Materials(const Attempts& attempts, const HelfrichParameters& p) {
        const HelfrichSpeciesTable& table = *p.species;
        for (int n = 0; n < 4; n++) {
            for (int lane = 0; lane < WIDTH; lane++) {
                const HelfrichSpecies& species = table[attempts.species(n, lane)];
                bendingModulus[n][lane] = species.bendingModulus;
                spontaneousCurvature[n][lane] = species.spontaneousCurvature;
                gaussianModulus[n][lane] = species.gaussianModulus;
            }
            spontaneousCurvature[n] += p.spontaneousCurvature;
        }
    }
};

inline Simd bendingChange(const Attempts& attempts, const Materials& materials, const VertexChanges& changes) {
    Simd change = {};
    for (int n = 0; n < 4; n++) {
        Simd area = attempts.area(n), curvature = attempts.curvature(n), half = 0.5 * materials.spontaneousCurvature[n];
        Simd areaAfter = area + changes.area[n], curvatureAfter = curvature + changes.curvature[n];
        change += materials.bendingModulus[n] *
                  (bendingOf(curvatureAfter - half * areaAfter, areaAfter) - bendingOf(curvature - half * area, area));
    }
    return 2.0 * change;
}

/**
 * The sum of a triangle's angles, each times the modulus of its corner.
 */
inline Simd weightedAngles(const Point& a, const Point& b, const Point& c, const Point& normal, Simd modulusA,
                           Simd modulusB, Simd modulusC) {
    Point u = b - a, w = c - a;
    Simd doubleArea = rootOf(dot(normal, normal)), uw = dot(u, w);
    return M_PI * modulusA + (modulusB - modulusA) * angleOf<SimdMath>(doubleArea, dot(u, u) - uw) +
           (modulusC - modulusA) * angleOf<SimdMath>(doubleArea, dot(w, w) - uw);
}

inline Simd gaussianChange(const Diamond& diamond, const Materials& materials) {
    const Simd* modulus = materials.gaussianModulus;
    if (!any((modulus[0] != modulus[1]) | (modulus[0] != modulus[2]) | (modulus[0] != modulus[3])))
        return Simd{};
    auto angles = [&](int a, int b, int c, int triangle) {
        return weightedAngles(diamond.corner[a], diamond.corner[b], diamond.corner[c], diamond.normal[triangle],
                              modulus[a], modulus[b], modulus[c]);
    };
    return angles(0, 1, 2, 0) + angles(1, 0, 3, 1) - angles(3, 1, 2, 2) - angles(2, 0, 3, 3);
}

/**
 * The energy of the boundaries in a triangle.
 */
inline double lineEnergy(const HelfrichParameters& p, const Vector3<double>& a, const Vector3<double>& b,
                         const Vector3<double>& c, int speciesA, int speciesB, int speciesC) {
    auto lengthOf = [](const Vector3<double>& d) { return std::sqrt(dot(d, d)); };
    if (speciesA == speciesB)
        return speciesB == speciesC ? 0 : 0.5 * p.getLineTension(speciesA, speciesC) * lengthOf(b - a);
    if (speciesB == speciesC)
        return 0.5 * p.getLineTension(speciesB, speciesA) * lengthOf(c - b);
    if (speciesC == speciesA)
        return 0.5 * p.getLineTension(speciesC, speciesB) * lengthOf(a - c);
    return (p.getLineTension(speciesA, speciesB) * lengthOf((a - c) + (b - c)) +
            p.getLineTension(speciesB, speciesC) * lengthOf((b - a) + (c - a)) +
            p.getLineTension(speciesC, speciesA) * lengthOf((c - b) + (a - b))) /
           6;
}

inline double lineChange(const Diamond& diamond, const HelfrichParameters& p, const int (&species)[4], int lane) {
    Vector3<double> x[4];
    for (int n = 0; n < 4; n++)
        x[n] = {diamond.corner[n].x[lane], diamond.corner[n].y[lane], diamond.corner[n].z[lane]};
    auto energy = [&](int a, int b, int c) {
        return lineEnergy(p, x[a], x[b], x[c], species[a], species[b], species[c]);
    };
    return energy(3, 1, 2) + energy(2, 0, 3) - energy(0, 1, 2) - energy(1, 0, 3);
}

/**
 * What depends on which species are neighbors: boundaries and pairs.
 */
inline Simd neighborChange(const Attempts& attempts, const Diamond& diamond, const HelfrichParameters& p) {
    Simd change = {};
    for (int lane = 0; lane < WIDTH; lane++) {
        int species[4];
        for (int n = 0; n < 4; n++)
            species[n] = attempts.species(n, lane);
        if (species[0] == species[1] && species[0] == species[2] && species[0] == species[3])
            continue;
        change[lane] = p.getPairEnergy(species[2], species[3]) - p.getPairEnergy(species[0], species[1]);
        if (p.has(Term::Line))
            change[lane] += lineChange(diamond, p, species, lane);
    }
    return change;
}

inline Simd bendingChange(const Attempts& attempts, const HelfrichParameters& p, const VertexChanges& changes) {
    Simd change = {};
    for (int n = 0; n < 4; n++) {
        Simd area = attempts.area(n), curvature = attempts.curvature(n);
        change += bendingOf(curvature + changes.curvature[n], area + changes.area[n]) - bendingOf(curvature, area);
    }
    return 2 * p.moduli[Term::Bending] * change;
}

inline Simd tetherOf(const Point& edge, const HelfrichParameters& p) {
    Simd length2 = dot(edge, edge), energy = {};
    SimdMask taut =
            (length2 < p.tetherMinLength * p.tetherMinLength) | (length2 > p.tetherMaxLength * p.tetherMaxLength);
    if (any(taut)) {
        double slope;
        for (int lane = 0; lane < WIDTH; lane++)
            if (taut[lane])
                energy[lane] = tetherPotential(p, std::sqrt(length2[lane]), slope);
    }
    return p.moduli[Term::Tether] * energy;
}

template <bool HasCurvature, bool HasTether, bool HasSpecies>
void evaluate(const HelfrichParameters& p, const CpuEdgeFlipVertex* vertices, CpuEdgeFlipBatch& batch, int first,
              int last) {
    HelfrichTotals spontaneous = getSpontaneousSlopes(p);
    for (int group = first - first % WIDTH; group < last; group += WIDTH) {
        Attempts attempts(vertices, batch, group);
        Diamond diamond(attempts, p);
        VertexChanges changes;
        Simd area, curvature = {}, energy;
        computeAreas(diamond, changes, area, energy);
        if constexpr (IS_PERIODIC)
            energy = forbidAcrossBox(diamond, p, energy);
        if (HasCurvature) {
            computeCurvatures(attempts, diamond, p, changes, curvature);
            if (p.has(Term::Bending) && !HasSpecies)
                energy += bendingChange(attempts, p, changes) + spontaneous.area * area +
                          spontaneous.curvature * curvature;
        }
        if (HasSpecies) {
            Materials materials(attempts, p);
            if (p.has(Term::Bending))
                energy += bendingChange(attempts, materials, changes);
            if (p.hasGaussianForces())
                energy += gaussianChange(diamond, materials);
            if (p.has(Term::Line) || p.has(Term::Pair))
                energy += neighborChange(attempts, diamond, p);
        }
        if (HasTether)
            energy += tetherOf(diamond.corner[3] - diamond.corner[2], p) - tetherOf(diamond.corner[1], p);
        attempts.set(batch.energy, energy);
        attempts.set(batch.area, area);
        attempts.set(batch.curvature, curvature);
        attempts.set(batch.volume, dot(diamond.normal[0], diamond.corner[3]) * (1.0 / 6.0));
        for (int n = 0; n < 4; n++) {
            attempts.set(batch.vertexArea[n], changes.area[n]);
            if (HasCurvature)
                attempts.set(batch.vertexCurvature[n], changes.curvature[n]);
        }
    }
}

template <bool HasTether>
void chooseEvaluate(const HelfrichParameters& p, const CpuEdgeFlipVertex* vertices, CpuEdgeFlipBatch& batch, int first,
                    int last) {
    auto function =
            p.species ? (p.needsCurvature() ? evaluate<true, HasTether, true> : evaluate<false, HasTether, true>)
                      : (p.needsCurvature() ? evaluate<true, HasTether, false> : evaluate<false, HasTether, false>);
    function(p, vertices, batch, first, last);
}

void evaluateAny(const HelfrichParameters& p, const CpuEdgeFlipVertex* vertices, CpuEdgeFlipBatch& batch, int first,
                 int last) {
    (p.has(Term::Tether) ? chooseEvaluate<true> : chooseEvaluate<false>) (p, vertices, batch, first, last);
}

void draw(const Philox& random, long long sweep, long long firstAttempt, int numDirectedEdges,
          CpuEdgeFlipBatch& batch) {
    for (int n = 0; n < batch.numAttempts; n++) {
        EdgeFlipDraw draw = drawEdgeFlip(random, sweep, firstAttempt + n, numDirectedEdges);
        batch.halfedge[n] = HelfrichMesh::halfedgeOf(draw.directedEdge);
        batch.uniform[n] = draw.uniform;
    }
}

} // namespace

namespace HelfrichPlugin {

template <>
const Evaluation& getCompiledFor<Evaluation, CpuInstructionSet::HELFRICH_SIMD>() {
    static const Evaluation functions = {CpuEdgeFlipEvaluation{draw, evaluateAny}};
    return functions;
}

} // namespace HelfrichPlugin
