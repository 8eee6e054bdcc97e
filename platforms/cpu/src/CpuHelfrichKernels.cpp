#include "CpuHelfrichKernels.h"
#include "openmm/OpenMMException.h"
#include "openmm/internal/ContextImpl.h"
#include "openmm/reference/ReferencePlatform.h"
#include <algorithm>
#include <cmath>
#include <limits>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const int GROUPS_PER_CHUNK = 8;

static ReferencePlatform::PlatformData& getData(ContextImpl& context) {
    return *reinterpret_cast<ReferencePlatform::PlatformData*>(context.getPlatformData());
}

void CpuCalcHelfrichForceKernel::initialize(const System& system, const HelfrichMesh& mesh) {
    this->mesh = &mesh;
    layout.initialize(mesh, passes.width);
    positions.resize(4*layout.getNumSlots());
    areas.resize(layout.getNumSlots());
    chunkSums.resize(getNumChunks());
    particles.resize(layout.getNumSlots());
    revision = mesh.getRevision()-1;
    updateLayout();
}

void CpuCalcHelfrichForceKernel::updateLayout() {
    if (revision == mesh->getRevision())
        return;
    layout.update(*mesh);
    for (int slot = 0; slot < layout.getNumSlots(); slot++)
        particles[slot] = mesh->getParticles()[layout.vertices[slot]];
    revision = mesh->getRevision();
}

void CpuCalcHelfrichForceKernel::resizeArrays(const HelfrichParameters& parameters, bool needsCurvature) {
    size_t numCorners = layout.neighbors.size();
    inverseNormals.resize(numCorners);
    if (needsCurvature) {
        bendingSlopes.resize(layout.getNumSlots());
        curvatures.resize(layout.getNumSlots());
        anglesPerLength.resize(numCorners);
    }
    if (parameters.tetherModulus != 0)
        tetherSlopes.resize(numCorners);
    arrays = {positions.data(), bendingSlopes.data(), areas.data(), curvatures.data(), inverseNormals.data(), anglesPerLength.data(), tetherSlopes.data()};
}

int CpuCalcHelfrichForceKernel::getNumChunks() const {
    return (layout.getNumGroups()+GROUPS_PER_CHUNK-1)/GROUPS_PER_CHUNK;
}

int CpuCalcHelfrichForceKernel::getLastGroup(int chunk) const {
    return min((chunk+1)*GROUPS_PER_CHUNK, layout.getNumGroups());
}

void CpuCalcHelfrichForceKernel::loadPositions(const vector<Vec3>& source, int firstSlot, int lastSlot) {
    for (int slot = firstSlot; slot < lastSlot; slot++) {
        const Vec3& x = source[particles[slot]];
        positions[4*slot] = x[0];
        positions[4*slot+1] = x[1];
        positions[4*slot+2] = x[2];
    }
}

/**
 * A sum that carries the rounding errors along (Neumaier, 1974).
 */
class CompensatedSum {
public:
    void add(double term) {
        double next = sum+term;
        error += (fabs(sum) >= fabs(term) ? (sum-next)+term : (term-next)+sum);
        sum = next;
    }
    double get() const {
        return isfinite(sum) ? sum+error : sum;
    }
private:
    double sum = 0, error = 0;
};

static double addUp(const vector<CpuHelfrichSums>& sums, double CpuHelfrichSums::*member) {
    CompensatedSum total;
    for (auto& chunk : sums)
        total.add(chunk.*member);
    return total.get();
}

void CpuCalcHelfrichForceKernel::computeEnergies(ContextImpl& context, const HelfrichParameters& parameters, bool needsCurvature) {
    updateLayout();
    resizeArrays(parameters, needsCurvature);
    const vector<Vec3>& source = *getData(context).positions;
    int numChunks = getNumChunks(), numThreads = getData(context).threads.getNumThreads();
    #pragma omp parallel num_threads(numThreads)
    {
        #pragma omp for schedule(static)
        for (int chunk = 0; chunk < numChunks; chunk++)
            loadPositions(source, chunk*GROUPS_PER_CHUNK*layout.width, getLastGroup(chunk)*layout.width);
        #pragma omp for schedule(static)
        for (int chunk = 0; chunk < numChunks; chunk++)
            passes.computeEnergy(layout, parameters, needsCurvature, arrays, chunk*GROUPS_PER_CHUNK, getLastGroup(chunk), chunkSums[chunk]);
    }
    for (auto member : {&CpuHelfrichSums::area, &CpuHelfrichSums::volume, &CpuHelfrichSums::curvature, &CpuHelfrichSums::bending, &CpuHelfrichSums::tether})
        totals.*member = addUp(chunkSums, member);
}

void CpuCalcHelfrichForceKernel::addForces(ContextImpl& context, const HelfrichParameters& parameters, const CpuHelfrichSlopes& slopes) {
    vector<Vec3>& forces = *getData(context).forces;
    int numChunks = getNumChunks(), numThreads = getData(context).threads.getNumThreads();
    #pragma omp parallel for schedule(static) num_threads(numThreads)
    for (int chunk = 0; chunk < numChunks; chunk++) {
        alignas(64) double gradients[4*GROUPS_PER_CHUNK*8];
        int firstGroup = chunk*GROUPS_PER_CHUNK, firstSlot = firstGroup*layout.width;
        int lastGroup = getLastGroup(chunk), lastSlot = min(lastGroup*layout.width, mesh->getNumVertices());
        passes.computeGradient(layout, parameters, slopes, arrays, firstGroup, lastGroup, gradients);
        if (parameters.repulsionModulus != 0)
            repulsion.compute(positions.data(), parameters, firstSlot, lastSlot, gradients);
        for (int slot = firstSlot; slot < lastSlot; slot++) {
            const double* gradient = gradients+4*(slot-firstSlot);
            forces[particles[slot]] -= Vec3(gradient[0], gradient[1], gradient[2]);
        }
    }
}

HelfrichEnergyTerms CpuCalcHelfrichForceKernel::execute(ContextImpl& context, const HelfrichParameters& p, bool includeForces) {
    computeEnergies(context, p, p.needsCurvature());
    HelfrichTotals sums;
    sums.area = totals.area;
    sums.volume = totals.volume;
    sums.curvature = totals.curvature;
    HelfrichEnergyTerms terms;
    terms.bending = totals.bending;
    terms.tether = totals.tether;
    addPenalties(p, sums, terms);
    if (p.repulsionModulus != 0) {
        if (!repulsion.update(*mesh, layout, positions.data(), p)) {
            terms.repulsion = numeric_limits<double>::quiet_NaN();
            return terms;
        }
        terms.repulsion = repulsion.compute(positions.data(), p, 0, mesh->getNumVertices(), NULL);
    }
    if (includeForces) {
        HelfrichTotals slopes = penaltySlopes(p, sums);
        CpuHelfrichSlopes byTotals;
        byTotals.area = slopes.area;
        byTotals.volume = slopes.volume;
        byTotals.curvature = slopes.curvature;
        addForces(context, p, byTotals);
    }
    return terms;
}

HelfrichGeometry CpuCalcHelfrichForceKernel::computeGeometry(ContextImpl& context) {
    computeEnergies(context, HelfrichParameters(), true);
    HelfrichGeometry geometry;
    geometry.area = totals.area;
    geometry.volume = totals.volume;
    geometry.integratedMeanCurvature = totals.curvature;
    for (int slot : layout.slots) {
        geometry.vertexAreas.push_back(areas[slot]);
        geometry.vertexMeanCurvatures.push_back(curvatures[slot]);
    }
    return geometry;
}
