#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/internal/Checks.h"
#include "openmmhelfrich/internal/HelfrichForceImpl.h"
#include "openmm/internal/ContextImpl.h"
#include <algorithm>
#include <cmath>
#include <sstream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static void fail(const string& item, double value, const string& allowed) {
    stringstream message;
    message << item << " is " << value << "; it must be " << allowed;
    throw OpenMMException(message.str());
}

/**
 * The largest exponent: its own power in the stretching potential is still a number, and a slip of the pen in a file
 * costs no hours.
 */
static const int MAX_EXPONENT = 100;

static void checkExponent(const string& item, int exponent) {
    if (exponent < 1 || exponent > MAX_EXPONENT)
        fail(item, exponent, "from 1 to " + to_string(MAX_EXPONENT));
}

static void checkFinite(const string& item, double value) {
    if (!isfinite(value))
        fail(item, value, "finite");
}

HelfrichForce::HelfrichForce() {
    setName("HelfrichForce");
}

int HelfrichForce::addTriangle(int particle1, int particle2, int particle3) {
    triangles.push_back({particle1, particle2, particle3});
    return triangles.size() - 1;
}

static void checkIndex(const string& method, const string& item, int index, int count) {
    if (index < 0 || index >= count)
        throw OpenMMException(method + ": there is no " + item + " " + to_string(index) + "; there are " +
                              to_string(count));
}

void HelfrichForce::getTriangleParameters(int index, int& particle1, int& particle2, int& particle3) const {
    checkIndex("getTriangleParameters", "triangle", index, triangles.size());
    particle1 = triangles[index][0];
    particle2 = triangles[index][1];
    particle3 = triangles[index][2];
}

void HelfrichForce::setTriangleParameters(int index, int particle1, int particle2, int particle3) {
    checkIndex("setTriangleParameters", "triangle", index, triangles.size());
    triangles[index] = {particle1, particle2, particle3};
}

void HelfrichForce::setTriangles(const vector<array<int, 3>>& triangles) {
    this->triangles = triangles;
}

int HelfrichForce::addFixedEdge(int particle1, int particle2) {
    fixedEdges.push_back({particle1, particle2});
    return fixedEdges.size() - 1;
}

void HelfrichForce::getFixedEdgeParameters(int index, int& particle1, int& particle2) const {
    checkIndex("getFixedEdgeParameters", "fixed edge", index, fixedEdges.size());
    particle1 = fixedEdges[index][0];
    particle2 = fixedEdges[index][1];
}

void HelfrichForce::setFixedEdgeParameters(int index, int particle1, int particle2) {
    checkIndex("setFixedEdgeParameters", "fixed edge", index, fixedEdges.size());
    fixedEdges[index] = {particle1, particle2};
}

static const int ALL_SURFACES = -1;

static void checkSurface(const string& method, int surface) {
    if (surface < ALL_SURFACES)
        fail(method + ": the surface", surface, "a number from 0, or -1 for all");
}

void HelfrichForce::setTarget(const char* method, Term term, double& targetOfAll, double value, int surface) {
    checkSurface(method, surface);
    if (surface != ALL_SURFACES) {
        parameters.surfaceTargets[{term, surface}] = value;
        return;
    }
    targetOfAll = value;
    auto& own = parameters.surfaceTargets;
    own.erase(own.lower_bound({term, 0}), own.lower_bound({Term(int(term) + 1), 0}));
}

double HelfrichForce::getTarget(const char* method, Term term, int surface) const {
    checkSurface(method, surface);
    return parameters.getTarget(term, surface);
}

HelfrichSpeciesTable& HelfrichForce::changeSpecies() {
    // A Context, or a copy of the parameters, may have the same table, and keeps it.

    if (!parameters.species)
        parameters.species = make_shared<HelfrichSpeciesTable>();
    else if (parameters.species.use_count() > 1)
        parameters.species = make_shared<HelfrichSpeciesTable>(*parameters.species);
    return const_cast<HelfrichSpeciesTable&>(*parameters.species);
}

void HelfrichForce::takeModuliOfSpecies() {
    const HelfrichSpeciesTable& table = *parameters.species;
    parameters.moduli[Term::Bending] = table.getGreatest().bendingModulus;
    parameters.moduli[Term::Gaussian] = table.getGreatest().gaussianModulus;
    parameters.moduli[Term::Line] = table.lineTensions.getGreatest();
    parameters.moduli[Term::Pair] = table.pairEnergies.getGreatest();
}

