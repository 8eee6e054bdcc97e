#ifndef OPENMM_CPUSIMD_H_
#define OPENMM_CPUSIMD_H_

#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <cmath>
#include <cstdint>
#include <limits>
#if defined(__AVX2__)
#include <immintrin.h>
#endif

/* Vectors of numbers as wide as the compiler's flags allow, and the few functions of them that the inner loops need.
   They are in an unnamed namespace, for sources that include this with different flags are linked together. */

namespace {

using HelfrichPlugin::Lane;

#if defined(__AVX512F__)
const int VECTOR_BYTES = 64;
#elif defined(__AVX2__)
const int VECTOR_BYTES = 32;
#else
const int VECTOR_BYTES = 16;
#endif

/**
 * The vectors of floating point numbers of a type, of integers of the same size, and of as many doubles.  Those of a
 * comparison are integers, -1 where it is true.
 */
template <class Real>
struct SimdOf;

template <>
struct SimdOf<double> {
    static const int WIDTH = VECTOR_BYTES / 8;
    typedef double Vector __attribute__((vector_size(VECTOR_BYTES)));
    typedef int64_t Integers __attribute__((vector_size(VECTOR_BYTES)));
    typedef Vector Doubles;
};

template <>
struct SimdOf<float> {
    static const int WIDTH = VECTOR_BYTES / 4;
    typedef float Vector __attribute__((vector_size(VECTOR_BYTES)));
    typedef int32_t Integers __attribute__((vector_size(VECTOR_BYTES)));
    typedef double Doubles __attribute__((vector_size(2 * VECTOR_BYTES)));
};

typedef SimdOf<double>::Vector Simd;
typedef SimdOf<double>::Integers SimdMask;
const int WIDTH = SimdOf<double>::WIDTH;

/// the integers, or the doubles, beside a vector
template <class Vector>
using IntegersOf = typename SimdOf<Lane<Vector>>::Integers;
template <class Vector>
using DoublesOf = typename SimdOf<Lane<Vector>>::Doubles;

template <class Real>
inline typename SimdOf<Real>::Vector broadcast(Real value) {
    return typename SimdOf<Real>::Vector{} + value;
}

template <class Vector>
inline Vector loadVector(const Lane<Vector>* data) {
    typedef Lane<Vector> Unaligned __attribute__((vector_size(sizeof(Vector)), aligned(sizeof(Lane<Vector>))));
    return *reinterpret_cast<const Unaligned*>(data);
}

template <class Real>
inline typename SimdOf<Real>::Vector load(const Real* data) {
    return loadVector<typename SimdOf<Real>::Vector>(data);
}

/**
 * As many integers as there are numbers of a type in a vector.
 */
template <class Real>
inline typename SimdOf<Real>::Integers loadIntegers(const int* data) {
    typedef int32_t Unaligned __attribute__((vector_size(4 * SimdOf<Real>::WIDTH), aligned(4)));
    return __builtin_convertvector(*reinterpret_cast<const Unaligned*>(data), typename SimdOf<Real>::Integers);
}

template <class Vector>
inline void store(Lane<Vector>* data, Vector value) {
    typedef Lane<Vector> Unaligned __attribute__((vector_size(sizeof(Vector)), aligned(sizeof(Lane<Vector>))));
    *reinterpret_cast<Unaligned*>(data) = value;
}

template <class Vector>
inline Vector choose(IntegersOf<Vector> condition, Vector ifTrue, Vector ifFalse) {
    return condition ? ifTrue : ifFalse;
}

template <class Integers>
inline bool any(Integers condition) {
#if defined(__AVX512F__)
    return _mm512_test_epi32_mask((__m512i) condition, (__m512i) condition) != 0;
#elif defined(__AVX2__)
    return _mm256_movemask_epi8((__m256i) condition) != 0;
#else
    int64_t bits[2] = {};
    store(bits, reinterpret_cast<SimdMask>(condition));
    return (bits[0] | bits[1]) != 0;
#endif
}

template <class Vector>
inline DoublesOf<Vector> toDoubles(Vector value) {
    return __builtin_convertvector(value, DoublesOf<Vector>);
}

template <class Vector>
inline double sum(Vector value) {
    double total = 0;
    for (int lane = 0; lane < int(sizeof(Vector) / sizeof(value[0])); lane++)
        total += value[lane];
    return total;
}

template <class Vector>
inline Vector absolute(Vector value) {
    typedef IntegersOf<Vector> Integers;
    return reinterpret_cast<Vector>(reinterpret_cast<Integers>(value) & std::numeric_limits<Lane<Integers>>::max());
}

/**
 * The magnitude of one vector with the sign of another.
 */
template <class Vector>
inline Vector copySign(Vector magnitude, Vector sign) {
    typedef IntegersOf<Vector> Integers;
    return reinterpret_cast<Vector>(reinterpret_cast<Integers>(magnitude) |
                                    (reinterpret_cast<Integers>(sign) & std::numeric_limits<Lane<Integers>>::min()));
}

inline SimdOf<double>::Vector squareRoot(SimdOf<double>::Vector x) {
#if defined(__AVX512F__)
    return (SimdOf<double>::Vector) _mm512_sqrt_pd((__m512d) x);
#elif defined(__AVX2__)
    return (SimdOf<double>::Vector) _mm256_sqrt_pd((__m256d) x);
#else
    for (int lane = 0; lane < SimdOf<double>::WIDTH; lane++)
        x[lane] = std::sqrt(x[lane]);
    return x;
#endif
}

inline SimdOf<float>::Vector squareRoot(SimdOf<float>::Vector x) {
#if defined(__AVX512F__)
    return (SimdOf<float>::Vector) _mm512_sqrt_ps((__m512) x);
#elif defined(__AVX2__)
    return (SimdOf<float>::Vector) _mm256_sqrt_ps((__m256) x);
#else
    for (int lane = 0; lane < SimdOf<float>::WIDTH; lane++)
        x[lane] = std::sqrt(x[lane]);
    return x;
#endif
}

/**
 * 1/sqrt(x).  AVX-512 has an estimate of 14 bits, which one Newton iteration makes a float and two a double; it takes a
 * fifth of the time of a root and a division.
 */
template <class Vector>
inline Vector inverseSqrt(Vector x) {
#if defined(__AVX512F__)
    typedef Lane<Vector> Real;
    Vector half = Real(0.5) * x, y;
    if constexpr (sizeof(Real) == sizeof(double)) {
        y = (Vector) _mm512_rsqrt14_pd((__m512d) x);
        y = y * (Real(1.5) - half * y * y);
    }
    else
        y = (Vector) _mm512_rsqrt14_ps((__m512) x);
    return y + y * (Real(0.5) - half * y * y);
#else
    return Lane<Vector>(1) / squareRoot(x);
#endif
}

/**
 * x/y, likewise.
 */
template <class Vector>
inline Vector divide(Vector x, Vector y) {
#if defined(__AVX512F__)
    typedef Lane<Vector> Real;
    Vector inverse;
    if constexpr (sizeof(Real) == sizeof(double)) {
        inverse = (Vector) _mm512_rcp14_pd((__m512d) y);
        inverse = inverse + inverse * (Real(1) - y * inverse);
        inverse = inverse + inverse * (Real(1) - y * inverse);
    }
    else
        inverse = (Vector) _mm512_rcp14_ps((__m512) y);
    Vector quotient = x * inverse;
    return quotient + inverse * (x - quotient * y);
#else
    return x / y;
#endif
}

/**
 * These operations by the names that HelfrichStencils.h uses.
 */
struct SimdMath {
    template <class Vector>
    static Vector absolute(Vector x) {
        return ::absolute(x);
    }
    template <class Vector>
    static Vector select(IntegersOf<Vector> condition, Vector ifTrue, Vector ifFalse) {
        return ::choose(condition, ifTrue, ifFalse);
    }
    template <class Vector>
    static Vector divide(Vector x, Vector y) {
        return ::divide(x, y);
    }
    template <class Vector>
    static Vector copySign(Vector magnitude, Vector sign) {
        return ::copySign(magnitude, sign);
    }
};

/**
 * exp(x) for x <= 0: 2^n times a Taylor polynomial of the rest, which is at most ln(2)/2; degree 13 leaves an error of
 * 4e-18, degree 7 one of 5e-9.
 */
template <class Vector>
inline Vector exponential(Vector x) {
    typedef Lane<Vector> Real;
    typedef IntegersOf<Vector> Integers;
    const bool isDouble = (sizeof(Real) == sizeof(double));
    const int DEGREE = isDouble ? 13 : 7, MANTISSA_BITS = isDouble ? 52 : 23;
    // The shift makes an addition round to an integer.  The first part of ln(2) has so few bits that its product with
    // the integer is exact.
    const Real shift = isDouble ? 6755399441055744.0 : 12582912.0, lowest = isDouble ? -700 : -86;
    const Real ln2 = isDouble ? 6.93147180369123816490e-01 : 0.693359375,
               ln2Rest = isDouble ? 1.90821492927058770002e-10 : -2.12194440054690583e-4;
    const Real c[] = {1,
                      1,
                      Real(1 / 2.0),
                      Real(1 / 6.0),
                      Real(1 / 24.0),
                      Real(1 / 120.0),
                      Real(1 / 720.0),
                      Real(1 / 5040.0),
                      Real(1 / 40320.0),
                      Real(1 / 362880.0),
                      Real(1 / 3628800.0),
                      Real(1 / 39916800.0),
                      Real(1 / 479001600.0),
                      Real(1 / 6227020800.0)};
    Vector shifted = x * Real(1.4426950408889634) + shift, n = shifted - shift;
    Vector rest = x - n * ln2 - n * ln2Rest;
    Vector value = broadcast(c[DEGREE]);
    for (int i = DEGREE - 1; i >= 0; i--)
        value = value * rest + c[i];
    Integers bits = reinterpret_cast<Integers>(value) + (reinterpret_cast<Integers>(shifted) << MANTISSA_BITS);
    return choose(x > lowest, reinterpret_cast<Vector>(bits), Vector{});
}

/**
 * Load the points (x, y, z, unused) that start at the given offsets.  They must be aligned to 32 bytes.
 */
inline void loadPoints(const double* data, const int* offsets, Simd& x, Simd& y, Simd& z) {
#if defined(__AVX512F__)
    auto rows = [&](int a, int b) {
        return _mm512_insertf64x4(_mm512_castpd256_pd512(_mm256_load_pd(data + offsets[a])),
                                  _mm256_load_pd(data + offsets[b]), 1);
    };
    __m512d r02 = rows(0, 2), r13 = rows(1, 3), r46 = rows(4, 6), r57 = rows(5, 7);
    __m512d low0 = _mm512_unpacklo_pd(r02, r13), low4 = _mm512_unpacklo_pd(r46, r57);
    __m512d high0 = _mm512_unpackhi_pd(r02, r13), high4 = _mm512_unpackhi_pd(r46, r57);
    x = (Simd) _mm512_shuffle_f64x2(low0, low4, 0x88);
    y = (Simd) _mm512_shuffle_f64x2(high0, high4, 0x88);
    z = (Simd) _mm512_shuffle_f64x2(low0, low4, 0xDD);
#elif defined(__AVX2__)
    __m256d r0 = _mm256_load_pd(data + offsets[0]), r1 = _mm256_load_pd(data + offsets[1]);
    __m256d r2 = _mm256_load_pd(data + offsets[2]), r3 = _mm256_load_pd(data + offsets[3]);
    __m256d low01 = _mm256_unpacklo_pd(r0, r1), low23 = _mm256_unpacklo_pd(r2, r3);
    __m256d high01 = _mm256_unpackhi_pd(r0, r1), high23 = _mm256_unpackhi_pd(r2, r3);
    x = (Simd) _mm256_permute2f128_pd(low01, low23, 0x20);
    y = (Simd) _mm256_permute2f128_pd(high01, high23, 0x20);
    z = (Simd) _mm256_permute2f128_pd(low01, low23, 0x31);
#else
    for (int lane = 0; lane < WIDTH; lane++) {
        const double* point = data + offsets[lane];
        x[lane] = point[0];
        y[lane] = point[1];
        z[lane] = point[2];
    }
#endif
}

/**
 * Store points (x, y, z, 0) one after the other.  They must be aligned to 32 bytes.
 */
inline void storePoints(double* data, SimdOf<double>::Vector x, SimdOf<double>::Vector y, SimdOf<double>::Vector z) {
#if defined(__AVX512F__)
    __m512d zero = _mm512_setzero_pd();
    auto storeRows = [&](int n, __m512d xy, __m512d z0) {
        __m512d r02 = _mm512_permutex2var_pd(xy, _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11), z0);
        __m512d r46 = _mm512_permutex2var_pd(xy, _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15), z0);
        _mm256_store_pd(data + 4 * n, _mm512_castpd512_pd256(r02));
        _mm256_store_pd(data + 4 * n + 8, _mm512_extractf64x4_pd(r02, 1));
        _mm256_store_pd(data + 4 * n + 16, _mm512_castpd512_pd256(r46));
        _mm256_store_pd(data + 4 * n + 24, _mm512_extractf64x4_pd(r46, 1));
    };
    storeRows(0, _mm512_unpacklo_pd((__m512d) x, (__m512d) y), _mm512_unpacklo_pd((__m512d) z, zero));
    storeRows(1, _mm512_unpackhi_pd((__m512d) x, (__m512d) y), _mm512_unpackhi_pd((__m512d) z, zero));
#elif defined(__AVX2__)
    __m256d zero = _mm256_setzero_pd();
    auto storeRows = [&](int n, __m256d xy, __m256d z0) {
        _mm256_store_pd(data + 4 * n, _mm256_permute2f128_pd(xy, z0, 0x20));
        _mm256_store_pd(data + 4 * n + 8, _mm256_permute2f128_pd(xy, z0, 0x31));
    };
    storeRows(0, _mm256_unpacklo_pd((__m256d) x, (__m256d) y), _mm256_unpacklo_pd((__m256d) z, zero));
    storeRows(1, _mm256_unpackhi_pd((__m256d) x, (__m256d) y), _mm256_unpackhi_pd((__m256d) z, zero));
#else
    for (int lane = 0; lane < SimdOf<double>::WIDTH; lane++) {
        double* point = data + 4 * lane;
        point[0] = x[lane];
        point[1] = y[lane];
        point[2] = z[lane];
        point[3] = 0;
    }
#endif
}

/**
 * The same for numbers in single precision.
 */
inline void storePoints(double* data, SimdOf<float>::Vector x, SimdOf<float>::Vector y, SimdOf<float>::Vector z) {
    const int HALF = SimdOf<double>::WIDTH;
    typedef float Half __attribute__((vector_size(4 * HALF), aligned(4)));
    auto toDouble = [](const SimdOf<float>::Vector& values, int half) {
        return __builtin_convertvector(reinterpret_cast<const Half*>(&values)[half], SimdOf<double>::Vector);
    };
    for (int half = 0; half < 2; half++)
        storePoints(data + half * 4 * HALF, toDouble(x, half), toDouble(y, half), toDouble(z, half));
}

