#include "openmmhelfrich/HybridMonteCarloIntegratorProxy.h"
#include "openmmhelfrich/CustomTrajectoryIntegrator.h"
#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include "openmmhelfrich/ShearWaveIntegrator.h"
#include "openmmhelfrich/internal/HelfrichSerialization.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmm/CustomIntegrator.h"
#include "openmm/OpenMMException.h"
#include <memory>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * Version 1 had two moves, or three with shear waves, each under a name of its own.
 */
static const int VERSION = 2, OLDEST_VERSION = 1;

HybridMonteCarloIntegratorProxy::HybridMonteCarloIntegratorProxy() : SerializationProxy("HybridMonteCarloIntegrator") {
}

void HybridMonteCarloIntegratorProxy::serialize(const void* object, SerializationNode& node) const {
    node.setIntProperty("version", VERSION);
    const HybridMonteCarloIntegrator& integrator = *reinterpret_cast<const HybridMonteCarloIntegrator*>(object);
    node.setIntProperty("randomSeed", integrator.getRandomNumberSeed());
    for (int i = 0; i < integrator.getNumMoves(); i++) {
        SerializationNode& move = node.createChildNode("Move");
        if (i > 0)
            move.setDoubleProperty("probability", integrator.getMoveProbability(i));
        move.createChildNode("Integrator", &integrator.getMove(i));
    }
}

static HybridMonteCarloIntegrator* loadMoves(const SerializationNode& node) {
    const vector<SerializationNode>& moves = node.getChildren();
    if (moves.empty())
        throw OpenMMException("HybridMonteCarloIntegrator: the serialized object has no moves");
    unique_ptr<HybridMonteCarloIntegrator> integrator;
    for (size_t i = 0; i < moves.size(); i++) {
        unique_ptr<Integrator> move(moves[i].getChildNode("Integrator").decodeObject<Integrator>());
        if (i == 0)
            integrator.reset(new HybridMonteCarloIntegrator(move.get()));
        else
            integrator->addMove(move.get(), moves[i].getDoubleProperty("probability"));
        move.release();
    }
    return integrator.release();
}

/**
 * Get the trajectories of version 1 as a CustomTrajectoryIntegrator, if it wrote that as a CustomIntegrator.
 */
static unique_ptr<Integrator> loadFirstTrajectory(const SerializationNode& node, const EdgeFlipIntegrator& flips) {
    unique_ptr<Integrator> found(node.decodeObject<Integrator>());
    CustomIntegrator* custom = dynamic_cast<CustomIntegrator*>(found.get());
    if (custom == NULL || custom->getNumGlobalVariables() < 2 ||
        custom->getGlobalVariableName(1) != "stepsPerTrajectory")
        return found;
    double kT = custom->getGlobalVariableByName("kT"), temperature = flips.getTemperature();
    if (BOLTZMANN * temperature != kT)
        temperature = kT / BOLTZMANN;
    unique_ptr<CustomTrajectoryIntegrator> trajectory(new CustomTrajectoryIntegrator(
            temperature, custom->getStepSize(), (int) custom->getGlobalVariableByName("stepsPerTrajectory")));
    trajectory->setRandomNumberSeed(custom->getRandomNumberSeed());
    trajectory->setIntegrationForceGroups(custom->getIntegrationForceGroups());
    trajectory->setConstraintTolerance(custom->getConstraintTolerance());
    return trajectory;
}

template <class Move>
static unique_ptr<Move> loadFirstMove(const SerializationNode& node, const string& name, const string& kind) {
    unique_ptr<Integrator> found(node.getChildNode(name).decodeObject<Integrator>());
    Move* move = dynamic_cast<Move*>(found.get());
    if (move == NULL)
        throw OpenMMException("HybridMonteCarloIntegrator: the node '" + name + "' does not describe " + kind);
    found.release();
    return unique_ptr<Move>(move);
}

static HybridMonteCarloIntegrator* loadFirstVersion(const SerializationNode& node) {
    auto flips = loadFirstMove<EdgeFlipIntegrator>(node, "Flips", "an EdgeFlipIntegrator");
    unique_ptr<Integrator> trajectory = loadFirstTrajectory(node.getChildNode("Trajectory"), *flips);
    unique_ptr<HybridMonteCarloIntegrator> integrator(
            new HybridMonteCarloIntegrator(trajectory.get(), flips.get(), node.getDoubleProperty("flipProbability")));
    trajectory.release();
    flips.release();
    if (node.hasProperty("shearWaveProbability")) {
        auto waves = loadFirstMove<ShearWaveIntegrator>(node, "ShearWaves", "a ShearWaveIntegrator");
        integrator->addMove(waves.get(), node.getDoubleProperty("shearWaveProbability"));
        waves.release();
    }
    return integrator.release();
}

void* HybridMonteCarloIntegratorProxy::deserialize(const SerializationNode& node) const {
    requireVersion(node, VERSION, getTypeName(), OLDEST_VERSION);
    bool isFirst = (node.getIntProperty("version") == OLDEST_VERSION);
    unique_ptr<HybridMonteCarloIntegrator> integrator(isFirst ? loadFirstVersion(node) : loadMoves(node));
    integrator->setRandomNumberSeed(node.getIntProperty("randomSeed"), false);
    return integrator.release();
}
