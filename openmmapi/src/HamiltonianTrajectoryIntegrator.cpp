#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include "openmmhelfrich/HelfrichSerialization.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmmhelfrich/internal/Splitting.h"
#include "openmm/internal/OSRngSeed.h"
#include "openmm/serialization/SerializationNode.h"
#include <algorithm>
#include <limits>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

HamiltonianTrajectoryIntegrator::HamiltonianTrajectoryIntegrator(double temperature, double stepSize,
                                                                 int stepsPerTrajectory) {
    setTemperature(temperature);
    setStepSize(stepSize);
    setStepsPerTrajectory(stepsPerTrajectory);
    setConstraintTolerance(1e-5);
}

void HamiltonianTrajectoryIntegrator::setTemperature(double temperature) {
    requirePositive("HamiltonianTrajectoryIntegrator: the temperature in K", temperature);
    this->temperature = temperature;
}

void HamiltonianTrajectoryIntegrator::setStepSize(double size) {
    requirePositive("HamiltonianTrajectoryIntegrator: the step size in ps", size);
    Integrator::setStepSize(size);
}

void HamiltonianTrajectoryIntegrator::setStepsPerTrajectory(int steps) {
    requirePositive("HamiltonianTrajectoryIntegrator: the number of steps per trajectory", steps);
    stepsPerTrajectory = steps;
}

void HamiltonianTrajectoryIntegrator::setForcePrecision(const string& precision) {
    if (precision != "double" && precision != "mixed")
        throw OpenMMException("HamiltonianTrajectoryIntegrator: the precision of forces is '" + precision +
                              "'; it must be 'double' or 'mixed'");
    forcePrecision = precision;
}

void HamiltonianTrajectoryIntegrator::setTrajectoryJitter(double jitter) {
    if (!(jitter >= 0 && jitter < 1))
        throw OpenMMException("HamiltonianTrajectoryIntegrator: the jitter of trajectories is " + to_string(jitter) +
                              "; it must be from 0 to less than 1");
    trajectoryJitter = jitter;
}

void HamiltonianTrajectoryIntegrator::setSplitting(const string& splitting) {
    try {
        Splitting::byName(splitting);
    }
    catch (const OpenMMException& error) {
        throw OpenMMException(string("HamiltonianTrajectoryIntegrator: ") + error.what());
    }
    this->splitting = splitting;
}

void HamiltonianTrajectoryIntegrator::setTetherSubsteps(int substeps) {
    requirePositive("HamiltonianTrajectoryIntegrator: the number of substeps of the tether", substeps);
    tetherSubsteps = substeps;
}

void HamiltonianTrajectoryIntegrator::setMomentumRefreshment(double refreshment) {
    if (!(refreshment > 0 && refreshment <= 1))
        throw OpenMMException("HamiltonianTrajectoryIntegrator: the refreshment of momenta is " +
                              to_string(refreshment) + "; it must be from more than 0 to 1");
    momentumRefreshment = refreshment;
}

void HamiltonianTrajectoryIntegrator::setRandomNumberSeed(int seed) {
    randomNumberSeed = seed;
    if (context != NULL)
        activeSeed = (seed == 0 ? osrngseed() : seed);
}

void HamiltonianTrajectoryIntegrator::initialize(ContextImpl& contextRef) {
    if (owner != NULL && &contextRef.getOwner() != owner)
        throw OpenMMException("This Integrator is already bound to a context");
    requireFreeParticles(contextRef.getSystem(), "HamiltonianTrajectoryIntegrator");
    context = &contextRef;
    owner = &contextRef.getOwner();
    activeSeed = (randomNumberSeed == 0 ? osrngseed() : randomNumberSeed);
    numTrajectories = numAccepted = numDiverged = 0;
    kernel = context->getPlatform().createKernel(IntegrateHamiltonianTrajectoryKernel::Name(), contextRef);
    kernel.getAs<IntegrateHamiltonianTrajectoryKernel>().initialize(context->getSystem());
    findMembranes();
}

void HamiltonianTrajectoryIntegrator::findMembranes() {
    membranes.clear();
    for (ForceImpl* impl : context->getForceImpls())
        if (HelfrichForceImpl* membrane = dynamic_cast<HelfrichForceImpl*>(impl))
            membranes.push_back(membrane);
    hasOnlyMembranes = (membranes.size() == context->getForceImpls().size());
    bool isAlone = (hasOnlyMembranes && membranes.size() == 1);
    soleMembrane = (isAlone && membranes[0]->canMakeTrajectory(*context) ? membranes[0] : NULL);
}

void HamiltonianTrajectoryIntegrator::cleanup() {
    kernel = Kernel();
    membranes.clear();
}

vector<string> HamiltonianTrajectoryIntegrator::getKernelNames() {
    return {IntegrateHamiltonianTrajectoryKernel::Name()};
}

void HamiltonianTrajectoryIntegrator::step(int steps) {
    if (context == NULL)
        throw OpenMMException("This Integrator is not bound to a context!");
    for (int i = 0; i < steps; i++) {
        makeTrajectory();
        context->setStepCount(context->getStepCount() + 1);
        context->setTime(context->getTime() + getStepSize());
    }
}

