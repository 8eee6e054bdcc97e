#ifndef OPENMM_CPUHELFRICHKERNELS_H_
#define OPENMM_CPUHELFRICHKERNELS_H_

#include "CacheLineAllocator.h"
#include "CpuCoarseMeshes.h"
#include "CpuHelfrichLayout.h"
#include "CpuHelfrichLoops.h"
#include "CpuHelfrichMaterials.h"
#include "CpuHelfrichRepulsion.h"
#include "CpuInstructionSet.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include "openmmhelfrich/internal/TrajectoryStart.h"
#include "CpuEdgeFlipSweep.h"
#include "CpuSpeciesExchange.h"
#include "CpuVertexGeometry.h"
#include <memory>
#include <vector>

namespace HelfrichPlugin {

/**
 * Sums over all vertices.
 */
struct CpuMembraneSums {
    explicit CpuMembraneSums(int numSurfaces) : totals(numSurfaces), slopes(numSurfaces) {
    }
    /// the area is finite if those of all surfaces are
    double area = 0, bending = 0, tether = 0, gaussian = 0, line = 0;
    /// of each surface, and the derivatives of the energy by them
    std::vector<HelfrichTotals> totals, slopes;
};

/**
 * This kernel is invoked by HelfrichForce to compute the energy of a membrane and the forces on its vertices.
 *
 * Its threads share out chunks of vertices, each of one surface.  No vertex's result depends on another thread's, and
 * the chunks' sums are added up in their order, so that the number of threads does not change a bit of the result.
 */
class CpuCalcHelfrichForceKernel : public CalcHelfrichForceKernel {
public:
    CpuCalcHelfrichForceKernel(std::string name, const OpenMM::Platform& platform)
            : CalcHelfrichForceKernel(name, platform), loops(&getForProcessor<CpuHelfrichLoops>()) {
    }
    void initialize(const OpenMM::System& system, const HelfrichForce& force, const HelfrichMesh& mesh);
    bool execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, bool includeForces,
                 HelfrichEnergyTerms& terms);
    void computeGeometry(OpenMM::ContextImpl& context, const PeriodicBox& box, HelfrichGeometry& geometry);
    /**
     * Get the geometry at the present positions, which a sweep reads.  It is not computed again where the last
     * evaluation, that at the end of a trajectory for example, was at the same positions and went through the same
     * loop.
     *
     * @param context     the Context in which to execute the kernel
     * @param parameters  the moduli
     * @return the geometry, which is valid up to the next evaluation
     */
    const CpuVertexGeometry& getGeometry(OpenMM::ContextImpl& context, const HelfrichParameters& parameters);
    /**
     * Get the neighbors of each vertex for the present positions, partitioned as the present mesh is.  Who changes the
     * mesh may partition them anew.
     *
     * @param context     the Context in which to execute the kernel
     * @param parameters  those of the repulsion
     */
    CpuHelfrichNeighborList& getNeighborList(OpenMM::ContextImpl& context, const HelfrichParameters& parameters);
    bool canMakeTrajectory() const {
        return true;
    }
    bool makeTrajectory(OpenMM::ContextImpl& context, const HelfrichParameters& parameters,
                        const KickAndDriftSequence& sequence, bool mixed, IntegrateHamiltonianTrajectoryKernel* waves,
                        HelfrichEnergyTerms& terms);
private:
    typedef std::vector<double, CacheLineAllocator<double>> Array;
    void setLayoutWidth(int width);
    void chooseNumThreads(OpenMM::ContextImpl& context);
    /**
     * Call a function with the number of each chunk, on all threads.
     */
    template <class Function>
    void forEachChunk(const Function& function) const;
    void updateLayout();
    void setBox(const PeriodicBox& newBox);
    /**
     * Load the positions of a chunk.
     *
     * @return whether they are the same as before
     */
    bool loadPositions(const std::vector<OpenMM::Vec3>& source, int chunk);
    void loadPositions(OpenMM::ContextImpl& context);
    void loadState(OpenMM::ContextImpl& context, int chunk);
    void storeState(OpenMM::ContextImpl& context, const double* positions, int chunk) const;
    void computeRepulsion(const HelfrichParameters& parameters, const double* positions, int chunk, double* gradients);
    double addForces(const HelfrichParameters& parameters, const CpuMembraneSums& sums,
                     const CpuHelfrichArrays<double>& arrays, int chunk, std::vector<OpenMM::Vec3>& forces);
    HelfrichEnergyTerms getTerms(const HelfrichParameters& parameters, const CpuMembraneSums& sums) const;
    // Real is the type in which the loops compute.
    template <class Real>
    CpuHelfrichArrays<Real> prepareArrays(const HelfrichParameters& parameters);
    /**
     * Get whether an evaluation has the geometry that sweeps ask for: its loop is that of findGeometry().
     */
    bool canKeepGeometry(const HelfrichParameters& parameters) const;
    /**
     * Let the next evaluation keep the geometry.
     */
    void keepGeometry(CpuHelfrichArrays<double>& arrays);
    void findGeometry(OpenMM::ContextImpl& context, const HelfrichParameters& parameters);
    template <class Real>
    void computeGradient(const HelfrichParameters& parameters, const CpuMembraneSums& sums,
                         const CpuHelfrichArrays<Real>& arrays, int chunk, double* gradients);
    template <class Real>
    void move(const HelfrichParameters& parameters, const CpuMembraneSums& sums, const CpuHelfrichArrays<Real>& arrays,
              int chunk, const KickAndDrift& times, double* nextPositions);
    template <class Real>
    void kick(const HelfrichParameters& parameters, const CpuMembraneSums& sums, const CpuHelfrichArrays<Real>& arrays,
              int chunk, double time);
    template <class Real>
    void drift(const CpuHelfrichArrays<Real>& arrays, int chunk, double time, double* nextPositions);
    template <class Real>
    void moveAll(const HelfrichParameters& parameters, const CpuMembraneSums& sums,
                 const CpuHelfrichArrays<Real>& arrays, const KickAndDrift& times, double* nextPositions);
    template <class Real>
    bool makeSteps(OpenMM::ContextImpl& context, const HelfrichParameters& parameters,
                   const KickAndDriftSequence& sequence, HelfrichEnergyTerms& terms);
    bool roundPositions(CpuHelfrichArrays<float>& arrays);
    template <class Real>
    void computeEnergy(const HelfrichParameters& parameters, const CpuHelfrichArrays<Real>& arrays,
                       CpuMembraneSums& sums);
    void addUpSurfaces(CpuMembraneSums& sums) const;
    static void findSlopes(const HelfrichParameters& parameters, CpuMembraneSums& sums);
    void updateRepulsion(const HelfrichParameters& parameters, const double* positions);
    template <class Real>
    bool makeStep(const HelfrichParameters& parameters, CpuHelfrichArrays<Real>& arrays, const KickAndDrift& times,
                  double* nextPositions, CpuMembraneSums& sums, HelfrichEnergyTerms& terms);
    int getNumChunks() const;
    int getFirstGroup(int chunk) const;
    int getLastGroup(int chunk) const;
    int getFirstSlot(int chunk) const;
    int getLastSlot(int chunk) const;
    const CpuHelfrichLoops* loops;
    const HelfrichMesh* mesh;
    bool isPeriodic;
    int numThreads;
    long long revision;
    CpuHelfrichLayout layout;
    std::vector<CpuHelfrichLayout::Part> chunks;
    CpuHelfrichRepulsion repulsion;
    CpuHelfrichMaterials materials;
    Array positions, bendingSlopes, anglesPerLength;
    /// in a trajectory: where the vertices go, and for each slot the velocity and the inverse mass
    Array nextPositions, velocities;
    /// the geometry at the positions of slots, if it is known; whether its loop had a tether, and whether sweeps ask
    CpuVertexGeometry geometry;
    bool isGeometryKnown = false, hadTether = false, isGeometryWanted = false;
    /// in which the positions are
    PeriodicBox box;
    /// in a trajectory with coarser meshes: these, and the force on each slot
    CoarseMotion<CpuCoarseMeshes>* coarse = NULL;
    Array forces;
    /// in a trajectory with forces in single precision: of each slot x, y, z, unused
    std::vector<int, CacheLineAllocator<int>> fixedPositions;
    std::vector<int> particles;
    std::vector<CpuHelfrichSums> chunkSums;
    std::vector<CpuHelfrichBox> chunkBoxes;
};

