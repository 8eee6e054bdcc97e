#include "openmmhelfrich/HelfrichKernels.h"

using namespace OpenMM;
using namespace std;

void HelfrichPlugin::registerHelfrichKernels(const string& platform, KernelFactory* (*createFactory)()) {
    // By name: OpenMM's CpuPlatform is a ReferencePlatform too, and has kernels of its own.

    for (int i = 0; i < Platform::getNumPlatforms(); i++) {
        Platform& candidate = Platform::getPlatform(i);
        if (candidate.getName() != platform)
            continue;
        KernelFactory* factory = createFactory();
        for (const string& kernel : {CalcHelfrichForceKernel::Name(), SweepEdgeFlipsKernel::Name(),
                                     ExchangeSpeciesKernel::Name(), IntegrateHamiltonianTrajectoryKernel::Name()})
            candidate.registerKernelFactory(kernel, factory);
    }
}
