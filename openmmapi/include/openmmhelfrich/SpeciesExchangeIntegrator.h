#ifndef OPENMM_SPECIESEXCHANGEINTEGRATOR_H_
#define OPENMM_SPECIESEXCHANGEINTEGRATOR_H_

#include "MonteCarloIntegrator.h"
#include "internal/windowsExportHelfrich.h"
#include <map>
#include <string>

namespace HelfrichPlugin {

class HelfrichForceImpl;
struct SpeciesExchangeStatistics;
struct SpeciesProposal;

/**
 * This Integrator changes the species of the vertices of the System's membranes and leaves particles and triangles
 * where they are.  One step is one sweep over each HelfrichForce with species: a fraction of its number of edges of
 * attempts, each of which proposes a change and accepts it with the Metropolis probability min(1, exp(-dE/kT)).
 * setProposal() says what is proposed:
 *
 * <ul>
 * <li>"neighbors", the default: the two ends of an edge, drawn uniformly, exchange their species (Kawasaki, 1966)</li>
 * <li>"anywhere": two vertices, each drawn uniformly from all of the membrane's, exchange their species</li>
 * <li>"mutation": a vertex, drawn uniformly from all vertices, gets a species, drawn uniformly from all species</li>
 * </ul>
 *
 * With "anywhere" vertices of different surfaces exchange too, and the composition comes to equilibrium sooner than by
 * diffusion.  With "mutation" the composition is that of the chemical potentials (the semi-grand canonical ensemble):
 * states are as likely as exp(-(E-sum mu)/kT), with the chemical potential mu of the species of each vertex.
 *
 * Nothing happens, and the attempt counts as one of alike vertices, where both vertices are of one species, or the
 * vertex has the species already.
 */
class OPENMM_EXPORT_HELFRICH SpeciesExchangeIntegrator : public MonteCarloIntegrator {
public:
    /**
     * Create a SpeciesExchangeIntegrator.
     *
     * @param temperature  the temperature of the Metropolis test, in Kelvin; at 0 K only exchanges that do not raise
     * the energy are accepted
     * @param fraction     the number of attempts in a sweep, as a fraction of the number of edges; unless it is 0, a
     * sweep has at least one
     */
    SpeciesExchangeIntegrator(double temperature, double fraction);
    /**
     * Get the number of attempts in a sweep, as a fraction of the number of edges.
     */
    double getFraction() const {
        return fraction;
    }
    /**
     * Set the number of attempts in a sweep, as a fraction of the number of edges.  Unless it is 0, a sweep has at
     * least one.
     */
    void setFraction(double fraction);
    /**
     * Get what an attempt proposes: "neighbors", "anywhere" or "mutation".
     */
    const std::string& getProposal() const {
        return proposal;
    }
    /**
     * Set what an attempt proposes: "neighbors" (the default), "anywhere" or "mutation".
     */
    void setProposal(const std::string& proposal);
    /**
     * Get the chemical potential of a species, measured in kJ/mol.
     *
     * @param species  the number of the species
     */
    double getChemicalPotential(int species) const;
    /**
     * Set the chemical potential of a species, measured in kJ/mol, on which mutations depend.  The default is 0.  Only
     * differences matter: the greater it is, the more vertices are of the species.
     *
     * @param species            the number of the species
     * @param chemicalPotential  the chemical potential
     */
    void setChemicalPotential(int species, double chemicalPotential);
    /**
     * Get the chemical potentials that were set, by the number of the species.
     */
    const std::map<int, double>& getChemicalPotentials() const {
        return chemicalPotentials;
    }
    /**
     * Get the number of changes attempted since the Context was created.
     */
    long long getNumAttempted() const {
        return numAttempted;
    }
    /**
     * Get the number of changes accepted since the Context was created.
     */
    long long getNumAccepted() const {
        return numAccepted;
    }
    /**
     * Get the number of attempts since the Context was created that would have changed nothing, for the two vertices
     * were of one species, or the vertex had the species already.
     */
    long long getNumAlike() const {
        return numAlike;
    }
    /**
     * Get the number of sweeps made: with the seed, the whole state of the random number generator.
     */
    long long getNumSweeps() const {
        return numSweeps;
    }
protected:
    std::vector<std::string> getKernelNames();
    void makeMove();
    void initialize(OpenMM::ContextImpl& context);
private:
    bool hasAttempts(const HelfrichForceImpl& membrane) const;
    long long getNumAttempts(const HelfrichForceImpl& membrane) const;
    SpeciesProposal createProposal(const HelfrichForceImpl& membrane) const;
    SpeciesExchangeStatistics sweep();
    double fraction;
    std::string proposal = "neighbors";
    std::map<int, double> chemicalPotentials;
    long long &numSweeps = addCounter("numSweeps"), &numAttempted = addCounter("numAttempted"),
              &numAccepted = addCounter("numAccepted"), &numAlike = addCounter("numAlike");
};

} // namespace HelfrichPlugin

#endif /*OPENMM_SPECIESEXCHANGEINTEGRATOR_H_*/
