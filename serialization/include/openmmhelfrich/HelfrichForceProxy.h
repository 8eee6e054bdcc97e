#ifndef OPENMM_HELFRICHFORCE_PROXY_H_
#define OPENMM_HELFRICHFORCE_PROXY_H_

#include "openmmhelfrich/internal/windowsExportHelfrich.h"
#include "openmm/serialization/SerializationProxy.h"

namespace HelfrichPlugin {

/**
 * This is a proxy for serializing HelfrichForce objects.  The triangles are one text of numbers, not a node each, so
 * that a membrane of millions of vertices remains practical.
 */
class OPENMM_EXPORT_HELFRICH HelfrichForceProxy : public OpenMM::SerializationProxy {
public:
    HelfrichForceProxy();
    void serialize(const void* object, OpenMM::SerializationNode& node) const;
    void* deserialize(const OpenMM::SerializationNode& node) const;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHFORCE_PROXY_H_*/
