#include "TestHelfrichForce.h"
#include "openmm/cpu/CpuPlatform.h"
#include <cstdlib>

extern "C" void registerHelfrichCpuKernelFactories();

OpenMM::Platform& initializeTests() {
    if (!CpuPlatform::isProcessorSupported()) {
        cout << "The CPU platform does not support this processor." << endl;
        exit(0);
    }
    Platform::registerPlatform(new CpuPlatform());
    registerHelfrichCpuKernelFactories();
    return Platform::getPlatform("CPU");
}
