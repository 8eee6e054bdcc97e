#include "openmmhelfrich/HelfrichForce.h"
#include "openmm/internal/AssertionUtilities.h"
#include "openmm/serialization/XmlSerializer.h"
#include <iostream>
#include <limits>
#include <memory>
#include <sstream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static string toXml(const HelfrichForce& force) {
    stringstream stream;
    XmlSerializer::serialize<Force>(&force, "Force", stream);
    return stream.str();
}

static unique_ptr<HelfrichForce> fromXml(const string& xml) {
    stringstream stream(xml);
    unique_ptr<Force> force(XmlSerializer::deserialize<Force>(stream));
    HelfrichForce* result = dynamic_cast<HelfrichForce*>(force.get());
    ASSERT(result != nullptr);
    force.release();
    return unique_ptr<HelfrichForce>(result);
}

static void makeForce(HelfrichForce& force) {
    force.setForceGroup(3);
    force.setName("inner <membrane>");
    force.setTriangles({{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, numeric_limits<int>::max()}});
    force.addFixedEdge(2, 1);
    force.addFixedEdge(0, 3);
    force.setBendingModulus(0.1);
    force.setAreaModulus(1.0 / 3);
    force.setTargetArea(1e300);
    force.setVolumeModulus(0.3);
    force.setTargetVolume(1e-300);
    force.setAreaDifferenceModulus(0.7);
    force.setTargetAreaDifference(-2.5);
    force.setLeafletSeparation(3.9);
    force.setTether(1.1, 0.25, 0.75, 5);
    force.setTetherLengthScale(0.3);
    force.setRepulsion(1.2, 0.35, 4, 2);
    force.setRepulsionLengthScale(0.6);
    force.setTension(-0.7);
    force.setPressure(0.9);
}

void testRoundTrip() {
    HelfrichForce force;
    makeForce(force);
    unique_ptr<HelfrichForce> copy = fromXml(toXml(force));
    ASSERT_EQUAL(force.getForceGroup(), copy->getForceGroup());
    ASSERT_EQUAL(force.getName(), copy->getName());
    ASSERT(force.getTriangles() == copy->getTriangles());
    ASSERT_EQUAL(force.getBendingModulus(), copy->getBendingModulus());
    ASSERT_EQUAL(force.getAreaModulus(), copy->getAreaModulus());
    ASSERT_EQUAL(force.getTargetArea(), copy->getTargetArea());
    ASSERT_EQUAL(force.getVolumeModulus(), copy->getVolumeModulus());
    ASSERT_EQUAL(force.getTargetVolume(), copy->getTargetVolume());
    ASSERT_EQUAL(force.getAreaDifferenceModulus(), copy->getAreaDifferenceModulus());
    ASSERT_EQUAL(force.getTargetAreaDifference(), copy->getTargetAreaDifference());
    ASSERT_EQUAL(force.getLeafletSeparation(), copy->getLeafletSeparation());
    ASSERT_EQUAL(-0.7, copy->getTension());
    ASSERT_EQUAL(0.9, copy->getPressure());
    ASSERT_EQUAL(toXml(force), toXml(*copy));
    ASSERT_EQUAL(2, copy->getNumFixedEdges());
    int particle1, particle2;
    copy->getFixedEdgeParameters(1, particle1, particle2);
    ASSERT(particle1 == 0 && particle2 == 3);
    double modulus, minLength, maxLength, onset;
    int exponent, exclusionLevel;
    copy->getTether(modulus, minLength, maxLength, exponent);
    ASSERT_EQUAL(1.1, modulus);
    ASSERT_EQUAL(0.25, minLength);
    ASSERT_EQUAL(0.75, maxLength);
    ASSERT_EQUAL(5, exponent);
    ASSERT_EQUAL(0.3, copy->getTetherLengthScale());
    copy->getRepulsion(modulus, onset, exponent, exclusionLevel);
    ASSERT_EQUAL(1.2, modulus);
    ASSERT_EQUAL(0.35, onset);
    ASSERT_EQUAL(4, exponent);
    ASSERT_EQUAL(2, exclusionLevel);
    ASSERT_EQUAL(0.6, copy->getRepulsionLengthScale());
}

void testDefaults() {
    HelfrichForce force;
    ASSERT_EQUAL(toXml(force), toXml(*fromXml(toXml(force))));
}

