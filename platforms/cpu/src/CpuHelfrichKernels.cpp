#include "CpuHelfrichKernels.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmm/System.h"
#include "openmm/internal/ContextImpl.h"
#include "openmm/reference/ReferencePlatform.h"
#include <algorithm>
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const int GROUPS_PER_CHUNK = 8, MAX_WIDTH = 8;

static ReferencePlatform::PlatformData& getData(ContextImpl& context) {
    return *reinterpret_cast<ReferencePlatform::PlatformData*>(context.getPlatformData());
}

/**
 * The number of vertices or particles that makes it worth to wake another thread.
 */
static const int ITEMS_PER_THREAD = 500;

static int chooseNumThreads(ContextImpl& context, int numItems) {
    return max(1, min(getData(context).threads.getNumThreads(), numItems/ITEMS_PER_THREAD));
}

void CpuCalcHelfrichForceKernel::initialize(const System& system, const HelfrichMesh& mesh) {
    this->mesh = &mesh;
    layout.initialize(mesh, passes.width);
    positions.resize(4*layout.getNumSlots());
    chunkSums.resize(getNumChunks());
    particles.resize(layout.getNumSlots());
    revision = mesh.getRevision()-1;
}

void CpuCalcHelfrichForceKernel::updateLayout() {
    if (revision == mesh->getRevision())
        return;
    layout.update(*mesh);
    for (int slot = 0; slot < layout.getNumSlots(); slot++)
        particles[slot] = mesh->getParticles()[layout.vertices[slot]];
    revision = mesh->getRevision();
}

void CpuCalcHelfrichForceKernel::resizeArrays(bool needsCurvature, bool needsGeometry) {
    if (needsCurvature) {
        bendingSlopes.resize(layout.getNumSlots());
        anglesPerLength.resize(layout.neighbors.size());
    }
    arrays = {positions.data(), bendingSlopes.data(), NULL, NULL, anglesPerLength.data()};
    if (needsGeometry) {
        areas.resize(layout.getNumSlots());
        curvatures.resize(layout.getNumSlots());
        arrays.areas = areas.data();
        arrays.curvatures = curvatures.data();
    }
}

int CpuCalcHelfrichForceKernel::getNumChunks() const {
    return (layout.getNumGroups()+GROUPS_PER_CHUNK-1)/GROUPS_PER_CHUNK;
}

int CpuCalcHelfrichForceKernel::getFirstGroup(int chunk) const {
    return chunk*GROUPS_PER_CHUNK;
}

int CpuCalcHelfrichForceKernel::getLastGroup(int chunk) const {
    return min((chunk+1)*GROUPS_PER_CHUNK, layout.getNumGroups());
}

int CpuCalcHelfrichForceKernel::getFirstSlot(int chunk) const {
    return getFirstGroup(chunk)*layout.width;
}

int CpuCalcHelfrichForceKernel::getLastSlot(int chunk) const {
    return min(getLastGroup(chunk)*layout.width, mesh->getNumVertices());
}

