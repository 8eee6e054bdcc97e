#include "openmmhelfrich/internal/HelfrichForceImpl.h"
#include "openmmhelfrich/internal/HelfrichSerialization.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmm/OpenMMException.h"
#include "openmm/internal/ContextImpl.h"
#include <algorithm>
#include <cmath>
#include <sstream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static vector<array<int, 2>> copyFixedEdges(const HelfrichForce& force) {
    vector<array<int, 2>> edges(force.getNumFixedEdges());
    for (int i = 0; i < force.getNumFixedEdges(); i++)
        force.getFixedEdgeParameters(i, edges[i][0], edges[i][1]);
    return edges;
}

HelfrichForceImpl::HelfrichForceImpl(const HelfrichForce& owner) : owner(owner) {
    forceGroup = owner.getForceGroup();
}

void HelfrichForceImpl::initialize(ContextImpl& context) {
    const System& system = context.getSystem();
    mesh.reset(new HelfrichMesh(owner.getTriangles(), system.getNumParticles()));
    mesh->setFixedEdges(copyFixedEdges(owner));
    checkOtherMembranes(system);
    parameters = owner.getParameters();
    createSpecies();
    checkSurfaceTargets();
    checkContextParameters(parameters);
    isPeriodic = owner.usesPeriodicBoundaryConditions();
    checkPeriodicTerms(parameters);
    kernel = context.getPlatform().createKernel(CalcHelfrichForceKernel::Name(), context);
    kernel.getAs<CalcHelfrichForceKernel>().initialize(system, owner, *mesh);
}

void HelfrichForceImpl::createSpecies() {
    if (owner.getNumSpecies() == 0 && owner.getVertexSpecies().empty())
        return;
    bool areSet = !owner.getVertexSpecies().empty();
    mesh->setSpecies(areSet ? owner.getVertexSpecies() : vector<int>(mesh->getNumVertices(), 0), owner.getNumSpecies());
}

void HelfrichForceImpl::checkSpecies(const HelfrichForce& force) const {
    const vector<int>& species = mesh->getSpecies();
    int numNeeded = species.empty() ? 0 : *max_element(species.begin(), species.end()) + 1;
    if (species.empty() && force.getNumSpecies() > 0)
        throw OpenMMException(owner.getName() + ": there are " + to_string(force.getNumSpecies()) +
                              " species, but there were none when the Context was created; create another one");
    if (force.getNumSpecies() < numNeeded)
        throw OpenMMException(owner.getName() + ": there are " + to_string(force.getNumSpecies()) +
                              " species, but a vertex of the Context is of species " + to_string(numNeeded - 1));
}

void HelfrichForceImpl::checkOtherMembranes(const System& system) const {
    vector<char> isVertex(system.getNumParticles(), 0);
    for (int particle : mesh->getParticles())
        isVertex[particle] = 1;
    for (int i = 0; i < system.getNumForces(); i++) {
        const HelfrichForce* other = dynamic_cast<const HelfrichForce*>(&system.getForce(i));
        if (other != NULL && other != &owner) {
            checkName(*other);
            checkParticles(*other, isVertex);
        }
    }
}

void HelfrichForceImpl::checkName(const HelfrichForce& other) const {
    if (other.getName() == owner.getName())
        throw OpenMMException(
                "HelfrichForce: two HelfrichForces have the name '" + owner.getName() +
                "', so that their parameters would have the same names; call setName() to tell them apart");
}

void HelfrichForceImpl::checkParticles(const HelfrichForce& other, const vector<char>& isVertex) const {
    for (auto& triangle : other.getTriangles())
        for (int particle : triangle)
            if (particle >= 0 && particle < (int) isVertex.size() && isVertex[particle])
                throw OpenMMException("HelfrichForce: particle " + to_string(particle) +
                                      " belongs to two HelfrichForces, '" + owner.getName() + "' and '" +
                                      other.getName() + "'; a particle may be a vertex of one only");
}