void testSurfaceTargets() {
    // Only a force that has these, or a length scale of the repulsion, is written as version 5.

    HelfrichForce force;
    makeForce(force);
    ASSERT(toXml(force).find("version=\"5\"") != string::npos);
    force.setRepulsionLengthScale(1);
    ASSERT(toXml(force).find("version=\"4\"") != string::npos);
    force.setTargetArea(0.1, 7);
    force.setTargetVolume(1.0 / 3, 0);
    force.setTargetVolume(1e-300, 2);
    force.setTargetAreaDifference(-0.7, 1);
    ASSERT(toXml(force).find("version=\"5\"") != string::npos);
    unique_ptr<HelfrichForce> copy = fromXml(toXml(force));
    ASSERT_EQUAL(toXml(force), toXml(*copy));
    ASSERT(force.getParameters().surfaceTargets == copy->getParameters().surfaceTargets);
    ASSERT_EQUAL(force.getTargetVolume(), copy->getTargetVolume());
    copy->setTargetArea(3);
    copy->setTargetVolume(3);
    copy->setTargetAreaDifference(3);
    ASSERT(toXml(*copy).find("version=\"4\"") != string::npos);
}

void testMaterial() {
    // Only a force that has species, a spontaneous curvature or a Gaussian modulus is written as version 6.

    for (int change = 0; change < 3; change++) {
        HelfrichForce force;
        makeForce(force);
        if (change == 0)
            force.setSpontaneousCurvature(1.0 / 3);
        if (change == 1)
            force.setGaussianModulus(-0.1);
        if (change == 2)
            force.setVertexSpecies({0, 3, 1});
        ASSERT(toXml(force).find("version=\"6\"") != string::npos);
        ASSERT_EQUAL(toXml(force), toXml(*fromXml(toXml(force))));
    }
    HelfrichForce force;
    makeForce(force);
    force.addSpecies(0.1, -1.0 / 3, 1e-300);
    force.addSpecies(1e300, 0.7);
    force.addSpecies(0, 0);
    force.setLineTension(2, 0, -0.3);
    force.setPairEnergy(1, 1, 0.9);
    force.setVertexSpecies({2, 0, 1, 1});
    unique_ptr<HelfrichForce> copy = fromXml(toXml(force));
    ASSERT_EQUAL(toXml(force), toXml(*copy));
    ASSERT_EQUAL(3, copy->getNumSpecies());
    double bendingModulus, spontaneousCurvature, gaussianModulus;
    copy->getSpeciesParameters(0, bendingModulus, spontaneousCurvature, gaussianModulus);
    ASSERT_EQUAL(0.1, bendingModulus);
    ASSERT_EQUAL(-1.0 / 3, spontaneousCurvature);
    ASSERT_EQUAL(1e-300, gaussianModulus);
    ASSERT_EQUAL(-0.3, copy->getLineTension(0, 2));
    ASSERT_EQUAL(0.0, copy->getLineTension(0, 1));
    ASSERT_EQUAL(0.9, copy->getPairEnergy(1, 1));
    ASSERT(force.getVertexSpecies() == copy->getVertexSpecies());
}

static string replaced(string text, const string& old, const string& with) {
    size_t position = text.find(old);
    ASSERT(position != string::npos);
    return text.replace(position, old.size(), with);
}

void testVersionWithoutLengthScaleOfRepulsion() {
    HelfrichForce force;
    makeForce(force);
    string xml = replaced(toXml(force), "version=\"5\"", "version=\"4\"");
    unique_ptr<HelfrichForce> copy = fromXml(replaced(xml, " lengthScale=\".6\"", ""));
    ASSERT_EQUAL(1.0, copy->getRepulsionLengthScale());
    ASSERT_EQUAL(0.9, copy->getPressure());
}

void testVersionWithoutTensionAndPressure() {
    HelfrichForce force;
    makeForce(force);
    string xml = replaced(toXml(force), "version=\"5\"", "version=\"3\"");
    xml = replaced(xml, " pressure=\".9\"", "");
    unique_ptr<HelfrichForce> copy = fromXml(replaced(xml, " tension=\"-.7\"", ""));
    ASSERT_EQUAL(0.0, copy->getTension());
    ASSERT_EQUAL(0.0, copy->getPressure());
    ASSERT_EQUAL(0.3, copy->getTetherLengthScale());
}

void testVersionWithoutLengthScale() {
    HelfrichForce force;
    makeForce(force);
    string xml = replaced(toXml(force), "version=\"5\"", "version=\"2\"");
    unique_ptr<HelfrichForce> copy = fromXml(replaced(xml, "lengthScale=\".3\" ", ""));
    ASSERT_EQUAL(1.0, copy->getTetherLengthScale());
    ASSERT_EQUAL(2, copy->getNumFixedEdges());
}