void HamiltonianTrajectoryIntegrator::makeTrajectory() {
    // The energy at the start is that of a valid state: an error there is the user's to see, and not a divergence.

    auto& trajectory = kernel.getAs<IntegrateHamiltonianTrajectoryKernel>();
    double kT = BOLTZMANN * temperature;
    double startEnergy = context->calcForcesAndEnergy(!movesByItself(), true, getIntegrationForceGroups());
    double refreshment = (numTrajectories == 0 ? 1 : momentumRefreshment);
    startEnergy +=
            trajectory.begin(*context, kT, refreshment, Philox(activeSeed, RandomStream::Momenta), numTrajectories);
    if (!isfinite(startEnergy))
        throw OpenMMException("HamiltonianTrajectoryIntegrator: the energy is not finite at the start of a trajectory; "
                              "see the forces of the System");
    lastNumSteps = drawNumSteps();
    try {
        lastEnergyChange = moveToEnd(lastNumSteps) - startEnergy;
    }
    catch (const OpenMMException&) {
        lastEnergyChange = numeric_limits<double>::infinity();
    }
    auto words = Philox(activeSeed, RandomStream::TrajectoryTest)(0, numTrajectories);
    numTrajectories++;
    if (!isfinite(lastEnergyChange)) {
        lastEnergyChange = numeric_limits<double>::infinity();
        numDiverged++;
    }
    if (Philox::uniform(words[0], words[1]) < exp(-lastEnergyChange / kT))
        numAccepted++;
    else
        trajectory.restore(*context);
    context->systemChanged();
}

int HamiltonianTrajectoryIntegrator::drawNumSteps() const {
    int least = max(1, (int) lround(stepsPerTrajectory * (1 - trajectoryJitter))),
        most = (int) lround(stepsPerTrajectory * (1 + trajectoryJitter));
    auto words = Philox(activeSeed, RandomStream::TrajectoryLength)(0, numTrajectories);
    int steps = least + Philox::index(words[0], words[1], most - least + 1),
        stages = Splitting::byName(splitting).getNumStages();
    return (steps + stages - 1) / stages * stages;
}

double HamiltonianTrajectoryIntegrator::moveToEnd(int numSteps) {
    auto& trajectory = kernel.getAs<IntegrateHamiltonianTrajectoryKernel>();
    Splitting scheme = Splitting::byName(splitting);
    int stages = scheme.getNumStages();
    vector<KickAndDrift> sequence = scheme.getSequence(stages * getStepSize(), numSteps / stages, tetherSubsteps);
    double potentialEnergy;
    if (movesByItself())
        potentialEnergy = soleMembrane->makeTrajectory(*context, sequence, forcePrecision == "mixed");
    else {
        moveStepByStep(sequence);
        potentialEnergy = calcForcesAndEnergy(*context, hasOnlyMembranes, false, true, getIntegrationForceGroups());
    }
    return potentialEnergy + trajectory.computeKineticEnergy(*context);
}

void HamiltonianTrajectoryIntegrator::moveStepByStep(const vector<KickAndDrift>& sequence) {
    auto& trajectory = kernel.getAs<IntegrateHamiltonianTrajectoryKernel>();
    if (tetherSubsteps > 1) {
        trajectory.move(*context, {0, 0}); // removes the forces at the start, which are those of all terms
        addForces(sequence[0]);
    }
    for (size_t i = 0; i < sequence.size(); i++) {
        if (i > 0)
            addForces(sequence[i]);
        trajectory.move(*context, sequence[i]);
    }
}

bool HamiltonianTrajectoryIntegrator::movesByItself() const {
    return soleMembrane != NULL && (getIntegrationForceGroups() & (1 << soleMembrane->getOwner().getForceGroup())) != 0;
}

void HamiltonianTrajectoryIntegrator::addForces(const KickAndDrift& kick) {
    auto setKick = [&](const KickAndDrift* kick) {
        for (auto membrane : membranes)
            membrane->setKick(kick);
    };
    setKick(&kick);
    try {
        if (kick.terms == TermMask::ALL) // other forces act with all terms of the membranes
            calcForcesAndEnergy(*context, hasOnlyMembranes, true, false, getIntegrationForceGroups());
        else
            for (auto membrane : membranes)
                membrane->calcForcesAndEnergy(*context, true, false, getIntegrationForceGroups());
    }
    catch (...) {
        setKick(NULL);
        throw;
    }
    setKick(NULL);
}

double HamiltonianTrajectoryIntegrator::computeKineticEnergy() {
    return kernel.getAs<IntegrateHamiltonianTrajectoryKernel>().computeKineticEnergy(*context);
}

bool HamiltonianTrajectoryIntegrator::kineticEnergyRequiresForce() const {
    return false;
}

void HamiltonianTrajectoryIntegrator::createCheckpoint(ostream& stream) const {
    writeBinary(stream, activeSeed);
    writeBinary(stream, numTrajectories);
    writeBinary(stream, numAccepted);
    writeBinary(stream, numDiverged);
}

void HamiltonianTrajectoryIntegrator::loadCheckpoint(istream& stream) {
    readBinary(stream, activeSeed);
    readBinary(stream, numTrajectories);
    readBinary(stream, numAccepted);
    readBinary(stream, numDiverged);
}

void HamiltonianTrajectoryIntegrator::serializeParameters(SerializationNode& node) const {
    node.setIntProperty("version", 1);
    node.setIntProperty("activeSeed", (int) activeSeed);
    node.setLongProperty("numTrajectories", numTrajectories);
    node.setLongProperty("numAccepted", numAccepted);
    node.setLongProperty("numDiverged", numDiverged);
}

void HamiltonianTrajectoryIntegrator::deserializeParameters(const SerializationNode& node) {
    requireVersion(node, 1, "HamiltonianTrajectoryIntegrator");
    activeSeed = (unsigned int) node.getIntProperty("activeSeed");
    numTrajectories = node.getLongProperty("numTrajectories");
    numAccepted = node.getLongProperty("numAccepted");
    numDiverged = node.getLongProperty("numDiverged");
}
