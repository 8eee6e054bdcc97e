#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include "openmmhelfrich/internal/HelfrichForceImpl.h"
#include "openmm/OpenMMException.h"
#include "openmm/System.h"
#include "openmm/internal/ContextImpl.h"
#include "openmm/internal/OSRngSeed.h"
#include "openmm/serialization/SerializationNode.h"
#include <cmath>
#include <istream>
#include <ostream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const double BOLTZMANN = 8.31446261815324e-3;

static void checkTemperature(double temperature) {
    if (!(temperature > 0 && isfinite(temperature)))
        throw OpenMMException("HybridMonteCarloIntegrator: the temperature is "+to_string(temperature)+" K; it must be finite and positive");
}

static void checkStepSize(double size) {
    if (!(size > 0 && isfinite(size)))
        throw OpenMMException("HybridMonteCarloIntegrator: the step size is "+to_string(size)+" ps; it must be finite and positive");
}

static void checkStepsPerTrajectory(int steps) {
    if (steps < 1)
        throw OpenMMException("HybridMonteCarloIntegrator: the number of steps per trajectory is "+to_string(steps)+"; it must be at least 1");
}

/**
 * The trajectory as a CustomIntegrator.  The test step(exp(-dH/kT)-u) is false when dH is not a number.
 */
static CustomIntegrator* createLeapfrog(double temperature, double stepSize, int steps) {
    CustomIntegrator* leapfrog = new CustomIntegrator(stepSize);
    leapfrog->addGlobalVariable("kT", BOLTZMANN*temperature);
    leapfrog->addGlobalVariable("stepsPerTrajectory", steps);
    for (string name : {"leapfrogStep", "startKineticEnergy", "startEnergy", "endKineticEnergy", "endEnergy", "accepted"})
        leapfrog->addGlobalVariable(name, 0);
    leapfrog->addPerDofVariable("startX", 0);
    leapfrog->addPerDofVariable("startV", 0);
    leapfrog->addComputePerDof("startX", "x");
    leapfrog->addComputePerDof("v", "sqrt(kT/m)*gaussian");
    leapfrog->addComputePerDof("startV", "v");
    leapfrog->addComputeSum("startKineticEnergy", "0.5*m*v*v");
    leapfrog->addComputeGlobal("startEnergy", "energy+startKineticEnergy");
    leapfrog->addComputePerDof("v", "v+0.5*dt*f/m");
    leapfrog->addComputeGlobal("leapfrogStep", "1");
    leapfrog->beginWhileBlock("leapfrogStep < stepsPerTrajectory");
    leapfrog->addComputePerDof("x", "x+dt*v");
    leapfrog->addComputePerDof("v", "v+dt*f/m");
    leapfrog->addComputeGlobal("leapfrogStep", "leapfrogStep+1");
    leapfrog->endBlock();
    leapfrog->addComputePerDof("x", "x+dt*v");
    leapfrog->addComputePerDof("v", "v+0.5*dt*f/m");
    leapfrog->addComputeSum("endKineticEnergy", "0.5*m*v*v");
    leapfrog->addComputeGlobal("endEnergy", "energy+endKineticEnergy");
    leapfrog->addComputeGlobal("accepted", "step(exp((startEnergy-endEnergy)/kT)-uniform)");
    leapfrog->beginIfBlock("accepted < 0.5");
    leapfrog->addComputePerDof("x", "startX");
    leapfrog->addComputePerDof("v", "startV");
    leapfrog->endBlock();
    return leapfrog;
}

HybridMonteCarloIntegrator::HybridMonteCarloIntegrator(double temperature, double stepSize, int stepsPerTrajectory, double flipFraction, double flipProbability) {
    checkTemperature(temperature);
    checkStepSize(stepSize);
    checkStepsPerTrajectory(stepsPerTrajectory);
    setFlipProbability(flipProbability);
    addIntegrator(createLeapfrog(temperature, stepSize, stepsPerTrajectory));
    addIntegrator(new EdgeFlipIntegrator(temperature, flipFraction));
}

HybridMonteCarloIntegrator::HybridMonteCarloIntegrator(Integrator* trajectory, EdgeFlipIntegrator* flips, double flipProbability) {
    setFlipProbability(flipProbability);
    addIntegrator(trajectory);
    addIntegrator(flips);
}

