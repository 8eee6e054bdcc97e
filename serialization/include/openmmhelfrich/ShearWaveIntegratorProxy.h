#ifndef OPENMM_SHEARWAVEINTEGRATOR_PROXY_H_
#define OPENMM_SHEARWAVEINTEGRATOR_PROXY_H_

#include "MonteCarloIntegratorProxy.h"
#include "openmmhelfrich/ShearWaveIntegrator.h"

namespace HelfrichPlugin {

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

} // namespace HelfrichPlugin

#endif /*OPENMM_SHEARWAVEINTEGRATOR_PROXY_H_*/
