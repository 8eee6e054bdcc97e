#ifndef OPENMM_HELFRICHKERNELS_H_
#define OPENMM_HELFRICHKERNELS_H_

#include "HelfrichForce.h"
#include "internal/HelfrichMesh.h"
#include "internal/HelfrichParameters.h"
#include "openmm/KernelImpl.h"
#include "openmm/Platform.h"
#include <string>

namespace HelfrichPlugin {

/**
 * This kernel is invoked by HelfrichForce to compute the energy of a membrane and the forces on its vertices.
 */
class CalcHelfrichForceKernel : public OpenMM::KernelImpl {
public:
    static std::string Name() {
        return "CalcHelfrichForce";
    }
    CalcHelfrichForceKernel(std::string name, const OpenMM::Platform& platform) : OpenMM::KernelImpl(name, platform) {
    }
    /**
     * Initialize the kernel.
     *
     * @param system  the System this kernel will be applied to
     * @param mesh    the live connectivity, which lasts as long as the kernel: its revision changes whenever it does
     */
    virtual void initialize(const OpenMM::System& system, const HelfrichMesh& mesh) = 0;
    /**
     * Compute the energy, and add the forces to those of the Context if they are wanted.
     *
     * @param context        the Context in which to execute the kernel
     * @param parameters     the moduli and targets
     * @param includeForces  true if forces should be computed
     * @return the terms of the energy
     */
    virtual HelfrichEnergyTerms execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, bool includeForces) = 0;
    /**
     * Compute areas, volume and curvatures.
     *
     * @param context  the Context in which to execute the kernel
     * @return the geometry, without the area difference
     */
    virtual HelfrichGeometry computeGeometry(OpenMM::ContextImpl& context) = 0;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHKERNELS_H_*/
