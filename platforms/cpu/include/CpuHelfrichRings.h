#ifndef OPENMM_CPUHELFRICHRINGS_H_
#define OPENMM_CPUHELFRICHRINGS_H_

#include "CpuHelfrichLayout.h"
#include "CpuHelfrichLoops.h"
#include "CpuSimd.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"

/* The loops of CpuHelfrichLoops.h as templates, for sources that are compiled once for each instruction set, whose
   name is HELFRICH_SIMD, and once for each space: HELFRICH_SPACE is Periodic for loops in a periodic box, which others
   have no trace of. */

#ifndef HELFRICH_SPACE
#define HELFRICH_SPACE Open
#endif

namespace HelfrichPlugin {

namespace Open {
constexpr bool IS_PERIODIC = false;
}

namespace Periodic {
constexpr bool IS_PERIODIC = true;
}

namespace {

/**
 * The vectors of floating point numbers of a type, and what the positions are given in: vectors of them, or of
 * integers.
 */
template <class Real>
using Vector = typename SimdOf<Real>::Vector;
template <class Real>
using Point = Vector3<Vector<Real>>;
template <class Real>
using Coordinates =
        Vector3<std::conditional_t<std::is_same<Real, double>::value, Vector<double>, typename SimdOf<Real>::Integers>>;

/* How far ahead to ask for what is in no cache.  A group's neighbors are in its patch, in an order that the processor
   does not foresee; and where it does, it stops at the end of each page. */
const int SLOTS_AHEAD = 2 * HelfrichMesh::PATCH, CORNERS_AHEAD = 24;

/**
 * Ask for the cache lines of an array's elements, which need not exist.
 */
template <class T>
inline void prefetch(const T* data, int count) {
    for (int i = 0; i < count; i += 64 / sizeof(T))
        __builtin_prefetch(data + i);
}

inline const double* getCoordinates(const CpuHelfrichArrays<double>& arrays) {
    return arrays.positions;
}

inline const int* getCoordinates(const CpuHelfrichArrays<float>& arrays) {
    return arrays.fixedPositions;
}

template <class Real>
inline Coordinates<Real> loadCoordinates(const CpuHelfrichArrays<Real>& arrays, const int* offsets) {
    Coordinates<Real> result;
    loadPoints(getCoordinates(arrays), offsets, result.x, result.y, result.z);
    return result;
}

/**
 * The vectors from points to others, in the type in which the loops compute.
 */
inline Point<double> displacement(const Coordinates<double>& from, const Coordinates<double>& to,
                                  const CpuHelfrichArrays<double>& arrays) {
    Point<double> d = HelfrichPlugin::displacement(from, to);
    if constexpr (HELFRICH_SPACE::IS_PERIODIC)
        d = nearestImage(d, arrays.box);
    return d;
}

/**
 * The shortest of the differences between fixed point numbers that differ by sides of the box.  Integers without a sign
 * have a difference of any sides, as long as the shortest has room in an integer.
 *
 * @param perSide  the inverse of the side
 * @param side     its lowest bits
 */
inline SimdOf<float>::Integers nearestImage(SimdOf<float>::Integers difference, float perSide, uint32_t side) {
    typedef uint32_t Unsigned __attribute__((vector_size(VECTOR_BYTES)));
    Vector<float> sides = roundToInteger(__builtin_convertvector(difference, Vector<float>) * perSide);
    auto numSides = (Unsigned) __builtin_convertvector(sides, SimdOf<float>::Integers);
    return (SimdOf<float>::Integers)((Unsigned) difference - numSides * side);
}

inline Point<float> displacement(const Coordinates<float>& from, const Coordinates<float>& to,
                                 const CpuHelfrichArrays<float>& arrays) {
    auto convert = [](auto integers) { return __builtin_convertvector(integers, Vector<float>); };
    Coordinates<float> d = HelfrichPlugin::displacement(from, to);
    if constexpr (HELFRICH_SPACE::IS_PERIODIC) {
        auto perSide = [&](int axis) { return arrays.fixedUnit * float(arrays.box.inverses[axis]); };
        d = {nearestImage(d.x, perSide(0), arrays.fixedBox[0]), nearestImage(d.y, perSide(1), arrays.fixedBox[1]),
             nearestImage(d.z, perSide(2), arrays.fixedBox[2])};
    }
    return Point<float>{convert(d.x), convert(d.y), convert(d.z)} * broadcast(arrays.fixedUnit);
}

/**
 * The rings of as many vertices as a vector has lanes: a group of the layout, or a part of it.
 */
template <class Real>
class Ring {
public:
    static const int WIDTH = SimdOf<Real>::WIDTH;
    Ring(const CpuHelfrichLayout& layout, const CpuHelfrichArrays<Real>& arrays, int firstSlot)
            : group(layout.groups[firstSlot / layout.width]), firstSlot(firstSlot), arrays(arrays),
              stride(layout.width), firstCorner(group.start + firstSlot % layout.width),
              neighbors(layout.neighbors.data() + firstCorner), valences(layout.valences.data() + firstSlot) {
        prefetch(getCoordinates(arrays) + 4 * (firstSlot + SLOTS_AHEAD), 4 * WIDTH);
        int own[WIDTH];
        for (int lane = 0; lane < WIDTH; lane++)
            own[lane] = 4 * (firstSlot + lane);
        center = loadCoordinates(arrays, own);
    }
    /// the vector from the vertices to their neighbors of a number
    Point<Real> toNeighbor(int i) const {
        return displacement(center, loadCoordinates(arrays, neighbors + i * stride), arrays);
    }
    /// a value of the neighbors of a number
    Vector<Real> ofNeighbor(const Real* values, int i) const {
        return loadScalars(values, neighbors + i * stride);
    }
    /// the normal of the triangles that follow a neighbor, u x w, and 0 where there is none
    Point<Real> normal(int i, const Point<Real>& u, const Point<Real>& w) const {
        Point<Real> n = cross(u, w);
        if (!group.isPadded)
            return n;
        auto exists = has(i);
        return {choose(exists, n.x, Vector<Real>{}), choose(exists, n.y, Vector<Real>{}),
                choose(exists, n.z, Vector<Real>{})};
    }
    /// where the vertices have a neighbor of this number that is not padding
    typename SimdOf<Real>::Integers has(int i) const {
        return loadIntegers<Real>(valences) > i;
    }
    /// whether neighbors in the group differ in their species
    bool isMixed() const {
        return arrays.areMixed[firstSlot / stride];
    }
    /// the first of the corners of a number
    int corner(int i) const {
        return firstCorner + i * stride;
    }
    const CpuHelfrichLayout::Group& group;
    const int firstSlot;
    Coordinates<Real> center;
private:
    const CpuHelfrichArrays<Real>& arrays;
    const int stride, firstCorner;
    const int* neighbors;
    const int* valences;
};

/**
 * 1/sqrt(x), and 0 where x is 0: what has no length has no direction.
 */
template <class V>
inline V inverseLength(V x) {
    return choose(x > Lane<V>(0), inverseSqrt(x), V{});
}

/**
 * The moduli and lengths that vectors are multiplied with or compared to, in their type.
 */
template <class Real>
struct Parameters {
    explicit Parameters(const HelfrichParameters& p)
            : bendingModulus(p.moduli[Term::Bending]), tetherModulus(p.moduli[Term::Tether]),
              tetherMinLength(p.tetherMinLength), tetherMaxLength(p.tetherMaxLength),
              perTetherScale(1 / p.tetherLengthScale), tetherExponent(p.tetherExponent) {
    }
    Real bendingModulus, tetherModulus, tetherMinLength, tetherMaxLength, perTetherScale;
    int tetherExponent;
};

/**
 * Where edges of a squared length may not be slack.
 */
template <class Real>
inline typename SimdOf<Real>::Integers isTetherTaut(Vector<Real> length2, const Parameters<Real>& p) {
    return (length2 < p.tetherMinLength * p.tetherMinLength) | (length2 > p.tetherMaxLength * p.tetherMaxLength);
}

/**
 * The tether's energy of edges, and its slope over their length.
 */
template <class Real>
inline Vector<Real> tetherEnergy(Vector<Real> length, typename SimdOf<Real>::Integers exists, const Parameters<Real>& p,
                                 Vector<Real>& slopeOverLength) {
    Vector<Real> energy = {}, slope = {}, branchSlope;
    Vector<Real> minLength = broadcast(p.tetherMinLength * p.perTetherScale),
                 maxLength = broadcast(p.tetherMaxLength * p.perTetherScale), scaled = length * p.perTetherScale;
    auto isShort = exists & (scaled < minLength), isLong = exists & (scaled > maxLength);
    if (any(isShort)) {
        Vector<Real> inverse = divide(broadcast(Real(1)), scaled - minLength);
        Vector<Real> value = contactPotential(scaled, minLength, p.tetherExponent, inverse,
                                              exponential(scaled * inverse), branchSlope);
        energy = choose(isShort, value, energy);
        slope = choose(isShort, branchSlope, slope);
    }
    if (any(isLong)) {
        Vector<Real> value = stretchPotential(scaled, maxLength, p.tetherExponent, branchSlope);
        energy = choose(isLong, value, energy);
        slope = choose(isLong, branchSlope, slope);
    }
    slopeOverLength =
            choose(isShort | isLong, divide(p.tetherModulus * p.perTetherScale * slope, length), Vector<Real>{});
    return p.tetherModulus * energy;
}

/**
 * What of the ring the terms need: each is evaluated with what comes before it.  Materials are moduli that differ from
 * vertex to vertex, Mixtures the terms that act where they differ between neighbors.
 */
enum Parts { Edges, Triangles, Angles, Materials, Mixtures };

/**
 * The sums over the rings of a group.
 */
template <class Real>
struct RingSums {
    Vector<Real> doubleAreas, curvature, tether;
    Point<Real> normals;
};

/**
 * The same with those over what acts between materials.  Loops that do without have no trace of them: what compilers
 * inline depends on the size of everything, and so do the last bits.
 */
template <class Real>
struct MaterialRingSums : RingSums<Real> {
    Vector<Real> line, gaussian;
};

template <Parts parts, class Real>
using RingSumsOf = std::conditional_t<parts >= Materials, MaterialRingSums<Real>, RingSums<Real>>;

/**
 * The angle of each vertex in a triangle, less that of an equilateral one, where the corners of the triangle differ in
 * their Gaussian moduli.
 *
 * @param doubleArea  twice the area of the triangle
 */
template <class Real>
inline Vector<Real> excessAngle(const Ring<Real>& ring, int i, Vector<Real> doubleArea, const Point<Real>& u,
                                const Point<Real>& w, const CpuHelfrichArrays<Real>& arrays) {
    Vector<Real> own = load(arrays.gaussianModuli + ring.firstSlot);
    auto differ = (ring.ofNeighbor(arrays.gaussianModuli, i) != own) |
                  (ring.ofNeighbor(arrays.gaussianModuli, i + 1 < ring.group.length ? i + 1 : 0) != own);
    if (!any(differ))
        return Vector<Real>{};
    Vector<Real> angle = angleOf<SimdMath>(doubleArea, dot(u, w));
    return choose(differ & ring.has(i), angle - Real(M_PI / 3), Vector<Real>{});
}

template <Parts parts, bool HasTether, class Real>
inline void addEdge(const Ring<Real>& ring, int i, const Point<Real>& normal, const Point<Real>& previousNormal,
                    const Point<Real>& toNeighbor, const Point<Real>& toPrevious, const Parameters<Real>& p,
                    const CpuHelfrichArrays<Real>& arrays, RingSumsOf<parts, Real>& sums) {
    if (parts < Angles && !HasTether)
        return;
    Vector<Real> length2 = dot(toNeighbor, toNeighbor);
    // Of an edge without length this makes something that is no number, and so an error.
    Vector<Real> inverse = inverseSqrt(length2), length = length2 * inverse;
    if (parts >= Angles) {
        Vector<Real> sine, cosine;
        dihedralSineCosine(length, normal, previousNormal, toPrevious, sine, cosine);
        Vector<Real> angle = angleOf<SimdMath>(sine, cosine);
        store(arrays.anglesPerLength + ring.corner(i), angle * inverse);
        sums.curvature += length * angle;
    }
    if constexpr (parts == Mixtures)
        if (arrays.lineTensions != nullptr)
            sums.line += load(arrays.lineTensions + ring.corner(i)) * length;
    if (HasTether && any(isTetherTaut(length2, p))) {
        Vector<Real> slope;
        sums.tether += tetherEnergy(length, ring.has(i), p, slope);
    }
}

template <Parts parts, bool HasTether, class Real>
inline RingSumsOf<parts, Real> sumRing(const Ring<Real>& ring, const Parameters<Real>& p,
                                       const CpuHelfrichArrays<Real>& arrays) {
    if constexpr (parts == Materials)
        if (ring.isMixed())
            return sumRing<Mixtures, HasTether>(ring, p, arrays);
    RingSumsOf<parts, Real> sums = {};
    const CpuHelfrichLayout::Group& group = ring.group;
    if (parts == Edges) {
        const Point<Real> none = {};
        for (int i = 0; i < group.length && HasTether; i++)
            addEdge<Edges, HasTether>(ring, i, none, none, ring.toNeighbor(i), none, p, arrays, sums);
        return sums;
    }
    Point<Real> first = ring.toNeighbor(0), current = first;
    Point<Real> firstNormal = {}, previous = {}, previousNormal = {}, last = {}, lastNormal = {};
    for (int i = 0; i < group.length; i++) {
        Point<Real> next = i + 1 < group.length ? ring.toNeighbor(i + 1) : first;
        Point<Real> normal = ring.normal(i, current, next);
        Vector<Real> square = dot(normal, normal);
        sums.doubleAreas += square * inverseLength(square);
        sums.normals = sums.normals + normal;
        if constexpr (parts == Mixtures)
            if (arrays.gaussianModuli != nullptr)
                sums.gaussian += excessAngle(ring, i, square * inverseLength(square), current, next, arrays);
        if (i == 0)
            firstNormal = normal;
        else
            addEdge<parts, HasTether>(ring, i, normal, previousNormal, current, previous, p, arrays, sums);
        if (group.isPadded) {
            auto exists = ring.has(i);
            last = {choose(exists, current.x, last.x), choose(exists, current.y, last.y),
                    choose(exists, current.z, last.z)};
            lastNormal = {choose(exists, normal.x, lastNormal.x), choose(exists, normal.y, lastNormal.y),
                          choose(exists, normal.z, lastNormal.z)};
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

template <Parts parts, bool HasTether, class Real>
void computeEnergy(const CpuHelfrichLayout& layout, const Parameters<Real>& p, const CpuHelfrichArrays<Real>& arrays,
                   int firstGroup, int lastGroup, CpuHelfrichSums& sums) {
    typename SimdOf<Real>::Doubles area = {}, volume = {}, curvature = {}, bending = {}, tether = {};
    std::conditional_t<parts == Materials, decltype(area), int> gaussian = {}, line = {};
    int origins[SimdOf<Real>::WIDTH];
    for (int& offset : origins)
        offset = 4 * layout.groups[firstGroup].origin;
    Coordinates<Real> origin = loadCoordinates(arrays, origins);
    for (int slot = firstGroup * layout.width; slot < lastGroup * layout.width; slot += SimdOf<Real>::WIDTH) {
        Ring<Real> ring(layout, arrays, slot);
        auto ringSums = sumRing<parts, HasTether>(ring, p, arrays);
        Point<Real> offset = displacement(origin, ring.center, arrays);
        // Without triangles there is an area of 0, and yet of NaN where a position is not finite.
        Vector<Real> vertexArea =
                parts == Edges ? Real(0) * dot(offset, offset) : ringSums.doubleAreas * Real(1.0 / 6.0);
        area += toDoubles(vertexArea);
        volume += toDoubles(dot(ringSums.normals, offset));
        if (arrays.areas != nullptr)
            store(arrays.areas + slot, vertexArea);
        if (parts >= Angles) {
            Vector<Real> vertexCurvature = Real(0.25) * ringSums.curvature;
            Vector<Real> meanCurvature = choose(vertexArea > Real(0), vertexCurvature / vertexArea, Vector<Real>{});
            curvature += toDoubles(vertexCurvature);
            if (arrays.curvatures != nullptr)
                store(arrays.curvatures + slot, vertexCurvature);
            if (parts == Materials) {
                // The energy is 2 kappa A e^2, with the excess e = M/A-C/2.
                Vector<Real> modulus = load(arrays.bendingModuli + slot),
                             spontaneous = load(arrays.spontaneousCurvatures + slot),
                             excess = choose(vertexArea > Real(0), meanCurvature - Real(0.5) * spontaneous,
                                             Vector<Real>{});
                bending += toDoubles(modulus * vertexArea * excess * excess);
                store(arrays.bendingSlopes + slot, Real(4) * modulus * excess);
                store(arrays.areaSlopes + slot, Real(-2) * modulus * excess * (excess + spontaneous));
            }
            else {
                bending += toDoubles(vertexCurvature * meanCurvature);
                store(arrays.bendingSlopes + slot, 4 * p.bendingModulus * meanCurvature);
            }
        }
        if (HasTether)
            tether += toDoubles(ringSums.tether);
        if constexpr (parts == Materials) {
            line += toDoubles(ringSums.line);
            if (arrays.gaussianModuli != nullptr)
                gaussian -= toDoubles(load(arrays.gaussianModuli + slot) * ringSums.gaussian);
        }
    }
    sums.area = sum(area);
    sums.volume = sum(volume) * (1.0 / 18.0);
    sums.curvature = sum(curvature);
    sums.bending = 2 * (parts == Materials ? Real(1) : p.bendingModulus) * sum(bending);
    sums.tether = 0.5 * sum(tether);
    if constexpr (parts == Materials) {
        sums.gaussian = sum(gaussian);
        sums.line = 0.5 * sum(line);
    }
}

/**
 * The gradient of the tether alone.
 */
template <bool HasTether, class Real>
inline Point<Real> edgeGradient(const Ring<Real>& ring, const Parameters<Real>& p) {
    Point<Real> gradient = {};
    for (int i = 0; i < ring.group.length && HasTether; i++) {
        Point<Real> u = ring.toNeighbor(i);
        Vector<Real> u2 = dot(u, u), slope;
        if (any(isTetherTaut(u2, p))) {
            tetherEnergy(u2 * inverseLength(u2), ring.has(i), p, slope);
            gradient = gradient - u * slope;
        }
    }
    return gradient;
}

/**
 * For the vertex a of the triangle (a, b, c) with u = b-a, w = c-a, N = u x w and the dots d_b, d_c of the edges at b
 * and c, the derivatives are
 *
 *     of the area,       dA/da = -(w d_b + u d_c)/(2|N|)
 *     of the volume,     dV/da = N/6, summed over the triangles of a closed surface
 *     of the dihedrals,  sum_e C_e l_e dphi_e/da = -N ((C_bc-C_ca) d_c + (C_bc-C_ab) d_b)/|N|^2, this triangle's part.
 *
 * An edge's coefficient is C_e = (alpha_i+alpha_j)/4 with alpha = dE/dM_i, so that only differences of alpha are left
 * in the last.  And of the angles theta with Gaussian moduli k, since those of a triangle add up to pi,
 *
 *     -sum_v k_v dtheta_v/da = ((k_b-k_a)(w-u (u.w)/u^2) + (k_c-k_a)(u-w (u.w)/w^2))/|N|.
 */
template <Parts parts, bool HasTether, class Real>
inline Point<Real> ringGradient(const Ring<Real>& ring, const Parameters<Real>& p, const HelfrichTotals& slopes,
                                const CpuHelfrichArrays<Real>& arrays) {
    if constexpr (parts == Materials)
        if (ring.isMixed())
            return ringGradient<Mixtures, HasTether>(ring, p, slopes, arrays);
    if (parts == Edges)
        return edgeGradient<HasTether>(ring, p);
    const Real byBendingSlope2 = p.bendingModulus == 0 ? 0 : -1 / (24 * p.bendingModulus),
               byVolume = slopes.volume * (1.0 / 6.0), byCurvature = slopes.curvature;
    const CpuHelfrichLayout::Group& group = ring.group;
    Point<Real> gradient = {};
    Point<Real> first = ring.toNeighbor(0), u = first;
    Vector<Real> u2 = dot(u, u), alpha = {}, firstAlpha = {}, alphaU = {};
    Vector<Real> areaSlope = {}, areaSlopeU = {};
    if (parts >= Angles) {
        alpha = load(arrays.bendingSlopes + ring.firstSlot);
        prefetch(arrays.bendingSlopes + ring.firstSlot + SLOTS_AHEAD, ring.WIDTH);
        prefetch(arrays.anglesPerLength + ring.corner(CORNERS_AHEAD), group.length * ring.WIDTH);
        firstAlpha = alphaU = ring.ofNeighbor(arrays.bendingSlopes, 0);
    }
    if (parts >= Materials) {
        areaSlope = load(arrays.areaSlopes + ring.firstSlot);
        areaSlopeU = ring.ofNeighbor(arrays.areaSlopes, 0);
    }
    for (int i = 0; i < group.length; i++) {
        bool isLast = (i + 1 == group.length);
        Point<Real> w = isLast ? first : ring.toNeighbor(i + 1);
        Vector<Real> w2 = dot(w, w), uw = dot(u, w), db = u2 - uw, dc = w2 - uw;
        Point<Real> normal = ring.normal(i, u, w);
        Vector<Real> inverse = inverseLength(dot(normal, normal));
        Vector<Real> byNormal = broadcast(byVolume), byArea = broadcast(Real(slopes.area)), byEdge = {};
        if (parts >= Angles) {
            Vector<Real> alphaW = isLast ? firstAlpha : ring.ofNeighbor(arrays.bendingSlopes, i + 1);
            if (parts >= Materials) {
                Vector<Real> areaSlopeW = ring.ofNeighbor(arrays.areaSlopes, isLast ? 0 : i + 1);
                byArea += Real(1.0 / 3.0) * (areaSlope + areaSlopeU + areaSlopeW);
                areaSlopeU = areaSlopeW;
            }
            else
                byArea += byBendingSlope2 * (alpha * alpha + alphaU * alphaU + alphaW * alphaW);
            byNormal -= Real(0.25) * inverse * inverse * ((alphaU - alpha) * dc + (alphaW - alpha) * db);
            byEdge = (Real(0.25) * (alpha + alphaU) + Real(0.5) * byCurvature) *
                     load(arrays.anglesPerLength + ring.corner(i));
            alphaU = alphaW;
        }
        if (HasTether && any(isTetherTaut(u2, p))) {
            Vector<Real> slope;
            tetherEnergy(u2 * inverseLength(u2), ring.has(i), p, slope);
            byEdge += slope;
        }
        if constexpr (parts == Mixtures) {
            if (arrays.lineTensions != nullptr)
                byEdge += load(arrays.lineTensions + ring.corner(i)) * inverseLength(u2);
            if (arrays.gaussianModuli != nullptr) {
                Vector<Real> own = load(arrays.gaussianModuli + ring.firstSlot);
                Vector<Real> ofU = (ring.ofNeighbor(arrays.gaussianModuli, i) - own) * inverse;
                Vector<Real> ofW = (ring.ofNeighbor(arrays.gaussianModuli, isLast ? 0 : i + 1) - own) * inverse;
                gradient = gradient + u * (ofW - ofU * divide(uw, u2)) + w * (ofU - ofW * divide(uw, w2));
            }
        }
        Vector<Real> byAreaHalf = Real(0.5) * byArea * inverse;
        gradient = gradient + normal * byNormal - u * (byAreaHalf * dc + byEdge) - w * (byAreaHalf * db);
        u = w;
        u2 = w2;
    }
    return gradient;
}

template <Parts parts, bool HasTether, class Real>
void computeGradient(const CpuHelfrichLayout& layout, const Parameters<Real>& p, const HelfrichTotals& slopes,
                     const CpuHelfrichArrays<Real>& arrays, int firstGroup, int lastGroup, double* gradients) {
    for (int slot = firstGroup * layout.width; slot < lastGroup * layout.width; slot += SimdOf<Real>::WIDTH) {
        Point<Real> gradient = ringGradient<parts, HasTether>(Ring<Real>(layout, arrays, slot), p, slopes, arrays);
        storePoints(gradients, gradient.x, gradient.y, gradient.z);
        gradients += 4 * SimdOf<Real>::WIDTH;
    }
}

} // namespace

/* The loops over vertices whose moduli differ, in a source of their own: compilers limit by how much inlining
   may make a source grow, and would inline less of the loops that everybody needs. */
namespace HELFRICH_SIMD {

namespace HELFRICH_SPACE {

template <class Real>
void computeEnergyOfMaterials(const CpuHelfrichLayout& layout, const HelfrichParameters& p,
                              const CpuHelfrichArrays<Real>& arrays, int firstGroup, int lastGroup,
                              CpuHelfrichSums& sums);
template <class Real>
void computeGradientOfMaterials(const CpuHelfrichLayout& layout, const HelfrichParameters& p,
                                const HelfrichTotals& slopes, const CpuHelfrichArrays<Real>& arrays, int firstGroup,
                                int lastGroup, double* gradients);

} // namespace HELFRICH_SPACE

} // namespace HELFRICH_SIMD

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHRINGS_H_*/
