#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/HelfrichForceProxy.h"
#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include "openmmhelfrich/HybridMonteCarloIntegratorProxy.h"
#include "openmmhelfrich/MonteCarloIntegratorProxies.h"

using namespace HelfrichPlugin;
using namespace OpenMM;

// Runs when the library is loaded.
#ifdef _MSC_VER
#include <windows.h>
extern "C" OPENMM_EXPORT_HELFRICH void registerHelfrichSerializationProxies();
BOOL WINAPI DllMain(HANDLE module, DWORD reason, LPVOID reserved) {
    if (reason == DLL_PROCESS_ATTACH)
        registerHelfrichSerializationProxies();
    return TRUE;
}
#else
extern "C" void __attribute__((constructor)) registerHelfrichSerializationProxies();
#endif

extern "C" OPENMM_EXPORT_HELFRICH void registerHelfrichSerializationProxies() {
    SerializationProxy::registerProxy(typeid(HelfrichForce), new HelfrichForceProxy());
    SerializationProxy::registerProxy(typeid(HybridMonteCarloIntegrator), new HybridMonteCarloIntegratorProxy());
    registerMonteCarloIntegratorProxies();
}
