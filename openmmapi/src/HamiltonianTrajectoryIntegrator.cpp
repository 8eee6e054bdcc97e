#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include "openmmhelfrich/internal/HelfrichSerialization.h"
#include "openmmhelfrich/internal/Interruption.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmmhelfrich/internal/Splitting.h"
#include <algorithm>
#include <cmath>
#include <limits>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * Of a trajectory, and of substeps; with a jitter there may be twice as many.
 */
static const int MAX_STEPS = 1000000000;

/**
 * With it the square root of the weight of any level that there can be is finite.
 */
static const double MAX_WEIGHT = 1000;

/**
 * There are fewer vertices on each level than on the one before, by a factor of much more than 1.
 */
static const int MAX_LEVEL = 100;

/**
 * What the velocities of coarser meshes begin with in a checkpoint.
 */
static const char MAGIC_BYTES[] = "HlfWaves";

HamiltonianTrajectoryIntegrator::HamiltonianTrajectoryIntegrator(double temperature, double stepSize,
                                                                 int stepsPerTrajectory)
        : MonteCarloIntegrator("HamiltonianTrajectoryIntegrator", temperature) {
    setStepSize(stepSize);
    setStepsPerTrajectory(stepsPerTrajectory);
}

void HamiltonianTrajectoryIntegrator::setStepSize(double size) {
    requirePositive("HamiltonianTrajectoryIntegrator: the step size in ps", size);
    Integrator::setStepSize(size);
}

