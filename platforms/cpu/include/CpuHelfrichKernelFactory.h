#ifndef OPENMM_CPUHELFRICHKERNELFACTORY_H_
#define OPENMM_CPUHELFRICHKERNELFACTORY_H_

#include "openmm/KernelFactory.h"

namespace HelfrichPlugin {

/**
 * This KernelFactory creates kernels for the CPU implementation of the Helfrich plugin.
 */
class CpuHelfrichKernelFactory : public OpenMM::KernelFactory {
public:
    OpenMM::KernelImpl* createKernelImpl(std::string name, const OpenMM::Platform& platform,
                                         OpenMM::ContextImpl& context) const;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHKERNELFACTORY_H_*/
