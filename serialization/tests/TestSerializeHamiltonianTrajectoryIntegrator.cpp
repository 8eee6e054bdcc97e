#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmm/internal/AssertionUtilities.h"
#include "openmm/serialization/XmlSerializer.h"
#include <iostream>
#include <memory>
#include <sstream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

void testRoundTrip() {
    HamiltonianTrajectoryIntegrator integrator(300.1, 0.015, 42);
    integrator.setForcePrecision("mixed");
    integrator.setTrajectoryJitter(0.3);
    integrator.setSplitting("bcss3");
    integrator.setTetherSubsteps(4);
    integrator.setMomentumRefreshment(0.4);
    integrator.setRandomNumberSeed(-5);
    integrator.setIntegrationForceGroups(6);
    stringstream stream;
    XmlSerializer::serialize<Integrator>(&integrator, "Integrator", stream);
    unique_ptr<Integrator> deserialized(XmlSerializer::deserialize<Integrator>(stream));
    HamiltonianTrajectoryIntegrator& copy = dynamic_cast<HamiltonianTrajectoryIntegrator&>(*deserialized);
    ASSERT_EQUAL(integrator.getTemperature(), copy.getTemperature());
    ASSERT_EQUAL(integrator.getStepSize(), copy.getStepSize());
    ASSERT_EQUAL(integrator.getStepsPerTrajectory(), copy.getStepsPerTrajectory());
    ASSERT_EQUAL(integrator.getForcePrecision(), copy.getForcePrecision());
    ASSERT_EQUAL(integrator.getTrajectoryJitter(), copy.getTrajectoryJitter());
    ASSERT_EQUAL(integrator.getSplitting(), copy.getSplitting());
    ASSERT_EQUAL(integrator.getTetherSubsteps(), copy.getTetherSubsteps());
    ASSERT_EQUAL(integrator.getMomentumRefreshment(), copy.getMomentumRefreshment());
    ASSERT_EQUAL(integrator.getRandomNumberSeed(), copy.getRandomNumberSeed());
    ASSERT_EQUAL(integrator.getIntegrationForceGroups(), copy.getIntegrationForceGroups());
}

void testOtherVersion() {
    stringstream stream("<Integrator type=\"HamiltonianTrajectoryIntegrator\" version=\"7\" temperature=\"1\" "
                        "stepSize=\"1\" stepsPerTrajectory=\"1\" randomSeed=\"1\"/>");
    try {
        XmlSerializer::deserialize<Integrator>(stream);
    }
    catch (const OpenMMException& error) {
        ASSERT(string(error.what()).find("HamiltonianTrajectoryIntegrator: unsupported version 7") != string::npos);
        return;
    }
    throwException(__FILE__, __LINE__, "version 7 was accepted");
}

int main() {
    try {
        testRoundTrip();
        testOtherVersion();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
