#include "openmmhelfrich/CustomTrajectoryIntegrator.h"
#include "openmmhelfrich/internal/MembraneState.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const string NAME = "CustomTrajectoryIntegrator";

CustomTrajectoryIntegrator::CustomTrajectoryIntegrator(double temperature, double stepSize, int stepsPerTrajectory)
        : CustomIntegrator(1) {
    addGlobalVariable("kT", 0);
    addGlobalVariable("stepsPerTrajectory", 0);
    setTemperature(temperature);
    setStepSize(stepSize);
    setStepsPerTrajectory(stepsPerTrajectory);
    addSteps();
}

void CustomTrajectoryIntegrator::addSteps() {
    // The test step(exp(-dH/kT)-u) is false when dH is not a number.  A rejection reverses velocities: moves beside
    // this one may keep them.

    for (string name :
         {"leapfrogStep", "startKineticEnergy", "startEnergy", "endKineticEnergy", "endEnergy", "accepted"})
        addGlobalVariable(name, 0);
    addPerDofVariable("startX", 0);
    addPerDofVariable("startV", 0);
    addComputePerDof("startX", "x");
    addComputePerDof("v", "sqrt(kT/m)*gaussian");
    addComputePerDof("startV", "v");
    addComputeSum("startKineticEnergy", "0.5*m*v*v");
    addComputeGlobal("startEnergy", "energy+startKineticEnergy");
    addComputePerDof("v", "v+0.5*dt*f/m");
    addComputeGlobal("leapfrogStep", "1");
    beginWhileBlock("leapfrogStep < stepsPerTrajectory");
    addComputePerDof("x", "x+dt*v");
    addComputePerDof("v", "v+dt*f/m");
    addComputeGlobal("leapfrogStep", "leapfrogStep+1");
    endBlock();
    addComputePerDof("x", "x+dt*v");
    addComputePerDof("v", "v+0.5*dt*f/m");
    addComputeSum("endKineticEnergy", "0.5*m*v*v");
    addComputeGlobal("endEnergy", "energy+endKineticEnergy");
    addComputeGlobal("accepted", "step(exp((startEnergy-endEnergy)/kT)-uniform)");
    beginIfBlock("accepted < 0.5");
    addComputePerDof("x", "startX");
    addComputePerDof("v", "-startV");
    endBlock();
}

double CustomTrajectoryIntegrator::getTemperature() const {
    // A checkpoint may have brought another kT.

    double kT = getGlobalVariableByName("kT");
    return kT == BOLTZMANN * temperature ? temperature : kT / BOLTZMANN;
}

void CustomTrajectoryIntegrator::setTemperature(double temperature) {
    requirePositive(NAME + ": the temperature in K", temperature);
    this->temperature = temperature;
    setGlobalVariableByName("kT", BOLTZMANN * temperature);
}

void CustomTrajectoryIntegrator::setStepSize(double size) {
    requirePositive(NAME + ": the step size in ps", size);
    CustomIntegrator::setStepSize(size);
}

int CustomTrajectoryIntegrator::getStepsPerTrajectory() const {
    return (int) getGlobalVariableByName("stepsPerTrajectory");
}

void CustomTrajectoryIntegrator::setStepsPerTrajectory(int steps) {
    requirePositive(NAME + ": the number of steps per trajectory", steps);
    setGlobalVariableByName("stepsPerTrajectory", steps);
}

void CustomTrajectoryIntegrator::initialize(ContextImpl& contextRef) {
    requireFreeParticles(contextRef.getSystem(), NAME);
    requireActingForces(contextRef, NAME);
    CustomIntegrator::initialize(contextRef);
    resetCounters();
}

void CustomTrajectoryIntegrator::step(int steps) {
    requireContext(context);
    for (int i = 0; i < steps; i++) {
        double start = context->getTime();
        makeTrajectory();
        context->setTime(start + getStepsPerTrajectory() * getStepSize());
        numTrajectories++;
    }
}

void CustomTrajectoryIntegrator::makeTrajectory() {
    try {
        CustomIntegrator::step(1);
        if (getGlobalVariableByName("accepted") > 0.5)
            numAccepted++;
        else if (!isfinite(getGlobalVariableByName("endEnergy")))
            numDiverged++;
    }
    catch (const OpenMMException&) {
        abandonTrajectory();
        numDiverged++;
    }
}

void CustomTrajectoryIntegrator::abandonTrajectory() {
    // Go back to the start.  If the energy cannot be computed there either, then the start is what is wrong, and not
    // the step size.

    vector<Vec3> startX, startV;
    getPerDofVariableByName("startX", startX);
    getPerDofVariableByName("startV", startV);
    vector<Vec3> positions;
    context->getPositions(positions);
    for (int i = 0; i < context->getSystem().getNumParticles(); i++)
        if (context->getSystem().getParticleMass(i) != 0)
            positions[i] = startX[i];
    context->setPositions(positions);
    for (Vec3& velocity : startV)
        velocity = -velocity;
    context->setVelocities(startV);
    context->calcForcesAndEnergy(false, true, getIntegrationForceGroups());
    context->setStepCount(context->getStepCount() + 1);
}

void CustomTrajectoryIntegrator::createCheckpoint(ostream& stream) const {
    writeName(stream, NAME);
    CustomIntegrator::createCheckpoint(stream);
    MembraneState(*this, *context).createCheckpoint(stream);
    writeCounters(stream);
}

void CustomTrajectoryIntegrator::loadCheckpoint(istream& stream) {
    bool hasName = readName(stream, NAME);
    CustomIntegrator::loadCheckpoint(stream);
    if (!stream)
        throw OpenMMException("loadCheckpoint: the checkpoint ends too early");
    if (MembraneState(*this, *context).loadCheckpoint(stream)) // what version 0.1.0 wrote has no more
        readCounters(stream);
    if (!hasName)
        requireEnd(stream, *this, *context, NAME);
}

void CustomTrajectoryIntegrator::serializeParameters(SerializationNode& node) const {
    CustomIntegrator::serializeParameters(node);
    storeCounters(node);
    MembraneState(*this, *context).serialize(node);
}

void CustomTrajectoryIntegrator::deserializeParameters(const SerializationNode& node) {
    CustomIntegrator::deserializeParameters(node);
    if (!node.hasProperty("numTrajectories"))
        return; // what version 0.1.0 wrote has no more
    loadCounters(node);
    MembraneState(*this, *context).deserialize(node);
}
