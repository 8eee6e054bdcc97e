#ifndef OPENMM_HELFRICHKERNELS_H_
#define OPENMM_HELFRICHKERNELS_H_

#include "HelfrichForce.h"
#include "internal/HelfrichMesh.h"
#include "internal/HelfrichParameters.h"
#include "internal/Philox.h"
#include "internal/SpeciesProposal.h"
#include "internal/Splitting.h"
#include "internal/windowsExportHelfrich.h"
#include "openmm/KernelFactory.h"
#include "openmm/KernelImpl.h"
#include "openmm/OpenMMException.h"
#include "openmm/Platform.h"
#include "openmm/Vec3.h"
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace HelfrichPlugin {

class IntegrateHamiltonianTrajectoryKernel;

/**
 * Get whether the totals of a geometry are finite, that of the curvature if it is needed.
 */
inline bool isFinite(const HelfrichGeometry& geometry, bool needsCurvature) {
    return std::isfinite(geometry.area) && std::isfinite(geometry.volume) &&
           (!needsCurvature || std::isfinite(geometry.integratedMeanCurvature));
}

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
     * @param force   the HelfrichForce this kernel will be used for
     * @param mesh    the live connectivity, which lasts as long as the kernel: its revision changes whenever it does
     */
    virtual void initialize(const OpenMM::System& system, const HelfrichForce& force, const HelfrichMesh& mesh) = 0;
    /**
     * Copy changed parameters over to a Context.  A kernel that keeps no more of them than execute() is given has
     * nothing to do.
     *
     * @param context  the Context to copy parameters to
     * @param force    the HelfrichForce to copy the parameters from
     */
    virtual void copyParametersToContext(OpenMM::ContextImpl& context, const HelfrichForce& force) {
    }
    /**
     * Compute the energy, and add the forces to those of the Context if they are wanted.  Without forces this may be
     * called at any time, as computeGeometry() may, and not only while the Context is being evaluated.
     *
     * @param context        the Context in which to execute the kernel
     * @param parameters     the moduli and other parameters, with the present values of those that are the Context's
     * @param includeForces  true if forces should be computed
     * @param[out] terms     the terms of the energy
     * @return false if the area of a surface is not finite, as it is where a position is not, or a force is not: the
     * terms then have no meaning
     */
    virtual bool execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, bool includeForces,
                         HelfrichEnergyTerms& terms) = 0;
    /**
     * Compute areas, volume and curvatures.
     *
     * @param context        the Context in which to execute the kernel
     * @param box            the periodic box, if the surface is periodic; its volume is 0 then
     * @param[out] geometry  the geometry; the area differences are left as they are
     */
    virtual void computeGeometry(OpenMM::ContextImpl& context, const PeriodicBox& box, HelfrichGeometry& geometry) = 0;
    /**
     * Get whether makeTrajectory() can take the place of execute() and IntegrateHamiltonianTrajectoryKernel::move()
     * where no other force acts and every particle belongs to the surface.  It gives the same result, bit for bit, if
     * it computes the forces in double precision.
     */
    virtual bool canMakeTrajectory() const {
        return false;
    }
    /**
     * Make a trajectory.
     *
     * @param context     the Context in which to execute the kernel
     * @param parameters  the moduli and targets
     * @param sequence    the kicks and drifts; the last drift is 0
     * @param mixed       whether the forces may be computed in single precision.  They must be a function of the
     * positions alone all the same, and the terms in double precision.
     * @param waves       the kernel whose coarse velocities move the vertices too; NULL if there are none
     * @param[out] terms  the terms of the energy at the end
     * @return false if an area or an energy on the way is not finite; the positions and velocities are then those of
     * the last drift made, and so they are when it throws StepInterrupted
     */
    virtual bool makeTrajectory(OpenMM::ContextImpl& context, const HelfrichParameters& parameters,
                                const KickAndDriftSequence& sequence, bool mixed,
                                IntegrateHamiltonianTrajectoryKernel* waves, HelfrichEnergyTerms& terms) {
        throw OpenMM::OpenMMException("CalcHelfrichForceKernel: this platform makes no trajectories");
    }
};

/**
 * The outcome of attempted edge flips.
 */
struct EdgeFlipStatistics {
    long long attempted = 0, accepted = 0, forbidden = 0;
};

/**
 * This kernel is invoked by HelfrichForce to make sweeps of edge flips, which EdgeFlipIntegrator asks for.
 */
