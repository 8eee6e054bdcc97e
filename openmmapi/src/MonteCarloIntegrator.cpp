#include "openmmhelfrich/MonteCarloIntegrator.h"
#include "openmmhelfrich/internal/HelfrichSerialization.h"
#include "openmmhelfrich/internal/MembraneState.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include <algorithm>
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * Version 2 of States added the membranes, which had been the EdgeFlipIntegrator's.
 */
static const int VERSION = 2, OLDEST_VERSION = 1;

MonteCarloIntegrator::MonteCarloIntegrator(const string& name, double temperature, bool allowsZero)
        : name(name), allowsZero(allowsZero) {
    MonteCarloIntegrator::setTemperature(temperature);
    Integrator::setStepSize(0);
    setConstraintTolerance(1e-5);
}

void MonteCarloIntegrator::setTemperature(double temperature) {
    requirePositive(name + ": the temperature in K", temperature, allowsZero);
    this->temperature = temperature;
}

void MonteCarloIntegrator::initialize(ContextImpl& contextRef) {
    requireActingForces(contextRef, name);
    bind(contextRef, context, owner);
    membranes = findMembranes(contextRef);
}

void MonteCarloIntegrator::cleanup() {
    membranes.clear();
}

vector<string> MonteCarloIntegrator::getKernelNames() {
    return {};
}

void MonteCarloIntegrator::step(int steps) {
    requireContext(context);
    for (int i = 0; i < steps; i++) {
        makeMove();
        context->setStepCount(context->getStepCount() + 1);
    }
}

double MonteCarloIntegrator::getThermalEnergy() const {
    return BOLTZMANN * temperature;
}

double MonteCarloIntegrator::getAcceptanceProbability(double energyChange) const {
    return min(1.0, exp(-energyChange / getThermalEnergy()));
}

bool MonteCarloIntegrator::draw(unsigned int stream, long long counter, double probability) const {
    auto words = getRandom(stream)(0, counter);
    return Philox::uniform(words[0], words[1]) < probability;
}

bool MonteCarloIntegrator::hasOnlyMembranes() const {
    return membranes.size() == context->getForceImpls().size();
}

bool MonteCarloIntegrator::isIntegrated(const HelfrichForceImpl& membrane) const {
    return (getIntegrationForceGroups() & (1 << membrane.getOwner().getForceGroup())) != 0;
}

double MonteCarloIntegrator::computePotentialEnergy() {
    if (!hasOnlyMembranes())
        return context->calcForcesAndEnergy(false, true, getIntegrationForceGroups());
    double energy = 0;
    for (auto membrane : membranes)
        energy += membrane->calcForcesAndEnergy(*context, false, true, getIntegrationForceGroups());
    return energy;
}

double MonteCarloIntegrator::computeKineticEnergy() {
    vector<Vec3> velocities;
    context->getVelocities(velocities);
    double energy = 0;
    for (int i = 0; i < (int) velocities.size(); i++)
        energy += 0.5 * context->getSystem().getParticleMass(i) * velocities[i].dot(velocities[i]);
    return energy;
}

bool MonteCarloIntegrator::kineticEnergyRequiresForce() const {
    return false;
}

void MonteCarloIntegrator::createCheckpoint(ostream& stream) const {
    writeName(stream, name);
    writeSeedAndCounters(stream);
    MembraneState(*this, *context).createCheckpoint(stream);
}

void MonteCarloIntegrator::loadCheckpoint(istream& stream) {
    bool hasName = readName(stream, name);
    readSeedAndCounters(stream);
    MembraneState state(*this, *context);
    if (!state.loadCheckpoint(stream))
        state.loadFirstCheckpoint(stream);
    if (!hasName)
        requireEnd(stream, *this, *context, name);
}

void MonteCarloIntegrator::serializeParameters(SerializationNode& node) const {
    node.setIntProperty("version", VERSION);
    storeSeedAndCounters(node);
    MembraneState(*this, *context).serialize(node);
}

void MonteCarloIntegrator::deserializeParameters(const SerializationNode& node) {
    requireVersion(node, VERSION, name, OLDEST_VERSION);
    MembraneState state(*this, *context);
    if (node.getIntProperty("version") == OLDEST_VERSION)
        state.deserializeFirst(node);
    else
        state.deserialize(node);
    loadSeedAndCounters(node);
}
