#ifndef OPENMM_REFERENCEHELFRICHKERNELS_H_
#define OPENMM_REFERENCEHELFRICHKERNELS_H_

#include "ReferenceCoarseMeshes.h"
#include "ReferenceHelfrichEnergy.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include "openmmhelfrich/internal/CoarseVelocities.h"
#include "openmmhelfrich/internal/TrajectoryStart.h"

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
    void computeGeometry(OpenMM::ContextImpl& context, const PeriodicBox& box, HelfrichGeometry& geometry);
private:
    const HelfrichMesh* mesh;
};

/**
 * This kernel is invoked by HelfrichForce to make sweeps of edge flips.
 */
class ReferenceSweepEdgeFlipsKernel : public SweepEdgeFlipsKernel {
public:
    ReferenceSweepEdgeFlipsKernel(std::string name, const OpenMM::Platform& platform)
            : SweepEdgeFlipsKernel(name, platform) {
    }
    void initialize(const OpenMM::System& system, const HelfrichForce& force, HelfrichMesh& mesh,
                    CalcHelfrichForceKernel& calculation);
    bool execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, double kT, long long numAttempts,
                 const Philox& random, long long sweep, EdgeFlipStatistics& statistics);
private:
    HelfrichMesh* mesh;
};

/**
 * This kernel is invoked by HelfrichForce to make sweeps of exchanges of species.
 */
class ReferenceExchangeSpeciesKernel : public ExchangeSpeciesKernel {
public:
    ReferenceExchangeSpeciesKernel(std::string name, const OpenMM::Platform& platform)
            : ExchangeSpeciesKernel(name, platform) {
    }
    void initialize(const OpenMM::System& system, const HelfrichForce& force, HelfrichMesh& mesh,
                    CalcHelfrichForceKernel& calculation);
    bool execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, const SpeciesProposal& proposal,
                 double kT, long long numAttempts, const Philox& random, long long sweep,
                 SpeciesExchangeStatistics& statistics);
private:
    HelfrichMesh* mesh;
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
    void setMultilevelWeight(double weight, const std::vector<const HelfrichMesh*>& meshes);
    std::vector<std::vector<CoarseVelocity>> getCoarseVelocities() const;
    void setCoarseVelocities(const std::vector<std::vector<CoarseVelocity>>& velocities);
    double begin(OpenMM::ContextImpl& context, double kT, double refreshment, const Philox& random,
                 long long trajectory);
    void move(OpenMM::ContextImpl& context, const KickAndDrift& times);
    double computeKineticEnergy(OpenMM::ContextImpl& context);
    double computeCoarseKineticEnergy() const;
    void reject(OpenMM::ContextImpl& context);
    void restore(OpenMM::ContextImpl& context);
private:
    // those of the start, times a factor
    void setVelocities(OpenMM::ContextImpl& context, double factor) const;
    std::vector<double> masses;
    TrajectoryStart start;
    CoarseMotion<ReferenceCoarseMeshes> coarse;
    double kT;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_REFERENCEHELFRICHKERNELS_H_*/