class SweepEdgeFlipsKernel : public OpenMM::KernelImpl {
public:
    /**
     * No number of attempts is greater than this.
     */
    static constexpr long long MAX_ATTEMPTS = 1LL << 33;
    /**
     * Get whether a sweep takes so long that to keep the triangles beforehand costs next to nothing.  Such a sweep may
     * throw StepInterrupted, and leaves the mesh changed then.
     */
    static bool isLong(long long numAttempts, const HelfrichMesh& mesh) {
        return numAttempts > std::max(100000LL, 4LL * mesh.getNumEdges());
    }
    static std::string Name() {
        return "SweepEdgeFlips";
    }
    SweepEdgeFlipsKernel(std::string name, const OpenMM::Platform& platform) : OpenMM::KernelImpl(name, platform) {
    }
    /**
     * Initialize the kernel.
     *
     * @param system       the System this kernel will be applied to
     * @param force        the HelfrichForce whose edges flip
     * @param mesh         the live connectivity, which lasts as long as the kernel
     * @param calculation  the kernel of the same platform that computes the force, which lasts as long, too
     */
    virtual void initialize(const OpenMM::System& system, const HelfrichForce& force, HelfrichMesh& mesh,
                            CalcHelfrichForceKernel& calculation) = 0;
    /**
     * Make a sweep: a sequential chain of attempts at the Context's positions, each to flip an edge that is drawn
     * uniformly.  drawEdgeFlip() has the random numbers of an attempt.  It is forbidden unless HelfrichMesh::canFlip(),
     * and otherwise accepted with probability min(1, exp(-dE/kT)), dE being the change of the whole energy of the
     * force.  The mesh is marked as changed if an attempt was accepted.
     *
     * @param context          the Context in which to execute the kernel
     * @param parameters       the moduli and targets
     * @param kT               the temperature, measured in kJ/mol
     * @param numAttempts      the number of flips to attempt, at most MAX_ATTEMPTS
     * @param random           the source of random numbers
     * @param sweep            the number of the sweep, which with that of the attempt is the counter of the random
     * numbers
     * @param[out] statistics  the outcome
     * @return false, with the mesh as it was, if the geometry is not finite
     */
    virtual bool execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, double kT,
                         long long numAttempts, const Philox& random, long long sweep,
                         EdgeFlipStatistics& statistics) = 0;
};

/**
 * The outcome of attempted changes of species.
 */
struct SpeciesExchangeStatistics {
    long long attempted = 0, accepted = 0, alike = 0;
};

/**
 * This kernel is invoked by HelfrichForce to make sweeps of exchanges of species, which SpeciesExchangeIntegrator asks
 * for.
 */
class ExchangeSpeciesKernel : public OpenMM::KernelImpl {
public:
    /**
     * No number of attempts is greater than this.
     */
    static constexpr long long MAX_ATTEMPTS = 1LL << 33;
    static std::string Name() {
        return "ExchangeSpecies";
    }
    ExchangeSpeciesKernel(std::string name, const OpenMM::Platform& platform) : OpenMM::KernelImpl(name, platform) {
    }
    /**
     * Initialize the kernel.
     *
     * @param system       the System this kernel will be applied to
     * @param force        the HelfrichForce whose vertices exchange species
     * @param mesh         the live connectivity and species, which last as long as the kernel
     * @param calculation  the kernel of the same platform that computes the force, which lasts as long, too
     */
    virtual void initialize(const OpenMM::System& system, const HelfrichForce& force, HelfrichMesh& mesh,
                            CalcHelfrichForceKernel& calculation) = 0;
    /**
     * Make a sweep: a sequential chain of attempts at the Context's positions and triangles.  SpeciesProposal::draw()
     * has the random numbers of an attempt.  It counts as one of alike vertices where it would change nothing, and is
     * otherwise accepted with probability min(1, exp(-dE/kT)), dE being the change of the whole energy of the force,
     * less that of the sum of the vertices' chemical potentials.  The species are marked as changed if an attempt was
     * accepted.  A sweep may throw StepInterrupted, and leaves the species changed then.
     *
     * @param context          the Context in which to execute the kernel
     * @param parameters       the moduli
     * @param proposal         what an attempt proposes
     * @param kT               the temperature, measured in kJ/mol
     * @param numAttempts      the number of changes to attempt, at most MAX_ATTEMPTS
     * @param random           the source of random numbers
     * @param sweep            the number of the sweep, which with that of the attempt is the counter of the random
     * numbers
     * @param[out] statistics  the outcome
     * @return false, with the species as they were, if the geometry is not finite and the energy depends on it
     */
    virtual bool execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters,
                         const SpeciesProposal& proposal, double kT, long long numAttempts, const Philox& random,
                         long long sweep, SpeciesExchangeStatistics& statistics) = 0;
};

