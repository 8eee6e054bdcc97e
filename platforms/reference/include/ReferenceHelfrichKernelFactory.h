#ifndef OPENMM_REFERENCEHELFRICHKERNELFACTORY_H_
#define OPENMM_REFERENCEHELFRICHKERNELFACTORY_H_

#include "openmm/KernelFactory.h"

namespace HelfrichPlugin {

/**
 * This KernelFactory creates kernels for the reference implementation of the Helfrich plugin.
 */
class ReferenceHelfrichKernelFactory : public OpenMM::KernelFactory {
public:
    OpenMM::KernelImpl* createKernelImpl(std::string name, const OpenMM::Platform& platform,
                                         OpenMM::ContextImpl& context) const;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_REFERENCEHELFRICHKERNELFACTORY_H_*/
