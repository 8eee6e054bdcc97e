#include "openmmhelfrich/HelfrichForceProxy.h"
#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/internal/HelfrichSerialization.h"
#include "openmm/OpenMMException.h"
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * Version 2 added the fixed edges, version 3 the length scale of the tether, version 4 the tension and the pressure,
 * version 5 the length scale of the repulsion and the targets of single surfaces, version 6 the spontaneous curvature,
 * the Gaussian modulus and the species, version 7 periodic membranes.  A force is written as the oldest version from 4
 * on that has all that it uses, which older releases read.
 */
static const int VERSION = 7, OLDEST_VERSION = 1;

static int getVersion(const HelfrichForce& force) {
    const HelfrichParameters& p = force.getParameters();
    if (force.usesPeriodicBoundaryConditions())
        return 7;
    if (p.species || !force.getVertexSpecies().empty() || p.spontaneousCurvature != 0 || p.has(Term::Gaussian))
        return 6;
    return p.repulsionLengthScale != 1 || !p.surfaceTargets.empty() ? 5 : 4;
}

HelfrichForceProxy::HelfrichForceProxy() : SerializationProxy("HelfrichForce") {
}

static void storeTether(const HelfrichParameters& p, SerializationNode& node) {
    node.setDoubleProperty("modulus", p.moduli[Term::Tether])
            .setDoubleProperty("minLength", p.tetherMinLength)
            .setDoubleProperty("maxLength", p.tetherMaxLength)
            .setIntProperty("exponent", p.tetherExponent)
            .setDoubleProperty("lengthScale", p.tetherLengthScale);
}

static void loadTether(HelfrichForce& force, const SerializationNode& node, int version) {
    force.setTether(node.getDoubleProperty("modulus"), node.getDoubleProperty("minLength"),
                    node.getDoubleProperty("maxLength"), node.getIntProperty("exponent"));
    if (version > 2)
        force.setTetherLengthScale(node.getDoubleProperty("lengthScale"));
}

static void storeRepulsion(const HelfrichParameters& p, SerializationNode& node, int version) {
    node.setDoubleProperty("modulus", p.moduli[Term::Repulsion])
            .setDoubleProperty("onset", p.repulsionOnset)
            .setIntProperty("exponent", p.repulsionExponent)
            .setIntProperty("exclusionLevel", p.repulsionExclusionLevel);
    if (version > 4)
        node.setDoubleProperty("lengthScale", p.repulsionLengthScale);
}

static void loadRepulsion(HelfrichForce& force, const SerializationNode& node, int version) {
    force.setRepulsion(node.getDoubleProperty("modulus"), node.getDoubleProperty("onset"),
                       node.getIntProperty("exponent"), node.getIntProperty("exclusionLevel"));
    if (version > 4)
        force.setRepulsionLengthScale(node.getDoubleProperty("lengthScale"));
}

static void storeFixedEdges(const HelfrichForce& force, SerializationNode& node) {
    vector<int> particles(2 * force.getNumFixedEdges());
    for (int i = 0; i < force.getNumFixedEdges(); i++)
        force.getFixedEdgeParameters(i, particles[2 * i], particles[2 * i + 1]);
    node.setIntProperty("count", force.getNumFixedEdges());
    storeIntegers(particles, "particles", node);
}

static void loadFixedEdges(HelfrichForce& force, const SerializationNode& node) {
    vector<int> particles = loadIntegers("particles", node);
    int count = node.getIntProperty("count");
    if (count < 0 || 2LL * count != (long long) particles.size())
        throw OpenMMException("HelfrichForce: the serialized fixed edges are not complete: " +
                              to_string(particles.size()) + " particles for " + to_string(count) + " edges");
    for (int i = 0; i < count; i++)
        force.addFixedEdge(particles[2 * i], particles[2 * i + 1]);
}

static void storeSurfaceTargets(const HelfrichParameters& p, SerializationNode& node) {
    for (auto& target : p.surfaceTargets)
        node.createChildNode("Target")
                .setStringProperty("term", TERM_NAMES[int(target.first.first)])
                .setIntProperty("surface", target.first.second)
                .setDoubleProperty("value", target.second);
}

static void loadSurfaceTarget(HelfrichForce& force, const SerializationNode& node) {
    const string& term = node.getStringProperty("term");
    int surface = node.getIntProperty("surface");
    double value = node.getDoubleProperty("value");
    if (surface < 0)
        throw OpenMMException("HelfrichForce: a serialized target is of surface " + to_string(surface) +
                              "; surfaces are numbered from 0");
    if (term == TERM_NAMES[int(Term::Area)])
        force.setTargetArea(value, surface);
    else if (term == TERM_NAMES[int(Term::Volume)])
        force.setTargetVolume(value, surface);
    else if (term == TERM_NAMES[int(Term::AreaDifference)])
        force.setTargetAreaDifference(value, surface);
    else
        throw OpenMMException("HelfrichForce: a serialized target is of the term '" + term +
                              "'; only area, volume and areaDifference have targets");
}

static void storePairs(const HelfrichSpeciesPairs& pairs, const string& name, SerializationNode& node) {
    pairs.forEach([&](int species1, int species2, double value) {
        node.createChildNode(name)
                .setIntProperty("species1", species1)
                .setIntProperty("species2", species2)
                .setDoubleProperty("value", value);
    });
}