void HelfrichForceImpl::checkSurfaceTargets() const {
    for (auto& target : parameters.surfaceTargets)
        if (target.first.second >= mesh->getNumSurfaces())
            throw OpenMMException(
                    owner.getName() + ": surface " + to_string(target.first.second) +
                    " has a target of its own, but the triangles form " + to_string(mesh->getNumSurfaces()) +
                    (mesh->getNumSurfaces() == 1 ? " surface" : " surfaces") + "; they are numbered from 0");
}

string HelfrichForceImpl::getParameterName(const pair<Term, int>& surfaceTarget) const {
    return owner.getName() + getContextParameter(surfaceTarget.first).name + to_string(surfaceTarget.second);
}

void HelfrichForceImpl::checkContextParameters(HelfrichParameters& p) const {
    TermValues numOwn;
    for (auto& target : p.surfaceTargets) {
        Term term = target.first.first;
        numOwn[term]++;
        checkContextParameter(p, getContextParameter(term), getParameterName(target.first), target.second);
    }
    for (auto& parameter : HELFRICH_CONTEXT_PARAMETERS)
        if (numOwn[parameter.term] < mesh->getNumSurfaces())
            checkContextParameter(p, parameter, owner.getName() + parameter.name, parameter.valueIn(p));
}

void HelfrichForceImpl::checkContextParameter(const HelfrichParameters& p, const HelfrichContextParameter& parameter,
                                              const string& name, double value) const {
    if (!p.has(parameter.term) || parameter.allows(value))
        return;
    const char* allowed[] = {"positive, finite value", "finite value other than zero", "finite value"};
    stringstream message;
    message << owner.getName() << ": the " << TERM_NAMES[int(parameter.term)] << " term is on, but " << name << " is "
            << value << "; set it to a " << allowed[parameter.allowed] << " with set" << parameter.name
            << "() or as a parameter of the Context";
    throw OpenMMException(message.str());
}

HelfrichParameters HelfrichForceImpl::getParameters(ContextImpl& context) const {
    HelfrichParameters p = parameters;
    for (auto& parameter : HELFRICH_CONTEXT_PARAMETERS)
        parameter.valueIn(p) = context.getParameter(owner.getName() + parameter.name);
    for (auto& target : p.surfaceTargets)
        target.second = context.getParameter(getParameterName(target.first));
    checkContextParameters(p);
    checkPeriodicTerms(p);
    p.box = getBox(context);
    return p;
}

void HelfrichForceImpl::checkPeriodicTerms(const HelfrichParameters& p) const {
    for (Term term : {Term::Volume, Term::Pressure})
        if (isPeriodic && p.has(term))
            throw OpenMMException(owner.getName() + ": the " + TERM_NAMES[int(term)] +
                                  " term is on, but a membrane in a periodic box encloses no volume; set its modulus "
                                  "to 0, or call setUsesPeriodicBoundaryConditions(False)");
}

PeriodicBox HelfrichForceImpl::getBox(ContextImpl& context) const {
    if (!isPeriodic)
        return PeriodicBox();
    Vec3 sides[3];
    context.getPeriodicBoxVectors(sides[0], sides[1], sides[2]);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (i != j && sides[i][j] != 0) {
                stringstream message;
                message << owner.getName() << ": periodic box vector " << "abc"[i] << " is (" << sides[i][0] << ", "
                        << sides[i][1] << ", " << sides[i][2]
                        << ") nm; a membrane needs a rectangular box, whose vectors are along x, y and z";
                throw OpenMMException(message.str());
            }
    return PeriodicBox(sides[0][0], sides[1][1], sides[2][2]);
}

/**
 * The least volume of a surface that is not flat, over its area to the power of 3/2: some times the rounding error of
 * a number.
 */
static const double LEAST_VOLUME = 1e-15;

