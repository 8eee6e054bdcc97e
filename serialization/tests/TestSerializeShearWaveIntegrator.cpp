#include "openmmhelfrich/ShearWaveIntegrator.h"
#include "openmm/internal/AssertionUtilities.h"
#include "openmm/serialization/XmlSerializer.h"
#include <iostream>
#include <memory>
#include <sstream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

void testRoundTrip() {
    ShearWaveIntegrator integrator(300.1, 0.015, 0.7, 2.1, 12);
    integrator.setRandomNumberSeed(-5);
    integrator.setIntegrationForceGroups(6);
    stringstream stream;
    XmlSerializer::serialize<Integrator>(&integrator, "Integrator", stream);
    unique_ptr<Integrator> deserialized(XmlSerializer::deserialize<Integrator>(stream));
    ShearWaveIntegrator& copy = dynamic_cast<ShearWaveIntegrator&>(*deserialized);
    ASSERT_EQUAL(integrator.getTemperature(), copy.getTemperature());
    ASSERT_EQUAL(integrator.getAmplitude(), copy.getAmplitude());
    ASSERT_EQUAL(integrator.getMinWaveNumber(), copy.getMinWaveNumber());
    ASSERT_EQUAL(integrator.getMaxWaveNumber(), copy.getMaxWaveNumber());
    ASSERT_EQUAL(integrator.getMovesPerStep(), copy.getMovesPerStep());
    ASSERT_EQUAL(integrator.getRandomNumberSeed(), copy.getRandomNumberSeed());
    ASSERT_EQUAL(integrator.getIntegrationForceGroups(), copy.getIntegrationForceGroups());
}

void testOtherVersion() {
    stringstream stream("<Integrator type=\"ShearWaveIntegrator\" version=\"7\" temperature=\"1\" amplitude=\"1\" "
                        "randomSeed=\"1\"/>");
    try {
        XmlSerializer::deserialize<Integrator>(stream);
    }
    catch (const OpenMMException& error) {
        ASSERT(string(error.what()).find("ShearWaveIntegrator: unsupported version 7") != string::npos);
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
