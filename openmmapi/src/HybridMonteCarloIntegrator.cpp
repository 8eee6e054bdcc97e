#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include "openmmhelfrich/CustomTrajectoryIntegrator.h"
#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/internal/HelfrichSerialization.h"
#include "openmmhelfrich/internal/MembraneState.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmmhelfrich/internal/Philox.h"
#include <memory>
#include <set>
#include <typeindex>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * Version 2 of States added the membranes.
 */
static const int VERSION = 2, OLDEST_VERSION = 1;

static const string NAME = "HybridMonteCarloIntegrator";

/**
 * What a checkpoint began with, where it now has the name, and version 0.1.0 had a seed and a counter.
 */
static const char MAGIC_BYTES[] = "HlfMoves";

static Integrator* createTrajectory(const string& engine, double temperature, double stepSize, int steps) {
    if (engine == "native")
        return new HamiltonianTrajectoryIntegrator(temperature, stepSize, steps);
    if (engine == "custom")
        return new CustomTrajectoryIntegrator(temperature, stepSize, steps);
    throw OpenMMException("HybridMonteCarloIntegrator: the engine is '" + engine +
                          "'; it must be 'native' or 'custom'");
}

HybridMonteCarloIntegrator::HybridMonteCarloIntegrator(double temperature, double stepSize, int stepsPerTrajectory,
                                                       double flipFraction, double flipProbability,
                                                       const string& engine) {
    unique_ptr<Integrator> trajectory(createTrajectory(engine, temperature, stepSize, stepsPerTrajectory));
    unique_ptr<Integrator> flips(new EdgeFlipIntegrator(temperature, flipFraction));
    add(trajectory.get(), 0, "");
    trajectory.release();
    add(flips.get(), flipProbability, "the flip probability");
    flips.release();
}

HybridMonteCarloIntegrator::HybridMonteCarloIntegrator(Integrator* trajectory, EdgeFlipIntegrator* flips,
                                                       double flipProbability) {
    checkProbability(1, flipProbability, "the flip probability");
    add(trajectory, 0, "");
    if (flips != NULL)
        add(flips, flipProbability, "the flip probability");
}

int HybridMonteCarloIntegrator::addMove(Integrator* move, double probability) {
    add(move, probability, "the probability of move " + to_string(getNumMoves()));
    return getNumMoves() - 1;
}

void HybridMonteCarloIntegrator::add(Integrator* move, double probability, const string& item) {
    checkProbability(getNumMoves(), probability, item);
    if (move == NULL)
        throw OpenMMException("HybridMonteCarloIntegrator: there is no Integrator to add");
    addIntegrator(move);
    probabilities.push_back(probability);
}

void HybridMonteCarloIntegrator::checkProbability(int index, double probability, const string& item) const {
    if (!(probability >= 0 && probability <= 1))
        throw OpenMMException("HybridMonteCarloIntegrator: " + item + " is " + toText(probability) +
                              "; it must be between 0 and 1");
    double sum = 0;
    for (int i = 1; i < max(getNumMoves(), index + 1); i++)
        sum += (i == index ? probability : probabilities[i]);
    if (sum > 1)
        throw OpenMMException("HybridMonteCarloIntegrator: with " + item + ", " + toText(probability) +
                              ", the probabilities of moves add up to more than 1, to " + toText(sum));
}

void HybridMonteCarloIntegrator::checkIndex(int index) const {
    if (index < 0 || index >= getNumMoves())
        throw OpenMMException("HybridMonteCarloIntegrator: there is no move " + to_string(index) + "; there are " +
                              to_string(getNumMoves()));
}

Integrator& HybridMonteCarloIntegrator::getMove(int index) {
    checkIndex(index);
    return getIntegrator(index);
}

const Integrator& HybridMonteCarloIntegrator::getMove(int index) const {
    checkIndex(index);
    return getIntegrator(index);
}

