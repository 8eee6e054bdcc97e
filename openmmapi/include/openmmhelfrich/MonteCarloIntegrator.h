#ifndef OPENMM_MONTECARLOINTEGRATOR_H_
#define OPENMM_MONTECARLOINTEGRATOR_H_

#include "MonteCarloMove.h"
#include "internal/windowsExportHelfrich.h"
#include "openmm/Integrator.h"
#include <string>
#include <vector>

namespace HelfrichPlugin {

class HelfrichForceImpl;

/**
 * This is the base of Integrators whose steps are Monte Carlo moves with random numbers of their own.  What a derived
 * class adds is the move, its settings and the names of what it counts.
 *
 * The random numbers come from a counter-based generator whose whole state is the seed and the counters.  These are
 * part of the checkpoint and of the State (as integrator parameters), and so is the live state of the membranes: a
 * simulation continued from either repeats exactly what an uninterrupted one does, and Context::reinitialize(true)
 * keeps the triangles.
 */
class OPENMM_EXPORT_HELFRICH MonteCarloIntegrator : public OpenMM::Integrator, public SeededMove {
public:
    /**
     * Get the temperature of the Metropolis test, in Kelvin.
     */
    double getTemperature() const {
        return temperature;
    }
    /**
     * Set the temperature of the Metropolis test, in Kelvin.
     */
    void setTemperature(double temperature);
    /**
     * Make Monte Carlo moves.
     *
     * @param steps  the number of steps; the class says what one of them is
     */
    void step(int steps);
protected:
    /**
     * Create a MonteCarloIntegrator.
     *
     * @param name         the name of the class, for messages
     * @param temperature  the temperature, in Kelvin
     * @param allowsZero   whether it can be 0 K
     */
    MonteCarloIntegrator(const std::string& name, double temperature, bool allowsZero = false);
    /**
     * Make one step.  The Context's step count is not for this method to advance.
     */
    virtual void makeMove() = 0;
    /**
     * Get kT, in kJ/mol.
     */
    double getThermalEnergy() const;
    /**
     * Get the Metropolis probability min(1, exp(-dE/kT)).
     */
    double getAcceptanceProbability(double energyChange) const;
    /**
     * Draw whether something of a given probability happens.
     *
     * @param stream       the stream of the random number, which must be for this alone
     * @param counter      the random number's place in the stream
     * @param probability  the probability that it happens
     */
    bool draw(unsigned int stream, long long counter, double probability) const;
    /**
     * Compute the potential energy of the Context, whose energy has been computed before.  What a platform prepares for
     * its own forces takes as long as a membrane's energy: where there are no such forces, the membranes are asked
     * directly.
     */
    double computePotentialEnergy();
    /**
     * Get the membranes of the Context.
     */
    const std::vector<HelfrichForceImpl*>& getMembranes() const {
        return membranes;
    }
    /**
     * Get whether a membrane is in the integration force groups.
     */
    bool isIntegrated(const HelfrichForceImpl& membrane) const;
    /**
     * Get whether no force acts in the Context but those of membranes.
     */
    bool hasOnlyMembranes() const;
    void initialize(OpenMM::ContextImpl& context);
    void cleanup();
    std::vector<std::string> getKernelNames();
    double computeKineticEnergy();
    bool kineticEnergyRequiresForce() const;
    void createCheckpoint(std::ostream& stream) const;
    void loadCheckpoint(std::istream& stream);
    void serializeParameters(OpenMM::SerializationNode& node) const;
    void deserializeParameters(const OpenMM::SerializationNode& node);
private:
    const std::string name;
    const bool allowsZero;
    double temperature;
    std::vector<HelfrichForceImpl*> membranes;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_MONTECARLOINTEGRATOR_H_*/
