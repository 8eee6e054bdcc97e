#include "openmmhelfrich/HelfrichForceProxy.h"
#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/HelfrichSerialization.h"
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const int VERSION = 1;

HelfrichForceProxy::HelfrichForceProxy() : SerializationProxy("HelfrichForce") {
}

static void storeTether(const HelfrichForce& force, SerializationNode& node) {
    double modulus, minLength, maxLength;
    int exponent;
    force.getTether(modulus, minLength, maxLength, exponent);
    node.setDoubleProperty("modulus", modulus).setDoubleProperty("minLength", minLength).setDoubleProperty("maxLength", maxLength).setIntProperty("exponent", exponent);
}

static void loadTether(HelfrichForce& force, const SerializationNode& node) {
    force.setTether(node.getDoubleProperty("modulus"), node.getDoubleProperty("minLength"), node.getDoubleProperty("maxLength"), node.getIntProperty("exponent"));
}

static void storeRepulsion(const HelfrichForce& force, SerializationNode& node) {
    double modulus, onset;
    int exponent, exclusionLevel;
    force.getRepulsion(modulus, onset, exponent, exclusionLevel);
    node.setDoubleProperty("modulus", modulus).setDoubleProperty("onset", onset).setIntProperty("exponent", exponent).setIntProperty("exclusionLevel", exclusionLevel);
}

static void loadRepulsion(HelfrichForce& force, const SerializationNode& node) {
    force.setRepulsion(node.getDoubleProperty("modulus"), node.getDoubleProperty("onset"), node.getIntProperty("exponent"), node.getIntProperty("exclusionLevel"));
}

void HelfrichForceProxy::serialize(const void* object, SerializationNode& node) const {
    node.setIntProperty("version", VERSION);
    const HelfrichForce& force = *reinterpret_cast<const HelfrichForce*>(object);
    node.setIntProperty("forceGroup", force.getForceGroup());
    node.setStringProperty("name", force.getName());
    node.setDoubleProperty("bendingModulus", force.getBendingModulus());
    node.setDoubleProperty("areaModulus", force.getAreaModulus());
    node.setDoubleProperty("targetArea", force.getTargetArea());
    node.setDoubleProperty("volumeModulus", force.getVolumeModulus());
    node.setDoubleProperty("targetVolume", force.getTargetVolume());
    node.setDoubleProperty("areaDifferenceModulus", force.getAreaDifferenceModulus());
    node.setDoubleProperty("targetAreaDifference", force.getTargetAreaDifference());
    node.setDoubleProperty("leafletSeparation", force.getLeafletSeparation());
    storeTether(force, node.createChildNode("Tether"));
    storeRepulsion(force, node.createChildNode("Repulsion"));
    storeTriangles(force.getTriangles(), node.createChildNode("Triangles"));
}

void* HelfrichForceProxy::deserialize(const SerializationNode& node) const {
    requireVersion(node, VERSION, getTypeName());
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
    loadTether(*force, node.getChildNode("Tether"));
    loadRepulsion(*force, node.getChildNode("Repulsion"));
    force->setTriangles(loadTriangles(node.getChildNode("Triangles")));
    return force.release();
}