void HelfrichForce::requireOneMaterial(const char* method) const {
    if (parameters.species)
        throw OpenMMException(string(method) + ": there are " + to_string(getNumSpecies()) +
                              " species, each with a modulus of its own; set that with setSpeciesParameters()");
}

static void checkSpecies(const string& method, double bendingModulus, double spontaneousCurvature,
                         double gaussianModulus) {
    requirePositive(method + ": the bending modulus", bendingModulus, true);
    checkFinite(method + ": the spontaneous curvature", spontaneousCurvature);
    checkFinite(method + ": the Gaussian modulus", gaussianModulus);
}

int HelfrichForce::addSpecies(double bendingModulus, double spontaneousCurvature, double gaussianModulus) {
    checkSpecies("addSpecies", bendingModulus, spontaneousCurvature, gaussianModulus);
    changeSpecies().add({bendingModulus, spontaneousCurvature, gaussianModulus});
    takeModuliOfSpecies();
    return getNumSpecies() - 1;
}

void HelfrichForce::getSpeciesParameters(int index, double& bendingModulus, double& spontaneousCurvature,
                                         double& gaussianModulus) const {
    checkIndex("getSpeciesParameters", "species", index, getNumSpecies());
    const HelfrichSpecies& species = (*parameters.species)[index];
    bendingModulus = species.bendingModulus;
    spontaneousCurvature = species.spontaneousCurvature;
    gaussianModulus = species.gaussianModulus;
}

void HelfrichForce::setSpeciesParameters(int index, double bendingModulus, double spontaneousCurvature,
                                         double gaussianModulus) {
    checkIndex("setSpeciesParameters", "species", index, getNumSpecies());
    checkSpecies("setSpeciesParameters", bendingModulus, spontaneousCurvature, gaussianModulus);
    changeSpecies().set(index, {bendingModulus, spontaneousCurvature, gaussianModulus});
    takeModuliOfSpecies();
}

void HelfrichForce::setVertexSpecies(const vector<int>& species) {
    for (size_t v = 0; v < species.size(); v++)
        if (species[v] < 0)
            fail("setVertexSpecies: the species of vertex " + to_string(v), species[v], "a number from 0");
    vertexSpecies = species;
}

void HelfrichForce::checkSpeciesPair(const char* method, int species1, int species2) const {
    checkIndex(method, "species", species1, getNumSpecies());
    checkIndex(method, "species", species2, getNumSpecies());
}

double HelfrichForce::getLineTension(int species1, int species2) const {
    checkSpeciesPair("getLineTension", species1, species2);
    return parameters.species->lineTensions.get(species1, species2);
}

void HelfrichForce::setLineTension(int species1, int species2, double lineTension) {
    checkSpeciesPair("setLineTension", species1, species2);
    checkFinite("setLineTension: the line tension", lineTension);
    if (species1 == species2)
        throw OpenMMException("setLineTension: the species are " + to_string(species1) + " and " + to_string(species2) +
                              "; a boundary is between two different ones");
    changeSpecies().lineTensions.set(species1, species2, lineTension);
    takeModuliOfSpecies();
}

double HelfrichForce::getPairEnergy(int species1, int species2) const {
    checkSpeciesPair("getPairEnergy", species1, species2);
    return parameters.species->pairEnergies.get(species1, species2);
}

void HelfrichForce::setPairEnergy(int species1, int species2, double energy) {
    checkSpeciesPair("setPairEnergy", species1, species2);
    checkFinite("setPairEnergy: the energy", energy);
    changeSpecies().pairEnergies.set(species1, species2, energy);
    takeModuliOfSpecies();
}

void HelfrichForce::setBendingModulus(double modulus) {
    requireOneMaterial("setBendingModulus");
    requirePositive("setBendingModulus: the modulus", modulus, true);
    parameters.moduli[Term::Bending] = modulus;
}

void HelfrichForce::setSpontaneousCurvature(double spontaneousCurvature) {
    checkFinite("setSpontaneousCurvature: the spontaneous curvature", spontaneousCurvature);
    parameters.spontaneousCurvature = spontaneousCurvature;
}

