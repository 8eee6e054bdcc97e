#ifndef OPENMM_EDGEFLIPINTEGRATOR_PROXY_H_
#define OPENMM_EDGEFLIPINTEGRATOR_PROXY_H_

#include "openmmhelfrich/internal/windowsExportHelfrich.h"
#include "openmm/serialization/SerializationProxy.h"

namespace HelfrichPlugin {

/**
 * This is a proxy for serializing EdgeFlipIntegrator objects.
 */
class OPENMM_EXPORT_HELFRICH EdgeFlipIntegratorProxy : public OpenMM::SerializationProxy {
public:
    EdgeFlipIntegratorProxy();
    void serialize(const void* object, OpenMM::SerializationNode& node) const;
    void* deserialize(const OpenMM::SerializationNode& node) const;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_EDGEFLIPINTEGRATOR_PROXY_H_*/
