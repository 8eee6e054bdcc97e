#include "TestHelfrichForce.h"

extern "C" void registerHelfrichReferenceKernelFactories();

OpenMM::Platform& initializeTests() {
    registerHelfrichReferenceKernelFactories();
    return Platform::getPlatform("Reference");
}

void runPlatformTests() {
}
