#ifndef OPENMM_EXACTGEOMETRY_H_
#define OPENMM_EXACTGEOMETRY_H_

#include "CpuVertexGeometry.h"
#include "HelfrichEquations.h"
#include <numeric>

namespace HelfrichPlugin {

/**
 * The correctly rounded areas and curvatures of a membrane.
 */
class ExactGeometry : public CpuVertexGeometry {
public:
    explicit ExactGeometry(const Membrane& membrane) : identity(membrane.positions.size()) {
        auto exact = computeExactly(membrane, HelfrichParameters());
        for (auto& surface : exact.surfaces)
            totals.push_back({(double) surface.area, (double) surface.volume, (double) surface.curvature});
        areas.assign(exact.vertexAreas.begin(), exact.vertexAreas.end());
        curvatures.assign(exact.vertexCurvatures.begin(), exact.vertexCurvatures.end());
        std::iota(identity.begin(), identity.end(), 0);
        slots = identity.data();
    }
    ExactGeometry(const ExactGeometry&) = delete;
private:
    std::vector<int> identity;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_EXACTGEOMETRY_H_*/
