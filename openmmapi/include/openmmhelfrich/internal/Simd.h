#ifndef OPENMM_HELFRICH_SIMD_H_
#define OPENMM_HELFRICH_SIMD_H_

#include <cmath>
#include <cstdint>
#if defined(__AVX2__)
#include <immintrin.h>
#endif

/* Vectors of doubles of the width that the compiler's flags allow, and the few functions of them that the inner loops need.  They are in an unnamed namespace, for
   sources that include this with different flags are linked together. */

namespace {

#if defined(__AVX512F__)
const int WIDTH = 8;
#elif defined(__AVX2__)
const int WIDTH = 4;
#else
const int WIDTH = 2;
#endif

typedef double Simd __attribute__((vector_size(8*WIDTH)));
typedef int64_t SimdMask __attribute__((vector_size(8*WIDTH)));

inline Simd broadcast(double value) {
    return Simd{}+value;
}

typedef double UnalignedSimd __attribute__((vector_size(8*WIDTH), aligned(8)));

inline Simd load(const double* data) {
    return *reinterpret_cast<const UnalignedSimd*>(data);
}

typedef int UnalignedIntegers __attribute__((vector_size(4*WIDTH), aligned(4)));

inline SimdMask loadIntegers(const int* data) {
    return __builtin_convertvector(*reinterpret_cast<const UnalignedIntegers*>(data), SimdMask);
}

inline void store(double* data, Simd value) {
    *reinterpret_cast<UnalignedSimd*>(data) = value;
}

inline Simd choose(SimdMask condition, Simd ifTrue, Simd ifFalse) {
    return condition ? ifTrue : ifFalse;
}

inline bool any(SimdMask condition) {
#if defined(__AVX512F__)
    return _mm512_test_epi64_mask((__m512i) condition, (__m512i) condition) != 0;
#elif defined(__AVX2__)
    return _mm256_movemask_pd((__m256d) condition) != 0;
#else
    int64_t bits = 0;
    for (int lane = 0; lane < WIDTH; lane++)
        bits |= condition[lane];
    return bits != 0;
#endif
}

inline double sum(Simd value) {
    double total = 0;
    for (int lane = 0; lane < WIDTH; lane++)
        total += value[lane];
    return total;
}

inline Simd absolute(Simd value) {
    return reinterpret_cast<Simd>(reinterpret_cast<SimdMask>(value)&INT64_MAX);
}

/**
 * The magnitude of one vector with the sign of another.
 */
inline Simd copySign(Simd magnitude, Simd sign) {
    return reinterpret_cast<Simd>(reinterpret_cast<SimdMask>(magnitude)|(reinterpret_cast<SimdMask>(sign)&INT64_MIN));
}

/**
 * 1/sqrt(x).  AVX-512 has an estimate of 14 bits, which two Newton iterations make a double; it takes a fifth of the time of a root and a division.
 */
inline Simd inverseSqrt(Simd x) {
#if defined(__AVX512F__)
    Simd y = (Simd) _mm512_rsqrt14_pd((__m512d) x);
    Simd half = 0.5*x;
    y = y*(1.5-half*y*y);
    return y+y*(0.5-half*y*y);
#else
    Simd root;
#if defined(__AVX2__)
    root = (Simd) _mm256_sqrt_pd((__m256d) x);
#else
    for (int lane = 0; lane < WIDTH; lane++)
        root[lane] = std::sqrt(x[lane]);
#endif
    return 1.0/root;
#endif
}

/**
 * x/y, likewise.
 */
inline Simd divide(Simd x, Simd y) {
#if defined(__AVX512F__)
    Simd inverse = (Simd) _mm512_rcp14_pd((__m512d) y);
    inverse = inverse+inverse*(1.0-y*inverse);
    inverse = inverse+inverse*(1.0-y*inverse);
    Simd quotient = x*inverse;
    return quotient+inverse*(x-quotient*y);
#else
    return x/y;
#endif
}

/**
 * These operations by the names that HelfrichStencils.h uses.
 */
struct SimdMath {
    typedef Simd Real;
    static Simd absolute(Simd x) {
        return ::absolute(x);
    }
    static Simd select(SimdMask condition, Simd ifTrue, Simd ifFalse) {
        return ::choose(condition, ifTrue, ifFalse);
    }
    static Simd divide(Simd x, Simd y) {
        return ::divide(x, y);
    }
    static Simd copySign(Simd magnitude, Simd sign) {
        return ::copySign(magnitude, sign);
    }
};

/**
 * exp(x) for x <= 0: 2^n times a Taylor polynomial of degree 13 of the rest, which is at most ln(2)/2 and leaves an error of 4e-18.
 */
inline Simd exponential(Simd x) {
    const double roundingShift = 6755399441055744.0;
    Simd shifted = x*1.4426950408889634+roundingShift, n = shifted-roundingShift;
    Simd rest = x-n*6.93147180369123816490e-01-n*1.90821492927058770002e-10;
    const double c[] = {1, 1, 1/2.0, 1/6.0, 1/24.0, 1/120.0, 1/720.0, 1/5040.0, 1/40320.0, 1/362880.0, 1/3628800.0, 1/39916800.0, 1/479001600.0, 1/6227020800.0};
    Simd value = broadcast(c[13]);
    for (int i = 12; i >= 0; i--)
        value = value*rest+c[i];
    SimdMask bits = reinterpret_cast<SimdMask>(value)+(reinterpret_cast<SimdMask>(shifted)<<52);
    return choose(x > -700.0, reinterpret_cast<Simd>(bits), Simd{});
}

/**
 * Load the points (x, y, z, unused) that start at the given offsets.  They must be aligned to 32 bytes.
 */
inline void loadPoints(const double* data, const int* offsets, Simd& x, Simd& y, Simd& z) {
#if defined(__AVX512F__)
    auto rows = [&] (int a, int b) {
        return _mm512_insertf64x4(_mm512_castpd256_pd512(_mm256_load_pd(data+offsets[a])), _mm256_load_pd(data+offsets[b]), 1);
    };
    __m512d r02 = rows(0, 2), r13 = rows(1, 3), r46 = rows(4, 6), r57 = rows(5, 7);
    __m512d low0 = _mm512_unpacklo_pd(r02, r13), low4 = _mm512_unpacklo_pd(r46, r57);
    __m512d high0 = _mm512_unpackhi_pd(r02, r13), high4 = _mm512_unpackhi_pd(r46, r57);
    x = (Simd) _mm512_shuffle_f64x2(low0, low4, 0x88);
    y = (Simd) _mm512_shuffle_f64x2(high0, high4, 0x88);
    z = (Simd) _mm512_shuffle_f64x2(low0, low4, 0xDD);
#elif defined(__AVX2__)
    __m256d r0 = _mm256_load_pd(data+offsets[0]), r1 = _mm256_load_pd(data+offsets[1]);
    __m256d r2 = _mm256_load_pd(data+offsets[2]), r3 = _mm256_load_pd(data+offsets[3]);
    __m256d low01 = _mm256_unpacklo_pd(r0, r1), low23 = _mm256_unpacklo_pd(r2, r3);
    __m256d high01 = _mm256_unpackhi_pd(r0, r1), high23 = _mm256_unpackhi_pd(r2, r3);
    x = (Simd) _mm256_permute2f128_pd(low01, low23, 0x20);
    y = (Simd) _mm256_permute2f128_pd(high01, high23, 0x20);
    z = (Simd) _mm256_permute2f128_pd(low01, low23, 0x31);
#else
    for (int lane = 0; lane < WIDTH; lane++) {
        const double* point = data+offsets[lane];
        x[lane] = point[0];
        y[lane] = point[1];
        z[lane] = point[2];
    }
#endif
}

/**
 * Load the numbers at a quarter of the given offsets.
 */
inline Simd loadScalars(const double* data, const int* offsets) {
    Simd result;
    for (int lane = 0; lane < WIDTH; lane++)
        result[lane] = data[offsets[lane]>>2];
    return result;
}

/**
 * Load the numbers at the given offsets.
 */
inline Simd loadStrided(const double* data, const int* offsets) {
    Simd result;
    for (int lane = 0; lane < WIDTH; lane++)
        result[lane] = data[offsets[lane]];
    return result;
}

} // namespace

#endif /*OPENMM_HELFRICH_SIMD_H_*/
