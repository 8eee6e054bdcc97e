#include "openmmhelfrich/internal/HelfrichForceImpl.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include "openmmhelfrich/internal/HelfrichSerialization.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmm/OpenMMException.h"
#include "openmm/internal/ContextImpl.h"
#include <algorithm>
#include <cmath>
#include <sstream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static HelfrichParameters copyModuli(const HelfrichForce& force) {
    HelfrichParameters p;
    p.bendingModulus = force.getBendingModulus();
    p.areaModulus = force.getAreaModulus();
    p.volumeModulus = force.getVolumeModulus();
    p.areaDifferenceModulus = force.getAreaDifferenceModulus();
    p.leafletSeparation = force.getLeafletSeparation();
    force.getTether(p.tetherModulus, p.tetherMinLength, p.tetherMaxLength, p.tetherExponent);
    p.tetherLengthScale = force.getTetherLengthScale();
    force.getRepulsion(p.repulsionModulus, p.repulsionOnset, p.repulsionExponent, p.repulsionExclusionLevel);
    return p;
}

static vector<array<int, 2>> copyFixedEdges(const HelfrichForce& force) {
    vector<array<int, 2>> edges(force.getNumFixedEdges());
    for (int i = 0; i < force.getNumFixedEdges(); i++)
        force.getFixedEdgeParameters(i, edges[i][0], edges[i][1]);
    return edges;
}

/**
 * Get the number of threads that a Context may use, 1 on a platform that leaves no choice.
 */
static int getNumThreads(ContextImpl& context) {
    const Platform& platform = context.getPlatform();
    for (const string& name : platform.getPropertyNames())
        if (name == "Threads")
            return max(1, stoi(platform.getPropertyValue(context.getOwner(), name)));
    return 1;
}

HelfrichForceImpl::HelfrichForceImpl(const HelfrichForce& owner) : owner(owner) {
    forceGroup = owner.getForceGroup();
}

void HelfrichForceImpl::initialize(ContextImpl& context) {
    const System& system = context.getSystem();
    checkName(system);
    moduli = copyModuli(owner);
    checkTarget("area", "setTargetArea", moduli.areaModulus, owner.getTargetArea());
    checkTarget("volume", "setTargetVolume", moduli.volumeModulus, owner.getTargetVolume());
    checkTarget("area difference", "setTargetAreaDifference", moduli.areaDifferenceModulus,
                owner.getTargetAreaDifference());
    mesh.reset(new HelfrichMesh(owner.getTriangles(), system.getNumParticles()));
    mesh->setFixedEdges(copyFixedEdges(owner));
    sweep.reset(new EdgeFlipSweep(*mesh, getNumThreads(context)));
    kernel = context.getPlatform().createKernel(CalcHelfrichForceKernel::Name(), context);
    kernel.getAs<CalcHelfrichForceKernel>().initialize(system, *mesh);
}

void HelfrichForceImpl::checkName(const System& system) const {
    for (int i = 0; i < system.getNumForces(); i++) {
        const Force& other = system.getForce(i);
        if (&other != &owner && dynamic_cast<const HelfrichForce*>(&other) != NULL &&
            other.getName() == owner.getName())
            throw OpenMMException(
                    "HelfrichForce: two HelfrichForces have the name '" + owner.getName() +
                    "', so that their target parameters would have the same names; call setName() to tell them apart");
    }
}

void HelfrichForceImpl::checkTarget(const string& term, const string& setter, double modulus, double target) const {
    if (modulus != 0 && (target == 0 || !isfinite(target))) {
        stringstream message;
        message << owner.getName() << ": the " << term << " term is on (modulus " << modulus
                << " kJ/mol), but its target is " << target << "; set it to a finite value other than zero with "
                << setter << "() or as a parameter of the Context";
        throw OpenMMException(message.str());
    }
}

HelfrichParameters HelfrichForceImpl::getParameters(ContextImpl& context) const {
    HelfrichParameters p = moduli;
    p.targetArea = context.getParameter(owner.getTargetAreaParameter());
    p.targetVolume = context.getParameter(owner.getTargetVolumeParameter());
    p.targetAreaDifference = context.getParameter(owner.getTargetAreaDifferenceParameter());
    checkTarget("area", "setTargetArea", p.areaModulus, p.targetArea);
    checkTarget("volume", "setTargetVolume", p.volumeModulus, p.targetVolume);
    checkTarget("area difference", "setTargetAreaDifference", p.areaDifferenceModulus, p.targetAreaDifference);
    return p;
}

