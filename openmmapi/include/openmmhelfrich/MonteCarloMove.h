#ifndef OPENMM_MONTECARLOMOVE_H_
#define OPENMM_MONTECARLOMOVE_H_

#include "internal/windowsExportHelfrich.h"

namespace HelfrichPlugin {

/**
 * What an Integrator has whose steps are Monte Carlo moves, which leave the Boltzmann distribution at a temperature as
 * it is: MonteCarloIntegrator and the classes derived from it, and those that OpenMM's own Integrators are the base of.
 */
class OPENMM_EXPORT_HELFRICH MonteCarloMove {
public:
    virtual ~MonteCarloMove() {
    }
    /**
     * Get the temperature, in Kelvin.
     */
    virtual double getTemperature() const = 0;
    /**
     * Set the temperature, in Kelvin.
     */
    virtual void setTemperature(double temperature) = 0;
    /**
     * Get the random number seed.
     */
    virtual int getRandomNumberSeed() const = 0;
    /**
     * Set the random number seed.  If it is 0 (the default), a unique one is chosen when a Context is created.
     */
    virtual void setRandomNumberSeed(int seed) = 0;
    /**
     * Get the number of moves attempted since the Context was created.
     */
    virtual long long getNumAttempted() const = 0;
    /**
     * Get the number of moves accepted since the Context was created.
     */
    virtual long long getNumAccepted() const = 0;
    /**
     * Get the fraction of attempted moves that were accepted, or 0 if there was none.
     */
    double getAcceptanceRate() const {
        return getNumAttempted() == 0 ? 0 : getNumAccepted() / (double) getNumAttempted();
    }
};

} // namespace HelfrichPlugin

#endif /*OPENMM_MONTECARLOMOVE_H_*/
