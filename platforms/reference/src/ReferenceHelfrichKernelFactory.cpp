#include "ReferenceHelfrichKernelFactory.h"
#include "ReferenceHelfrichKernels.h"
#include "openmm/OpenMMException.h"
#include "openmm/Platform.h"
#include "openmm/internal/windowsExport.h"

using namespace HelfrichPlugin;
using namespace OpenMM;

extern "C" OPENMM_EXPORT void registerPlatforms() {
}

extern "C" OPENMM_EXPORT void registerKernelFactories() {
    // By name: CpuPlatform is a ReferencePlatform too, and has kernels of its own.

    for (int i = 0; i < Platform::getNumPlatforms(); i++) {
        Platform& platform = Platform::getPlatform(i);
        if (platform.getName() == "Reference") {
            KernelFactory* factory = new ReferenceHelfrichKernelFactory();
            platform.registerKernelFactory(CalcHelfrichForceKernel::Name(), factory);
            platform.registerKernelFactory(SweepEdgeFlipsKernel::Name(), factory);
            platform.registerKernelFactory(IntegrateHamiltonianTrajectoryKernel::Name(), factory);
        }
    }
}

extern "C" OPENMM_EXPORT void registerHelfrichReferenceKernelFactories() {
    registerKernelFactories();
}

KernelImpl* ReferenceHelfrichKernelFactory::createKernelImpl(std::string name, const Platform& platform,
                                                             ContextImpl& context) const {
    if (name == CalcHelfrichForceKernel::Name())
        return new ReferenceCalcHelfrichForceKernel(name, platform);
    if (name == SweepEdgeFlipsKernel::Name())
        return new ReferenceSweepEdgeFlipsKernel(name, platform);
    if (name == IntegrateHamiltonianTrajectoryKernel::Name())
        return new ReferenceIntegrateHamiltonianTrajectoryKernel(name, platform);
    throw OpenMMException("Tried to create kernel with illegal kernel name '" + name + "'");
}