/**
 * This kernel is invoked by HelfrichForce to make sweeps of edge flips.
 */
class CpuSweepEdgeFlipsKernel : public SweepEdgeFlipsKernel {
public:
    CpuSweepEdgeFlipsKernel(std::string name, const OpenMM::Platform& platform) : SweepEdgeFlipsKernel(name, platform) {
    }
    void initialize(const OpenMM::System& system, const HelfrichForce& force, HelfrichMesh& mesh,
                    CalcHelfrichForceKernel& calculation);
    bool execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, double kT, long long numAttempts,
                 const Philox& random, long long sweep, EdgeFlipStatistics& statistics);
private:
    HelfrichMesh* mesh;
    CpuCalcHelfrichForceKernel* calculation;
    std::unique_ptr<CpuEdgeFlipSweep> edgeFlips;
};

/**
 * This kernel is invoked by HelfrichForce to make sweeps of exchanges of species.
 */
class CpuExchangeSpeciesKernel : public ExchangeSpeciesKernel {
public:
    CpuExchangeSpeciesKernel(std::string name, const OpenMM::Platform& platform)
            : ExchangeSpeciesKernel(name, platform) {
    }
    void initialize(const OpenMM::System& system, const HelfrichForce& force, HelfrichMesh& mesh,
                    CalcHelfrichForceKernel& calculation);
    bool execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, const SpeciesProposal& proposal,
                 double kT, long long numAttempts, const Philox& random, long long sweep,
                 SpeciesExchangeStatistics& statistics);
