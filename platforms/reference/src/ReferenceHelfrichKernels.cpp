#include "ReferenceHelfrichKernels.h"
#include "ReferenceEdgeFlips.h"
#include "ReferenceSpeciesExchange.h"
#include "openmm/System.h"
#include "openmm/internal/ContextImpl.h"
#include "openmm/reference/ReferencePlatform.h"
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static ReferencePlatform::PlatformData& getData(ContextImpl& context) {
    return *reinterpret_cast<ReferencePlatform::PlatformData*>(context.getPlatformData());
}

static ReferenceHelfrichEnergy::Vectors getVertexPositions(ContextImpl& context, const HelfrichMesh& mesh) {
    const vector<Vec3>& positions = *getData(context).positions;
    ReferenceHelfrichEnergy::Vectors x;
    for (int particle : mesh.getParticles())
        x.push_back({positions[particle][0], positions[particle][1], positions[particle][2]});
    return x;
}

void ReferenceCalcHelfrichForceKernel::initialize(const System& system, const HelfrichForce& force,
                                                  const HelfrichMesh& mesh) {
    this->mesh = &mesh;
}

bool ReferenceCalcHelfrichForceKernel::execute(ContextImpl& context, const HelfrichParameters& parameters,
                                               bool includeForces, HelfrichEnergyTerms& terms) {
    auto x = getVertexPositions(context, *mesh);
    ReferenceHelfrichEnergy energy(*mesh, x, parameters.box);
    bool isFinite = true;
    for (auto& totals : energy.getTotals())
        isFinite = isFinite && isfinite(double(totals.area));
    if (includeForces) {
        vector<Vec3>& forces = *getData(context).forces;
        auto gradient = energy.computeGradient(parameters);
        for (int v = 0; v < mesh->getNumVertices(); v++) {
            Eigen::Vector3d rounded = gradient[v].cast<double>();
            forces[mesh->getParticles()[v]] -= Vec3(rounded[0], rounded[1], rounded[2]);
            isFinite = isFinite && rounded.allFinite();
        }
    }
    terms = energy.computeEnergy(parameters);
    return isFinite;
}

void ReferenceCalcHelfrichForceKernel::computeGeometry(ContextImpl& context, const PeriodicBox& box,
                                                       HelfrichGeometry& geometry) {
    auto x = getVertexPositions(context, *mesh);
    ReferenceHelfrichEnergy(*mesh, x, box).getGeometry(geometry);
}

void ReferenceSweepEdgeFlipsKernel::initialize(const System& system, const HelfrichForce& force, HelfrichMesh& mesh,
                                               CalcHelfrichForceKernel& calculation) {
    this->mesh = &mesh;
}

bool ReferenceSweepEdgeFlipsKernel::execute(ContextImpl& context, const HelfrichParameters& parameters, double kT,
                                            long long numAttempts, const Philox& random, long long sweep,
                                            EdgeFlipStatistics& statistics) {
    auto x = getVertexPositions(context, *mesh);
    ReferenceHelfrichEnergy energy(*mesh, x, parameters.box);
    HelfrichGeometry geometry;
    energy.getGeometry(geometry);
    if (!isFinite(geometry, parameters.needsCurvature()))
        return false;
    statistics = ReferenceEdgeFlips(*mesh, x, parameters, energy.getTotals()).sweep(kT, numAttempts, random, sweep);
    return true;
}

void ReferenceExchangeSpeciesKernel::initialize(const System& system, const HelfrichForce& force, HelfrichMesh& mesh,
                                                CalcHelfrichForceKernel& calculation) {
    this->mesh = &mesh;
}

bool ReferenceExchangeSpeciesKernel::execute(ContextImpl& context, const HelfrichParameters& parameters,
                                             const SpeciesProposal& proposal, double kT, long long numAttempts,
                                             const Philox& random, long long sweep,
                                             SpeciesExchangeStatistics& statistics) {
    auto x = getVertexPositions(context, *mesh);
    HelfrichGeometry geometry;
    ReferenceHelfrichEnergy(*mesh, x, parameters.box).getGeometry(geometry);
    if (parameters.hasForcesOfSpecies() && !isFinite(geometry, parameters.needsCurvature()))
        return false;
    statistics = ReferenceSpeciesExchange(*mesh, x, parameters, proposal).sweep(kT, numAttempts, random, sweep);
    return true;
}