double HybridMonteCarloIntegrator::getMoveProbability(int index) const {
    checkIndex(index);
    if (index > 0)
        return probabilities[index];
    double sum = 0;
    for (int i = 1; i < getNumMoves(); i++)
        sum += probabilities[i];
    return 1 - sum;
}

void HybridMonteCarloIntegrator::setMoveProbability(int index, double probability) {
    checkIndex(index);
    if (index == 0)
        throw OpenMMException("HybridMonteCarloIntegrator: the probability of move 0 cannot be set; it is what the "
                              "other moves leave");
    checkProbability(index, probability, "the probability of move " + to_string(index));
    probabilities[index] = probability;
}

const MonteCarloMove* HybridMonteCarloIntegrator::findMonteCarloMove(int index) const {
    return dynamic_cast<const MonteCarloMove*>(&getMove(index));
}

int HybridMonteCarloIntegrator::findFlips() const {
    for (int i = 0; i < getNumMoves(); i++)
        if (dynamic_cast<const EdgeFlipIntegrator*>(&getMove(i)) != NULL)
            return i;
    return -1;
}

int HybridMonteCarloIntegrator::requireFlips() const {
    int index = findFlips();
    if (index < 0)
        throw OpenMMException("HybridMonteCarloIntegrator: it has no EdgeFlipIntegrator; call addMove()");
    return index;
}

const EdgeFlipIntegrator& HybridMonteCarloIntegrator::getFlipIntegrator() const {
    return dynamic_cast<const EdgeFlipIntegrator&>(getMove(requireFlips()));
}

double HybridMonteCarloIntegrator::getFlipProbability() const {
    return findFlips() < 0 ? 0 : getMoveProbability(findFlips());
}

void HybridMonteCarloIntegrator::setFlipProbability(double probability) {
    int index = requireFlips();
    if (index > 0)
        checkProbability(index, probability, "the flip probability");
    setMoveProbability(index, probability);
}

double HybridMonteCarloIntegrator::getFlipAcceptanceRate() const {
    return findFlips() < 0 ? 0 : getFlipIntegrator().getAcceptanceRate();
}

double HybridMonteCarloIntegrator::getTemperature() const {
    for (int i = 0; i < getNumMoves(); i++)
        if (auto move = findMonteCarloMove(i))
            return move->getTemperature();
    throw OpenMMException("HybridMonteCarloIntegrator: it has no move with a temperature");
}

void HybridMonteCarloIntegrator::setTemperature(double temperature) {
    requirePositive("HybridMonteCarloIntegrator: the temperature in K", temperature);
    for (int i = 0; i < getNumMoves(); i++)
        if (auto move = dynamic_cast<MonteCarloMove*>(&getMove(i)))
            move->setTemperature(temperature);
}

double HybridMonteCarloIntegrator::getStepSize() const {
    return getMove(0).getStepSize();
}

void HybridMonteCarloIntegrator::setStepSize(double size) {
    requirePositive("HybridMonteCarloIntegrator: the step size in ps", size);
    getMove(0).setStepSize(size);
}

/**
 * Get the seed of a move that is not the first of its kind: with the same one it would draw the numbers of the first.
 */
static int getOtherSeed(int seed, int index) {
    return seed == 0 ? 0 : int(Philox(seed, RandomStream::Seeds)(0, index)[0] >> 1) | 1;
}

void HybridMonteCarloIntegrator::setRandomNumberSeed(int seed, bool alsoForIntegrators) {
    SeededMove::setRandomNumberSeed(seed);
    set<type_index> kinds = {typeid(*this)};
    for (int i = 0; i < getNumMoves() && alsoForIntegrators; i++)
        if (auto move = dynamic_cast<MonteCarloMove*>(&getMove(i)))
            move->setRandomNumberSeed(kinds.insert(typeid(*move)).second ? seed : getOtherSeed(seed, i));
}

long long HybridMonteCarloIntegrator::getNumAttempted() const {
    auto move = findMonteCarloMove(0);
    return move == NULL ? numTrajectories : move->getNumAttempted();
}