void HelfrichForceImpl::checkOrientation(ContextImpl& context, const HelfrichParameters& parameters) {
    // A trajectory may turn the surface inside out and be rejected for it: only the positions that a user set are held
    // to this.

    if (isOrientationChecked || parameters.volumeModulus == 0)
        return;
    HelfrichGeometry geometry;
    kernel.getAs<CalcHelfrichForceKernel>().computeGeometry(context, geometry);
    double volume = geometry.volume;
    if (volume <= 0) {
        stringstream message;
        message << owner.getName() << ": the volume term is on, but the surface encloses a volume of " << volume
                << " nm^3: it is inside out or flat.  The triangles must be counter-clockwise seen from outside: "
                   "exchange two particles of each";
        throw OpenMMException(message.str());
    }
    isOrientationChecked = isfinite(volume);
}

HelfrichEnergyTerms HelfrichForceImpl::execute(ContextImpl& context, bool includeForces) {
    HelfrichParameters parameters = getParameters(context);
    checkOrientation(context, parameters);
    if (kick != NULL)
        parameters = kick->getParameters(parameters);
    HelfrichEnergyTerms terms;
    bool isFinite = kernel.getAs<CalcHelfrichForceKernel>().execute(context, parameters, includeForces, terms);
    if (!isFinite || !isfinite(terms.getTotal()))
        throwNonFinite(context, terms);
    return terms;
}

void HelfrichForceImpl::checkPositions(const vector<Vec3>& positions) const {
    for (int particle : mesh->getParticles()) {
        const Vec3& x = positions[particle];
        if (!isfinite(x[0]) || !isfinite(x[1]) || !isfinite(x[2])) {
            stringstream message;
            message << owner.getName() << ": the position of particle " << particle << " is (" << x[0] << ", " << x[1]
                    << ", " << x[2] << "); positions must be finite";
            throw OpenMMException(message.str());
        }
    }
}

void HelfrichForceImpl::throwNonFinite(ContextImpl& context, const HelfrichEnergyTerms& terms) const {
    vector<Vec3> positions;
    context.getPositions(positions);
    checkPositions(positions);
    stringstream message;
    message << owner.getName() << ": the energy is not finite, or a force is not (bending " << terms.bending
            << ", area " << terms.area << ", volume " << terms.volume << ", area difference " << terms.areaDifference
            << ", tether " << terms.tether << ", repulsion " << terms.repulsion
            << " kJ/mol): the positions are too far apart, or vertices or triangles have collapsed to a point";
    throw OpenMMException(message.str());
}

void HelfrichForceImpl::checkGeometry(ContextImpl& context, const HelfrichGeometry& geometry,
                                      bool needsCurvature) const {
    if (isfinite(geometry.area) && isfinite(geometry.volume) &&
        (!needsCurvature || isfinite(geometry.integratedMeanCurvature)))
        return;
    vector<Vec3> positions;
    context.getPositions(positions);
    checkPositions(positions);
    stringstream message;
    message << owner.getName() << ": the geometry is not finite (area " << geometry.area << " nm^2, volume "
            << geometry.volume << " nm^3, integrated mean curvature " << geometry.integratedMeanCurvature
            << " nm): the positions are too far apart, or the two ends of an edge are in one place";
    throw OpenMMException(message.str());
}

double HelfrichForceImpl::calcForcesAndEnergy(ContextImpl& context, bool includeForces, bool includeEnergy,
                                              int groups) {
    if (kick == NULL && (groups & (1 << owner.getForceGroup())) == 0)
        return 0;
    double energy = execute(context, includeForces).getTotal();
    return includeEnergy ? energy : 0;
}

bool HelfrichForceImpl::canMakeTrajectory(ContextImpl& context) const {
    return mesh->getNumVertices() == context.getSystem().getNumParticles() &&
           kernel.getAs<CalcHelfrichForceKernel>().canMakeTrajectory();
}

double HelfrichForceImpl::makeTrajectory(ContextImpl& context, const vector<KickAndDrift>& sequence, bool mixed) {
    HelfrichEnergyTerms terms;
    if (!kernel.getAs<CalcHelfrichForceKernel>().makeTrajectory(context, getParameters(context), sequence, mixed,
                                                                terms))
        throwNonFinite(context, terms);
    return terms.getTotal();
}

map<string, double> HelfrichForceImpl::getDefaultParameters() {
    return {{owner.getTargetAreaParameter(), owner.getTargetArea()},
            {owner.getTargetVolumeParameter(), owner.getTargetVolume()},
            {owner.getTargetAreaDifferenceParameter(), owner.getTargetAreaDifference()}};
}

vector<string> HelfrichForceImpl::getKernelNames() {
    return {CalcHelfrichForceKernel::Name()};
}