EdgeFlipIntegrator& HybridMonteCarloIntegrator::getFlips() {
    return dynamic_cast<EdgeFlipIntegrator&>(getIntegrator(1));
}

const EdgeFlipIntegrator& HybridMonteCarloIntegrator::getFlipIntegrator() const {
    return dynamic_cast<const EdgeFlipIntegrator&>(getIntegrator(1));
}

CustomIntegrator* HybridMonteCarloIntegrator::getLeapfrog() const {
    const CustomIntegrator* custom = dynamic_cast<const CustomIntegrator*>(&getIntegrator(0));
    if (custom == NULL || custom->getNumGlobalVariables() < 2 || custom->getGlobalVariableName(1) != "stepsPerTrajectory")
        return NULL;
    return const_cast<CustomIntegrator*>(custom);
}

double HybridMonteCarloIntegrator::getTemperature() const {
    return getFlipIntegrator().getTemperature();
}

void HybridMonteCarloIntegrator::setTemperature(double temperature) {
    checkTemperature(temperature);
    getFlips().setTemperature(temperature);
    if (CustomIntegrator* leapfrog = getLeapfrog())
        leapfrog->setGlobalVariableByName("kT", BOLTZMANN*temperature);
}

double HybridMonteCarloIntegrator::getStepSize() const {
    return getIntegrator(0).getStepSize();
}

void HybridMonteCarloIntegrator::setStepSize(double size) {
    checkStepSize(size);
    getIntegrator(0).setStepSize(size);
}

int HybridMonteCarloIntegrator::getStepsPerTrajectory() const {
    CustomIntegrator* leapfrog = getLeapfrog();
    return leapfrog == NULL ? 1 : (int) leapfrog->getGlobalVariableByName("stepsPerTrajectory");
}

void HybridMonteCarloIntegrator::setStepsPerTrajectory(int steps) {
    checkStepsPerTrajectory(steps);
    CustomIntegrator* leapfrog = getLeapfrog();
    if (leapfrog == NULL)
        throw OpenMMException("HybridMonteCarloIntegrator: integrator 0 is not one whose number of steps can be set");
    leapfrog->setGlobalVariableByName("stepsPerTrajectory", steps);
}

double HybridMonteCarloIntegrator::getFlipFraction() const {
    return getFlipIntegrator().getFraction();
}

void HybridMonteCarloIntegrator::setFlipFraction(double fraction) {
    getFlips().setFraction(fraction);
}

void HybridMonteCarloIntegrator::setFlipProbability(double probability) {
    if (!(probability >= 0 && probability <= 1))
        throw OpenMMException("HybridMonteCarloIntegrator: the flip probability is "+to_string(probability)+"; it must be between 0 and 1");
    flipProbability = probability;
}

void HybridMonteCarloIntegrator::setRandomNumberSeed(int seed) {
    randomNumberSeed = seed;
    if (context != NULL)
        activeSeed = (seed == 0 ? osrngseed() : seed);
    getFlips().setRandomNumberSeed(seed);
    if (CustomIntegrator* leapfrog = getLeapfrog())
        leapfrog->setRandomNumberSeed(seed);
}

double HybridMonteCarloIntegrator::getAcceptanceRate() const {
    return numTrajectories == 0 ? 0 : numAcceptedTrajectories/(double) numTrajectories;
}

double HybridMonteCarloIntegrator::getFlipAcceptanceRate() const {
    const EdgeFlipIntegrator& flips = getFlipIntegrator();
    return flips.getNumAttempted() == 0 ? 0 : flips.getNumAccepted()/(double) flips.getNumAttempted();
}

void HybridMonteCarloIntegrator::initialize(ContextImpl& contextRef) {
    if (owner != NULL && &contextRef.getOwner() != owner)
        throw OpenMMException("This Integrator is already bound to a context");
    const System& system = contextRef.getSystem();
    if (getLeapfrog() != NULL && system.getNumConstraints() > 0)
        throw OpenMMException("HybridMonteCarloIntegrator: the System has constraints, which its trajectories do not support");
    for (int i = 0; i < system.getNumParticles(); i++)
        if (getLeapfrog() != NULL && system.isVirtualSite(i))
            throw OpenMMException("HybridMonteCarloIntegrator: particle "+to_string(i)+" is a virtual site, which its trajectories do not support");
    context = &contextRef;
    owner = &contextRef.getOwner();
    activeSeed = (randomNumberSeed == 0 ? osrngseed() : randomNumberSeed);
    numTrajectories = numAcceptedTrajectories = numDivergedTrajectories = 0;
    CompoundIntegrator::initialize(contextRef);
}

