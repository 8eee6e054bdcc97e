#ifndef OPENMM_CPUVERTEXGEOMETRY_H_
#define OPENMM_CPUVERTEXGEOMETRY_H_

#include "CacheLineAllocator.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include <cmath>
#include <vector>

namespace HelfrichPlugin {

/**
 * The areas and curvatures of vertices at some positions, as sweeps read them.
 */
struct CpuVertexGeometry {
    typedef std::vector<double, CacheLineAllocator<double>> Array;
    /// of each surface
    std::vector<HelfrichTotals> totals;
    /// of each slot
    Array areas, curvatures;
    /// the slot of each vertex
    const int* slots = nullptr;
    /// this number changes whenever the others do
    long long number = 0;
    double getArea(int vertex) const {
        return areas[slots[vertex]];
    }
    double getCurvature(int vertex) const {
        return curvatures[slots[vertex]];
    }
    /**
     * Bring a vertex's into the cache.
     */
    void prefetch(int vertex) const {
        __builtin_prefetch(&areas[slots[vertex]]);
        __builtin_prefetch(&curvatures[slots[vertex]]);
    }
    /**
     * Get whether the totals are finite, that of the curvature if it is needed.
     */
    bool isFinite(bool needsCurvature) const {
        HelfrichTotals sum;
        for (auto& ofSurface : totals)
            sum += ofSurface;
        return std::isfinite(sum.area) && std::isfinite(sum.volume) &&
               (!needsCurvature || std::isfinite(sum.curvature));
    }
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUVERTEXGEOMETRY_H_*/
