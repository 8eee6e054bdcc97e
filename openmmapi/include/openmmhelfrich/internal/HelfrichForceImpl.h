#ifndef OPENMM_HELFRICHFORCEIMPL_H_
#define OPENMM_HELFRICHFORCEIMPL_H_

#include "HelfrichMesh.h"
#include "HelfrichParameters.h"
#include "Splitting.h"
#include "openmm/Kernel.h"
#include "openmm/internal/ForceImpl.h"
#include "openmm/serialization/SerializationNode.h"
#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include <istream>
#include <map>
#include <memory>
#include <optional>
#include <ostream>
#include <string>
#include <vector>

namespace HelfrichPlugin {

/**
 * The internal implementation of HelfrichForce.  It owns the live mesh of a Context.
 */
class OPENMM_EXPORT_HELFRICH HelfrichForceImpl : public OpenMM::ForceImpl {
public:
    explicit HelfrichForceImpl(const HelfrichForce& owner);
    void initialize(OpenMM::ContextImpl& context);
    const HelfrichForce& getOwner() const {
        return owner;
    }
    void updateContextState(OpenMM::ContextImpl& context, bool& forcesInvalid) {
    }
    double calcForcesAndEnergy(OpenMM::ContextImpl& context, bool includeForces, bool includeEnergy, int groups);
    /**
     * Get whether makeTrajectory() can move the particles: the platform must be able to, and all particles must be
     * vertices.
     */
    bool canMakeTrajectory(OpenMM::ContextImpl& context) const;
    /**
     * Make a trajectory under this force alone.  See CalcHelfrichForceKernel::makeTrajectory() for the parameters.
     *
     * @return the energy at the end
     */
    double makeTrajectory(OpenMM::ContextImpl& context, const KickAndDriftSequence& sequence, bool mixed,
                          IntegrateHamiltonianTrajectoryKernel* waves = NULL);
    /**
     * Compute from now on only the forces that act in a kick, whatever the force groups, or all with NULL.
     */
    void setKick(const KickAndDrift* kick) {
        this->kick = kick;
    }
    std::map<std::string, double> getDefaultParameters();
    std::vector<std::string> getKernelNames();
    std::vector<std::pair<int, int>> getBondedParticles() const;
    void updateParametersInContext(OpenMM::ContextImpl& context);
    HelfrichEnergyTerms getEnergyTerms(OpenMM::ContextImpl& context);
    HelfrichGeometry getGeometry(OpenMM::ContextImpl& context);
    const HelfrichMesh& getMesh() const {
        return *mesh;
    }
    HelfrichMesh& getMesh() {
        return *mesh;
    }
    void setTriangles(OpenMM::ContextImpl& context, const std::vector<std::array<int, 3>>& triangles);
    void setSpecies(OpenMM::ContextImpl& context, const std::vector<int>& species);
    /**
     * Write the live state, which is the triangles, the order of the vertices and their species, to a checkpoint.
     */
    void createCheckpoint(std::ostream& stream) const;
    /**
     * Read what createCheckpoint() wrote.
     */
    void loadCheckpoint(OpenMM::ContextImpl& context, std::istream& stream);
    /**
     * Write the live state to a node of a State.
     */
    void serializeState(OpenMM::SerializationNode& node) const;
    /**
     * Read what serializeState() wrote.
     */
    void deserializeState(OpenMM::ContextImpl& context, const OpenMM::SerializationNode& node);
    /**
     * Make a sweep of edge flips.  See SweepEdgeFlipsKernel::execute() for the parameters.
     */
    EdgeFlipStatistics flipEdges(OpenMM::ContextImpl& context, double kT, long long numAttempts, const Philox& random,
                                 long long sweep);
    /**
     * Make a sweep of exchanges of species.  See ExchangeSpeciesKernel::execute() for the parameters.
     */
    SpeciesExchangeStatistics exchangeSpecies(OpenMM::ContextImpl& context, const SpeciesProposal& proposal, double kT,
                                              long long numAttempts, const Philox& random, long long sweep);
    /**
     * Get the number of species that there are in the Context.
     */
    int getNumSpecies() const {
        return parameters.species ? parameters.species->getNumSpecies() : 0;
    }
    /**
     * Get the moduli and other parameters, with the present values of those that are the Context's.
     */
    HelfrichParameters getParameters(OpenMM::ContextImpl& context) const;
private:
    void checkOtherMembranes(const OpenMM::System& system) const;
    void checkName(const HelfrichForce& other) const;
    void checkParticles(const HelfrichForce& other, const std::vector<char>& isVertex) const;
    void checkSurfaceTargets() const;
    void createSpecies();
    void checkSpecies(const HelfrichForce& force) const;
    void checkOrientation(OpenMM::ContextImpl& context, const HelfrichParameters& parameters);
    void checkBox(OpenMM::ContextImpl& context, const HelfrichParameters& parameters);
    void checkClosedInBox(OpenMM::ContextImpl& context) const;
    void checkPeriodicInBox(OpenMM::ContextImpl& context, const HelfrichParameters& parameters) const;
    /**
     * Throw if the nearest images of a triangle's vertices do not make a triangle, because edges have become too long
     * for the box or the box is not that of the mesh.
     */
    void checkWhole(OpenMM::ContextImpl& context, const PeriodicBox& box) const;
    void checkPeriodicTerms(const HelfrichParameters& parameters) const;
    PeriodicBox getBox(OpenMM::ContextImpl& context) const;
    std::string getParameterName(const std::pair<Term, int>& surfaceTarget) const;
    void checkContextParameters(HelfrichParameters& parameters) const;
    void checkContextParameter(const HelfrichParameters& parameters, const HelfrichContextParameter& parameter,
                               const std::string& name, double value) const;
    HelfrichEnergyTerms execute(OpenMM::ContextImpl& context, bool includeForces);
    void addTermsOfConnectivity(const HelfrichParameters& parameters, HelfrichEnergyTerms& terms);
    double computePairEnergy(const HelfrichParameters& parameters) const;
    void restore(OpenMM::ContextImpl& context, const std::vector<std::array<int, 3>>& triangles,
                 const std::vector<int>& order, const std::vector<int>& species);
    void requirePositions(OpenMM::ContextImpl& context);
    void checkPositions(const std::vector<OpenMM::Vec3>& positions) const;
    void throwNonFinite(OpenMM::ContextImpl& context, const HelfrichGeometry& geometry) const;
    void throwNonFinite(OpenMM::ContextImpl& context, const HelfrichEnergyTerms& terms) const;
    const HelfrichForce& owner;
    /// those of the owner, as of initialize() or, but for which surfaces have targets of their own,
    /// updateParametersInContext()
    HelfrichParameters parameters;
    const KickAndDrift* kick = NULL;
    bool isPeriodic = false, isOrientationChecked = false, isBoxChecked = false, arePositionsSet = false;
    PeriodicBox checkedBox;
    std::unique_ptr<HelfrichMesh> mesh;
    /// the energy of pairs of species, and what it is of
    double pairEnergy = 0;
    std::shared_ptr<const HelfrichSpeciesTable> tableOfPairs;
    long long revisionOfPairs = 0, speciesRevisionOfPairs = 0;
    OpenMM::Kernel kernel;
    /// created when they are first needed
    std::optional<OpenMM::Kernel> flipKernel, exchangeKernel;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHFORCEIMPL_H_*/
