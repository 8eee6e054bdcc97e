#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include "openmmhelfrich/HelfrichSerialization.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmm/System.h"
#include "openmm/internal/ContextImpl.h"
#include "openmm/internal/OSRngSeed.h"
#include "openmm/serialization/SerializationNode.h"
#include <cmath>
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * The trajectory as a CustomIntegrator.  The test step(exp(-dH/kT)-u) is false when dH is not a number.
 */
static CustomIntegrator* createLeapfrog(double temperature, double stepSize, int steps) {
    CustomIntegrator* leapfrog = new CustomIntegrator(stepSize);
    leapfrog->addGlobalVariable("kT", BOLTZMANN * temperature);
    leapfrog->addGlobalVariable("stepsPerTrajectory", steps);
    for (string name :
         {"leapfrogStep", "startKineticEnergy", "startEnergy", "endKineticEnergy", "endEnergy", "accepted"})
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

HybridMonteCarloIntegrator::HybridMonteCarloIntegrator(double temperature, double stepSize, int stepsPerTrajectory,
                                                       double flipFraction, double flipProbability,
                                                       const string& engine) {
    if (engine != "native" && engine != "custom")
        throw OpenMMException("HybridMonteCarloIntegrator: the engine is '" + engine +
                              "'; it must be 'native' or 'custom'");
    setFlipProbability(flipProbability);
    unique_ptr<Integrator> native(new HamiltonianTrajectoryIntegrator(temperature, stepSize, stepsPerTrajectory));
    unique_ptr<Integrator> flips(new EdgeFlipIntegrator(temperature, flipFraction));
    addIntegrator(engine == "native" ? native.release() : createLeapfrog(temperature, stepSize, stepsPerTrajectory));
    addIntegrator(flips.release());
}

HybridMonteCarloIntegrator::HybridMonteCarloIntegrator(Integrator* trajectory, EdgeFlipIntegrator* flips,
                                                       double flipProbability) {
    setFlipProbability(flipProbability);
    addIntegrator(trajectory);
    addIntegrator(flips);
}

void HybridMonteCarloIntegrator::addShearWaves(ShearWaveIntegrator* shearWaves, double probability) {
    if (findShearWaves() != NULL)
        throw OpenMMException("HybridMonteCarloIntegrator: it has a ShearWaveIntegrator already");
    checkProbabilities(flipProbability, probability);
    addIntegrator(shearWaves);
    shearWaveProbability = probability;
}

const ShearWaveIntegrator* HybridMonteCarloIntegrator::findShearWaves() const {
    return getNumIntegrators() < 3 ? NULL : &dynamic_cast<const ShearWaveIntegrator&>(getIntegrator(2));
}

const ShearWaveIntegrator& HybridMonteCarloIntegrator::getShearWaveIntegrator() const {
    if (findShearWaves() == NULL)
        throw OpenMMException("HybridMonteCarloIntegrator: it has no ShearWaveIntegrator; call addShearWaves()");
    return *findShearWaves();
}

ShearWaveIntegrator& HybridMonteCarloIntegrator::getShearWaves() {
    return const_cast<ShearWaveIntegrator&>(getShearWaveIntegrator());
}

EdgeFlipIntegrator& HybridMonteCarloIntegrator::getFlips() {
    return dynamic_cast<EdgeFlipIntegrator&>(getIntegrator(1));
}

const EdgeFlipIntegrator& HybridMonteCarloIntegrator::getFlipIntegrator() const {
    return dynamic_cast<const EdgeFlipIntegrator&>(getIntegrator(1));
}

HamiltonianTrajectoryIntegrator* HybridMonteCarloIntegrator::getNative() const {
    return const_cast<HamiltonianTrajectoryIntegrator*>(
            dynamic_cast<const HamiltonianTrajectoryIntegrator*>(&getIntegrator(0)));
}

CustomIntegrator* HybridMonteCarloIntegrator::getCustom() const {
    const CustomIntegrator* custom = dynamic_cast<const CustomIntegrator*>(&getIntegrator(0));
    if (custom == NULL || custom->getNumGlobalVariables() < 2 ||
        custom->getGlobalVariableName(1) != "stepsPerTrajectory")
        return NULL;
    return const_cast<CustomIntegrator*>(custom);
}

double HybridMonteCarloIntegrator::getTemperature() const {
    return getFlipIntegrator().getTemperature();
}

void HybridMonteCarloIntegrator::setTemperature(double temperature) {
    requirePositive("HybridMonteCarloIntegrator: the temperature in K", temperature);
    getFlips().setTemperature(temperature);
    if (findShearWaves() != NULL)
        getShearWaves().setTemperature(temperature);
    if (HamiltonianTrajectoryIntegrator* native = getNative())
        native->setTemperature(temperature);
    if (CustomIntegrator* custom = getCustom())
        custom->setGlobalVariableByName("kT", BOLTZMANN * temperature);
}

double HybridMonteCarloIntegrator::getStepSize() const {
    return getIntegrator(0).getStepSize();
}

void HybridMonteCarloIntegrator::setStepSize(double size) {
    requirePositive("HybridMonteCarloIntegrator: the step size in ps", size);
    getIntegrator(0).setStepSize(size);
}

int HybridMonteCarloIntegrator::getStepsPerTrajectory() const {
    if (HamiltonianTrajectoryIntegrator* native = getNative())
        return native->getStepsPerTrajectory();
    CustomIntegrator* custom = getCustom();
    return custom == NULL ? 1 : (int) custom->getGlobalVariableByName("stepsPerTrajectory");
}

void HybridMonteCarloIntegrator::setStepsPerTrajectory(int steps) {
    requirePositive("HybridMonteCarloIntegrator: the number of steps per trajectory", steps);
    if (HamiltonianTrajectoryIntegrator* native = getNative())
        native->setStepsPerTrajectory(steps);
    else if (CustomIntegrator* custom = getCustom())
        custom->setGlobalVariableByName("stepsPerTrajectory", steps);
    else
        throw OpenMMException("HybridMonteCarloIntegrator: integrator 0 is not one whose number of steps can be set");
}

template <class Value, class Result>
static Value getFrom(const HamiltonianTrajectoryIntegrator* native,
                     Result (HamiltonianTrajectoryIntegrator::*get)() const, const Value& defaultValue) {
    return native == NULL ? defaultValue : (native->*get)();
}

template <class Value, class Argument>
static void setIn(HamiltonianTrajectoryIntegrator* native, void (HamiltonianTrajectoryIntegrator::*set)(Argument),
                  const Value& value, const Value& defaultValue, const string& problem) {
    // Other integrators have but the default.

    if (native != NULL)
        (native->*set)(value);
    else if (value != defaultValue)
        throw OpenMMException("HybridMonteCarloIntegrator: " + problem);
}

string HybridMonteCarloIntegrator::getForcePrecision() const {
    return getFrom(getNative(), &HamiltonianTrajectoryIntegrator::getForcePrecision, string("double"));
}

void HybridMonteCarloIntegrator::setForcePrecision(const string& precision) {
    setIn(getNative(), &HamiltonianTrajectoryIntegrator::setForcePrecision, precision, string("double"),
          "the precision of forces is '" + precision +
                  "'; integrator 0 is not one for which it can be other than 'double'");
}

double HybridMonteCarloIntegrator::getTrajectoryJitter() const {
    return getFrom(getNative(), &HamiltonianTrajectoryIntegrator::getTrajectoryJitter, 0.0);
}

void HybridMonteCarloIntegrator::setTrajectoryJitter(double jitter) {
    setIn(getNative(), &HamiltonianTrajectoryIntegrator::setTrajectoryJitter, jitter, 0.0,
          "integrator 0 is not one whose trajectories can vary in length: it must be a "
          "HamiltonianTrajectoryIntegrator");
}

string HybridMonteCarloIntegrator::getSplitting() const {
    return getFrom(getNative(), &HamiltonianTrajectoryIntegrator::getSplitting, string("leapfrog"));
}

void HybridMonteCarloIntegrator::setSplitting(const string& splitting) {
    setIn(getNative(), &HamiltonianTrajectoryIntegrator::setSplitting, splitting, string("leapfrog"),
          "integrator 0 has no splitting but its own: it must be a HamiltonianTrajectoryIntegrator");
}

int HybridMonteCarloIntegrator::getTetherSubsteps() const {
    return getFrom(getNative(), &HamiltonianTrajectoryIntegrator::getTetherSubsteps, 1);
}

void HybridMonteCarloIntegrator::setTetherSubsteps(int substeps) {
    setIn(getNative(), &HamiltonianTrajectoryIntegrator::setTetherSubsteps, substeps, 1,
          "integrator 0 has no substeps: it must be a HamiltonianTrajectoryIntegrator");
}

double HybridMonteCarloIntegrator::getMomentumRefreshment() const {
    return getFrom(getNative(), &HamiltonianTrajectoryIntegrator::getMomentumRefreshment, 1.0);
}

void HybridMonteCarloIntegrator::setMomentumRefreshment(double refreshment) {
    setIn(getNative(), &HamiltonianTrajectoryIntegrator::setMomentumRefreshment, refreshment, 1.0,
          "integrator 0 is not one that keeps a part of its velocities: it must be a HamiltonianTrajectoryIntegrator");
}

double HybridMonteCarloIntegrator::getFlipFraction() const {
    return getFlipIntegrator().getFraction();
}

void HybridMonteCarloIntegrator::setFlipFraction(double fraction) {
    getFlips().setFraction(fraction);
}

void HybridMonteCarloIntegrator::checkProbabilities(double flipProbability, double shearWaveProbability) const {
    if (!(flipProbability >= 0 && flipProbability <= 1))
        throw OpenMMException("HybridMonteCarloIntegrator: the flip probability is " + to_string(flipProbability) +
                              "; it must be between 0 and 1");
    if (!(shearWaveProbability >= 0 && shearWaveProbability <= 1))
        throw OpenMMException("HybridMonteCarloIntegrator: the probability of shear waves is " +
                              to_string(shearWaveProbability) + "; it must be between 0 and 1");
    if (flipProbability + shearWaveProbability > 1)
        throw OpenMMException("HybridMonteCarloIntegrator: the probabilities of flips, " + to_string(flipProbability) +
                              ", and of shear waves, " + to_string(shearWaveProbability) + ", add up to more than 1");
}

void HybridMonteCarloIntegrator::setFlipProbability(double probability) {
    checkProbabilities(probability, shearWaveProbability);
    flipProbability = probability;
}

void HybridMonteCarloIntegrator::setShearWaveProbability(double probability) {
    checkProbabilities(flipProbability, probability);
    if (probability > 0)
        getShearWaves();
    shearWaveProbability = probability;
}

void HybridMonteCarloIntegrator::setRandomNumberSeed(int seed, bool alsoForIntegrators) {
    randomNumberSeed = seed;
    if (context != NULL)
        activeSeed = (seed == 0 ? osrngseed() : seed);
    if (!alsoForIntegrators)
        return;
    getFlips().setRandomNumberSeed(seed);
    if (findShearWaves() != NULL)
        getShearWaves().setRandomNumberSeed(seed);
    if (HamiltonianTrajectoryIntegrator* native = getNative())
        native->setRandomNumberSeed(seed);
    if (CustomIntegrator* custom = getCustom())
        custom->setRandomNumberSeed(seed);
}

long long HybridMonteCarloIntegrator::getNumTrajectories() const {
    HamiltonianTrajectoryIntegrator* native = getNative();
    return native == NULL ? numTrajectories : native->getNumTrajectories();
}

long long HybridMonteCarloIntegrator::getNumAcceptedTrajectories() const {
    HamiltonianTrajectoryIntegrator* native = getNative();
    return native == NULL ? numAccepted : native->getNumAccepted();
}

long long HybridMonteCarloIntegrator::getNumDivergedTrajectories() const {
    HamiltonianTrajectoryIntegrator* native = getNative();
    return native == NULL ? numDiverged : native->getNumDiverged();
}

double HybridMonteCarloIntegrator::getAcceptanceRate() const {
    return getNumTrajectories() == 0 ? 0 : getNumAcceptedTrajectories() / (double) getNumTrajectories();
}

double HybridMonteCarloIntegrator::getFlipAcceptanceRate() const {
    const EdgeFlipIntegrator& flips = getFlipIntegrator();
    return flips.getNumAttempted() == 0 ? 0 : flips.getNumAccepted() / (double) flips.getNumAttempted();
}

double HybridMonteCarloIntegrator::getFlipRate() const {
    return getFlipIntegrator().getFlipRate();
}

double HybridMonteCarloIntegrator::getShearWaveAcceptanceRate() const {
    const ShearWaveIntegrator* waves = findShearWaves();
    return waves == NULL || waves->getNumAttempted() == 0 ? 0
                                                          : waves->getNumAccepted() / (double) waves->getNumAttempted();
}

void HybridMonteCarloIntegrator::initialize(ContextImpl& contextRef) {
    if (owner != NULL && &contextRef.getOwner() != owner)
        throw OpenMMException("This Integrator is already bound to a context");
    if (getCustom() != NULL)
        requireFreeParticles(contextRef.getSystem(), "HybridMonteCarloIntegrator");
    context = &contextRef;
    owner = &contextRef.getOwner();
    activeSeed = (randomNumberSeed == 0 ? osrngseed() : randomNumberSeed);
    numTrajectories = numAccepted = numDiverged = 0;
    CompoundIntegrator::initialize(contextRef);
}

void HybridMonteCarloIntegrator::step(int steps) {
    if (context == NULL)
        throw OpenMMException("This Integrator is not bound to a context!");
    for (int i = 0; i < steps; i++) {
        auto words = Philox(activeSeed, RandomStream::MoveChoice)(0, context->getStepCount());
        double choice = Philox::uniform(words[0], words[1]);
        if (choice < flipProbability)
            getFlips().step(1);
        else if (choice < flipProbability + shearWaveProbability)
            getShearWaves().step(1);
        else
            makeTrajectory();
    }
}

void HybridMonteCarloIntegrator::makeTrajectory() {
    CustomIntegrator* custom = getCustom();
    if (custom == NULL) {
        getIntegrator(0).step(1);
        numTrajectories++;
        numAccepted++;
        return;
    }
    try {
        custom->step(1);
        numTrajectories++;
        if (custom->getGlobalVariableByName("accepted") > 0.5)
            numAccepted++;
        else if (!isfinite(custom->getGlobalVariableByName("endEnergy")))
            numDiverged++;
    }
    catch (const OpenMMException&) {
        abandonTrajectory(*custom);
        numTrajectories++;
        numDiverged++;
    }
}

void HybridMonteCarloIntegrator::abandonTrajectory(CustomIntegrator& custom) {
    // Go back to the start.  If the energy cannot be computed there either, then the start is what is wrong, and not
    // the step size.

    vector<Vec3> startX, startV;
    custom.getPerDofVariableByName("startX", startX);
    custom.getPerDofVariableByName("startV", startV);
    vector<Vec3> positions;
    context->getPositions(positions);
    for (int i = 0; i < context->getSystem().getNumParticles(); i++)
        if (context->getSystem().getParticleMass(i) != 0)
            positions[i] = startX[i];
    context->setPositions(positions);
    context->setVelocities(startV);
    context->calcForcesAndEnergy(false, true, getIntegrationForceGroups());
    context->setStepCount(context->getStepCount() + 1);
    context->setTime(context->getTime() + getStepSize());
}

void HybridMonteCarloIntegrator::createCheckpoint(ostream& stream) const {
    writeBinary(stream, activeSeed);
    writeBinary(stream, numTrajectories);
    writeBinary(stream, numAccepted);
    writeBinary(stream, numDiverged);
    CompoundIntegrator::createCheckpoint(stream);
}

void HybridMonteCarloIntegrator::loadCheckpoint(istream& stream) {
    readBinary(stream, activeSeed);
    readBinary(stream, numTrajectories);
    readBinary(stream, numAccepted);
    readBinary(stream, numDiverged);
    // OpenMM takes the number of the present integrator as it is.
    auto requireIntegrator = [&]() {
        if (getCurrentIntegrator() >= 0 && getCurrentIntegrator() < getNumIntegrators())
            return;
        setCurrentIntegrator(0);
        throw OpenMMException("HybridMonteCarloIntegrator: the checkpoint is damaged");
    };
    try {
        CompoundIntegrator::loadCheckpoint(stream);
    }
    catch (const OpenMMException&) {
        requireIntegrator();
        throw;
    }
    requireIntegrator();
}

void HybridMonteCarloIntegrator::serializeParameters(SerializationNode& node) const {
    node.setIntProperty("version", 1);
    node.setIntProperty("activeSeed", (int) activeSeed);
    node.setLongProperty("numTrajectories", numTrajectories);
    node.setLongProperty("numAccepted", numAccepted);
    node.setLongProperty("numDiverged", numDiverged);
    CompoundIntegrator::serializeParameters(node.createChildNode("Integrators"));
}

void HybridMonteCarloIntegrator::deserializeParameters(const SerializationNode& node) {
    requireVersion(node, 1, "HybridMonteCarloIntegrator");
    CompoundIntegrator::deserializeParameters(node.getChildNode("Integrators"));
    activeSeed = (unsigned int) node.getIntProperty("activeSeed");
    numTrajectories = node.getLongProperty("numTrajectories");
    numAccepted = node.getLongProperty("numAccepted");
    numDiverged = node.getLongProperty("numDiverged");
}
