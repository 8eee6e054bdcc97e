#ifndef FUZZING_H_
#define FUZZING_H_

/* What the fuzzers have in common.  A fuzzer breaks what it finds broken by abort(): libFuzzer keeps the input that led
 * there. */

#include "Membranes.h"
#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include "openmmhelfrich/ShearWaveIntegrator.h"
#include "openmm/Context.h"
#include "openmm/OpenMMException.h"
#include "openmm/Platform.h"
#include "openmm/System.h"
#include "openmm/cpu/CpuPlatform.h"
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fuzzer/FuzzedDataProvider.h>
#include <string>
#include <vector>

extern "C" void registerHelfrichReferenceKernelFactories();
extern "C" void registerHelfrichCpuKernelFactories();

namespace HelfrichPlugin {

inline void require(bool condition, const char* what) {
    if (!condition) {
        std::fprintf(stderr, "Broken: %s\n", what);
        std::abort();
    }
}

/**
 * Both platforms, with one thread.
 */
inline std::vector<OpenMM::Platform*> getPlatforms() {
    static bool isRegistered = false;
    if (!isRegistered) {
        OpenMM::Platform::registerPlatform(new OpenMM::CpuPlatform());
        registerHelfrichReferenceKernelFactories();
        registerHelfrichCpuKernelFactories();
        OpenMM::Platform::getPlatform("CPU").setPropertyDefaultValue(OpenMM::CpuPlatform::CpuThreads(), "1");
        isRegistered = true;
    }
    return {&OpenMM::Platform::getPlatform("Reference"), &OpenMM::Platform::getPlatform("CPU")};
}

/**
 * An integrator that lets others call what its Context calls.
 */
class OpenIntegrator : public HybridMonteCarloIntegrator {
public:
    OpenIntegrator() : HybridMonteCarloIntegrator(300, 0.001, 2, 1.0, 0.5) {
        addMove(new ShearWaveIntegrator(300, 0.01, 1, 3, 1), 0.2);
        setRandomNumberSeed(1);
    }
    using HybridMonteCarloIntegrator::createCheckpoint;
    using HybridMonteCarloIntegrator::deserializeParameters;
    using HybridMonteCarloIntegrator::loadCheckpoint;
    using HybridMonteCarloIntegrator::serializeParameters;
};

inline bool isFinite(const std::vector<OpenMM::Vec3>& vectors) {
    for (auto& v : vectors)
        if (!std::isfinite(v[0]) || !std::isfinite(v[1]) || !std::isfinite(v[2]))
            return false;
    return true;
}

/**
 * Compute the energy and the forces, and require that they be finite.
 *
 * @return whether they can be computed: otherwise there was an OpenMMException
 */
inline bool isComputable(OpenMM::Context& context) {
    try {
        OpenMM::State state = context.getState(OpenMM::State::Energy | OpenMM::State::Forces);
        require(std::isfinite(state.getPotentialEnergy()), "an energy that is not finite");
        require(isFinite(state.getForces()), "a force that is not finite");
        return true;
    }
    catch (const OpenMM::OpenMMException&) {
        return false;
    }
}

/**
 * A System of the particles of a membrane, which takes possession of its forces.
 */
inline void fillSystem(OpenMM::System& system, int numParticles, const std::vector<HelfrichForce*>& forces) {
    for (int i = 0; i < numParticles; i++)
        system.addParticle(1);
    for (auto force : forces)
        system.addForce(force);
}

} // namespace HelfrichPlugin

#endif /*FUZZING_H_*/