void HelfrichForceImpl::checkOrientation(ContextImpl& context, const HelfrichParameters& parameters) {
    // A trajectory may turn the surface inside out and be rejected for it: only the positions that a user set are held
    // to this.

    if (isOrientationChecked || isPeriodic || !parameters.needsOrientation())
        return;
    HelfrichGeometry geometry;
    kernel.getAs<CalcHelfrichForceKernel>().computeGeometry(context, parameters.box, geometry);
    for (int i = 0; i < mesh->getNumSurfaces(); i++) {
        double volume = geometry.surfaces[i].volume;
        if (volume <= LEAST_VOLUME * pow(geometry.surfaces[i].area, 1.5)) {
            stringstream message;
            message << owner.getName() << ": the energy depends on "
                    << (parameters.hasSpontaneousCurvature() ? "which side of the surface is outside" : "the volume")
                    << ", but " << (mesh->getNumSurfaces() == 1 ? "the surface" : "surface " + to_string(i))
                    << " encloses one of " << volume
                    << " nm^3: it is inside out or flat.  The triangles must be counter-clockwise seen from outside: "
                       "exchange two particles of each";
            throw OpenMMException(message.str());
        }
    }
    isOrientationChecked = isfinite(geometry.volume);
}

/**
 * The box that every System has that was given none, in nm.
 */
static const double DEFAULT_BOX = 2;

void HelfrichForceImpl::checkBox(ContextImpl& context, const HelfrichParameters& parameters) {
    if (isBoxChecked && checkedBox == parameters.box)
        return;
    isBoxChecked = true;
    checkedBox = parameters.box;
    if (isPeriodic)
        checkPeriodicInBox(context, parameters);
    else
        checkClosedInBox(context);
}

void HelfrichForceImpl::checkPeriodicInBox(ContextImpl& context, const HelfrichParameters& parameters) const {
    const PeriodicBox& box = parameters.box;
    vector<Vec3> positions;
    context.getPositions(positions);
    auto point = [&](int particle) {
        const Vec3& x = positions[particle];
        return Vector3<double>{x[0], x[1], x[2]};
    };
    double longest = 0, shortestSide = box.shortest();
    for (auto& t : mesh->getTriangles())
        for (int c = 0; c < 3; c++) {
            Vector3<double> edge = displacement(point(t[c]), point(t[(c + 1) % 3]), box);
            longest = max(longest, sqrt(dot(edge, edge)));
        }
    stringstream message;
    message << owner.getName() << ": the periodic box is " << box.lengths[0] << " x " << box.lengths[1] << " x "
            << box.lengths[2] << " nm, and ";
    if (shortestSide < 2 * longest) {
        message << "an edge from a vertex to the nearest image of another is " << longest
                << " nm long; each side must be at least twice as long as any edge, and be that of the mesh";
        throw OpenMMException(message.str());
    }
    checkWhole(context, box);
    if (parameters.has(Term::Repulsion) && parameters.repulsionOnset > shortestSide / 3) {
        message << "the repulsion's onset " << parameters.repulsionOnset << " nm; it must be at most a third of a side";
        throw OpenMMException(message.str());
    }
}

void HelfrichForceImpl::checkWhole(ContextImpl& context, const PeriodicBox& box) const {
    if (!isPeriodic)
        return;
    vector<Vec3> positions;
    context.getPositions(positions);
    auto edge = [&](int from, int to) {
        const Vec3 &a = positions[from], &b = positions[to];
        return displacement(Vector3<double>{a[0], a[1], a[2]}, Vector3<double>{b[0], b[1], b[2]}, box);
    };
    for (auto& t : mesh->getTriangles()) {
        Vector3<double> gap = edge(t[0], t[1]) + edge(t[1], t[2]) + edge(t[2], t[0]);
        if (max({fabs(gap.x), fabs(gap.y), fabs(gap.z)}) > box.shortest() / 2) {
            stringstream message;
            message << owner.getName() << ": the periodic box is " << box.lengths[0] << " x " << box.lengths[1] << " x "
                    << box.lengths[2] << " nm, and the nearest images of particles " << t[0] << ", " << t[1] << " and "
                    << t[2]
                    << " make no triangle: the box must be that of the mesh, and edges shorter than half a side, to "
                       "which a tether keeps them";
            throw OpenMMException(message.str());
        }
    }
}

