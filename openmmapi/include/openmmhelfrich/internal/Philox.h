#ifndef OPENMM_HELFRICH_PHILOX_H_
#define OPENMM_HELFRICH_PHILOX_H_

#include <array>
#include <cstdint>

namespace HelfrichPlugin {

/**
 * The counter-based random number generator Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2,
 * 3", SC11, 2011).  It has no state: a key and a counter give four independent 32-bit words, so that any number of a
 * stream can be had in any order, and a restart needs nothing but the counter.
 */
class Philox {
public:
    /**
     * Create a generator.
     *
     * @param seed    the user's seed
     * @param stream  tells apart the independent uses of one seed: see RandomStream
     */
    Philox(uint32_t seed, uint32_t stream) : key{seed, stream} {
    }
    /**
     * Get the four random words of a counter.
     */
    std::array<uint32_t, 4> operator()(uint64_t high, uint64_t low) const {
        std::array<uint32_t, 4> c = {uint32_t(low), uint32_t(low >> 32), uint32_t(high), uint32_t(high >> 32)};
        uint32_t k0 = key[0], k1 = key[1];
        for (int round = 0; round < 10; round++) {
            uint64_t p0 = uint64_t(0xD2511F53) * c[0], p1 = uint64_t(0xCD9E8D57) * c[2];
            c = {uint32_t(p1 >> 32) ^ c[1] ^ k0, uint32_t(p1), uint32_t(p0 >> 32) ^ c[3] ^ k1, uint32_t(p0)};
            k0 += 0x9E3779B9;
            k1 += 0xBB67AE85;
        }
        return c;
    }
    /**
     * Convert two words to a double that is uniformly distributed in [0, 1).
     */
    static double uniform(uint32_t a, uint32_t b) {
        return ((uint64_t(a) << 32 | b) >> 11) * (1.0 / 9007199254740992.0);
    }
    /**
     * Convert a word and a half to an integer that is uniformly distributed in [0, n), but for a bias below n/2^64.
     */
    static uint32_t index(uint32_t a, uint32_t b, uint32_t n) {
        return uint32_t((uint64_t(a) * n + (uint64_t(b) * n >> 32)) >> 32);
    }
private:
    uint32_t key[2];
};

/**
 * The streams of random numbers that one seed gives.  The flips of the System's n'th HelfrichForce use EdgeFlips+n, and
 * its exchanges of species three from SpeciesExchanges+3n on, one for each kind of proposal.
 */
namespace RandomStream {
enum : uint32_t {
    MoveChoice = 0,
    Momenta = 1,
    TrajectoryTest = 2,
    ShearWaves = 3,
    ShearWaveTest = 4,
    TrajectoryLength = 5,
    Seeds = 6,
    EdgeFlips = 16,
    SpeciesExchanges = 1 << 24
};
}

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_PHILOX_H_*/