void HelfrichForce::setGaussianModulus(double modulus) {
    requireOneMaterial("setGaussianModulus");
    checkFinite("setGaussianModulus: the modulus", modulus);
    parameters.moduli[Term::Gaussian] = modulus;
}

void HelfrichForce::setAreaModulus(double modulus) {
    requirePositive("setAreaModulus: the modulus", modulus, true);
    parameters.moduli[Term::Area] = modulus;
}

double HelfrichForce::getTargetArea(int surface) const {
    return getTarget("getTargetArea", Term::Area, surface);
}

void HelfrichForce::setTargetArea(double area, int surface) {
    requirePositive("setTargetArea: the area", area, true);
    setTarget("setTargetArea", Term::Area, parameters.targetArea, area, surface);
}

void HelfrichForce::setVolumeModulus(double modulus) {
    requirePositive("setVolumeModulus: the modulus", modulus, true);
    parameters.moduli[Term::Volume] = modulus;
}

double HelfrichForce::getTargetVolume(int surface) const {
    return getTarget("getTargetVolume", Term::Volume, surface);
}

void HelfrichForce::setTargetVolume(double volume, int surface) {
    requirePositive("setTargetVolume: the volume", volume, true);
    setTarget("setTargetVolume", Term::Volume, parameters.targetVolume, volume, surface);
}

void HelfrichForce::setAreaDifferenceModulus(double modulus) {
    requirePositive("setAreaDifferenceModulus: the modulus", modulus, true);
    parameters.moduli[Term::AreaDifference] = modulus;
}

double HelfrichForce::getTargetAreaDifference(int surface) const {
    return getTarget("getTargetAreaDifference", Term::AreaDifference, surface);
}

void HelfrichForce::setTargetAreaDifference(double areaDifference, int surface) {
    checkFinite("setTargetAreaDifference: the area difference", areaDifference);
    setTarget("setTargetAreaDifference", Term::AreaDifference, parameters.targetAreaDifference, areaDifference,
              surface);
}

void HelfrichForce::setLeafletSeparation(double separation) {
    requirePositive("setLeafletSeparation: the separation", separation);
    parameters.leafletSeparation = separation;
}

void HelfrichForce::getTether(double& modulus, double& minLength, double& maxLength, int& exponent) const {
    modulus = parameters.moduli[Term::Tether];
    minLength = parameters.tetherMinLength;
    maxLength = parameters.tetherMaxLength;
    exponent = parameters.tetherExponent;
}

void HelfrichForce::setTether(double modulus, double minLength, double maxLength, int exponent) {
    requirePositive("setTether: the modulus", modulus, true);
    requirePositive("setTether: the minimum length", minLength, true);
    checkFinite("setTether: the maximum length", maxLength);
    if (modulus != 0 && minLength >= maxLength) {
        stringstream message;
        message << "setTether: the minimum length " << minLength << " must be less than the maximum length "
                << maxLength;
        throw OpenMMException(message.str());
    }
    checkExponent("setTether: the exponent", exponent);
    parameters.moduli[Term::Tether] = modulus;
    parameters.tetherMinLength = minLength;
    parameters.tetherMaxLength = maxLength;
    parameters.tetherExponent = exponent;
}

void HelfrichForce::setTetherLengthScale(double length) {
    requirePositive("setTetherLengthScale: the length", length);
    parameters.tetherLengthScale = length;
}

void HelfrichForce::getRepulsion(double& modulus, double& onset, int& exponent, int& exclusionLevel) const {
    modulus = parameters.moduli[Term::Repulsion];
    onset = parameters.repulsionOnset;
    exponent = parameters.repulsionExponent;
    exclusionLevel = parameters.repulsionExclusionLevel;
}

void HelfrichForce::setRepulsion(double modulus, double onset, int exponent, int exclusionLevel) {
    requirePositive("setRepulsion: the modulus", modulus, true);
    requirePositive("setRepulsion: the onset", onset, true);
    if (modulus != 0 && onset == 0)
        fail("setRepulsion: the onset", onset, "positive");
    checkExponent("setRepulsion: the exponent", exponent);
    if (exclusionLevel < 0 || exclusionLevel > 2)
        fail("setRepulsion: the exclusion level", exclusionLevel, "0, 1 or 2");
    parameters.moduli[Term::Repulsion] = modulus;
    parameters.repulsionOnset = onset;
    parameters.repulsionExponent = exponent;
    parameters.repulsionExclusionLevel = exclusionLevel;
}