void HamiltonianTrajectoryIntegrator::setStepsPerTrajectory(int steps) {
    requirePositive("HamiltonianTrajectoryIntegrator: the number of steps per trajectory", steps);
    requireAtMost("HamiltonianTrajectoryIntegrator: the number of steps per trajectory", steps, MAX_STEPS);
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
        throw OpenMMException("HamiltonianTrajectoryIntegrator: the jitter of trajectories is " + toText(jitter) +
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
    requireAtMost("HamiltonianTrajectoryIntegrator: the number of substeps of the tether", substeps, MAX_STEPS);
    tetherSubsteps = substeps;
}

void HamiltonianTrajectoryIntegrator::setMomentumRefreshment(double refreshment) {
    if (!(refreshment > 0 && refreshment <= 1))
        throw OpenMMException("HamiltonianTrajectoryIntegrator: the refreshment of momenta is " + toText(refreshment) +
                              "; it must be from more than 0 to 1");
    momentumRefreshment = refreshment;
}

void HamiltonianTrajectoryIntegrator::setMultilevelWeight(double weight) {
    requirePositive("HamiltonianTrajectoryIntegrator: the multilevel weight", weight, true);
    requireAtMost("HamiltonianTrajectoryIntegrator: the multilevel weight", weight, MAX_WEIGHT);
    multilevelWeight = weight;
}

void HamiltonianTrajectoryIntegrator::scaleCoarseVelocities(double factor) {
    requirePositive("HamiltonianTrajectoryIntegrator: the factor of velocities", factor);
    if (context == NULL)
        throw OpenMMException("HamiltonianTrajectoryIntegrator: it is not bound to a Context");
    auto velocities = kernel.getAs<IntegrateHamiltonianTrajectoryKernel>().getCoarseVelocities();
    for (auto& ofMembrane : velocities)
        for (auto& item : ofMembrane)
            item.velocity *= factor;
    setCoarseVelocities(velocities);
}

void HamiltonianTrajectoryIntegrator::initialize(ContextImpl& contextRef) {
    requireFreeParticles(contextRef.getSystem(), "HamiltonianTrajectoryIntegrator");
    MonteCarloIntegrator::initialize(contextRef);
    kernel = context->getPlatform().createKernel(IntegrateHamiltonianTrajectoryKernel::Name(), contextRef);
    kernel.getAs<IntegrateHamiltonianTrajectoryKernel>().initialize(context->getSystem());
    soleMembrane = findSoleMembrane();
}

HelfrichForceImpl* HamiltonianTrajectoryIntegrator::findSoleMembrane() const {
    if (!hasOnlyMembranes() || getMembranes().size() != 1 || !getMembranes()[0]->canMakeTrajectory(*context))
        return NULL;
    return getMembranes()[0];
}

void HamiltonianTrajectoryIntegrator::cleanup() {
    kernel = Kernel();
    MonteCarloIntegrator::cleanup();
}

vector<string> HamiltonianTrajectoryIntegrator::getKernelNames() {
    return {IntegrateHamiltonianTrajectoryKernel::Name()};
}

void HamiltonianTrajectoryIntegrator::makeMove() {
    // The energy at the start is that of a valid state: an error there is the user's to see, and not a divergence.

    auto& trajectory = kernel.getAs<IntegrateHamiltonianTrajectoryKernel>();
    double startEnergy = context->calcForcesAndEnergy(!movesByItself(), true, getIntegrationForceGroups());
    double refreshment = (numTrajectories == 0 ? 1 : momentumRefreshment);
    findCoarseMeshes();
    startEnergy += trajectory.begin(*context, getThermalEnergy(), refreshment, getRandom(RandomStream::Momenta),
                                    numTrajectories);
    if (!isfinite(startEnergy))
        throw OpenMMException("HamiltonianTrajectoryIntegrator: the energy is not finite at the start of a trajectory; "
                              "see the forces of the System");
    int numSteps = drawNumSteps();
    double endEnergy;
    try {
        endEnergy = moveToEnd(numSteps);
    }
    catch (const StepInterrupted&) {
        trajectory.restore(*context);
        context->systemChanged();
        throw;
    }
    lastNumSteps = numSteps;
    lastEnergyChange = endEnergy - startEnergy;
    if (!isfinite(lastEnergyChange)) {
        lastEnergyChange = numeric_limits<double>::infinity();
        numDiverged++;
    }
    bool isAccepted = draw(RandomStream::TrajectoryTest, numTrajectories, getAcceptanceProbability(lastEnergyChange));
    numTrajectories++;
    if (isAccepted)
        numAccepted++;
    else
        trajectory.reject(*context);
    context->systemChanged();
    context->setTime(context->getTime() + numSteps * getStepSize());
}

void HamiltonianTrajectoryIntegrator::findCoarseMeshes() {
    vector<const HelfrichMesh*> meshes;
    for (auto membrane : getMembranes())
        if (isIntegrated(*membrane))
            meshes.push_back(&membrane->getMesh());
    kernel.getAs<IntegrateHamiltonianTrajectoryKernel>().setMultilevelWeight(multilevelWeight, meshes);
}

int HamiltonianTrajectoryIntegrator::drawNumSteps() const {
    int least = max(1, (int) lround(stepsPerTrajectory * (1 - trajectoryJitter))),
        most = (int) lround(stepsPerTrajectory * (1 + trajectoryJitter));
    auto words = getRandom(RandomStream::TrajectoryLength)(0, numTrajectories);
    int steps = least + Philox::index(words[0], words[1], most - least + 1),
        stages = Splitting::byName(splitting).getNumStages();
    return (steps + stages - 1) / stages * stages;
}

double HamiltonianTrajectoryIntegrator::moveToEnd(int numSteps) {
    try {
        return computeEnd(numSteps);
    }
    catch (const OpenMMException&) {
        return numeric_limits<double>::infinity();
    }
}

double HamiltonianTrajectoryIntegrator::computeEnd(int numSteps) {
    auto& trajectory = kernel.getAs<IntegrateHamiltonianTrajectoryKernel>();
    Splitting scheme = Splitting::byName(splitting);
    int stages = scheme.getNumStages();
    KickAndDriftSequence sequence = scheme.getSequence(stages * getStepSize(), numSteps / stages, tetherSubsteps);
    double potentialEnergy;
    if (movesByItself())
        potentialEnergy = soleMembrane->makeTrajectory(*context, sequence, forcePrecision == "mixed",
                                                       multilevelWeight == 0 ? NULL : &trajectory);
    else {
        moveStepByStep(sequence);
        potentialEnergy = computePotentialEnergy();
    }
    return potentialEnergy + trajectory.computeKineticEnergy(*context) + trajectory.computeCoarseKineticEnergy();
}

void HamiltonianTrajectoryIntegrator::moveStepByStep(const KickAndDriftSequence& sequence) {
    auto& trajectory = kernel.getAs<IntegrateHamiltonianTrajectoryKernel>();
    Interruption interruption(context->getSystem().getNumParticles());
    for (long long i = 0; i < sequence.size(); i++) {
        if (interruption.isRequested())
            throw StepInterrupted();
        if (i > 0 || tetherSubsteps > 1)
            computeForces(sequence[i]);
        trajectory.move(*context, sequence[i]);
    }
}

bool HamiltonianTrajectoryIntegrator::movesByItself() const {
    return soleMembrane != NULL && isIntegrated(*soleMembrane);
}

void HamiltonianTrajectoryIntegrator::computeForces(const KickAndDrift& kick) {
    // Membranes that know of a kick act in every group: where not all of their terms act, no
    // group does.

    int groups = (kick.terms == TermMask::ALL ? getIntegrationForceGroups() : 0);
    setKick(&kick);
    try {
        context->calcForcesAndEnergy(true, false, groups);
    }
    catch (...) {
        setKick(NULL);
        throw;
    }
    setKick(NULL);
}

void HamiltonianTrajectoryIntegrator::setKick(const KickAndDrift* kick) {
    for (auto membrane : getMembranes())
        if (isIntegrated(*membrane))
            membrane->setKick(kick);
}

double HamiltonianTrajectoryIntegrator::computeKineticEnergy() {
    return kernel.getAs<IntegrateHamiltonianTrajectoryKernel>().computeKineticEnergy(*context);
}

void HamiltonianTrajectoryIntegrator::createCheckpoint(ostream& stream) const {
    MonteCarloIntegrator::createCheckpoint(stream);
    auto velocities = kernel.getAs<IntegrateHamiltonianTrajectoryKernel>().getCoarseVelocities();
    if (velocities.empty())
        return;
    writeMagic(stream, MAGIC_BYTES);
    writeBinary(stream, velocities.size());
    for (auto& ofMembrane : velocities) {
        writeBinary(stream, ofMembrane.size());
        for (auto& velocity : ofMembrane)
            writeBinary(stream, velocity);
    }
}

void HamiltonianTrajectoryIntegrator::loadCheckpoint(istream& stream) {
    MonteCarloIntegrator::loadCheckpoint(stream);
    vector<vector<CoarseVelocity>> velocities;
    if (readMagic(stream, MAGIC_BYTES)) {
        size_t numMembranes, size;
        readBinary(stream, numMembranes);
        for (size_t i = 0; i < numMembranes; i++) {
            readBinary(stream, size);
            velocities.emplace_back();
            for (size_t j = 0; j < size; j++) {
                velocities.back().emplace_back();
                readBinary(stream, velocities.back().back());
            }
        }
    }
    setCoarseVelocities(velocities);
}

void HamiltonianTrajectoryIntegrator::serializeParameters(SerializationNode& node) const {
    MonteCarloIntegrator::serializeParameters(node);
    for (auto& ofMembrane : kernel.getAs<IntegrateHamiltonianTrajectoryKernel>().getCoarseVelocities()) {
        SerializationNode& membrane = node.createChildNode("CoarseVelocities");
        for (auto& item : ofMembrane)
            membrane.createChildNode("Velocity")
                    .setIntProperty("level", item.level)
                    .setIntProperty("particle", item.particle)
                    .setDoubleProperty("x", item.velocity[0])
                    .setDoubleProperty("y", item.velocity[1])
                    .setDoubleProperty("z", item.velocity[2]);
    }
}

void HamiltonianTrajectoryIntegrator::deserializeParameters(const SerializationNode& node) {
    MonteCarloIntegrator::deserializeParameters(node);
    vector<vector<CoarseVelocity>> velocities;
    for (auto& membrane : node.getChildren()) {
        if (membrane.getName() != "CoarseVelocities")
            continue;
        velocities.emplace_back();
        for (auto& item : membrane.getChildren())
            velocities.back().push_back(
                    {item.getIntProperty("level"), item.getIntProperty("particle"),
                     Vec3(item.getDoubleProperty("x"), item.getDoubleProperty("y"), item.getDoubleProperty("z"))});
    }
    setCoarseVelocities(velocities);
}

void HamiltonianTrajectoryIntegrator::setCoarseVelocities(const vector<vector<CoarseVelocity>>& velocities) {
    for (auto& ofMembrane : velocities)
        for (auto& item : ofMembrane)
            if (item.level < 1 || item.level > MAX_LEVEL || item.particle < 0 ||
                item.particle >= context->getSystem().getNumParticles())
                throw OpenMMException("HamiltonianTrajectoryIntegrator: there is a velocity of level " +
                                      to_string(item.level) + " for particle " + to_string(item.particle) +
                                      "; levels are 1 to " + to_string(MAX_LEVEL) + ", and there are " +
                                      to_string(context->getSystem().getNumParticles()) + " particles");
    kernel.getAs<IntegrateHamiltonianTrajectoryKernel>().setCoarseVelocities(velocities);
}
