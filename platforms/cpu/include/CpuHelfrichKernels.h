#ifndef OPENMM_CPUHELFRICHKERNELS_H_
#define OPENMM_CPUHELFRICHKERNELS_H_

#include "CpuHelfrichLayout.h"
#include "CpuHelfrichPasses.h"
#include "CpuHelfrichRepulsion.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include <new>
#include <vector>

namespace HelfrichPlugin {

/**
 * An allocator of memory on cache lines.
 */
template <class T>
struct CacheLineAllocator {
    typedef T value_type;
    CacheLineAllocator() = default;
    template <class U>
    CacheLineAllocator(const CacheLineAllocator<U>&) {
    }
    T* allocate(size_t n) {
        return static_cast<T*>(::operator new(n*sizeof(T), std::align_val_t(64)));
    }
    void deallocate(T* data, size_t) {
        ::operator delete(data, std::align_val_t(64));
    }
    bool operator==(const CacheLineAllocator&) const {
        return true;
    }
    bool operator!=(const CacheLineAllocator&) const {
        return false;
    }
};

/**
 * This kernel is invoked by HelfrichForce to compute the energy of a membrane and the forces on its vertices.
 *
 * Its threads share out chunks of vertices.  No vertex's result depends on another thread's, and the chunks' sums are added up in their order, so that the number of threads
 * does not change a bit of the result.
 */
class CpuCalcHelfrichForceKernel : public CalcHelfrichForceKernel {
public:
    CpuCalcHelfrichForceKernel(std::string name, const OpenMM::Platform& platform) : CalcHelfrichForceKernel(name, platform), passes(getCpuHelfrichPasses()) {
    }
    void initialize(const OpenMM::System& system, const HelfrichMesh& mesh);
    bool execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, bool includeForces, HelfrichEnergyTerms& terms);
    void computeGeometry(OpenMM::ContextImpl& context, HelfrichGeometry& geometry);
private:
    typedef std::vector<double, CacheLineAllocator<double> > Array;
    void updateLayout();
    void resizeArrays(bool needsCurvature, bool needsGeometry);
    void compute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, bool includeForces, bool needsGeometry);
    void loadPositions(const std::vector<OpenMM::Vec3>& positions, int chunk);
    void addUpTotals();
    void computeForces(const HelfrichParameters& parameters, const HelfrichTotals& slopes, int chunk, std::vector<OpenMM::Vec3>& forces);
    void computeRepulsion(const HelfrichParameters& parameters, int chunk, double* gradients);
    int getNumChunks() const;
    int getFirstGroup(int chunk) const;
    int getLastGroup(int chunk) const;
    int getFirstSlot(int chunk) const;
    int getLastSlot(int chunk) const;
    const CpuHelfrichPasses& passes;
    const HelfrichMesh* mesh;
    long long revision;
    CpuHelfrichLayout layout;
    CpuHelfrichRepulsion repulsion;
    CpuHelfrichArrays arrays;
    Array positions, bendingSlopes, areas, curvatures, anglesPerLength;
    std::vector<int> particles;
    std::vector<CpuHelfrichSums> chunkSums;
    HelfrichTotals totals;
    double bendingEnergy, tetherEnergy, repulsionEnergy;
};

/**
 * This kernel is invoked by HamiltonianTrajectoryIntegrator to move the particles.
 */
class CpuIntegrateHamiltonianTrajectoryKernel : public IntegrateHamiltonianTrajectoryKernel {
public:
    CpuIntegrateHamiltonianTrajectoryKernel(std::string name, const OpenMM::Platform& platform) : IntegrateHamiltonianTrajectoryKernel(name, platform) {
    }
    void initialize(const OpenMM::System& system);
    double begin(OpenMM::ContextImpl& context, double kT, const Philox& random, long long trajectory);
    void move(OpenMM::ContextImpl& context, double velocityStep, double positionStep);
    double computeKineticEnergy(OpenMM::ContextImpl& context);
    void restore(OpenMM::ContextImpl& context);
private:
    void drawVelocities(OpenMM::ContextImpl& context);
    std::vector<double> inverseMasses, chunkEnergies;
    std::vector<OpenMM::Vec3> startPositions;
    Philox random = Philox(0, 0);
    double kT;
    long long trajectory;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHKERNELS_H_*/