bool HybridMonteCarloIntegrator::isNextStepSweep() const {
    auto words = Philox(activeSeed, RandomStream::MoveChoice)(0, context->getStepCount());
    return Philox::uniform(words[0], words[1]) < flipProbability;
}

void HybridMonteCarloIntegrator::step(int steps) {
    if (context == NULL)
        throw OpenMMException("This Integrator is not bound to a context!");
    for (int i = 0; i < steps; i++) {
        if (isNextStepSweep())
            getFlips().step(1);
        else
            makeTrajectory();
    }
}

void HybridMonteCarloIntegrator::makeTrajectory() {
    CustomIntegrator* leapfrog = getLeapfrog();
    if (leapfrog == NULL) {
        getIntegrator(0).step(1);
        numTrajectories++;
        numAcceptedTrajectories++;
        return;
    }
    try {
        leapfrog->step(1);
        numTrajectories++;
        if (leapfrog->getGlobalVariableByName("accepted") > 0.5)
            numAcceptedTrajectories++;
        else if (!isfinite(leapfrog->getGlobalVariableByName("endEnergy")))
            numDivergedTrajectories++;
    }
    catch (const OpenMMException&) {
        abandonTrajectory(*leapfrog);
    }
}

void HybridMonteCarloIntegrator::abandonTrajectory(CustomIntegrator& leapfrog) {
    // Go back to the start.  If the energy cannot be computed there either, then the start is what is wrong, and not the step size.

    vector<Vec3> startX, startV;
    leapfrog.getPerDofVariableByName("startX", startX);
    leapfrog.getPerDofVariableByName("startV", startV);
    vector<Vec3> positions;
    context->getPositions(positions);
    for (int i = 0; i < context->getSystem().getNumParticles(); i++)
        if (context->getSystem().getParticleMass(i) != 0)
            positions[i] = startX[i];
    context->setPositions(positions);
    context->setVelocities(startV);
    context->calcForcesAndEnergy(false, true, getIntegrationForceGroups());
    context->setStepCount(context->getStepCount()+1);
    context->setTime(context->getTime()+getStepSize());
    numTrajectories++;
    numDivergedTrajectories++;
}

void HybridMonteCarloIntegrator::createCheckpoint(ostream& stream) const {
    long long counters[4] = {(long long) activeSeed, numTrajectories, numAcceptedTrajectories, numDivergedTrajectories};
    stream.write((const char*) counters, sizeof(counters));
    CompoundIntegrator::createCheckpoint(stream);
}

void HybridMonteCarloIntegrator::loadCheckpoint(istream& stream) {
    long long counters[4];
    if (!stream.read((char*) counters, sizeof(counters)))
        throw OpenMMException("HybridMonteCarloIntegrator: the checkpoint ends too early");
    activeSeed = (unsigned int) counters[0];
    numTrajectories = counters[1];
    numAcceptedTrajectories = counters[2];
    numDivergedTrajectories = counters[3];
    CompoundIntegrator::loadCheckpoint(stream);
}

void HybridMonteCarloIntegrator::serializeParameters(SerializationNode& node) const {
    node.setIntProperty("version", 1);
    node.setIntProperty("activeSeed", (int) activeSeed);
    node.setLongProperty("numTrajectories", numTrajectories);
    node.setLongProperty("numAcceptedTrajectories", numAcceptedTrajectories);
    node.setLongProperty("numDivergedTrajectories", numDivergedTrajectories);
    CompoundIntegrator::serializeParameters(node.createChildNode("Integrators"));
}

void HybridMonteCarloIntegrator::deserializeParameters(const SerializationNode& node) {
    if (node.getIntProperty("version") != 1)
        throw OpenMMException("HybridMonteCarloIntegrator: unsupported version "+to_string(node.getIntProperty("version"))+
                              " of the State's integrator parameters");
    CompoundIntegrator::deserializeParameters(node.getChildNode("Integrators"));
    activeSeed = (unsigned int) node.getIntProperty("activeSeed");
    numTrajectories = node.getLongProperty("numTrajectories");
    numAcceptedTrajectories = node.getLongProperty("numAcceptedTrajectories");
    numDivergedTrajectories = node.getLongProperty("numDivergedTrajectories");
}
