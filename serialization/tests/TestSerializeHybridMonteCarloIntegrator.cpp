#include "IntegratorXml.h"
#include "openmmhelfrich/CustomTrajectoryIntegrator.h"
#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include "openmmhelfrich/ShearWaveIntegrator.h"
#include "openmm/LangevinMiddleIntegrator.h"
#include <iostream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

template <class Trajectory>
void testRoundTrip(const string& engine) {
    HybridMonteCarloIntegrator integrator(310.5, 0.003, 42, 0.2, 0.3, engine);
    integrator.setRandomNumberSeed(17);
    auto copy = copyThroughXml(integrator);
    ASSERT_EQUAL(310.5, copy->getTemperature());
    ASSERT_EQUAL(0.003, copy->getStepSize());
    ASSERT_EQUAL(42, dynamic_cast<Trajectory&>(copy->getMove(0)).getStepsPerTrajectory());
    ASSERT_EQUAL(0.2, copy->getFlipIntegrator().getFraction());
    ASSERT_EQUAL(0.3, copy->getFlipProbability());
    ASSERT_EQUAL(17, copy->getRandomNumberSeed());

    // The copy remains adjustable.

    copy->setTemperature(200.0);
    ASSERT_EQUAL(200.0, dynamic_cast<Trajectory&>(copy->getMove(0)).getTemperature());
    ASSERT_EQUAL(200.0, copy->getFlipIntegrator().getTemperature());
}

template <class Trajectory>
void testOwnSeeds(const string& engine) {
    HybridMonteCarloIntegrator integrator(310.5, 0.003, 100, 0.1, 0.5, engine);
    integrator.setRandomNumberSeed(17);
    dynamic_cast<Trajectory&>(integrator.getMove(0)).setRandomNumberSeed(18);
    dynamic_cast<EdgeFlipIntegrator&>(integrator.getMove(1)).setRandomNumberSeed(19);
    auto copy = copyThroughXml(integrator);
    ASSERT_EQUAL(17, copy->getRandomNumberSeed());
    ASSERT_EQUAL(18, dynamic_cast<Trajectory&>(copy->getMove(0)).getRandomNumberSeed());
    ASSERT_EQUAL(19, copy->getFlipIntegrator().getRandomNumberSeed());
}

void testOtherTrajectories() {
    EdgeFlipIntegrator* flips = new EdgeFlipIntegrator(250.0, 0.4);
    HybridMonteCarloIntegrator integrator(new LangevinMiddleIntegrator(280.0, 1.5, 0.002), flips, 0.6);
    auto copy = copyThroughXml(integrator);
    ASSERT_EQUAL(280.0, dynamic_cast<LangevinMiddleIntegrator&>(copy->getMove(0)).getTemperature());
    ASSERT_EQUAL(250.0, copy->getFlipIntegrator().getTemperature());
    ASSERT_EQUAL(0.6, copy->getFlipProbability());
}

void testManyMoves() {
    HybridMonteCarloIntegrator integrator(new HamiltonianTrajectoryIntegrator(300.0, 0.003));
    integrator.addMove(new ShearWaveIntegrator(300.0, 0.01, 1.0, 3.0), 0.25);
    integrator.addMove(new LangevinMiddleIntegrator(280.0, 1.5, 0.002), 0.125);
    integrator.addMove(new HybridMonteCarloIntegrator(290.0, 0.001), 0.0625);
    auto copy = copyThroughXml(integrator);
    ASSERT_EQUAL(4, copy->getNumMoves());
    ASSERT_EQUAL(0.5625, copy->getMoveProbability(0));
    ASSERT_EQUAL(0.25, copy->getMoveProbability(1));
    ASSERT_EQUAL(0.125, copy->getMoveProbability(2));
    ASSERT_EQUAL(0.0625, copy->getMoveProbability(3));
    ASSERT_EQUAL(3.0, dynamic_cast<ShearWaveIntegrator&>(copy->getMove(1)).getMaxWaveNumber());
    ASSERT_EQUAL(280.0, dynamic_cast<LangevinMiddleIntegrator&>(copy->getMove(2)).getTemperature());
    ASSERT_EQUAL(290.0, dynamic_cast<HybridMonteCarloIntegrator&>(copy->getMove(3)).getTemperature());
}

void testDamagedText() {
    HybridMonteCarloIntegrator integrator(310.5, 0.003);
    string text = toXml(integrator);
    assertRejected(text, "version=\"2\"", "version=\"3\"", "HybridMonteCarloIntegrator: unsupported version 3");
    assertRejected(text, "probability", "chance", "probability");
    assertRejected(text, "probability=\".5\"", "probability=\"2\"", "must be between 0 and 1");
    assertRejected("<Integrator type=\"HybridMonteCarloIntegrator\" version=\"2\" randomSeed=\"1\"/>", "1", "1",
                   "no moves");
}

void testDamagedTextOfVersion1() {
    string flips = "type=\"EdgeFlipIntegrator\"";
    string text =
            "<Integrator type=\"HybridMonteCarloIntegrator\" version=\"1\" flipProbability=\"0.5\" randomSeed=\"1\">"
            "<Trajectory type=\"VerletIntegrator\" version=\"1\" stepSize=\"1\" constraintTolerance=\"1e-5\"/>"
            "<Flips version=\"1\" temperature=\"1\" fraction=\"1\" randomSeed=\"1\" " +
            flips + "/></Integrator>";
    fromXml(text);
    assertRejected(text, flips, "type=\"VerletIntegrator\" stepSize=\"1\" constraintTolerance=\"1e-5\"", "'Flips'");
    assertRejected(text, "<Trajectory", "<Path", "Trajectory");
    assertRejected(text, "flipProb", "shearWaveProbability=\"0.1\" flipProb", "ShearWaves");
}

int main() {
    try {
        testRoundTrip<HamiltonianTrajectoryIntegrator>("native");
        testRoundTrip<CustomTrajectoryIntegrator>("custom");
        testOwnSeeds<HamiltonianTrajectoryIntegrator>("native");
        testOwnSeeds<CustomTrajectoryIntegrator>("custom");
        testOtherTrajectories();
        testManyMoves();
        testDamagedText();
        testDamagedTextOfVersion1();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