vector<pair<int, int>> HelfrichForceImpl::getBondedParticles() const {
    vector<pair<int, int>> bonds;
    for (auto& t : owner.getTriangles())
        for (int c = 0; c < 3; c++)
            if (t[c] < t[(c + 1) % 3])
                bonds.push_back({t[c], t[(c + 1) % 3]});
    return bonds;
}

void HelfrichForceImpl::updateParametersInContext(ContextImpl& context) {
    moduli = copyModuli(owner);
    context.systemChanged();
}

void HelfrichForceImpl::requirePositions(ContextImpl& context) {
    // The only way to ask whether positions were set is to compute the energy of no force group.

    if (arePositionsSet)
        return;
    int lastForceGroups = context.getLastForceGroups();
    context.calcForcesAndEnergy(false, false, 0);
    context.getLastForceGroups() = lastForceGroups;
    arePositionsSet = true;
}

HelfrichEnergyTerms HelfrichForceImpl::getEnergyTerms(ContextImpl& context) {
    requirePositions(context);
    return execute(context, false);
}

HelfrichGeometry HelfrichForceImpl::getGeometry(ContextImpl& context) {
    requirePositions(context);
    HelfrichGeometry geometry;
    kernel.getAs<CalcHelfrichForceKernel>().computeGeometry(context, geometry);
    checkGeometry(context, geometry, true);
    geometry.areaDifference = 2 * moduli.leafletSeparation * geometry.integratedMeanCurvature;
    return geometry;
}

void HelfrichForceImpl::setTriangles(ContextImpl& context, const vector<array<int, 3>>& triangles) {
    mesh->setTriangles(triangles);
    isOrientationChecked = false;
    context.systemChanged();
}

void HelfrichForceImpl::createCheckpoint(ostream& stream) const {
    auto triangles = mesh->getTriangles();
    writeBinary(stream, (long long) triangles.size());
    stream.write((const char*) triangles.data(), sizeof(triangles[0]) * triangles.size());
    stream.write((const char*) mesh->getOrder().data(), sizeof(int) * mesh->getOrder().size());
}

void HelfrichForceImpl::loadCheckpoint(ContextImpl& context, istream& stream) {
    long long numTriangles;
    readBinary(stream, numTriangles);
    if (numTriangles != mesh->getNumTriangles())
        throw OpenMMException("loadCheckpoint: the checkpoint is of a membrane with " + to_string(numTriangles) +
                              " triangles, and " + owner.getName() + " has " + to_string(mesh->getNumTriangles()));
    vector<array<int, 3>> triangles(numTriangles);
    vector<int> order(mesh->getNumVertices());
    if (!stream.read((char*) triangles.data(), sizeof(triangles[0]) * triangles.size()) ||
        !stream.read((char*) order.data(), sizeof(int) * order.size()))
        throw OpenMMException("loadCheckpoint: the checkpoint ends too early");
    restore(context, triangles, order);
}

void HelfrichForceImpl::serializeState(SerializationNode& node) const {
    storeTriangles(mesh->getTriangles(), node);
    storeIntegers(mesh->getOrder(), "vertices", node.createChildNode("Order"));
}

void HelfrichForceImpl::deserializeState(ContextImpl& context, const SerializationNode& node) {
    restore(context, loadTriangles(node), loadIntegers("vertices", node.getChildNode("Order")));
}

void HelfrichForceImpl::restore(ContextImpl& context, const vector<array<int, 3>>& triangles,
                                const vector<int>& order) {
    setTriangles(context, triangles);
    mesh->setOrder(order);
    isOrientationChecked = true;
}

EdgeFlipStatistics HelfrichForceImpl::flipEdges(ContextImpl& context, double kT, long long numAttempts,
                                                const Philox& random, long long sweepIndex,
                                                const EdgeFlipSweep::Observer& observer) {
    HelfrichParameters parameters = getParameters(context);
    requirePositions(context);
    CalcHelfrichForceKernel& calculation = kernel.getAs<CalcHelfrichForceKernel>();
    calculation.computeGeometry(context, sweepGeometry);
    checkGeometry(context, sweepGeometry, parameters.needsCurvature());
    HelfrichNeighborList* neighbors = NULL;
    if (EdgeFlipSweep::needsNeighborList(parameters))
        neighbors = &calculation.getNeighborList(context, parameters.repulsionOnset);
    sweep->setPositions(calculation.getPositions(context), sweepGeometry, neighbors);
    EdgeFlipStatistics statistics = sweep->execute(parameters, kT, numAttempts, random, sweepIndex, observer);
    context.systemChanged();
    return statistics;
}
