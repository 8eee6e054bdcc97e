#include "CpuHelfrichKernelFactory.h"
#include "CpuHelfrichKernels.h"
#include "openmm/OpenMMException.h"
#include "openmm/Platform.h"
#include "openmm/internal/windowsExport.h"
#include <cstdlib>
#include <string>
#include <vector>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

extern "C" OPENMM_EXPORT void registerPlatforms() {
}

extern "C" OPENMM_EXPORT void registerKernelFactories() {
    for (int i = 0; i < Platform::getNumPlatforms(); i++) {
        Platform& platform = Platform::getPlatform(i);
        if (platform.getName() == "CPU") {
            KernelFactory* factory = new CpuHelfrichKernelFactory();
            platform.registerKernelFactory(CalcHelfrichForceKernel::Name(), factory);
            platform.registerKernelFactory(IntegrateHamiltonianTrajectoryKernel::Name(), factory);
        }
    }
}

extern "C" OPENMM_EXPORT void registerHelfrichCpuKernelFactories() {
    registerKernelFactories();
}

KernelImpl* CpuHelfrichKernelFactory::createKernelImpl(string name, const Platform& platform, ContextImpl& context) const {
    if (name == CalcHelfrichForceKernel::Name())
        return new CpuCalcHelfrichForceKernel(name, platform);
    if (name == IntegrateHamiltonianTrajectoryKernel::Name())
        return new CpuIntegrateHamiltonianTrajectoryKernel(name, platform);
    throw OpenMMException("Tried to create kernel with illegal kernel name '"+name+"'");
}

namespace HelfrichPlugin {

extern const CpuHelfrichPasses cpuHelfrichPassesBaseline;
#ifdef HELFRICH_HAS_AVX2
extern const CpuHelfrichPasses cpuHelfrichPassesAVX2;
#endif
#ifdef HELFRICH_HAS_AVX512
extern const CpuHelfrichPasses cpuHelfrichPassesAVX512;
#endif

/**
 * Get the passes that this processor can execute, the best last.
 */
static vector<const CpuHelfrichPasses*> findSupportedPasses() {
    vector<const CpuHelfrichPasses*> supported = {&cpuHelfrichPassesBaseline};
#ifdef HELFRICH_HAS_AVX2
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        supported.push_back(&cpuHelfrichPassesAVX2);
#endif
#ifdef HELFRICH_HAS_AVX512
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
        supported.push_back(&cpuHelfrichPassesAVX512);
#endif
    return supported;
}

const CpuHelfrichPasses& getCpuHelfrichPasses() {
    vector<const CpuHelfrichPasses*> supported = findSupportedPasses();
    const char* wanted = getenv("OPENMM_HELFRICH_SIMD");
    if (wanted == NULL || *wanted == 0)
        return *supported.back();
    string names;
    for (auto passes : supported) {
        if (string(wanted) == passes->name)
            return *passes;
        names += string(names.empty() ? "" : ", ")+passes->name;
    }
    throw OpenMMException("HelfrichForce: OPENMM_HELFRICH_SIMD is '"+string(wanted)+"'; this processor and build support "+names);
}

} // namespace HelfrichPlugin
