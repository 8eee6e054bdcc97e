#ifndef OPENMM_EDGEFLIPINTEGRATOR_PROXY_H_
#define OPENMM_EDGEFLIPINTEGRATOR_PROXY_H_

#include "MonteCarloIntegratorProxy.h"
#include "openmmhelfrich/EdgeFlipIntegrator.h"

namespace HelfrichPlugin {

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

} // namespace HelfrichPlugin

#endif /*OPENMM_EDGEFLIPINTEGRATOR_PROXY_H_*/
