#ifndef OPENMM_HELFRICH_MONTECARLOUTILITIES_H_
#define OPENMM_HELFRICH_MONTECARLOUTILITIES_H_

#include "Checks.h"
#include "HelfrichForceImpl.h"
#include "Philox.h"
#include "openmm/OpenMMException.h"
#include "openmm/System.h"
#include "openmm/Vec3.h"
#include "openmm/internal/ContextImpl.h"
#include <cmath>
#include <istream>
#include <ostream>
#include <string>
#include <vector>

/* What the Monte Carlo integrators have in common. */

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
 * Get whether no force acts in a Context but those of membranes.
 */
inline bool hasOnlyMembranes(OpenMM::ContextImpl& context) {
    for (OpenMM::ForceImpl* impl : context.getForceImpls())
        if (dynamic_cast<HelfrichForceImpl*>(impl) == NULL)
            return false;
    return true;
}

/**
 * Compute the energy of a Context whose energy has been computed before, and add the forces.  What a platform prepares
 * for its own forces takes as long as a membrane's own: it is left out where there are none.
 */
inline double calcForcesAndEnergy(OpenMM::ContextImpl& context, bool hasOnlyMembranes, bool includeForces,
                                  bool includeEnergy, int groups) {
    if (!hasOnlyMembranes)
        return context.calcForcesAndEnergy(includeForces, includeEnergy, groups);
    double energy = 0;
    for (OpenMM::ForceImpl* impl : context.getForceImpls())
        energy += impl->calcForcesAndEnergy(context, includeForces, includeEnergy, groups);
    return energy;
}

/**
 * Compute the kinetic energy of a Context.
 */
inline double computeKineticEnergy(OpenMM::ContextImpl& context) {
    std::vector<OpenMM::Vec3> velocities;
    context.getVelocities(velocities);
    double energy = 0;
    for (int i = 0; i < (int) velocities.size(); i++)
        energy += 0.5 * context.getSystem().getParticleMass(i) * velocities[i].dot(velocities[i]);
    return energy;
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

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_MONTECARLOUTILITIES_H_*/