void HelfrichForceImpl::checkClosedInBox(ContextImpl& context) const {
    Vec3 vectors[3];
    context.getPeriodicBoxVectors(vectors[0], vectors[1], vectors[2]);
    bool isPeriodic = context.getSystem().usesPeriodicBoundaryConditions(), isGiven = isPeriodic;
    for (int i = 0; i < 3; i++)
        isGiven |= (vectors[i][i] != DEFAULT_BOX);
    vector<Vec3> positions;
    context.getPositions(positions);
    for (int i = 0; i < 3 && isGiven; i++) {
        double box = vectors[i][i], lower = INFINITY, upper = -INFINITY, longest = 0;
        for (auto& t : mesh->getTriangles())
            for (int c = 0; c < 3; c++) {
                double x = positions[t[c]][i];
                lower = min(lower, x);
                upper = max(upper, x);
                longest = max(longest, fabs(positions[t[(c + 1) % 3]][i] - x));
            }
        if (longest <= box / 2 && (!isPeriodic || upper - lower < box))
            continue;
        stringstream message;
        message << owner.getName() << ": the System's periodic box is " << box << " nm along " << "xyz"[i]
                << ", and the vertices span " << upper - lower << " nm, with edges of up to " << longest
                << " nm; a HelfrichForce does not use periodic boundary conditions, unless "
                   "setUsesPeriodicBoundaryConditions() makes it.  It takes a closed mesh that is smaller than the "
                   "box, "
                   "with no edge longer than half of it";
        throw OpenMMException(message.str());
    }
}

HelfrichEnergyTerms HelfrichForceImpl::execute(ContextImpl& context, bool includeForces) {
    HelfrichParameters parameters = getParameters(context);
    checkBox(context, parameters);
    checkOrientation(context, parameters);
    if (kick != NULL)
        parameters = kick->getParameters(parameters);
    HelfrichEnergyTerms terms;
    bool isFinite = kernel.getAs<CalcHelfrichForceKernel>().execute(context, parameters, includeForces, terms);
    addTermsOfConnectivity(parameters, terms);
    if (!isFinite || !isfinite(terms.getTotal()))
        throwNonFinite(context, terms);
    return terms;
}

void HelfrichForceImpl::addTermsOfConnectivity(const HelfrichParameters& parameters, HelfrichEnergyTerms& terms) {
    if (parameters.has(Term::Gaussian) && !parameters.hasGaussianForces())
        terms[Term::Gaussian] = 2 * M_PI * parameters.getMaterial(0).gaussianModulus * mesh->getEulerCharacteristic();
    if (!parameters.has(Term::Pair))
        return;
    if (tableOfPairs != parameters.species || revisionOfPairs != mesh->getRevision() ||
        speciesRevisionOfPairs != mesh->getSpeciesRevision()) {
        pairEnergy = computePairEnergy(parameters);
        tableOfPairs = parameters.species;
        revisionOfPairs = mesh->getRevision();
        speciesRevisionOfPairs = mesh->getSpeciesRevision();
    }
    terms[Term::Pair] = pairEnergy;
}

double HelfrichForceImpl::computePairEnergy(const HelfrichParameters& parameters) const {
    double energy = 0;
    for (int h = 0; h < mesh->getNumHalfedges(); h++)
        if (h < mesh->opposite(h))
            energy += parameters.getPairEnergy(mesh->getSpecies(mesh->origin(h)), mesh->getSpecies(mesh->tip(h)));
    return energy;
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
    message << owner.getName() << ": the energy is not finite, or a force is not (";
    for (int i = 0; i < NUM_TERMS; i++)
        message << (i == 0 ? "" : ", ") << TERM_NAMES[i] << " " << terms[Term(i)];
    message << " kJ/mol): the positions are too far apart, or vertices or triangles have collapsed to a point";
    throw OpenMMException(message.str());
}