static void storeMaterial(const HelfrichForce& force, SerializationNode& node) {
    const HelfrichParameters& p = force.getParameters();
    node.setDoubleProperty("spontaneousCurvature", p.spontaneousCurvature);
    node.setDoubleProperty("gaussianModulus", p.moduli[Term::Gaussian]);
    SerializationNode& all = node.createChildNode("AllSpecies");
    for (int i = 0; i < force.getNumSpecies(); i++)
        all.createChildNode("Species")
                .setDoubleProperty("bendingModulus", (*p.species)[i].bendingModulus)
                .setDoubleProperty("spontaneousCurvature", (*p.species)[i].spontaneousCurvature)
                .setDoubleProperty("gaussianModulus", (*p.species)[i].gaussianModulus);
    if (p.species) {
        storePairs(p.species->lineTensions, "LineTension", node.createChildNode("LineTensions"));
        storePairs(p.species->pairEnergies, "PairEnergy", node.createChildNode("PairEnergies"));
    }
    storeIntegers(force.getVertexSpecies(), "vertices", node.createChildNode("VertexSpecies"));
}

static void loadMaterial(HelfrichForce& force, const SerializationNode& node) {
    force.setSpontaneousCurvature(node.getDoubleProperty("spontaneousCurvature"));
    force.setGaussianModulus(node.getDoubleProperty("gaussianModulus"));
    for (auto& species : node.getChildNode("AllSpecies").getChildren())
        force.addSpecies(species.getDoubleProperty("bendingModulus"), species.getDoubleProperty("spontaneousCurvature"),
                         species.getDoubleProperty("gaussianModulus"));
    if (force.getNumSpecies() > 0) {
        for (auto& pair : node.getChildNode("LineTensions").getChildren())
            force.setLineTension(pair.getIntProperty("species1"), pair.getIntProperty("species2"),
                                 pair.getDoubleProperty("value"));
        for (auto& pair : node.getChildNode("PairEnergies").getChildren())
            force.setPairEnergy(pair.getIntProperty("species1"), pair.getIntProperty("species2"),
                                pair.getDoubleProperty("value"));
    }
    force.setVertexSpecies(loadIntegers("vertices", node.getChildNode("VertexSpecies")));
}

void HelfrichForceProxy::serialize(const void* object, SerializationNode& node) const {
    const HelfrichForce& force = *reinterpret_cast<const HelfrichForce*>(object);
    const HelfrichParameters& p = force.getParameters();
    int version = getVersion(force);
    node.setIntProperty("version", version);
    node.setIntProperty("forceGroup", force.getForceGroup());
    node.setStringProperty("name", force.getName());
    node.setDoubleProperty("bendingModulus", p.moduli[Term::Bending]);
    node.setDoubleProperty("areaModulus", p.moduli[Term::Area]);
    node.setDoubleProperty("targetArea", p.targetArea);
    node.setDoubleProperty("volumeModulus", p.moduli[Term::Volume]);
    node.setDoubleProperty("targetVolume", p.targetVolume);
    node.setDoubleProperty("areaDifferenceModulus", p.moduli[Term::AreaDifference]);
    node.setDoubleProperty("targetAreaDifference", p.targetAreaDifference);
    node.setDoubleProperty("leafletSeparation", p.leafletSeparation);
    node.setDoubleProperty("tension", p.moduli[Term::Tension]);
    node.setDoubleProperty("pressure", p.moduli[Term::Pressure]);
    storeTether(p, node.createChildNode("Tether"));
    storeRepulsion(p, node.createChildNode("Repulsion"), version);
    storeTriangles(force.getTriangles(), node.createChildNode("Triangles"));
    storeFixedEdges(force, node.createChildNode("FixedEdges"));
    if (version > 4)
        storeSurfaceTargets(p, node.createChildNode("SurfaceTargets"));
    if (version > 5)
        storeMaterial(force, node.createChildNode("Material"));
    if (version > 6)
        node.setBoolProperty("usesPeriodicBoundaryConditions", force.usesPeriodicBoundaryConditions());
}

void* HelfrichForceProxy::deserialize(const SerializationNode& node) const {
    requireVersion(node, VERSION, getTypeName(), OLDEST_VERSION);
    unique_ptr<HelfrichForce> force(new HelfrichForce());
    force->setForceGroup(node.getIntProperty("forceGroup", 0));
    force->setName(node.getStringProperty("name", force->getName()));
    force->setBendingModulus(node.getDoubleProperty("bendingModulus"));
    force->setAreaModulus(node.getDoubleProperty("areaModulus"));
    force->setTargetArea(node.getDoubleProperty("targetArea"));
    force->setVolumeModulus(node.getDoubleProperty("volumeModulus"));
    force->setTargetVolume(node.getDoubleProperty("targetVolume"));
    force->setAreaDifferenceModulus(node.getDoubleProperty("areaDifferenceModulus"));
    force->setTargetAreaDifference(node.getDoubleProperty("targetAreaDifference"));
    force->setLeafletSeparation(node.getDoubleProperty("leafletSeparation"));
    int version = node.getIntProperty("version");
    loadTether(*force, node.getChildNode("Tether"), version);
    loadRepulsion(*force, node.getChildNode("Repulsion"), version);
    force->setTriangles(loadTriangles(node.getChildNode("Triangles")));
    if (version > 1)
        loadFixedEdges(*force, node.getChildNode("FixedEdges"));
    if (version > 3) {
        force->setTension(node.getDoubleProperty("tension"));
        force->setPressure(node.getDoubleProperty("pressure"));
    }
    if (version > 4)
        for (auto& target : node.getChildNode("SurfaceTargets").getChildren())
            loadSurfaceTarget(*force, target);
    if (version > 5)
        loadMaterial(*force, node.getChildNode("Material"));
    if (version > 6)
        force->setUsesPeriodicBoundaryConditions(node.getBoolProperty("usesPeriodicBoundaryConditions"));
    return force.release();
}
