#ifndef OPENMM_HELFRICHSTENCILS_H_
#define OPENMM_HELFRICHSTENCILS_H_

#include "HelfrichParameters.h"
#include <cmath>
#include <type_traits>
#include <utility>

namespace HelfrichPlugin {

/**
 * The type of a vector's lanes; for a number, its own.
 */
template <class Real, class = void>
struct LaneOf {
    typedef Real type;
};

template <class Real>
struct LaneOf<Real, std::void_t<decltype(std::declval<Real&>()[0])>> {
    typedef std::remove_reference_t<decltype(std::declval<Real&>()[0])> type;
};

template <class Real>
using Lane = typename LaneOf<Real>::type;

/**
 * A vector in space.  Real is a floating point type, or several of them side by side.
 */
template <class Real>
struct Vector3 {
    Real x, y, z;
    Vector3 operator+(const Vector3& v) const {
        return {x + v.x, y + v.y, z + v.z};
    }
    Vector3 operator-(const Vector3& v) const {
        return {x - v.x, y - v.y, z - v.z};
    }
    Vector3 operator*(Real s) const {
        return {x * s, y * s, z * s};
    }
};

template <class Real>
inline Real dot(const Vector3<Real>& a, const Vector3<Real>& b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

template <class Real>
inline Vector3<Real> cross(const Vector3<Real>& a, const Vector3<Real>& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/**
 * The vector from a point to another.  Nothing else on the CPU takes the difference of two positions.
 */
template <class Real>
inline Vector3<Real> displacement(const Vector3<Real>& from, const Vector3<Real>& to) {
    return to - from;
}

/**
 * Round a number, or several side by side, to integers: it must be small enough for a sum with 1.5*2^52 (2^23) to do
 * so.
 */
template <class Real>
inline Real roundToInteger(Real x) {
    const Lane<Real> shift = std::is_same<Lane<Real>, float>::value ? 12582912.0 : 6755399441055744.0;
    return (x + shift) - shift;
}

/**
 * The shortest of the vectors that differ from a given one by sides of a periodic box.
 */
template <class Real>
inline Vector3<Real> nearestImage(const Vector3<Real>& d, const PeriodicBox& box) {
    return {d.x - box.lengths[0] * roundToInteger(d.x * box.inverses[0]),
            d.y - box.lengths[1] * roundToInteger(d.y * box.inverses[1]),
            d.z - box.lengths[2] * roundToInteger(d.z * box.inverses[2])};
}

/**
 * The vector from a point to another, or to the nearest of its images if there is a periodic box.
 */
inline Vector3<double> displacement(const Vector3<double>& from, const Vector3<double>& to, const PeriodicBox& box) {
    Vector3<double> d = displacement(from, to);
    return box.exists() ? nearestImage(d, box) : d;
}

/**
 * The sine and cosine of the dihedral angle of an edge, both times the same positive factor.  The edge i-j belongs to
 * the triangles (i, j, k) and (j, i, l).  With N_g = (x_l-x_i) x e, the cross product N_f x N_g is parallel to the edge
 * e, and its component along it is
 * -|e| N_f.(x_l-x_i): no cross product is needed, and no normal need have unit length.  It is never -0, so that two
 * triangles folded onto each other have the angle pi.
 *
 * @param length   |e|
 * @param normalF  (x_j-x_i) x (x_k-x_i)
 * @param normalG  (x_l-x_i) x (x_j-x_i)
 * @param toL      x_l-x_i
 */
template <class Real>
inline void dihedralSineCosine(Real length, const Vector3<Real>& normalF, const Vector3<Real>& normalG,
                               const Vector3<Real>& toL, Real& sine, Real& cosine) {
    sine = Lane<Real>(0) - length * dot(normalF, toL);
    cosine = dot(normalF, normalG);
}

/**
 * The dihedral angle of an edge: 0 when flat, positive when convex, and 0 by definition when one of the triangles has
 * no area. See dihedralSineCosine() for the parameters.
 */
template <class Real>
inline Real dihedralAngle(Real length, const Vector3<Real>& normalF, const Vector3<Real>& normalG,
                          const Vector3<Real>& toL) {
    using std::atan2;
    Real sine, cosine;
    dihedralSineCosine(length, normalF, normalG, toL, sine, cosine);
    return sine == 0 && cosine == 0 ? Real(0) : atan2(sine, cosine);
}

/**
 * The operations of numbers that angleOf() needs.
 */
struct ScalarMath {
    template <class Real>
    static Real absolute(Real x) {
        return std::fabs(x);
    }
    template <class Real>
    static Real select(bool condition, Real ifTrue, Real ifFalse) {
        return condition ? ifTrue : ifFalse;
    }
    template <class Real>
    static Real divide(Real x, Real y) {
        return x / y;
    }
    template <class Real>
    static Real copySign(Real magnitude, Real sign) {
        return std::copysign(magnitude, sign);
    }
};

/**
 * (arctan(z)/z-1)/z^2 as a function of t = z^2, for z up to tan(pi/8): Chebyshev polynomials, good enough for errors of
 * 6e-18 (double) and 2e-9 (single) of the angle.
 */
template <class Real>
inline Real arctangentSeries(Real t) {
    if constexpr (std::is_same<Lane<Real>, float>::value)
        return (((-0.06451928158f * t + 0.1074373147f) * t - 0.142639556f) * t + 0.1999954048f) * t - 0.3333333176f;
    else {
        Real t2 = t * t;
        Real odd = ((((0.03923044778479309 * t2 + 0.05858140904866328) * t2 + 0.07692183125376892) * t2 +
                     0.11111111015187018) *
                            t2 +
                    0.19999999999995516);
        Real even = (((((-0.019175404711104935 * t2 - 0.050854078345894844) * t2 - 0.06664510525508936) * t2 -
                       0.0909090457530649) *
                              t2 -
                      0.14285714284665682) *
                             t2 -
                     0.3333333333333333);
        return even + t * odd;
    }
}

/**
 * The angle of the point (x, y), and 0 if both are 0: atan2() without branches, for several points at a time.  The
 * ratio of the smaller to the larger coordinate is brought below tan(pi/8); small angles keep their relative accuracy.
 */
template <class Math, class Real>
inline Real angleOf(Real y, Real x) {
    typedef Lane<Real> L;
    Real ay = Math::absolute(y), ax = Math::absolute(x);
    auto steep = (ay > ax);
    Real low = Math::select(steep, ax, ay), high = Math::select(steep, ay, ax);
    auto wide = (low > L(0.41421356237309503) * high);
    Real numerator = Math::select(wide, low - high, low), denominator = Math::select(wide, low + high, high);
    Real z = Math::select(denominator > L(0), Math::divide(numerator, denominator), denominator * L(0));
    Real t = z * z;
    Real angle = z + z * t * arctangentSeries(t);
    angle = Math::select(wide, L(0.78539816339744828) + angle, angle);
    angle = Math::select(steep, L(1.5707963267948966) - angle, angle);
    angle = Math::select(x < L(0), L(3.1415926535897931) - angle, angle);
    return Math::copySign(angle, y);
}

/**
 * x^n for a small n >= 0.
 */
template <class Real>
inline Real integerPower(Real x, int n) {
    Real result = x * 0 + 1;
    for (int i = 0; i < n; i++)
        result = result * x;
    return result;
}

/**
 * The potential exp(r/(r-onset)) r^-n that keeps two points apart, for 0 < r < onset: it and all its derivatives vanish
 * at the onset.
 *
 * @param inverse      1/(r-onset)
 * @param exponential  exp(r/(r-onset))
 * @param[out] slope   its derivative by r
 */
template <class Real>
inline Real contactPotential(Real r, Real onset, int exponent, Real inverse, Real exponential, Real& slope) {
    Real value = exponential / integerPower(r, exponent);
    slope = -value * (onset * inverse * inverse + Lane<Real>(exponent) / r);
    return value;
}

template <class Real>
inline Real contactPotential(Real r, Real onset, int exponent, Real& slope) {
    using std::exp;
    Real inverse = 1 / (r - onset);
    return contactPotential(r, onset, exponent, inverse, exp(r * inverse), slope);
}

/**
 * The potential n^(n+1) (l-maxLength)^n that holds two points together, for l > maxLength.
 *
 * @param[out] slope  its derivative by l
 */
template <class Real>
inline Real stretchPotential(Real l, Real maxLength, int exponent, Real& slope) {
    Real excess = l - maxLength,
         power = integerPower(excess, exponent - 1) * Lane<Real>(integerPower(double(exponent), exponent + 1));
    slope = Lane<Real>(exponent) * power;
    return power * excess;
}

/**
 * The potential of an edge of length l: contactPotential() below minLength, stretchPotential() above maxLength, 0
 * between.
 *
 * @param[out] slope  its derivative by l
 */
template <class Real>
inline Real tetherPotential(Real l, Real minLength, Real maxLength, int exponent, Real& slope) {
    if (l < minLength)
        return contactPotential(l, minLength, exponent, slope);
    if (l > maxLength)
        return stretchPotential(l, maxLength, exponent, slope);
    slope = 0;
    return 0;
}

/**
 * The tether's potential of an edge of length l, which its modulus multiplies.
 *
 * @param[out] slope  its derivative by l
 */
template <class Real>
inline Real tetherPotential(const HelfrichParameters& p, Real l, Real& slope) {
    Real scale = p.tetherLengthScale;
    Real potential = tetherPotential<Real>(l / scale, p.tetherMinLength / scale, p.tetherMaxLength / scale,
                                           p.tetherExponent, slope);
    slope = slope / scale;
    return potential;
}

/**
 * A flip makes no triangle of less area than this part of the square of its edge.  Three points on a line, as of a
 * surface that follows a grid, have no dihedral angle, and so no energy that would keep them from it.
 */
const double FLAT_TRIANGLE = 5e-13;

/**
 * The potential of a pair of vertices at distance r: contactPotential() below the onset, 0 above it.
 *
 * @param[out] slope  its derivative by r
 */
template <class Real>
inline Real repulsionPotential(Real r, Real onset, int exponent, Real& slope) {
    slope = 0;
    return r < onset ? contactPotential(r, onset, exponent, slope) : Real(0);
}

/**
 * The repulsion's potential of a pair of vertices at distance r, which its modulus multiplies.
 *
 * @param[out] slope  its derivative by r
 */
template <class Real>
inline Real repulsionPotential(const HelfrichParameters& p, Real r, Real& slope) {
    Real scale = p.repulsionLengthScale;
    Real potential = repulsionPotential<Real>(r / scale, p.repulsionOnset / scale, p.repulsionExponent, slope);
    slope = slope / scale;
    return potential;
}

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHSTENCILS_H_*/