void HelfrichForce::setRepulsionLengthScale(double length) {
    requirePositive("setRepulsionLengthScale: the length", length);
    parameters.repulsionLengthScale = length;
}

void HelfrichForce::setTension(double tension) {
    checkFinite("setTension: the tension", tension);
    parameters.moduli[Term::Tension] = tension;
}

void HelfrichForce::setPressure(double pressure) {
    checkFinite("setPressure: the pressure", pressure);
    parameters.moduli[Term::Pressure] = pressure;
}

static string getParameterName(const HelfrichForce& force, Term term, int surface = ALL_SURFACES) {
    bool isOwn = (force.getParameters().surfaceTargets.count({term, surface}) != 0);
    return force.getName() + getContextParameter(term).name + (isOwn ? to_string(surface) : "");
}

string HelfrichForce::getTargetAreaParameter(int surface) const {
    checkSurface("getTargetAreaParameter", surface);
    return getParameterName(*this, Term::Area, surface);
}

string HelfrichForce::getTargetVolumeParameter(int surface) const {
    checkSurface("getTargetVolumeParameter", surface);
    return getParameterName(*this, Term::Volume, surface);
}

string HelfrichForce::getTargetAreaDifferenceParameter(int surface) const {
    checkSurface("getTargetAreaDifferenceParameter", surface);
    return getParameterName(*this, Term::AreaDifference, surface);
}

string HelfrichForce::getTensionParameter() const {
    return getParameterName(*this, Term::Tension);
}

string HelfrichForce::getPressureParameter() const {
    return getParameterName(*this, Term::Pressure);
}

string HelfrichForce::getSpontaneousCurvatureParameter() const {
    return getParameterName(*this, Term::Bending);
}

vector<string> HelfrichForce::getTermNames() {
    return vector<string>(begin(TERM_NAMES), end(TERM_NAMES));
}

bool HelfrichForce::hasTerm(const string& name) const {
    int term = find(begin(TERM_NAMES), end(TERM_NAMES), name) - begin(TERM_NAMES);
    if (term == NUM_TERMS) {
        string message = "hasTerm: there is no term '" + name + "'; there are ";
        for (int i = 0; i < NUM_TERMS; i++)
            message += (i == 0 ? "" : ", ") + string(TERM_NAMES[i]);
        throw OpenMMException(message);
    }
    return parameters.has(Term(term));
}

static HelfrichForceImpl& findImpl(ForceImpl& impl) {
    return dynamic_cast<HelfrichForceImpl&>(impl);
}

int HelfrichForce::getNumSurfacesInContext(Context& context) const {
    return findImpl(getImplInContext(context)).getMesh().getNumSurfaces();
}

void HelfrichForce::getTrianglesInContext(Context& context, vector<array<int, 3>>& triangles) const {
    triangles = findImpl(getImplInContext(context)).getMesh().getTriangles();
}

void HelfrichForce::setTrianglesInContext(Context& context, const vector<array<int, 3>>& triangles) const {
    findImpl(getImplInContext(context)).setTriangles(getContextImpl(context), triangles);
}

void HelfrichForce::getVertexSpeciesInContext(Context& context, vector<int>& species) const {
    species = findImpl(getImplInContext(context)).getMesh().getSpecies();
}

void HelfrichForce::setVertexSpeciesInContext(Context& context, const vector<int>& species) const {
    findImpl(getImplInContext(context)).setSpecies(getContextImpl(context), species);
}

HelfrichEnergyTerms HelfrichForce::getEnergyTermsInContext(Context& context) const {
    return findImpl(getImplInContext(context)).getEnergyTerms(getContextImpl(context));
}

HelfrichGeometry HelfrichForce::getGeometryInContext(Context& context) const {
    return findImpl(getImplInContext(context)).getGeometry(getContextImpl(context));
}

void HelfrichForce::updateParametersInContext(Context& context) {
    findImpl(getImplInContext(context)).updateParametersInContext(getContextImpl(context));
}

ForceImpl* HelfrichForce::createImpl() const {
    return new HelfrichForceImpl(*this);
}