void HelfrichForceImpl::throwNonFinite(ContextImpl& context, const HelfrichGeometry& geometry) const {
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
    if (!includeEnergy)
        return 0;
    // Not at each step of a simulation, but wherever an energy is looked at.
    checkWhole(context, getBox(context));
    return energy;
}

bool HelfrichForceImpl::canMakeTrajectory(ContextImpl& context) const {
    return mesh->getNumVertices() == context.getSystem().getNumParticles() &&
           kernel.getAs<CalcHelfrichForceKernel>().canMakeTrajectory();
}

double HelfrichForceImpl::makeTrajectory(ContextImpl& context, const KickAndDriftSequence& sequence, bool mixed,
                                         IntegrateHamiltonianTrajectoryKernel* waves) {
    HelfrichEnergyTerms terms;
    HelfrichParameters parameters = getParameters(context);
    if (!kernel.getAs<CalcHelfrichForceKernel>().makeTrajectory(context, parameters, sequence, mixed, waves, terms))
        throwNonFinite(context, terms);
    checkWhole(context, parameters.box);
    addTermsOfConnectivity(parameters, terms);
    return terms.getTotal();
}

map<string, double> HelfrichForceImpl::getDefaultParameters() {
    HelfrichParameters p = owner.getParameters();
    map<string, double> defaults;
    for (auto& parameter : HELFRICH_CONTEXT_PARAMETERS)
        defaults[owner.getName() + parameter.name] = parameter.valueIn(p);
    for (auto& target : p.surfaceTargets)
        defaults[getParameterName(target.first)] = target.second;
    return defaults;
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
    checkSpecies(owner);
    auto surfaceTargets = parameters.surfaceTargets;
    parameters = owner.getParameters();
    parameters.surfaceTargets = surfaceTargets;
    isBoxChecked = isBoxChecked && !isPeriodic;
    kernel.getAs<CalcHelfrichForceKernel>().copyParametersToContext(context, owner);
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
    kernel.getAs<CalcHelfrichForceKernel>().computeGeometry(context, getBox(context), geometry);
    if (!isFinite(geometry, true))
        throwNonFinite(context, geometry);
    geometry.areaDifference = 2 * parameters.leafletSeparation * geometry.integratedMeanCurvature;
    for (auto& surface : geometry.surfaces)
        surface.areaDifference = 2 * parameters.leafletSeparation * surface.integratedMeanCurvature;
    return geometry;
}

void HelfrichForceImpl::setTriangles(ContextImpl& context, const vector<array<int, 3>>& triangles) {
    mesh->setTriangles(triangles);
    isOrientationChecked = false;
    context.systemChanged();
}

void HelfrichForceImpl::setSpecies(ContextImpl& context, const vector<int>& species) {
    if (mesh->getSpecies().empty())
        throw OpenMMException(owner.getName() +
                              ": there were no species when the Context was created; add them with addSpecies()");
    mesh->setSpecies(species, getNumSpecies());
    context.systemChanged();
}

void HelfrichForceImpl::createCheckpoint(ostream& stream) const {
    auto triangles = mesh->getTriangles();
    writeBinary(stream, (long long) triangles.size());
    stream.write((const char*) triangles.data(), sizeof(triangles[0]) * triangles.size());
    stream.write((const char*) mesh->getOrder().data(), sizeof(int) * mesh->getOrder().size());
    stream.write((const char*) mesh->getSpecies().data(), sizeof(int) * mesh->getSpecies().size());
}

void HelfrichForceImpl::loadCheckpoint(ContextImpl& context, istream& stream) {
    long long numTriangles;
    readBinary(stream, numTriangles);
    if (numTriangles != mesh->getNumTriangles())
        throw OpenMMException("loadCheckpoint: the checkpoint is of a membrane with " + to_string(numTriangles) +
                              " triangles, and " + owner.getName() + " has " + to_string(mesh->getNumTriangles()));
    vector<array<int, 3>> triangles(numTriangles);
    vector<int> order(mesh->getNumVertices()), species(mesh->getSpecies().size());
    if (!stream.read((char*) triangles.data(), sizeof(triangles[0]) * triangles.size()) ||
        !stream.read((char*) order.data(), sizeof(int) * order.size()) ||
        !stream.read((char*) species.data(), sizeof(int) * species.size()))
        throw OpenMMException("loadCheckpoint: the checkpoint ends too early");
    restore(context, triangles, order, species);
}