private:
    HelfrichMesh* mesh;
    CpuCalcHelfrichForceKernel* calculation;
    std::unique_ptr<CpuSpeciesExchange> exchange;
};

/**
 * This kernel is invoked by HamiltonianTrajectoryIntegrator to move the particles.
 */
class CpuIntegrateHamiltonianTrajectoryKernel : public IntegrateHamiltonianTrajectoryKernel {
public:
    CpuIntegrateHamiltonianTrajectoryKernel(std::string name, const OpenMM::Platform& platform)
            : IntegrateHamiltonianTrajectoryKernel(name, platform) {
    }
    void initialize(const OpenMM::System& system);
    void setMultilevelWeight(double weight, const std::vector<const HelfrichMesh*>& meshes);
    std::vector<std::vector<CoarseVelocity>> getCoarseVelocities() const;
    void setCoarseVelocities(const std::vector<std::vector<CoarseVelocity>>& velocities);
    CoarseMotion<CpuCoarseMeshes>& getCoarseMotion() {
        return coarse;
    }
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
    // change the coarse velocities of a membrane, and find the motion that they give its vertices
    void findMotion(OpenMM::ContextImpl& context, const KickAndDrift& times, int membrane);
    std::vector<double> masses, inverseMasses, partEnergies;
    TrajectoryStart start;
    CoarseMotion<CpuCoarseMeshes> coarse;
    /// the motion that coarser meshes give each particle; of each vertex of a membrane a vector (x, y, z, unused), and
    /// its place among these
    std::vector<OpenMM::Vec3> motions;
    std::vector<double, CacheLineAllocator<double>> vectors;
    std::vector<int> places;
    double kT;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHKERNELS_H_*/