void testVersionWithoutFixedEdges() {
    HelfrichForce force;
    makeForce(force);
    string xml = replaced(toXml(force), "version=\"5\"", "version=\"1\"");
    size_t start = xml.find("<FixedEdges"), end = xml.find("/>", start);
    unique_ptr<HelfrichForce> copy = fromXml(xml.erase(start, end + 2 - start));
    ASSERT_EQUAL(0, copy->getNumFixedEdges());
    ASSERT(force.getTriangles() == copy->getTriangles());
}

static void assertRejected(const string& xml, const string& message) {
    try {
        fromXml(xml);
    }
    catch (const OpenMMException& error) {
        ASSERT(string(error.what()).find(message) != string::npos);
        return;
    }
    throwException(__FILE__, __LINE__, "no exception that says '" + message + "'");
}

void testDamagedSurfaceTargets() {
    HelfrichForce force;
    makeForce(force);
    force.setTargetVolume(0.3, 1);
    string xml = toXml(force);
    assertRejected(replaced(xml, "<SurfaceTargets", "<Targets"), "SurfaceTargets");
    assertRejected(replaced(xml, "term=\"volume\"", "term=\"bending\""), "'bending'");
    assertRejected(replaced(xml, "surface=\"1\"", "surface=\"-1\""), "surface -1");
    assertRejected(replaced(xml, "value=\".3\"", "value=\"-.3\""), "setTargetVolume");
    assertRejected(replaced(xml, "value=\".3\"", ""), "value");
}

void testDamagedText() {
    HelfrichForce force;
    makeForce(force);
    string xml = toXml(force);
    const string triangles = "0 2 1 0 1 3 0 3 2 1 2 2147483647";
    assertRejected(replaced(xml, "version=\"5\"", "version=\"8\""), "unsupported version 8");
    assertRejected(replaced(xml, "version=\"5\"", "version=\"0\""), "unsupported version 0");
    assertRejected(replaced(xml, "lengthScale=\".3\"", "lengthScale=\"-.3\""), "setTetherLengthScale");
    assertRejected(replaced(xml, "lengthScale=\".6\"", "lengthScale=\"0\""), "setRepulsionLengthScale");
    assertRejected(replaced(xml, "lengthScale", "unit"), "lengthScale");
    assertRejected(replaced(xml, "tension=\"-.7\"", "tension=\"inf\""), "setTension");
    assertRejected(replaced(xml, "tension", "sigma"), "tension");
    assertRejected(replaced(xml, "pressure=\".9\"", "pressure=\"inf\""), "setPressure");
    assertRejected(replaced(xml, "pressure", "p"), "pressure");
    assertRejected(replaced(xml, "2 1 0 3", "2 1 0"), "fixed edges are not complete");
    assertRejected(replaced(xml, "<FixedEdges ", "<Edges "), "FixedEdges");
    assertRejected(replaced(xml, triangles, "0 2 1 0 1 3 0 3 2"), "not complete");
    assertRejected(replaced(xml, triangles, "0 2 1 0 1 3 0 3 2 1 2"), "not complete");
    assertRejected(replaced(xml, triangles, ""), "not complete");
    assertRejected(replaced(xml, "2147483647", "2147483648"), "2147483648");
    assertRejected(replaced(xml, "0 2 1", "0 2.5 1"), "2.5");
    assertRejected(replaced(xml, "0 2 1", "0 two 1"), "two");
    assertRejected(replaced(xml, "0 2 1", "0  2 1"), "something else than an integer");
    assertRejected(replaced(xml, "2147483647", "4 "), "something else than an integer");
    assertRejected(replaced(xml, "<Tether ", "<Rope "), "Tether");
    assertRejected(replaced(xml, "bendingModulus", "stiffness"), "bendingModulus");
}

void testPeriodic() {
    // Only a periodic force is written as version 7.

    HelfrichForce force;
    makeForce(force);
    force.setUsesPeriodicBoundaryConditions(true);
    ASSERT(toXml(force).find("version=\"7\"") != string::npos);
    unique_ptr<HelfrichForce> copy = fromXml(toXml(force));
    ASSERT(copy->usesPeriodicBoundaryConditions());
    ASSERT_EQUAL(toXml(force), toXml(*copy));
    copy->setUsesPeriodicBoundaryConditions(false);
    ASSERT(toXml(*copy).find("version=\"5\"") != string::npos);
    ASSERT(!fromXml(toXml(*copy))->usesPeriodicBoundaryConditions());
}

int main() {
    try {
        testRoundTrip();
        testDefaults();
        testSurfaceTargets();
        testMaterial();
        testPeriodic();
        testVersionWithoutLengthScaleOfRepulsion();
        testVersionWithoutTensionAndPressure();
        testVersionWithoutLengthScale();
        testVersionWithoutFixedEdges();
        testDamagedSurfaceTargets();
        testDamagedText();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
