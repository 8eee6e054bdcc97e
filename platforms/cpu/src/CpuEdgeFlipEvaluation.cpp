// This file is compiled once for each instruction set; HELFRICH_SIMD is its name.

#include "CpuEdgeFlipEvaluation.h"
#include "openmmhelfrich/internal/EdgeFlipDraw.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include "CpuSimd.h"

using namespace HelfrichPlugin;

namespace {

typedef Vector3<Simd> Point;

/**
 * The attempts beside each other in one vector.
 */
class Attempts {
public:
    Attempts(const EdgeFlipVertex* vertices, EdgeFlipBatch& batch, int first)
            : vertices(vertices), batch(batch), first(first) {
    }
    Point position(int n) const {
        int offsets[WIDTH];
        for (int lane = 0; lane < WIDTH; lane++)
            offsets[lane] = batch.vertex[n][first + lane] * int(sizeof(EdgeFlipVertex) / sizeof(double));
        Point x;
        loadPoints(&vertices[0].x, offsets, x.x, x.y, x.z);
        return x;
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
    void set(double (&results)[EdgeFlipBatch::SIZE], Simd values) const {
        store(results + first, values);
    }
private:
    const EdgeFlipVertex* vertices;
    EdgeFlipBatch& batch;
    int first;
};

/**
 * The vectors from i that a flip's geometry needs, and the normals, twice the triangles' areas long, of (i, j, k), (j,
 * i, l) before and of (l, j, k), (k, i, l) after it.
 */
struct Patch {
    Point origin, corner[4] = {}, normal[4];
    explicit Patch(const Attempts& attempts) {
        origin = attempts.position(0);
        for (int n = 1; n < 4; n++)
            corner[n] = attempts.position(n) - origin;
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

inline void computeAreas(const Patch& patch, VertexChanges& changes, Simd& area) {
    Simd areas[4];
    for (int n = 0; n < 4; n++)
        areas[n] = 0.5 * rootOf(dot(patch.normal[n], patch.normal[n]));
    Simd before = areas[0] + areas[1], after = areas[2] + areas[3];
    const double third = 1.0 / 3.0;
    changes.area[0] = third * (areas[3] - before);
    changes.area[1] = third * (areas[2] - before);
    changes.area[2] = third * (after - areas[0]);
    changes.area[3] = third * (after - areas[1]);
    area = after - before;
}

/**
 * Length times dihedral angle of an edge.  See dihedralSineCosine() for the parameters.
 */
inline Simd computeCurvature(Simd length, const Point& normalF, const Point& normalG, const Point& toL) {
    Simd sine, cosine;
    dihedralSineCosine(length, normalF, normalG, toL, sine, cosine);
    return length * angleOf<SimdMath>(sine, cosine);
}

inline void computeCurvatures(const Attempts& attempts, const Patch& patch, VertexChanges& changes, Simd& curvature) {
    const Point &j = patch.corner[1], &k = patch.corner[2], &l = patch.corner[3], i = {};
    Simd removed = computeCurvature(rootOf(dot(j, j)), patch.normal[0], patch.normal[1], l);
    Simd added = computeCurvature(rootOf(dot(l - k, l - k)), patch.normal[2], patch.normal[3], i - k);

    // Around the patch j-k, k-i, i-l and l-j belong to these triangles before and after the flip.

    const Point from[4] = {j, k, i, l}, to[4] = {k, i, l, j};
    const int before[4] = {0, 0, 1, 1}, after[4] = {2, 3, 3, 2};
    Simd rim[4];
    for (int side = 0; side < 4; side++) {
        Point edge = to[side] - from[side], outer = attempts.position(4 + side) - patch.origin - from[side],
              outerNormal = cross(outer, edge);
        Simd length = rootOf(dot(edge, edge));
        rim[side] = computeCurvature(length, patch.normal[after[side]], outerNormal, outer) -
                    computeCurvature(length, patch.normal[before[side]], outerNormal, outer);
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

inline Simd bendingChange(const Attempts& attempts, const HelfrichParameters& p, const VertexChanges& changes) {
    Simd change = {};
    for (int n = 0; n < 4; n++) {
        Simd area = attempts.area(n), curvature = attempts.curvature(n);
        change += bendingOf(curvature + changes.curvature[n], area + changes.area[n]) - bendingOf(curvature, area);
    }
    return 2 * p.bendingModulus * change;
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
    return p.tetherModulus * energy;
}

template <bool HasCurvature, bool HasTether>
void evaluate(const HelfrichParameters& p, const EdgeFlipVertex* vertices, EdgeFlipBatch& batch, int first, int last) {
    for (int group = first - first % WIDTH; group < last; group += WIDTH) {
        Attempts attempts(vertices, batch, group);
        Patch patch(attempts);
        VertexChanges changes;
        Simd area, curvature = {}, energy = {};
        computeAreas(patch, changes, area);
        if (HasCurvature) {
            computeCurvatures(attempts, patch, changes, curvature);
            if (p.bendingModulus != 0)
                energy += bendingChange(attempts, p, changes);
        }
        if (HasTether)
            energy += tetherOf(patch.corner[3] - patch.corner[2], p) - tetherOf(patch.corner[1], p);
        attempts.set(batch.energy, energy);
        attempts.set(batch.area, area);
        attempts.set(batch.curvature, curvature);
        attempts.set(batch.volume, dot(patch.normal[0], patch.corner[3]) * (1.0 / 6.0));
        for (int n = 0; n < 4; n++) {
            attempts.set(batch.vertexArea[n], changes.area[n]);
            if (HasCurvature)
                attempts.set(batch.vertexCurvature[n], changes.curvature[n]);
        }
    }
}

void chooseEvaluate(const HelfrichParameters& p, const EdgeFlipVertex* vertices, EdgeFlipBatch& batch, int first,
                    int last) {
    bool hasTether = (p.tetherModulus != 0);
    auto function = p.needsCurvature() ? (hasTether ? evaluate<true, true> : evaluate<true, false>)
                                       : (hasTether ? evaluate<false, true> : evaluate<false, false>);
    function(p, vertices, batch, first, last);
}

void draw(const Philox& random, long long sweep, long long firstAttempt, int numDirectedEdges, EdgeFlipBatch& batch) {
    for (int n = 0; n < batch.numAttempts; n++) {
        EdgeFlipDraw draw = drawEdgeFlip(random, sweep, firstAttempt + n, numDirectedEdges);
        batch.halfedge[n] = HelfrichMesh::halfedgeOf(draw.directedEdge);
        batch.uniform[n] = draw.uniform;
    }
}

} // namespace

#define CONCATENATE_(a, b) a##b
#define CONCATENATE(a, b) CONCATENATE_(a, b)

namespace HelfrichPlugin {

extern const EdgeFlipEvaluation CONCATENATE(edgeFlipEvaluation, HELFRICH_SIMD);
const EdgeFlipEvaluation CONCATENATE(edgeFlipEvaluation, HELFRICH_SIMD) = {draw, chooseEvaluate};

} // namespace HelfrichPlugin
