#ifndef OPENMM_REFERENCEHELFRICHKERNELS_H_
#define OPENMM_REFERENCEHELFRICHKERNELS_H_

#include "ReferenceHelfrichEnergy.h"
#include "openmmhelfrich/HelfrichKernels.h"

namespace HelfrichPlugin {

/**
 * This kernel is invoked by HelfrichForce to compute the energy of a membrane and the forces on its vertices.
 */
class ReferenceCalcHelfrichForceKernel : public CalcHelfrichForceKernel {
public:
    ReferenceCalcHelfrichForceKernel(std::string name, const OpenMM::Platform& platform)
            : CalcHelfrichForceKernel(name, platform) {
    }
    void initialize(const OpenMM::System& system, const HelfrichForce& force, const HelfrichMesh& mesh);
    bool execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, bool includeForces,
                 HelfrichEnergyTerms& terms);
    const std::vector<OpenMM::Vec3>& getPositions(OpenMM::ContextImpl& context);
    void computeGeometry(OpenMM::ContextImpl& context, HelfrichGeometry& geometry);
    HelfrichNeighborList& getNeighborList(OpenMM::ContextImpl& context, double onset);
private:
    ReferenceHelfrichEnergy::Vectors getVertexPositions(OpenMM::ContextImpl& context) const;
    const HelfrichMesh* mesh;
    HelfrichNeighborList neighbors;
};

/**
 * This kernel is invoked by HamiltonianTrajectoryIntegrator to move the particles.
 */
class ReferenceIntegrateHamiltonianTrajectoryKernel : public IntegrateHamiltonianTrajectoryKernel {
public:
    ReferenceIntegrateHamiltonianTrajectoryKernel(std::string name, const OpenMM::Platform& platform)
            : IntegrateHamiltonianTrajectoryKernel(name, platform) {
    }
    void initialize(const OpenMM::System& system);
    double begin(OpenMM::ContextImpl& context, double kT, double refreshment, const Philox& random,
                 long long trajectory);
    void move(OpenMM::ContextImpl& context, const KickAndDrift& times);
    double computeKineticEnergy(OpenMM::ContextImpl& context);
    void restore(OpenMM::ContextImpl& context);
private:
    std::vector<double> masses;
    std::vector<OpenMM::Vec3> startPositions, startVelocities;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_REFERENCEHELFRICHKERNELS_H_*/
