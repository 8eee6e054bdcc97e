#ifndef OPENMM_CPUHELFRICHKERNELS_H_
#define OPENMM_CPUHELFRICHKERNELS_H_

#include "CpuHelfrichLayout.h"
#include "CpuHelfrichPasses.h"
#include "CpuHelfrichRepulsion.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include <cstdlib>
#include <memory>
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
    HelfrichEnergyTerms execute(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, bool includeForces);
    HelfrichGeometry computeGeometry(OpenMM::ContextImpl& context);
private:
    typedef std::vector<double, CacheLineAllocator<double> > Array;
    void updateLayout();
    void resizeArrays(const HelfrichParameters& parameters, bool needsCurvature);
    void loadPositions(const std::vector<OpenMM::Vec3>& positions, int firstSlot, int lastSlot);
    void computeEnergies(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, bool needsCurvature);
    void addForces(OpenMM::ContextImpl& context, const HelfrichParameters& parameters, const CpuHelfrichSlopes& slopes);
    int getNumChunks() const;
    int getLastGroup(int chunk) const;
    const CpuHelfrichPasses& passes;
    const HelfrichMesh* mesh;
    long long revision;
    CpuHelfrichLayout layout;
    CpuHelfrichRepulsion repulsion;
    CpuHelfrichArrays arrays;
    Array positions, bendingSlopes, areas, curvatures, inverseNormals, anglesPerLength, tetherSlopes;
    std::vector<int> particles;
    std::vector<CpuHelfrichSums> chunkSums;
    CpuHelfrichSums totals;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHKERNELS_H_*/
