#ifndef OPENMM_HELFRICH_MONTECARLOUTILITIES_H_
#define OPENMM_HELFRICH_MONTECARLOUTILITIES_H_

#include "Checks.h"
#include "HelfrichForceImpl.h"
#include "Philox.h"
#include "openmm/OpenMMException.h"
#include "openmm/System.h"
#include "openmm/Vec3.h"
#include "openmm/internal/ContextImpl.h"
#include "openmm/internal/OSRngSeed.h"
#include <algorithm>
#include <cmath>
#include <istream>
#include <ostream>
#include <string>
#include <vector>

/* What the Monte Carlo integrators and their kernels have in common. */

namespace HelfrichPlugin {

/**
 * The gas constant, measured in kJ/mol/K: exact, by the definitions of mole and kelvin of 2019.
 */
static const double BOLTZMANN = 8.31446261815324e-3;

/**
 * Throw an OpenMMException if a System has constraints or virtual sites.
 */
inline void requireFreeParticles(const OpenMM::System& system, const std::string& integrator) {
    if (system.getNumConstraints() > 0)
        throw OpenMM::OpenMMException(integrator + ": the System has " + std::to_string(system.getNumConstraints()) +
                                      " constraints; its trajectories support none");
    for (int i = 0; i < system.getNumParticles(); i++)
        if (system.isVirtualSite(i))
            throw OpenMM::OpenMMException(integrator + ": particle " + std::to_string(i) +
                                          " is a virtual site; its trajectories support none");
}

/**
 * Throw an OpenMMException if a System has a Force that OpenMM's Integrators ask to change the state now and then, and
 * none of the Context's Integrators does.
 */
void requireActingForces(OpenMM::ContextImpl& context, const std::string& integrator);

/**
 * Find a HelfrichForce that another Force of a System computes in a Context of its own, or NULL if there is none.
 */
const HelfrichForce* findHiddenMembrane(const OpenMM::System& system);

/**
 * Find the membranes of a Context.
 */
inline std::vector<HelfrichForceImpl*> findMembranes(OpenMM::ContextImpl& context) {
    std::vector<HelfrichForceImpl*> membranes;
    for (OpenMM::ForceImpl* impl : context.getForceImpls())
        if (HelfrichForceImpl* membrane = dynamic_cast<HelfrichForceImpl*>(impl))
            membranes.push_back(membrane);
    return membranes;
}

/**
 * Get the seed of a Context's random numbers: the one that was asked for, or a unique one for 0.
 */
inline unsigned int chooseSeed(int seed) {
    return seed == 0 ? osrngseed() : seed;
}

/**
 * Draw three independent numbers from the standard normal distribution (Box and Muller, 1958).
 */
inline OpenMM::Vec3 drawNormals(const Philox& random, uint64_t high, uint64_t low) {
    const double twoPi = 6.283185307179586;
    auto a = random(high, 2 * low), b = random(high, 2 * low + 1);
    double radius1 = std::sqrt(-2 * std::log(1 - Philox::uniform(a[0], a[1]))),
           angle1 = twoPi * Philox::uniform(a[2], a[3]);
    double radius2 = std::sqrt(-2 * std::log(1 - Philox::uniform(b[0], b[1]))),
           angle2 = twoPi * Philox::uniform(b[2], b[3]);
    return OpenMM::Vec3(radius1 * std::cos(angle1), radius1 * std::sin(angle1), radius2 * std::cos(angle2));
}

/**
 * Write a value to a checkpoint.
 */
template <class T>
void writeBinary(std::ostream& stream, const T& value) {
    stream.write((const char*) &value, sizeof(T));
}

/**
 * Read a value from a checkpoint.
 */
template <class T>
void readBinary(std::istream& stream, T& value) {
    if (!stream.read((char*) &value, sizeof(T)))
        throw OpenMM::OpenMMException("loadCheckpoint: the checkpoint ends too early");
}

/**
 * What tells apart the kinds of data in a checkpoint: so many characters.
 */
static const int NUM_MAGIC_BYTES = 8;

inline void writeMagic(std::ostream& stream, const char* magicBytes) {
    stream.write(magicBytes, NUM_MAGIC_BYTES);
}

/**
 * Read what writeMagic() wrote.
 *
 * @return false, with the stream as it was, if there is something else
 */
inline bool readMagic(std::istream& stream, const char* magicBytes) {
    char found[NUM_MAGIC_BYTES];
    std::istream::pos_type start = stream.tellg();
    if (stream.read(found, NUM_MAGIC_BYTES) && std::equal(found, found + NUM_MAGIC_BYTES, magicBytes))
        return true;
    stream.clear();
    stream.seekg(start);
    return false;
}

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_MONTECARLOUTILITIES_H_*/
