#include "openmmhelfrich/HelfrichForceProxy.h"
#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/internal/HelfrichSerialization.h"
#include "openmm/OpenMMException.h"
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * Version 2 added the fixed edges, version 3 the length scale of the tether, version 4 the tension and
 * the pressure, version 5 the length scale of the repulsion.
 */
static const int VERSION = 5, OLDEST_VERSION = 1;

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

static void storeRepulsion(const HelfrichParameters& p, SerializationNode& node) {
    node.setDoubleProperty("modulus", p.moduli[Term::Repulsion])
            .setDoubleProperty("onset", p.repulsionOnset)
            .setIntProperty("exponent", p.repulsionExponent)
            .setIntProperty("exclusionLevel", p.repulsionExclusionLevel)
            .setDoubleProperty("lengthScale", p.repulsionLengthScale);
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

void HelfrichForceProxy::serialize(const void* object, SerializationNode& node) const {
    node.setIntProperty("version", VERSION);
    const HelfrichForce& force = *reinterpret_cast<const HelfrichForce*>(object);
    node.setIntProperty("forceGroup", force.getForceGroup());
    node.setStringProperty("name", force.getName());
    const HelfrichParameters& p = force.getParameters();
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
    storeRepulsion(p, node.createChildNode("Repulsion"));
    storeTriangles(force.getTriangles(), node.createChildNode("Triangles"));
    storeFixedEdges(force, node.createChildNode("FixedEdges"));
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
    return force.release();
}