/**
 * Load the points of 16 bytes, aligned to as many, that start at the given offsets.
 */
inline void loadPoints(const int32_t* data, const int* offsets, SimdOf<float>::Integers& x, SimdOf<float>::Integers& y,
                       SimdOf<float>::Integers& z) {
#if defined(__AVX2__)
    typedef SimdOf<float>::Integers Integers;
    auto point = [&](int n) { return _mm_load_si128(reinterpret_cast<const __m128i*>(data + offsets[n])); };
#if defined(__AVX512F__)
    auto rows = [&](int n) {
        __m512i result = _mm512_inserti32x4(_mm512_castsi128_si512(point(n)), point(n + 4), 1);
        return _mm512_inserti32x4(_mm512_inserti32x4(result, point(n + 8), 2), point(n + 12), 3);
    };
    __m512i r0 = rows(0), r1 = rows(1), r2 = rows(2), r3 = rows(3);
    __m512i low01 = _mm512_unpacklo_epi32(r0, r1), low23 = _mm512_unpacklo_epi32(r2, r3);
    x = (Integers) _mm512_unpacklo_epi64(low01, low23);
    y = (Integers) _mm512_unpackhi_epi64(low01, low23);
    z = (Integers) _mm512_unpacklo_epi64(_mm512_unpackhi_epi32(r0, r1), _mm512_unpackhi_epi32(r2, r3));
#else
    auto rows = [&](int n) { return _mm256_inserti128_si256(_mm256_castsi128_si256(point(n)), point(n + 4), 1); };
    __m256i r0 = rows(0), r1 = rows(1), r2 = rows(2), r3 = rows(3);
    __m256i low01 = _mm256_unpacklo_epi32(r0, r1), low23 = _mm256_unpacklo_epi32(r2, r3);
    x = (Integers) _mm256_unpacklo_epi64(low01, low23);
    y = (Integers) _mm256_unpackhi_epi64(low01, low23);
    z = (Integers) _mm256_unpacklo_epi64(_mm256_unpackhi_epi32(r0, r1), _mm256_unpackhi_epi32(r2, r3));
#endif
#else
    for (int lane = 0; lane < SimdOf<float>::WIDTH; lane++) {
        const int32_t* point = data + offsets[lane];
        x[lane] = point[0];
        y[lane] = point[1];
        z[lane] = point[2];
    }
#endif
}

/**
 * Load the numbers at a quarter of the given offsets.
 */
template <class Real>
inline typename SimdOf<Real>::Vector loadScalars(const Real* data, const int* offsets) {
    typename SimdOf<Real>::Vector result;
    for (int lane = 0; lane < SimdOf<Real>::WIDTH; lane++)
        result[lane] = data[offsets[lane] >> 2];
    return result;
}

} // namespace

#endif /*OPENMM_CPUSIMD_H_*/
