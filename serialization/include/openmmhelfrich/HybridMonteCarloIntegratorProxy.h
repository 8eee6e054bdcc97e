#ifndef OPENMM_HYBRIDMONTECARLOINTEGRATOR_PROXY_H_
#define OPENMM_HYBRIDMONTECARLOINTEGRATOR_PROXY_H_

#include "openmmhelfrich/internal/windowsExportHelfrich.h"
#include "openmm/serialization/SerializationProxy.h"

namespace HelfrichPlugin {

/**
 * This is a proxy for serializing HybridMonteCarloIntegrator objects.  The moves are child nodes, written by their own
 * proxies.
 */
class OPENMM_EXPORT_HELFRICH HybridMonteCarloIntegratorProxy : public OpenMM::SerializationProxy {
public:
    HybridMonteCarloIntegratorProxy();
    void serialize(const void* object, OpenMM::SerializationNode& node) const;
    void* deserialize(const OpenMM::SerializationNode& node) const;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HYBRIDMONTECARLOINTEGRATOR_PROXY_H_*/
