#ifndef OPENMM_REFERENCESPECIESEXCHANGE_H_
#define OPENMM_REFERENCESPECIESEXCHANGE_H_

#include "ReferenceHelfrichGeometry.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include <set>

namespace HelfrichPlugin {

/**
 * Metropolis sweeps of exchanges of species, written for reading: one attempt follows the other, and the change of
 * energy is what the equations of HelfrichForce say of the two vertices, their edges and their triangles after the
 * exchange, less what they said before.  Totals do not depend on species.
 */
class ReferenceSpeciesExchange : public ReferenceHelfrichGeometry {
public:
    /**
     * @param mesh        the connectivity, and the species that the exchanges change
     * @param x           the position of each vertex
     * @param parameters  the moduli
     * @param proposal    what an attempt proposes
     */
    ReferenceSpeciesExchange(HelfrichMesh& mesh, const Vectors& x, const HelfrichParameters& parameters,
                             const SpeciesProposal& proposal);
    /**
     * Make a sweep.  See ExchangeSpeciesKernel::execute() for the parameters.
     */
    SpeciesExchangeStatistics sweep(double kT, long long numAttempts, const Philox& random, long long sweep);
private:
    bool isAlike(const SpeciesDraw& draw) const;
    bool attempt(const SpeciesDraw& draw, double kT);
    /**
     * Make the change of species that was drawn.  Made twice, an exchange undoes itself.
     */
    void change(const SpeciesDraw& draw);
    /**
     * Get the energy of a vertex, or two, with their edges and triangles, less the chemical potentials.
     */
    Real compute(const std::set<int>& changed) const;
    Real computeMaterial(int vertex) const;
    HelfrichMesh& changing;
    const HelfrichParameters& p;
    const SpeciesProposal& proposal;
    /// of each vertex; the defect is what its angles lack of a full turn
    std::vector<Real> areas, curvatures, defects;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_REFERENCESPECIESEXCHANGE_H_*/
