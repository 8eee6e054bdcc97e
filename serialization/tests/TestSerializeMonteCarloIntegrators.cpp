#include "IntegratorXml.h"
#include "openmmhelfrich/CustomTrajectoryIntegrator.h"
#include "openmmhelfrich/EdgeFlipIntegrator.h"
#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/ShearWaveIntegrator.h"
#include "openmmhelfrich/SpeciesExchangeIntegrator.h"
#include <iostream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * Test what all moves have, and return a copy for tests of what one has.
 */
template <class T>
static unique_ptr<T> testMove(T& move, const string& name) {
    move.setTemperature(300.1);
    move.setRandomNumberSeed(-5);
    move.setIntegrationForceGroups(6);
    move.setConstraintTolerance(1e-7);
    assertRejected(toXml(move), "version=\"1\"", "version=\"7\"", name + ": unsupported version 7");
    unique_ptr<T> copy = copyThroughXml(move);
    ASSERT_EQUAL(300.1, copy->getTemperature());
    ASSERT_EQUAL(-5, copy->getRandomNumberSeed());
    ASSERT_EQUAL(6, copy->getIntegrationForceGroups());
    ASSERT_EQUAL(1e-7, copy->getConstraintTolerance());
    return copy;
}

void testEdgeFlips() {
    EdgeFlipIntegrator move(1, 0.15);
    auto copy = testMove(move, "EdgeFlipIntegrator");
    ASSERT_EQUAL(0.15, copy->getFraction());
}

void testShearWaves() {
    ShearWaveIntegrator move(1, 0.015, 0.7, 2.1, 12);
    auto copy = testMove(move, "ShearWaveIntegrator");
    ASSERT_EQUAL(0.015, copy->getAmplitude());
    ASSERT_EQUAL(0.7, copy->getMinWaveNumber());
    ASSERT_EQUAL(2.1, copy->getMaxWaveNumber());
    ASSERT_EQUAL(12, copy->getMovesPerStep());
}

void testSpeciesExchanges() {
    SpeciesExchangeIntegrator move(1, 0.15);
    move.setProposal("mutation");
    move.setChemicalPotential(0, -0.3);
    move.setChemicalPotential(7, 1.25);
    auto copy = testMove(move, "SpeciesExchangeIntegrator");
    ASSERT_EQUAL(0.15, copy->getFraction());
    ASSERT_EQUAL("mutation", copy->getProposal());
    ASSERT(move.getChemicalPotentials() == copy->getChemicalPotentials());
    assertRejected(toXml(move), "mutation", "nothing", "the proposal is 'nothing'; it must be 'neighbors'");
}

void testTrajectories() {
    HamiltonianTrajectoryIntegrator move(1, 0.015, 42);
    move.setForcePrecision("mixed");
    move.setTrajectoryJitter(0.3);
    move.setSplitting("bcss3");
    move.setTetherSubsteps(4);
    move.setMomentumRefreshment(0.4);
    auto copy = testMove(move, "HamiltonianTrajectoryIntegrator");
    ASSERT_EQUAL(0.015, copy->getStepSize());
    ASSERT_EQUAL(42, copy->getStepsPerTrajectory());
    ASSERT_EQUAL("mixed", copy->getForcePrecision());
    ASSERT_EQUAL(0.3, copy->getTrajectoryJitter());
    ASSERT_EQUAL("bcss3", copy->getSplitting());
    ASSERT_EQUAL(4, copy->getTetherSubsteps());
    ASSERT_EQUAL(0.4, copy->getMomentumRefreshment());
    ASSERT_EQUAL(0.0, copy->getMultilevelWeight());
    move.setMultilevelWeight(1.5);
    assertRejected(toXml(move), "version=\"2\"", "version=\"7\"",
                   "HamiltonianTrajectoryIntegrator: unsupported version 7");
    ASSERT_EQUAL(1.5, copyThroughXml(move)->getMultilevelWeight());
}

void testCustomTrajectories() {
    CustomTrajectoryIntegrator move(1, 0.015, 42);
    auto copy = testMove(move, "CustomTrajectoryIntegrator");
    ASSERT_EQUAL(0.015, copy->getStepSize());
    ASSERT_EQUAL(42, copy->getStepsPerTrajectory());
}

int main() {
    try {
        testEdgeFlips();
        testShearWaves();
        testSpeciesExchanges();
        testTrajectories();
        testCustomTrajectories();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