long long HybridMonteCarloIntegrator::getNumAccepted() const {
    auto move = findMonteCarloMove(0);
    return move == NULL ? numTrajectories : move->getNumAccepted();
}

void HybridMonteCarloIntegrator::initialize(ContextImpl& contextRef) {
    bind(contextRef, context, owner);
    CompoundIntegrator::initialize(contextRef);
    if (getFlipProbability() > 0)
        getFlipIntegrator().requireLiveMembranes();
}

void HybridMonteCarloIntegrator::step(int steps) {
    requireContext(context);
    for (int i = 0; i < steps; i++) {
        int index = chooseMove();
        getMove(index).step(1);
        if (index == 0)
            numTrajectories++;
    }
}

int HybridMonteCarloIntegrator::chooseMove() const {
    auto words = getRandom(RandomStream::MoveChoice)(0, context->getStepCount());
    double choice = Philox::uniform(words[0], words[1]), bound = 0;
    for (int i = 1; i < getNumMoves(); i++) {
        bound += probabilities[i];
        if (choice < bound)
            return i;
    }
    return 0;
}

void HybridMonteCarloIntegrator::createCheckpoint(ostream& stream) const {
    writeName(stream, NAME);
    writeBinary(stream, getNumIntegrators());
    writeSeedAndCounters(stream);
    CompoundIntegrator::createCheckpoint(stream);
    MembraneState(*this, *context).createCheckpoint(stream);
}

void HybridMonteCarloIntegrator::loadCheckpoint(istream& stream) {
    if (!readName(stream, NAME) && !readMagic(stream, MAGIC_BYTES)) {
        loadFirstCheckpoint(stream);
        return;
    }
    int numIntegrators;
    readBinary(stream, numIntegrators);
    if (numIntegrators != getNumIntegrators())
        throw OpenMMException("HybridMonteCarloIntegrator: the checkpoint is of one with " + to_string(numIntegrators) +
                              " moves, and this one has " + to_string(getNumIntegrators()));
    readSeedAndCounters(stream);
    loadIntegrators(stream);
    if (!MembraneState(*this, *context).loadCheckpoint(stream))
        throw OpenMMException("HybridMonteCarloIntegrator: the checkpoint is damaged");
}

void HybridMonteCarloIntegrator::loadFirstCheckpoint(istream& stream) {
    long long numAccepted, numDiverged;
    readSeedAndCounters(stream);
    readBinary(stream, numAccepted);
    readBinary(stream, numDiverged);
    loadIntegrators(stream);
    setFirstCounters(numAccepted, numDiverged);
}

void HybridMonteCarloIntegrator::loadIntegrators(istream& stream) {
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

void HybridMonteCarloIntegrator::setFirstCounters(long long numAccepted, long long numDiverged) {
    if (auto custom = dynamic_cast<CustomTrajectoryIntegrator*>(&getMove(0))) {
        custom->numTrajectories = numTrajectories;
        custom->numAccepted = numAccepted;
        custom->numDiverged = numDiverged;
    }
}

void HybridMonteCarloIntegrator::serializeParameters(SerializationNode& node) const {
    node.setIntProperty("version", VERSION);
    storeSeedAndCounters(node);
    CompoundIntegrator::serializeParameters(node.createChildNode("Integrators"));
    MembraneState(*this, *context).serialize(node);
}

void HybridMonteCarloIntegrator::deserializeParameters(const SerializationNode& node) {
    requireVersion(node, VERSION, "HybridMonteCarloIntegrator", OLDEST_VERSION);
    CompoundIntegrator::deserializeParameters(node.getChildNode("Integrators"));
    loadSeedAndCounters(node);
    if (node.getIntProperty("version") == OLDEST_VERSION)
        setFirstCounters(node.getLongProperty("numAccepted"), node.getLongProperty("numDiverged"));
    else
        MembraneState(*this, *context).deserialize(node);
}
