#include "CpuHelfrichKernelFactory.h"
#include "CpuHelfrichKernels.h"
#include "openmm/OpenMMException.h"
#include "openmm/internal/windowsExport.h"

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

extern "C" OPENMM_EXPORT void registerPlatforms() {
}

extern "C" OPENMM_EXPORT void registerKernelFactories() {
    registerHelfrichKernels("CPU", []() -> KernelFactory* { return new CpuHelfrichKernelFactory(); });
}

extern "C" OPENMM_EXPORT void registerHelfrichCpuKernelFactories() {
    registerKernelFactories();
}

KernelImpl* CpuHelfrichKernelFactory::createKernelImpl(string name, const Platform& platform,
                                                       ContextImpl& context) const {
    if (name == CalcHelfrichForceKernel::Name())
        return new CpuCalcHelfrichForceKernel(name, platform);
    if (name == SweepEdgeFlipsKernel::Name())
        return new CpuSweepEdgeFlipsKernel(name, platform);
    if (name == ExchangeSpeciesKernel::Name())
        return new CpuExchangeSpeciesKernel(name, platform);
    if (name == IntegrateHamiltonianTrajectoryKernel::Name())
        return new CpuIntegrateHamiltonianTrajectoryKernel(name, platform);
    throw OpenMMException("Tried to create kernel with illegal kernel name '" + name + "'");
}
