#ifndef OPENMM_MONTECARLOINTEGRATOR_PROXIES_H_
#define OPENMM_MONTECARLOINTEGRATOR_PROXIES_H_

/* The proxies of single moves, which differ in a few settings, and their registration. */

#include "openmmhelfrich/CustomTrajectoryIntegrator.h"
#include "openmmhelfrich/EdgeFlipIntegrator.h"
#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/ShearWaveIntegrator.h"
#include "openmmhelfrich/SpeciesExchangeIntegrator.h"
#include "openmmhelfrich/internal/HelfrichSerialization.h"
#include "openmm/serialization/SerializationNode.h"
#include "openmm/serialization/SerializationProxy.h"
#include <memory>
#include <string>

namespace HelfrichPlugin {

/**
 * This is the base of proxies for serializing Monte Carlo moves.  It takes care of the settings that all have; those of
 * the class T are for a derived class.
 */
template <class T>
class MonteCarloIntegratorProxy : public OpenMM::SerializationProxy {
public:
    void serialize(const void* object, OpenMM::SerializationNode& node) const {
        const T& move = *reinterpret_cast<const T*>(object);
        node.setIntProperty("version", getVersion(move));
        node.setDoubleProperty("temperature", move.getTemperature());
        node.setIntProperty("randomSeed", move.getRandomNumberSeed());
        node.setIntProperty("integrationForceGroups", move.getIntegrationForceGroups());
        node.setDoubleProperty("constraintTolerance", move.getConstraintTolerance());
        storeSettings(move, node);
    }
    void* deserialize(const OpenMM::SerializationNode& node) const {
        requireVersion(node, newestVersion, getTypeName(), 1);
        std::unique_ptr<T> move(create(node.getDoubleProperty("temperature"), node));
        move->setRandomNumberSeed(node.getIntProperty("randomSeed"));
        move->setIntegrationForceGroups(node.getIntProperty("integrationForceGroups", 0xFFFFFFFF));
        move->setConstraintTolerance(node.getDoubleProperty("constraintTolerance", 1e-5));
        return move.release();
    }
protected:
    /**
     * @param typeName       the name of the class
     * @param newestVersion  the newest version that getVersion() returns
     */
    explicit MonteCarloIntegratorProxy(const std::string& typeName, int newestVersion = 1)
            : SerializationProxy(typeName), newestVersion(newestVersion) {
    }
    /**
     * Get the oldest version that has the settings of a move.
     */
    virtual int getVersion(const T& move) const {
        return 1;
    }
    /**
     * Write the settings that only this class has.
     */
    virtual void storeSettings(const T& move, OpenMM::SerializationNode& node) const = 0;
    /**
     * Create a move with the settings that storeSettings() wrote.
     */
    virtual T* create(double temperature, const OpenMM::SerializationNode& node) const = 0;
private:
    const int newestVersion;
};

/**
 * This is a proxy for serializing CustomTrajectoryIntegrator objects.
 */
class CustomTrajectoryIntegratorProxy : public MonteCarloIntegratorProxy<CustomTrajectoryIntegrator> {
public:
    CustomTrajectoryIntegratorProxy() : MonteCarloIntegratorProxy("CustomTrajectoryIntegrator") {
    }
protected:
    void storeSettings(const CustomTrajectoryIntegrator& move, OpenMM::SerializationNode& node) const {
        node.setDoubleProperty("stepSize", move.getStepSize());
        node.setIntProperty("stepsPerTrajectory", move.getStepsPerTrajectory());
    }
    CustomTrajectoryIntegrator* create(double temperature, const OpenMM::SerializationNode& node) const {
        return new CustomTrajectoryIntegrator(temperature, node.getDoubleProperty("stepSize"),
                                              node.getIntProperty("stepsPerTrajectory"));
    }
};

/**
 * This is a proxy for serializing EdgeFlipIntegrator objects.
 */
class EdgeFlipIntegratorProxy : public MonteCarloIntegratorProxy<EdgeFlipIntegrator> {
public:
    EdgeFlipIntegratorProxy() : MonteCarloIntegratorProxy("EdgeFlipIntegrator") {
    }
protected:
    void storeSettings(const EdgeFlipIntegrator& move, OpenMM::SerializationNode& node) const {
        node.setDoubleProperty("fraction", move.getFraction());
    }
    EdgeFlipIntegrator* create(double temperature, const OpenMM::SerializationNode& node) const {
        return new EdgeFlipIntegrator(temperature, node.getDoubleProperty("fraction"));
    }
};

/**
 * This is a proxy for serializing HamiltonianTrajectoryIntegrator objects.
 */
class HamiltonianTrajectoryIntegratorProxy : public MonteCarloIntegratorProxy<HamiltonianTrajectoryIntegrator> {
public:
    HamiltonianTrajectoryIntegratorProxy() : MonteCarloIntegratorProxy("HamiltonianTrajectoryIntegrator", 2) {
    }
protected:
    int getVersion(const HamiltonianTrajectoryIntegrator& move) const {
        return move.getMultilevelWeight() == 0 ? 1 : 2;
    }
    void storeSettings(const HamiltonianTrajectoryIntegrator& move, OpenMM::SerializationNode& node) const {
        node.setDoubleProperty("stepSize", move.getStepSize());
        node.setIntProperty("stepsPerTrajectory", move.getStepsPerTrajectory());
        node.setStringProperty("forcePrecision", move.getForcePrecision());
        node.setDoubleProperty("trajectoryJitter", move.getTrajectoryJitter());
        node.setStringProperty("splitting", move.getSplitting());
        node.setIntProperty("tetherSubsteps", move.getTetherSubsteps());
        node.setDoubleProperty("momentumRefreshment", move.getMomentumRefreshment());
        if (move.getMultilevelWeight() != 0)
            node.setDoubleProperty("multilevelWeight", move.getMultilevelWeight());
    }
    HamiltonianTrajectoryIntegrator* create(double temperature, const OpenMM::SerializationNode& node) const {
        std::unique_ptr<HamiltonianTrajectoryIntegrator> move(new HamiltonianTrajectoryIntegrator(
                temperature, node.getDoubleProperty("stepSize"), node.getIntProperty("stepsPerTrajectory")));
        move->setForcePrecision(node.getStringProperty("forcePrecision", "double"));
        move->setTrajectoryJitter(node.getDoubleProperty("trajectoryJitter", 0.0));
        move->setSplitting(node.getStringProperty("splitting", "leapfrog"));
        move->setTetherSubsteps(node.getIntProperty("tetherSubsteps", 1));
        move->setMomentumRefreshment(node.getDoubleProperty("momentumRefreshment", 1.0));
        move->setMultilevelWeight(node.getDoubleProperty("multilevelWeight", 0.0));
        return move.release();
    }
};

/**
 * This is a proxy for serializing ShearWaveIntegrator objects.
 */
class ShearWaveIntegratorProxy : public MonteCarloIntegratorProxy<ShearWaveIntegrator> {
public:
    ShearWaveIntegratorProxy() : MonteCarloIntegratorProxy("ShearWaveIntegrator") {
    }
protected:
    void storeSettings(const ShearWaveIntegrator& move, OpenMM::SerializationNode& node) const {
        node.setDoubleProperty("amplitude", move.getAmplitude());
        node.setDoubleProperty("minWaveNumber", move.getMinWaveNumber());
        node.setDoubleProperty("maxWaveNumber", move.getMaxWaveNumber());
        node.setIntProperty("movesPerStep", move.getMovesPerStep());
    }
    ShearWaveIntegrator* create(double temperature, const OpenMM::SerializationNode& node) const {
        return new ShearWaveIntegrator(temperature, node.getDoubleProperty("amplitude"),
                                       node.getDoubleProperty("minWaveNumber"), node.getDoubleProperty("maxWaveNumber"),
                                       node.getIntProperty("movesPerStep"));
    }
};

/**
 * This is a proxy for serializing SpeciesExchangeIntegrator objects.
 */
class SpeciesExchangeIntegratorProxy : public MonteCarloIntegratorProxy<SpeciesExchangeIntegrator> {
public:
    SpeciesExchangeIntegratorProxy() : MonteCarloIntegratorProxy("SpeciesExchangeIntegrator") {
    }
protected:
    void storeSettings(const SpeciesExchangeIntegrator& move, OpenMM::SerializationNode& node) const {
        node.setDoubleProperty("fraction", move.getFraction());
        node.setStringProperty("proposal", move.getProposal());
        OpenMM::SerializationNode& potentials = node.createChildNode("ChemicalPotentials");
        for (auto& potential : move.getChemicalPotentials())
            potentials.createChildNode("ChemicalPotential")
                    .setIntProperty("species", potential.first)
                    .setDoubleProperty("mu", potential.second);
    }
    SpeciesExchangeIntegrator* create(double temperature, const OpenMM::SerializationNode& node) const {
        std::unique_ptr<SpeciesExchangeIntegrator> move(
                new SpeciesExchangeIntegrator(temperature, node.getDoubleProperty("fraction")));
        move->setProposal(node.getStringProperty("proposal"));
        for (auto& potential : node.getChildNode("ChemicalPotentials").getChildren())
            move->setChemicalPotential(potential.getIntProperty("species"), potential.getDoubleProperty("mu"));
        return move.release();
    }
};

/**
 * Register the proxies of single moves.
 */
inline void registerMonteCarloIntegratorProxies() {
    OpenMM::SerializationProxy::registerProxy(typeid(CustomTrajectoryIntegrator),
                                              new CustomTrajectoryIntegratorProxy());
    OpenMM::SerializationProxy::registerProxy(typeid(EdgeFlipIntegrator), new EdgeFlipIntegratorProxy());
    OpenMM::SerializationProxy::registerProxy(typeid(HamiltonianTrajectoryIntegrator),
                                              new HamiltonianTrajectoryIntegratorProxy());
    OpenMM::SerializationProxy::registerProxy(typeid(ShearWaveIntegrator), new ShearWaveIntegratorProxy());
    OpenMM::SerializationProxy::registerProxy(typeid(SpeciesExchangeIntegrator), new SpeciesExchangeIntegratorProxy());
}

} // namespace HelfrichPlugin

#endif /*OPENMM_MONTECARLOINTEGRATOR_PROXIES_H_*/