void ReferenceIntegrateHamiltonianTrajectoryKernel::initialize(const System& system) {
    for (int i = 0; i < system.getNumParticles(); i++)
        masses.push_back(system.getParticleMass(i));
}

void ReferenceIntegrateHamiltonianTrajectoryKernel::setMultilevelWeight(double weight,
                                                                        const vector<const HelfrichMesh*>& meshes) {
    coarse.setWeight(weight, meshes, masses);
}

vector<vector<CoarseVelocity>> ReferenceIntegrateHamiltonianTrajectoryKernel::getCoarseVelocities() const {
    return coarse.store();
}

void ReferenceIntegrateHamiltonianTrajectoryKernel::setCoarseVelocities(
        const vector<vector<CoarseVelocity>>& velocities) {
    coarse.load(velocities);
}

double ReferenceIntegrateHamiltonianTrajectoryKernel::begin(ContextImpl& context, double kT, double refreshment,
                                                            const Philox& random, long long trajectory) {
    this->kT = kT;
    start.keep(*getData(context).positions, *getData(context).velocities, refreshment, random, trajectory);
    setVelocities(context, 1);
    coarse.begin(kT, refreshment, random, trajectory);
    return computeKineticEnergy(context) + coarse.getKineticEnergy();
}

void ReferenceIntegrateHamiltonianTrajectoryKernel::setVelocities(ContextImpl& context, double factor) const {
    for (size_t i = 0; i < masses.size(); i++) {
        Vec3 velocity = (masses[i] == 0 ? start.getVelocities()[i] : start.drawVelocity(i, sqrt(kT / masses[i])));
        (*getData(context).velocities)[i] = velocity * factor;
    }
}

void ReferenceIntegrateHamiltonianTrajectoryKernel::move(ContextImpl& context, const KickAndDrift& times) {
    vector<Vec3>& positions = *getData(context).positions;
    vector<Vec3>& velocities = *getData(context).velocities;
    vector<Vec3>& forces = *getData(context).forces;
    for (int i = 0; i < coarse.size(); i++) {
        const ReferenceCoarseMeshes& meshes = coarse.getMeshes(i);
        meshes.kick(forces, times.kick, coarse.getWeight(), coarse.getVelocities(i));
        vector<Vec3> motion = meshes.getMotion(coarse.getWeight(), coarse.getVelocities(i));
        for (size_t v = 0; v < motion.size(); v++)
            positions[meshes.getMembrane().getParticles()[v]] += motion[v] * times.drift;
    }
    for (size_t i = 0; i < masses.size(); i++) {
        if (masses[i] != 0) {
            velocities[i] += forces[i] * (times.kick / masses[i]);
            positions[i] += velocities[i] * times.drift;
        }
        forces[i] = Vec3();
    }
}

double ReferenceIntegrateHamiltonianTrajectoryKernel::computeKineticEnergy(ContextImpl& context) {
    const vector<Vec3>& velocities = *getData(context).velocities;
    double energy = 0;
    for (size_t i = 0; i < masses.size(); i++)
        energy += 0.5 * masses[i] * velocities[i].dot(velocities[i]);
    return energy;
}

double ReferenceIntegrateHamiltonianTrajectoryKernel::computeCoarseKineticEnergy() const {
    return coarse.getKineticEnergy();
}

void ReferenceIntegrateHamiltonianTrajectoryKernel::reject(ContextImpl& context) {
    *getData(context).positions = start.getPositions();
    setVelocities(context, -1);
    coarse.reject();
}

void ReferenceIntegrateHamiltonianTrajectoryKernel::restore(ContextImpl& context) {
    *getData(context).positions = start.getPositions();
    *getData(context).velocities = start.getVelocities();
    coarse.restore();
}
