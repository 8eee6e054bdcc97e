#ifndef OPENMM_HAMILTONIANTRAJECTORYINTEGRATOR_PROXY_H_
#define OPENMM_HAMILTONIANTRAJECTORYINTEGRATOR_PROXY_H_

#include "openmmhelfrich/internal/windowsExportHelfrich.h"
#include "openmm/serialization/SerializationProxy.h"

namespace HelfrichPlugin {

/**
 * This is a proxy for serializing HamiltonianTrajectoryIntegrator objects.
 */
class OPENMM_EXPORT_HELFRICH HamiltonianTrajectoryIntegratorProxy : public OpenMM::SerializationProxy {
public:
    HamiltonianTrajectoryIntegratorProxy();
    void serialize(const void* object, OpenMM::SerializationNode& node) const;
    void* deserialize(const OpenMM::SerializationNode& node) const;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HAMILTONIANTRAJECTORYINTEGRATOR_PROXY_H_*/
