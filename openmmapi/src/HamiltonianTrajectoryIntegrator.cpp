#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/HelfrichKernels.h"
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
    requireAtMost("HamiltonianTrajectoryIntegrator: the number of substeps of the tether", substeps, MAX_STEPS);
    tetherSubsteps = substeps;
}

void HamiltonianTrajectoryIntegrator::setMomentumRefreshment(double refreshment) {
    if (!(refreshment > 0 && refreshment <= 1))
        throw OpenMMException("HamiltonianTrajectoryIntegrator: the refreshment of momenta is " +
                              to_string(refreshment) + "; it must be from more than 0 to 1");
    momentumRefreshment = refreshment;
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
        potentialEnergy = soleMembrane->makeTrajectory(*context, sequence, forcePrecision == "mixed");
    else {
        moveStepByStep(sequence);
        potentialEnergy = computePotentialEnergy();
    }
    return potentialEnergy + trajectory.computeKineticEnergy(*context);
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
