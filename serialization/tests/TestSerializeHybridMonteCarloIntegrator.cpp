#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include "openmm/LangevinMiddleIntegrator.h"
#include "openmm/internal/AssertionUtilities.h"
#include "openmm/serialization/XmlSerializer.h"
#include <iostream>
#include <memory>
#include <sstream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static string toXml(const Integrator& integrator) {
    stringstream stream;
    XmlSerializer::serialize<Integrator>(&integrator, "Integrator", stream);
    return stream.str();
}

static unique_ptr<Integrator> fromXml(const string& xml) {
    stringstream stream(xml);
    return unique_ptr<Integrator>(XmlSerializer::deserialize<Integrator>(stream));
}

void testRoundTrip(const string& engine) {
    HybridMonteCarloIntegrator integrator(310.5, 0.003, 42, 0.2, 0.3, engine);
    integrator.setRandomNumberSeed(17);
    string xml = toXml(integrator);
    unique_ptr<Integrator> deserialized = fromXml(xml);
    HybridMonteCarloIntegrator& copy = dynamic_cast<HybridMonteCarloIntegrator&>(*deserialized);
    ASSERT_EQUAL(integrator.getTemperature(), copy.getTemperature());
    ASSERT_EQUAL(integrator.getStepSize(), copy.getStepSize());
    ASSERT_EQUAL(integrator.getStepsPerTrajectory(), copy.getStepsPerTrajectory());
    ASSERT_EQUAL(integrator.getFlipFraction(), copy.getFlipFraction());
    ASSERT_EQUAL(integrator.getFlipProbability(), copy.getFlipProbability());
    ASSERT_EQUAL(integrator.getRandomNumberSeed(), copy.getRandomNumberSeed());
    ASSERT_EQUAL(xml, toXml(copy));

    // The copy remains adjustable.

    copy.setTemperature(200.0);
    copy.setStepsPerTrajectory(7);
    ASSERT_EQUAL(200.0, copy.getTemperature());
    ASSERT_EQUAL(7, copy.getStepsPerTrajectory());
}

template <class Trajectory>
void testOwnSeeds(const string& engine) {
    HybridMonteCarloIntegrator integrator(310.5, 0.003, 100, 0.1, 0.5, engine);
    integrator.setRandomNumberSeed(17);
    dynamic_cast<Trajectory&>(integrator.getIntegrator(0)).setRandomNumberSeed(18);
    dynamic_cast<EdgeFlipIntegrator&>(integrator.getIntegrator(1)).setRandomNumberSeed(19);
    string xml = toXml(integrator);
    ASSERT_EQUAL(xml, toXml(*fromXml(xml)));
    for (string seed : {"17", "18", "19"})
        ASSERT(xml.find("randomSeed=\"" + seed + "\"") != string::npos);
}

void testOtherTrajectories() {
    EdgeFlipIntegrator* flips = new EdgeFlipIntegrator(250.0, 0.4);
    flips->setRandomNumberSeed(4);
    HybridMonteCarloIntegrator integrator(new LangevinMiddleIntegrator(280.0, 1.5, 0.002), flips, 0.6);
    string xml = toXml(integrator);
    unique_ptr<Integrator> deserialized = fromXml(xml);
    HybridMonteCarloIntegrator& copy = dynamic_cast<HybridMonteCarloIntegrator&>(*deserialized);
    LangevinMiddleIntegrator& trajectory = dynamic_cast<LangevinMiddleIntegrator&>(copy.getIntegrator(0));
    ASSERT_EQUAL(280.0, trajectory.getTemperature());
    ASSERT_EQUAL(250.0, copy.getFlipIntegrator().getTemperature());
    ASSERT_EQUAL(4, copy.getFlipIntegrator().getRandomNumberSeed());
    ASSERT_EQUAL(0.6, copy.getFlipProbability());
    ASSERT_EQUAL(xml, toXml(copy));
}

void testShearWaves() {
    HybridMonteCarloIntegrator integrator(310.5, 0.003);
    ASSERT(toXml(integrator).find("hearWave") == string::npos);
    integrator.addShearWaves(new ShearWaveIntegrator(310.5, 0.01, 1.0, 3.0), 0.25);
    string xml = toXml(integrator);
    unique_ptr<Integrator> deserialized = fromXml(xml);
    HybridMonteCarloIntegrator& copy = dynamic_cast<HybridMonteCarloIntegrator&>(*deserialized);
    ASSERT_EQUAL(0.25, copy.getShearWaveProbability());
    ASSERT_EQUAL(3.0, copy.getShearWaveIntegrator().getMaxWaveNumber());
    ASSERT_EQUAL(xml, toXml(copy));
}

static void assertRejected(string xml, const string& old, const string& with, const string& message) {
    size_t position = xml.find(old);
    ASSERT(position != string::npos);
    try {
        fromXml(xml.replace(position, old.size(), with));
    }
    catch (const OpenMMException& error) {
        ASSERT(string(error.what()).find(message) != string::npos);
        return;
    }
    throwException(__FILE__, __LINE__, "no exception that says '" + message + "'");
}

void testDamagedText() {
    string flips = "type=\"EdgeFlipIntegrator\"";
    string text =
            "<Integrator type=\"HybridMonteCarloIntegrator\" version=\"1\" flipProbability=\"0.5\" randomSeed=\"1\">"
            "<Trajectory type=\"VerletIntegrator\" version=\"1\" stepSize=\"1\" constraintTolerance=\"1e-5\"/>"
            "<Flips version=\"1\" temperature=\"1\" fraction=\"1\" randomSeed=\"1\" " +
            flips + "/></Integrator>";
    fromXml(text);
    assertRejected(text, "version=\"1\"", "version=\"3\"", "HybridMonteCarloIntegrator: unsupported version 3");
    assertRejected(text, flips, "type=\"VerletIntegrator\" stepSize=\"1\" constraintTolerance=\"1e-5\"", "'Flips'");
    assertRejected(text, "<Trajectory", "<Path", "Trajectory");
    assertRejected(text, "flipProb", "shearWaveProbability=\"0.1\" flipProb", "ShearWaves");
}

int main() {
    try {
        testRoundTrip("native");
        testRoundTrip("custom");
        testOwnSeeds<HamiltonianTrajectoryIntegrator>("native");
        testOwnSeeds<CustomIntegrator>("custom");
        testOtherTrajectories();
        testShearWaves();
        testDamagedText();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