/**
 * The velocity of a vertex of a coarser mesh.
 */
struct CoarseVelocity {
    /// 1 for the coarser mesh that is made of the membrane, 2 for the one that is made of that, and so on
    int level;
    /// the particle that the vertex stands for
    int particle;
    OpenMM::Vec3 velocity;
};

/**
 * This kernel is invoked by HamiltonianTrajectoryIntegrator to move the particles.
 */
class IntegrateHamiltonianTrajectoryKernel : public OpenMM::KernelImpl {
public:
    static std::string Name() {
        return "IntegrateHamiltonianTrajectory";
    }
    IntegrateHamiltonianTrajectoryKernel(std::string name, const OpenMM::Platform& platform)
            : OpenMM::KernelImpl(name, platform) {
    }
    /**
     * Initialize the kernel.
     *
     * @param system  the System this kernel will be applied to
     */
    virtual void initialize(const OpenMM::System& system) = 0;
    /**
     * Set what coarser meshes of the membranes weigh in the trajectories to come.  See
     * HamiltonianTrajectoryIntegrator::setMultilevelWeight() for the algorithm.
     *
     * @param weight  the weight of a level, as a multiple of that of the next finer one; 0 for no coarser meshes
     * @param meshes  the live connectivity of each membrane, which lasts as long as the kernel
     */
    virtual void setMultilevelWeight(double weight, const std::vector<const HelfrichMesh*>& meshes) = 0;
    /**
     * Get the velocities of the vertices of all coarser meshes, of one membrane after the other.
     */
    virtual std::vector<std::vector<CoarseVelocity>> getCoarseVelocities() const = 0;
    /**
     * Set what getCoarseVelocities() returned.
     */
    virtual void setCoarseVelocities(const std::vector<std::vector<CoarseVelocity>>& velocities) = 0;
    /**
     * Keep a copy of the positions and velocities, and draw those with which a trajectory begins.
     *
     * @param context      the Context in which to execute the kernel
     * @param kT           the temperature, measured in kJ/mol
     * @param refreshment  the factor of the velocities drawn; those that there are have the factor
     * sqrt(1-refreshment^2)
     * @param random       the source of random numbers
     * @param trajectory   the number of the trajectory, which with that of the particle is the counter of the random
     * numbers
     * @return the kinetic energy, with that of the coarser meshes
     */
    virtual double begin(OpenMM::ContextImpl& context, double kT, double refreshment, const Philox& random,
                         long long trajectory) = 0;
    /**
     * Change the velocities by the forces of the Context, and then move the particles.  The forces are zero afterwards.
     *
     * @param context  the Context in which to execute the kernel
     * @param times    the time for which the forces act, and that for which the particles move
     */
    virtual void move(OpenMM::ContextImpl& context, const KickAndDrift& times) = 0;
    /**
     * Compute the kinetic energy of the particles' own velocities.
     */
    virtual double computeKineticEnergy(OpenMM::ContextImpl& context) = 0;
    /**
     * Compute the kinetic energy of the vertices of all coarser meshes.
     */
    virtual double computeCoarseKineticEnergy() const = 0;
    /**
     * Go back to the positions and velocities with which begin() left the Context, and reverse the velocities: what
     * becomes of a trajectory that is rejected.
     */
    virtual void reject(OpenMM::ContextImpl& context) = 0;
    /**
     * Go back to the positions and velocities that begin() found in the Context.
     */
    virtual void restore(OpenMM::ContextImpl& context) = 0;
};

/**
 * Make a factory the one that creates all of these kernels for a platform, if there is such a platform.
 *
 * This is a function of the library so that every platform's plugin needs the library: whoever imports OpenMM alone can
 * then read the XML of its classes.
 *
 * @param platform       the name of the platform
 * @param createFactory  creates the factory
 */
OPENMM_EXPORT_HELFRICH void registerHelfrichKernels(const std::string& platform,
                                                    OpenMM::KernelFactory* (*createFactory)());

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHKERNELS_H_*/
