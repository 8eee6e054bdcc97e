#include "openmmhelfrich/ShearWaveIntegrator.h"
#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/internal/Interruption.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include <cmath>
#include <limits>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * A step of so many moves can be interrupted: to keep the positions at its start costs next to nothing.
 */
static const int LONG_STEP = 100;

ShearWaveIntegrator::ShearWaveIntegrator(double temperature, double amplitude, double minWaveNumber,
                                         double maxWaveNumber, int movesPerStep)
        : MonteCarloIntegrator("ShearWaveIntegrator", temperature) {
    setAmplitude(amplitude);
    setWaveNumbers(minWaveNumber, maxWaveNumber);
    setMovesPerStep(movesPerStep);
}

void ShearWaveIntegrator::setAmplitude(double amplitude) {
    requirePositive("ShearWaveIntegrator: the amplitude in nm", amplitude);
    this->amplitude = amplitude;
}

void ShearWaveIntegrator::setWaveNumbers(double minWaveNumber, double maxWaveNumber) {
    requirePositive("ShearWaveIntegrator: the least wave number in 1/nm", minWaveNumber);
    requirePositive("ShearWaveIntegrator: the greatest wave number in 1/nm", maxWaveNumber);
    if (minWaveNumber > maxWaveNumber) {
        stringstream message;
        message << "ShearWaveIntegrator: the least wave number is " << minWaveNumber << " and the greatest "
                << maxWaveNumber << " 1/nm; the least must not be above the greatest";
        throw OpenMMException(message.str());
    }
    this->minWaveNumber = minWaveNumber;
    this->maxWaveNumber = maxWaveNumber;
}

void ShearWaveIntegrator::setMovesPerStep(int moves) {
    requirePositive("ShearWaveIntegrator: the number of moves per step", moves);
    movesPerStep = moves;
}

static void requireNoPeriodicMembrane(const System& system) {
    for (int i = 0; i < system.getNumForces(); i++)
        if (dynamic_cast<const HelfrichForce*>(&system.getForce(i)) != NULL &&
            system.getForce(i).usesPeriodicBoundaryConditions())
            throw OpenMMException("ShearWaveIntegrator: the membrane of " + system.getForce(i).getName() +
                                  " is periodic, and waves in any direction would tear it at the borders of the box; "
                                  "use setMultilevelWeight() of the trajectories instead");
}

void ShearWaveIntegrator::initialize(ContextImpl& contextRef) {
    const System& system = contextRef.getSystem();
    requireFreeParticles(system, "ShearWaveIntegrator");
    requireNoPeriodicMembrane(system);
    MonteCarloIntegrator::initialize(contextRef);
    lastAcceptanceProbability = 0;
    fixedParticles.clear();
    for (int i = 0; i < system.getNumParticles(); i++)
        if (system.getParticleMass(i) == 0)
            fixedParticles.push_back(i);
}

void ShearWaveIntegrator::makeMove() {
    // The energy at the start is that of a valid state: an error there is the user's to see.

    double energy = context->calcForcesAndEnergy(false, true, getIntegrationForceGroups());
    if (!isfinite(energy))
        throw OpenMMException(
                "ShearWaveIntegrator: the energy is not finite before a move; see the forces of the System");
    context->getPositions(positions);
    if (movesPerStep >= LONG_STEP)
        makeMovesOrRestore(energy);
    else
        makeMoves(energy);
}

void ShearWaveIntegrator::makeMovesOrRestore(double energy) {
    vector<Vec3> start = positions;
    long long counters[] = {numAttempted, numAccepted, numDiverged};
    try {
        makeMoves(energy);
    }
    catch (const StepInterrupted&) {
        numAttempted = counters[0];
        numAccepted = counters[1];
        numDiverged = counters[2];
        context->setPositions(start);
        throw;
    }
}

void ShearWaveIntegrator::makeMoves(double energy) {
    double sumOfProbabilities = 0;
    Interruption interruption(context->getSystem().getNumParticles());
    for (int i = 0; i < movesPerStep; i++) {
        if (movesPerStep >= LONG_STEP && interruption.isRequested())
            throw StepInterrupted();
        displace();
        context->setPositions(trialPositions);
        double trialEnergy = computeTrialEnergy();
        double probability = getAcceptanceProbability(trialEnergy - energy);
        bool isAccepted = draw(RandomStream::ShearWaveTest, numAttempted, probability);
        numAttempted++;
        sumOfProbabilities += probability;
        if (isAccepted) {
            numAccepted++;
            energy = trialEnergy;
            positions.swap(trialPositions);
        }
        else
            context->setPositions(positions);
    }
    lastAcceptanceProbability = sumOfProbabilities / movesPerStep;
}

/**
 * Compute the sine of 2 pi times a number to within 5e-14: by Taylor's series from -1/4 to 1/4, in operations that
 * compilers vectorize.  The error takes nothing from the exactness of the moves, for any function of k.x makes a shear.
 */
static inline double sineOfTurns(double turns) {
    const double roundingShift = 6755399441055744.0; // 1.5*2^52, a sum with which is rounded to an integer
    double turn = turns - ((turns + roundingShift) - roundingShift);
    double angle = 2 * M_PI * copysign(0.25 - fabs(fabs(turn) - 0.25), turn), square = angle * angle;
    double series = 1.0 / 6227020800 - square * (1.0 / 1307674368000 - square * (1.0 / 355687428096000));
    series = 1.0 / 5040 - square * (1.0 / 362880 - square * (1.0 / 39916800 - square * series));
    return angle * (1 - square * (1.0 / 6 - square * (1.0 / 120 - square * series)));
}

void ShearWaveIntegrator::displace() {
    Philox random = getRandom(RandomStream::ShearWaves);
    Vec3 direction = drawNormals(random, numAttempted, 0), other = drawNormals(random, numAttempted, 1);
    auto words = random(numAttempted, 4);
    double waveNumber = minWaveNumber + (maxWaveNumber - minWaveNumber) * Philox::uniform(words[0], words[1]);
    double phase = Philox::uniform(words[2], words[3]);
    Vec3 turnsPerLength = direction * (waveNumber / (2 * M_PI * sqrt(direction.dot(direction))));
    Vec3 displacement = direction.cross(other);
    displacement *= amplitude * (minWaveNumber / waveNumber) * drawNormals(random, numAttempted, 3)[0] /
                    sqrt(displacement.dot(displacement));
    trialPositions.resize(positions.size());
    for (size_t i = 0; i < positions.size(); i++) {
        Vec3 x = positions[i];
        trialPositions[i] = x + displacement * sineOfTurns(turnsPerLength.dot(x) + phase);
    }
    for (int i : fixedParticles)
        trialPositions[i] = positions[i];
}

double ShearWaveIntegrator::computeTrialEnergy() {
    double energy;
    try {
        energy = computePotentialEnergy();
    }
    catch (const OpenMMException&) {
        energy = numeric_limits<double>::infinity();
    }
    if (isfinite(energy))
        return energy;
    numDiverged++;
    return numeric_limits<double>::infinity();
}
