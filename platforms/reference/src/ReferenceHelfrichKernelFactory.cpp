#include "ReferenceHelfrichKernelFactory.h"
#include "ReferenceHelfrichKernels.h"
#include "openmm/OpenMMException.h"
#include "openmm/internal/windowsExport.h"

using namespace HelfrichPlugin;
using namespace OpenMM;

extern "C" OPENMM_EXPORT void registerPlatforms() {
}

extern "C" OPENMM_EXPORT void registerKernelFactories() {
    registerHelfrichKernels("Reference", []() -> KernelFactory* { return new ReferenceHelfrichKernelFactory(); });
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
    if (name == ExchangeSpeciesKernel::Name())
        return new ReferenceExchangeSpeciesKernel(name, platform);
    if (name == IntegrateHamiltonianTrajectoryKernel::Name())
        return new ReferenceIntegrateHamiltonianTrajectoryKernel(name, platform);
    throw OpenMMException("Tried to create kernel with illegal kernel name '" + name + "'");
}
