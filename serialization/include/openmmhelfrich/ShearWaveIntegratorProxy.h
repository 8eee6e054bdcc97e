#ifndef OPENMM_SHEARWAVEINTEGRATOR_PROXY_H_
#define OPENMM_SHEARWAVEINTEGRATOR_PROXY_H_

#include "openmmhelfrich/internal/windowsExportHelfrich.h"
#include "openmm/serialization/SerializationProxy.h"

namespace HelfrichPlugin {

/**
 * This is a proxy for serializing ShearWaveIntegrator objects.
 */
class OPENMM_EXPORT_HELFRICH ShearWaveIntegratorProxy : public OpenMM::SerializationProxy {
public:
    ShearWaveIntegratorProxy();
    void serialize(const void* object, OpenMM::SerializationNode& node) const;
    void* deserialize(const OpenMM::SerializationNode& node) const;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_SHEARWAVEINTEGRATOR_PROXY_H_*/
