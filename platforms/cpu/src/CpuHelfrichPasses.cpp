// This file is compiled once for each instruction set; HELFRICH_SIMD is its name.

#include "CpuHelfrichPasses.h"
#include "CpuHelfrichLayout.h"
#include "openmmhelfrich/internal/Simd.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"

using namespace HelfrichPlugin;

namespace {

typedef Vector3<Simd> Point;

/* How far ahead to ask for what is in no cache.  A group's neighbors are in its patch, in an order that the processor does not foresee; and where it does, it stops at the end of
   each page. */
const int GROUPS_AHEAD = 2*HelfrichMesh::PATCH/WIDTH, CORNERS_AHEAD = 24;

/**
 * Ask for the cache lines of an array's elements, which need not exist.
 */
template <class T>
inline void prefetch(const T* data, int count) {
    for (int i = 0; i < count; i += 64/sizeof(T))
        __builtin_prefetch(data+i);
}

/**
 * The ring of a group of vertices.
 */
class Ring {
public:
    Ring(const CpuHelfrichLayout& layout, const double* positions, int g) : group(layout.groups[g]), positions(positions), neighbors(layout.neighbors.data()+group.start),
            valences(layout.valences.data()+g*WIDTH) {
        prefetch(positions+4*(g+GROUPS_AHEAD)*WIDTH, 4*WIDTH);
        int own[WIDTH];
        for (int lane = 0; lane < WIDTH; lane++)
            own[lane] = 4*(g*WIDTH+lane);
        loadPoints(positions, own, center.x, center.y, center.z);
    }
    /// the vector from the vertices to their neighbors of a number
    Point toNeighbor(int i) const {
        Point point;
        loadPoints(positions, neighbors+i*WIDTH, point.x, point.y, point.z);
        return point-center;
    }
    /// a value of the neighbors of a number
    Simd ofNeighbor(const double* values, int i) const {
        return loadScalars(values, neighbors+i*WIDTH);
    }
    /// the normal of the triangles that follow a neighbor, u x w, and 0 where there is none
    Point normal(int i, const Point& u, const Point& w) const {
        Point n = cross(u, w);
        if (!group.isPadded)
            return n;
        SimdMask exists = has(i);
        return {choose(exists, n.x, Simd{}), choose(exists, n.y, Simd{}), choose(exists, n.z, Simd{})};
    }
    /// where the vertices have a neighbor of this number that is not padding
    SimdMask has(int i) const {
        return loadIntegers(valences) > i;
    }
    const CpuHelfrichLayout::Group& group;
    Point center;
private:
    const double* positions;
    const int* neighbors;
    const int* valences;
};

/**
 * 1/sqrt(x), and 0 where x is 0: what has no length has no direction.
 */
inline Simd inverseLength(Simd x) {
    return choose(x > 0.0, inverseSqrt(x), Simd{});
}

/**
 * Where edges of a squared length may not be slack.
 */
inline SimdMask isTetherTaut(Simd length2, const HelfrichParameters& p) {
    return (length2 < p.tetherMinLength*p.tetherMinLength) | (length2 > p.tetherMaxLength*p.tetherMaxLength);
}

/**
 * The tether's energy of edges, and its slope over their length.
 */
inline Simd tetherEnergy(Simd length, SimdMask exists, const HelfrichParameters& p, Simd& slopeOverLength) {
    Simd energy = {}, slope = {}, branchSlope;
    SimdMask isShort = exists & (length < p.tetherMinLength), isLong = exists & (length > p.tetherMaxLength);
    if (any(isShort)) {
        Simd minLength = broadcast(p.tetherMinLength), inverse = divide(broadcast(1), length-minLength);
        Simd value = contactPotential(length, minLength, p.tetherExponent, inverse, exponential(length*inverse), branchSlope);
        energy = choose(isShort, value, energy);
        slope = choose(isShort, branchSlope, slope);
    }
    if (any(isLong)) {
        Simd value = stretchPotential(length, broadcast(p.tetherMaxLength), p.tetherExponent, branchSlope);
        energy = choose(isLong, value, energy);
        slope = choose(isLong, branchSlope, slope);
    }
    slopeOverLength = choose(isShort | isLong, divide(p.tetherModulus*slope, length), Simd{});
    return p.tetherModulus*energy;
}

/**
 * What of the ring the terms need: each is evaluated with what comes before it.
 */
enum Parts {Edges, Triangles, Angles};

/**
 * The sums over the rings of a group.
 */
struct RingSums {
    Simd doubleAreas, curvature, tether;
    Point normals;
};

template <Parts parts, bool HasTether>
inline void addEdge(const Ring& ring, int i, const Point& normal, const Point& previousNormal, const Point& toNeighbor, const Point& toPrevious,
                    const HelfrichParameters& p, const CpuHelfrichArrays& arrays, RingSums& sums) {
    if (parts != Angles && !HasTether)
        return;
    Simd length2 = dot(toNeighbor, toNeighbor);
    // Of an edge without length this makes something that is no number, and so an error.
    Simd inverse = inverseSqrt(length2), length = length2*inverse;
    if (parts == Angles) {
        Simd sine, cosine;
        dihedralSineCosine(length, normal, previousNormal, toPrevious, sine, cosine);
        Simd angle = angleOf<SimdMath>(sine, cosine);
        store(arrays.anglesPerLength+ring.group.start+i*WIDTH, angle*inverse);
        sums.curvature += length*angle;
    }
    if (HasTether && any(isTetherTaut(length2, p))) {
        Simd slope;
        sums.tether += tetherEnergy(length, ring.has(i), p, slope);
    }
}

template <Parts parts, bool HasTether>
inline RingSums sumRing(const Ring& ring, const HelfrichParameters& p, const CpuHelfrichArrays& arrays) {
    RingSums sums = {};
    const CpuHelfrichLayout::Group& group = ring.group;
    if (parts == Edges) {
        const Point none = {};
        for (int i = 0; i < group.length && HasTether; i++)
            addEdge<Edges, HasTether>(ring, i, none, none, ring.toNeighbor(i), none, p, arrays, sums);
        return sums;
    }
    Point first = ring.toNeighbor(0), current = first;
    Point firstNormal = {}, previous = {}, previousNormal = {}, last = {}, lastNormal = {};
    for (int i = 0; i < group.length; i++) {
        Point next = i+1 < group.length ? ring.toNeighbor(i+1) : first;
        Point normal = ring.normal(i, current, next);
        Simd square = dot(normal, normal);
        sums.doubleAreas += square*inverseLength(square);
        sums.normals = sums.normals+normal;
        if (i == 0)
            firstNormal = normal;
        else
            addEdge<parts, HasTether>(ring, i, normal, previousNormal, current, previous, p, arrays, sums);
        if (group.isPadded) {
            SimdMask exists = ring.has(i);
            last = {choose(exists, current.x, last.x), choose(exists, current.y, last.y), choose(exists, current.z, last.z)};
            lastNormal = {choose(exists, normal.x, lastNormal.x), choose(exists, normal.y, lastNormal.y), choose(exists, normal.z, lastNormal.z)};
        }
        previous = current;
        previousNormal = normal;
        current = next;
    }
    if (!group.isPadded) {
        last = previous;
        lastNormal = previousNormal;
    }
    addEdge<parts, HasTether>(ring, 0, firstNormal, lastNormal, first, last, p, arrays, sums);
    return sums;
}

template <Parts parts, bool HasTether>
void computeEnergy(const CpuHelfrichLayout& layout, const HelfrichParameters& p, const CpuHelfrichArrays& arrays, int firstGroup, int lastGroup, CpuHelfrichSums& sums) {
    Simd area = {}, volume = {}, curvature = {}, bending = {}, tether = {};
    Point origin = {broadcast(arrays.positions[0]), broadcast(arrays.positions[1]), broadcast(arrays.positions[2])};
    for (int g = firstGroup; g < lastGroup; g++) {
        Ring ring(layout, arrays.positions, g);
        RingSums ringSums = sumRing<parts, HasTether>(ring, p, arrays);
        Point offset = ring.center-origin;
        // Without triangles there is an area of 0, and yet of NaN where a position is not finite.
        Simd vertexArea = parts == Edges ? 0.0*dot(offset, offset) : ringSums.doubleAreas*(1.0/6.0);
        area += vertexArea;
        volume += dot(ringSums.normals, offset);
        if (arrays.areas != nullptr)
            store(arrays.areas+g*WIDTH, vertexArea);
        if (parts == Angles) {
            Simd vertexCurvature = 0.25*ringSums.curvature;
            Simd meanCurvature = choose(vertexArea > 0.0, vertexCurvature/vertexArea, Simd{});
            curvature += vertexCurvature;
            bending += vertexCurvature*meanCurvature;
            if (arrays.curvatures != nullptr)
                store(arrays.curvatures+g*WIDTH, vertexCurvature);
            store(arrays.bendingSlopes+g*WIDTH, 4.0*p.bendingModulus*meanCurvature);
        }
        if (HasTether)
            tether += ringSums.tether;
    }
    sums.area = sum(area);
    sums.volume = sum(volume)*(1.0/18.0);
    sums.curvature = sum(curvature);
    sums.bending = 2*p.bendingModulus*sum(bending);
    sums.tether = 0.5*sum(tether);
}

void chooseEnergy(const CpuHelfrichLayout& layout, const HelfrichParameters& p, const CpuHelfrichArrays& arrays, int firstGroup, int lastGroup, CpuHelfrichSums& sums) {
    bool hasTether = (p.tetherModulus != 0);
    auto compute = hasTether ? computeEnergy<Edges, true> : computeEnergy<Edges, false>;
    if (p.needsCurvature() || arrays.areas != nullptr)
        compute = hasTether ? computeEnergy<Angles, true> : computeEnergy<Angles, false>;
    else if (p.needsTriangles())
        compute = hasTether ? computeEnergy<Triangles, true> : computeEnergy<Triangles, false>;
    compute(layout, p, arrays, firstGroup, lastGroup, sums);
}

/**
 * The gradient of the tether alone.
 */
template <bool HasTether>
inline Point edgeGradient(const Ring& ring, const HelfrichParameters& p) {
    Point gradient = {};
    for (int i = 0; i < ring.group.length && HasTether; i++) {
        Point u = ring.toNeighbor(i);
        Simd u2 = dot(u, u), slope;
        if (any(isTetherTaut(u2, p))) {
            tetherEnergy(u2*inverseLength(u2), ring.has(i), p, slope);
            gradient = gradient-u*slope;
        }
    }
    return gradient;
}

/**
 * For the vertex a of the triangle (a, b, c) with u = b-a, w = c-a, N = u x w and the dots d_b, d_c of the edges at b and c, the derivatives are
 *
 *     of the area,       dA/da = -(w d_b + u d_c)/(2|N|)
 *     of the volume,     dV/da = N/6, summed over the triangles of a closed surface
 *     of the dihedrals,  sum_e C_e l_e dphi_e/da = -N ((C_bc-C_ca) d_c + (C_bc-C_ab) d_b)/|N|^2, this triangle's part.
 *
 * An edge's coefficient is C_e = (alpha_i+alpha_j)/4 with alpha = dE/dM_i, so that only differences of alpha are left in the last.
 */
template <Parts parts, bool HasTether>
inline Point ringGradient(const Ring& ring, const HelfrichParameters& p, const HelfrichTotals& slopes, const CpuHelfrichArrays& arrays, int g) {
    if (parts == Edges)
        return edgeGradient<HasTether>(ring, p);
    const double byBendingSlope2 = p.bendingModulus == 0 ? 0 : -1/(24*p.bendingModulus);
    const CpuHelfrichLayout::Group& group = ring.group;
    Point gradient = {};
    Point first = ring.toNeighbor(0), u = first;
    Simd u2 = dot(u, u), alpha = {}, firstAlpha = {}, alphaU = {};
    if (parts == Angles) {
        alpha = load(arrays.bendingSlopes+g*WIDTH);
        prefetch(arrays.bendingSlopes+(g+GROUPS_AHEAD)*WIDTH, WIDTH);
        prefetch(arrays.anglesPerLength+group.start+CORNERS_AHEAD*WIDTH, group.length*WIDTH);
        firstAlpha = alphaU = ring.ofNeighbor(arrays.bendingSlopes, 0);
    }
    for (int i = 0; i < group.length; i++) {
        bool isLast = (i+1 == group.length);
        Point w = isLast ? first : ring.toNeighbor(i+1);
        Simd w2 = dot(w, w), uw = dot(u, w), db = u2-uw, dc = w2-uw;
        Point normal = ring.normal(i, u, w);
        Simd inverse = inverseLength(dot(normal, normal));
        Simd byNormal = broadcast(slopes.volume*(1.0/6.0)), byArea = broadcast(slopes.area), byEdge = {};
        if (parts == Angles) {
            Simd alphaW = isLast ? firstAlpha : ring.ofNeighbor(arrays.bendingSlopes, i+1);
            byArea += byBendingSlope2*(alpha*alpha+alphaU*alphaU+alphaW*alphaW);
            byNormal -= 0.25*inverse*inverse*((alphaU-alpha)*dc+(alphaW-alpha)*db);
            byEdge = (0.25*(alpha+alphaU)+0.5*slopes.curvature)*load(arrays.anglesPerLength+group.start+i*WIDTH);
            alphaU = alphaW;
        }
        if (HasTether && any(isTetherTaut(u2, p))) {
            Simd slope;
            tetherEnergy(u2*inverseLength(u2), ring.has(i), p, slope);
            byEdge += slope;
        }
        Simd byAreaHalf = 0.5*byArea*inverse;
        gradient = gradient+normal*byNormal-u*(byAreaHalf*dc+byEdge)-w*(byAreaHalf*db);
        u = w;
        u2 = w2;
    }
    return gradient;
}

template <Parts parts, bool HasTether>
void computeGradient(const CpuHelfrichLayout& layout, const HelfrichParameters& p, const HelfrichTotals& slopes, const CpuHelfrichArrays& arrays, int firstGroup,
                     int lastGroup, double* gradients) {
    for (int g = firstGroup; g < lastGroup; g++) {
        Point gradient = ringGradient<parts, HasTether>(Ring(layout, arrays.positions, g), p, slopes, arrays, g);
        for (int lane = 0; lane < WIDTH; lane++, gradients += 4) {
            gradients[0] = gradient.x[lane];
            gradients[1] = gradient.y[lane];
            gradients[2] = gradient.z[lane];
        }
    }
}

void chooseGradient(const CpuHelfrichLayout& layout, const HelfrichParameters& p, const HelfrichTotals& slopes, const CpuHelfrichArrays& arrays, int firstGroup,
                    int lastGroup, double* gradients) {
    bool hasTether = (p.tetherModulus != 0);
    auto compute = hasTether ? computeGradient<Edges, true> : computeGradient<Edges, false>;
    if (p.needsCurvature())
        compute = hasTether ? computeGradient<Angles, true> : computeGradient<Angles, false>;
    else if (p.needsTriangles())
        compute = hasTether ? computeGradient<Triangles, true> : computeGradient<Triangles, false>;
    compute(layout, p, slopes, arrays, firstGroup, lastGroup, gradients);
}

} // namespace

#define CONCATENATE_(a, b) a##b
#define CONCATENATE(a, b) CONCATENATE_(a, b)

namespace HelfrichPlugin {

extern const CpuHelfrichPasses CONCATENATE(cpuHelfrichPasses, HELFRICH_SIMD);
const CpuHelfrichPasses CONCATENATE(cpuHelfrichPasses, HELFRICH_SIMD) = {WIDTH, chooseEnergy, chooseGradient};

} // namespace HelfrichPlugin