void HelfrichForceImpl::serializeState(SerializationNode& node) const {
    storeTriangles(mesh->getTriangles(), node);
    storeIntegers(mesh->getOrder(), "vertices", node.createChildNode("Order"));
    if (!mesh->getSpecies().empty())
        storeIntegers(mesh->getSpecies(), "vertices", node.createChildNode("Species"));
}

void HelfrichForceImpl::deserializeState(ContextImpl& context, const SerializationNode& node) {
    vector<int> species;
    bool hasSpecies = any_of(node.getChildren().begin(), node.getChildren().end(),
                             [](const SerializationNode& child) { return child.getName() == "Species"; });
    if (hasSpecies != !mesh->getSpecies().empty())
        throw OpenMMException("setState: the State is of a membrane with" + string(hasSpecies ? "" : "out") +
                              " species, and " + owner.getName() + " has " + to_string(owner.getNumSpecies()));
    if (hasSpecies)
        species = loadIntegers("vertices", node.getChildNode("Species"));
    restore(context, loadTriangles(node), loadIntegers("vertices", node.getChildNode("Order")), species);
}

void HelfrichForceImpl::restore(ContextImpl& context, const vector<array<int, 3>>& triangles, const vector<int>& order,
                                const vector<int>& species) {
    setTriangles(context, triangles);
    mesh->setOrder(order);
    if (!mesh->getSpecies().empty())
        setSpecies(context, species);
    isOrientationChecked = true;
}

EdgeFlipStatistics HelfrichForceImpl::flipEdges(ContextImpl& context, double kT, long long numAttempts,
                                                const Philox& random, long long sweep) {
    HelfrichParameters parameters = getParameters(context);
    requirePositions(context);
    CalcHelfrichForceKernel& calculation = kernel.getAs<CalcHelfrichForceKernel>();
    if (!flipKernel) {
        flipKernel = context.getPlatform().createKernel(SweepEdgeFlipsKernel::Name(), context);
        flipKernel->getAs<SweepEdgeFlipsKernel>().initialize(context.getSystem(), owner, *mesh, calculation);
    }
    EdgeFlipStatistics statistics;
    if (!flipKernel->getAs<SweepEdgeFlipsKernel>().execute(context, parameters, kT, numAttempts, random, sweep,
                                                           statistics)) {
        HelfrichGeometry geometry;
        calculation.computeGeometry(context, parameters.box, geometry);
        throwNonFinite(context, geometry);
    }
    context.systemChanged();
    return statistics;
}

SpeciesExchangeStatistics HelfrichForceImpl::exchangeSpecies(ContextImpl& context, const SpeciesProposal& proposal,
                                                             double kT, long long numAttempts, const Philox& random,
                                                             long long sweep) {
    HelfrichParameters parameters = getParameters(context);
    requirePositions(context);
    CalcHelfrichForceKernel& calculation = kernel.getAs<CalcHelfrichForceKernel>();
    if (!exchangeKernel) {
        exchangeKernel = context.getPlatform().createKernel(ExchangeSpeciesKernel::Name(), context);
        exchangeKernel->getAs<ExchangeSpeciesKernel>().initialize(context.getSystem(), owner, *mesh, calculation);
    }
    SpeciesExchangeStatistics statistics;
    if (!exchangeKernel->getAs<ExchangeSpeciesKernel>().execute(context, parameters, proposal, kT, numAttempts, random,
                                                                sweep, statistics)) {
        HelfrichGeometry geometry;
        calculation.computeGeometry(context, parameters.box, geometry);
        throwNonFinite(context, geometry);
    }
    context.systemChanged();
    return statistics;
}
