#ifndef OPENMM_MONTECARLOINTEGRATOR_PROXY_H_
#define OPENMM_MONTECARLOINTEGRATOR_PROXY_H_

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
        node.setIntProperty("version", VERSION);
        node.setDoubleProperty("temperature", move.getTemperature());
        node.setIntProperty("randomSeed", move.getRandomNumberSeed());
        node.setIntProperty("integrationForceGroups", move.getIntegrationForceGroups());
        node.setDoubleProperty("constraintTolerance", move.getConstraintTolerance());
        storeSettings(move, node);
    }
    void* deserialize(const OpenMM::SerializationNode& node) const {
        requireVersion(node, VERSION, getTypeName());
        std::unique_ptr<T> move(create(node.getDoubleProperty("temperature"), node));
        move->setRandomNumberSeed(node.getIntProperty("randomSeed"));
        move->setIntegrationForceGroups(node.getIntProperty("integrationForceGroups", 0xFFFFFFFF));
        move->setConstraintTolerance(node.getDoubleProperty("constraintTolerance", 1e-5));
        return move.release();
    }
protected:
    explicit MonteCarloIntegratorProxy(const std::string& typeName) : SerializationProxy(typeName) {
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
    static const int VERSION = 1;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_MONTECARLOINTEGRATOR_PROXY_H_*/