void CpuCalcHelfrichForceKernel::loadPositions(const vector<Vec3>& source, int chunk) {
    for (int slot = getFirstSlot(chunk); slot < getLastGroup(chunk)*layout.width; slot++) {
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

static double addUp(const vector<double>& terms) {
    CompensatedSum total;
    for (double term : terms)
        total.add(term);
    return total.get();
}

static double addUp(const vector<CpuHelfrichSums>& sums, double CpuHelfrichSums::*member) {
    CompensatedSum total;
    for (auto& chunk : sums)
        total.add(chunk.*member);
    return total.get();
}

void CpuCalcHelfrichForceKernel::addUpTotals() {
    totals.area = addUp(chunkSums, &CpuHelfrichSums::area);
    totals.volume = addUp(chunkSums, &CpuHelfrichSums::volume);
    totals.curvature = addUp(chunkSums, &CpuHelfrichSums::curvature);
    bendingEnergy = addUp(chunkSums, &CpuHelfrichSums::bending);
    tetherEnergy = addUp(chunkSums, &CpuHelfrichSums::tether);
}

void CpuCalcHelfrichForceKernel::computeRepulsion(const HelfrichParameters& parameters, int chunk, double* gradients) {
    chunkSums[chunk].repulsion = repulsion.compute(positions.data(), parameters, getFirstSlot(chunk), getLastSlot(chunk), gradients);
}

void CpuCalcHelfrichForceKernel::computeForces(const HelfrichParameters& parameters, const HelfrichTotals& slopes, int chunk, vector<Vec3>& forces) {
    alignas(64) double gradients[4*GROUPS_PER_CHUNK*MAX_WIDTH];
    passes.computeGradient(layout, parameters, slopes, arrays, getFirstGroup(chunk), getLastGroup(chunk), gradients);
    if (parameters.repulsionModulus != 0)
        computeRepulsion(parameters, chunk, gradients);
    const double* gradient = gradients;
    for (int slot = getFirstSlot(chunk); slot < getLastSlot(chunk); slot++, gradient += 4)
        forces[particles[slot]] -= Vec3(gradient[0], gradient[1], gradient[2]);
}

void CpuCalcHelfrichForceKernel::compute(ContextImpl& context, const HelfrichParameters& parameters, bool includeForces, bool needsGeometry) {
    bool needsCurvature = (needsGeometry || parameters.needsCurvature());
    updateLayout();
    resizeArrays(needsCurvature, needsGeometry);
    const vector<Vec3>& source = *getData(context).positions;
    vector<Vec3>& forces = *getData(context).forces;
    HelfrichTotals slopes;
    bool hasRepulsion = (parameters.repulsionModulus != 0), isFinite = true;
    int numChunks = getNumChunks(), numThreads = chooseNumThreads(context, mesh->getNumVertices());
    #pragma omp parallel num_threads(numThreads)
    {
        #pragma omp for schedule(static)
        for (int chunk = 0; chunk < numChunks; chunk++)
            loadPositions(source, chunk);
        #pragma omp for schedule(static)
        for (int chunk = 0; chunk < numChunks; chunk++)
            passes.computeEnergy(layout, parameters, needsCurvature, arrays, getFirstGroup(chunk), getLastGroup(chunk), chunkSums[chunk]);
        #pragma omp single
        {
            addUpTotals();
            slopes = penaltySlopes(parameters, totals);
            isFinite = isfinite(totals.area);
            if (hasRepulsion && isFinite)
                repulsion.update(*mesh, layout, positions.data(), parameters);
        }
        if (isFinite && includeForces) {
            #pragma omp for schedule(static)
            for (int chunk = 0; chunk < numChunks; chunk++)
                computeForces(parameters, slopes, chunk, forces);
        }
        else if (isFinite && hasRepulsion) {
            #pragma omp for schedule(static)
            for (int chunk = 0; chunk < numChunks; chunk++)
                computeRepulsion(parameters, chunk, NULL);
        }
    }
    repulsionEnergy = addUp(chunkSums, &CpuHelfrichSums::repulsion);
}

bool CpuCalcHelfrichForceKernel::execute(ContextImpl& context, const HelfrichParameters& parameters, bool includeForces, HelfrichEnergyTerms& terms) {
    compute(context, parameters, includeForces, false);
    terms = HelfrichEnergyTerms();
    terms.bending = bendingEnergy;
    terms.tether = tetherEnergy;
    addPenalties(parameters, totals, terms);
    if (parameters.repulsionModulus != 0)
        terms.repulsion = repulsionEnergy;
    return isfinite(totals.area);
}

void CpuCalcHelfrichForceKernel::computeGeometry(ContextImpl& context, HelfrichGeometry& geometry) {
    compute(context, HelfrichParameters(), false, true);
    geometry.area = totals.area;
    geometry.volume = totals.volume;
    geometry.integratedMeanCurvature = totals.curvature;
    geometry.vertexAreas.resize(mesh->getNumVertices());
    geometry.vertexMeanCurvatures.resize(mesh->getNumVertices());
    for (int slot = 0; slot < mesh->getNumVertices(); slot++) {
        int vertex = layout.vertices[slot];
        geometry.vertexAreas[vertex] = areas[slot];
        geometry.vertexMeanCurvatures[vertex] = curvatures[slot];
    }
}

static const int PARTICLES_PER_CHUNK = 256;

/**
 * Call a function with the first and last particle of each chunk, on all threads of a Context.
 */
template <class Function>
static void forEachChunk(ContextImpl& context, int numParticles, Function function) {
    int numChunks = (numParticles+PARTICLES_PER_CHUNK-1)/PARTICLES_PER_CHUNK, numThreads = chooseNumThreads(context, numParticles);
    #pragma omp parallel for schedule(static) num_threads(numThreads)
    for (int chunk = 0; chunk < numChunks; chunk++)
        function(chunk, chunk*PARTICLES_PER_CHUNK, min((chunk+1)*PARTICLES_PER_CHUNK, numParticles));
}

void CpuIntegrateHamiltonianTrajectoryKernel::initialize(const System& system) {
    for (int i = 0; i < system.getNumParticles(); i++) {
        double mass = system.getParticleMass(i);
        inverseMasses.push_back(mass == 0 ? 0 : 1/mass);
    }
    startPositions.resize(inverseMasses.size());
    chunkEnergies.resize((inverseMasses.size()+PARTICLES_PER_CHUNK-1)/PARTICLES_PER_CHUNK);
}

double CpuIntegrateHamiltonianTrajectoryKernel::begin(ContextImpl& context, double kT, const Philox& random, long long trajectory) {
    this->kT = kT;
    this->random = random;
    this->trajectory = trajectory;
    startPositions = *getData(context).positions;
    drawVelocities(context);
    return computeKineticEnergy(context);
}

void CpuIntegrateHamiltonianTrajectoryKernel::drawVelocities(ContextImpl& context) {
    vector<Vec3>& velocities = *getData(context).velocities;
    forEachChunk(context, inverseMasses.size(), [&] (int chunk, int first, int last) {
        for (int i = first; i < last; i++)
            if (inverseMasses[i] != 0)
                velocities[i] = drawNormals(random, trajectory, i)*sqrt(kT*inverseMasses[i]);
    });
}

void CpuIntegrateHamiltonianTrajectoryKernel::move(ContextImpl& context, double velocityStep, double positionStep) {
    vector<Vec3>& positions = *getData(context).positions;
    vector<Vec3>& velocities = *getData(context).velocities;
    vector<Vec3>& forces = *getData(context).forces;
    forEachChunk(context, inverseMasses.size(), [&] (int chunk, int first, int last) {
        for (int i = first; i < last; i++) {
            double scale = velocityStep*inverseMasses[i], positionScale = inverseMasses[i] == 0 ? 0 : positionStep;
            for (int j = 0; j < 3; j++) {
                velocities[i][j] += scale*forces[i][j];
                positions[i][j] += positionScale*velocities[i][j];
                forces[i][j] = 0;
            }
        }
    });
}

double CpuIntegrateHamiltonianTrajectoryKernel::computeKineticEnergy(ContextImpl& context) {
    const vector<Vec3>& velocities = *getData(context).velocities;
    forEachChunk(context, inverseMasses.size(), [&] (int chunk, int first, int last) {
        double energy = 0;
        for (int i = first; i < last; i++)
            if (inverseMasses[i] != 0)
                energy += 0.5*velocities[i].dot(velocities[i])/inverseMasses[i];
        chunkEnergies[chunk] = energy;
    });
    return addUp(chunkEnergies);
}

void CpuIntegrateHamiltonianTrajectoryKernel::restore(ContextImpl& context) {
    *getData(context).positions = startPositions;
    drawVelocities(context);
}
