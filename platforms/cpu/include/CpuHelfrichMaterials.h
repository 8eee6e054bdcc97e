#ifndef OPENMM_CPUHELFRICHMATERIALS_H_
#define OPENMM_CPUHELFRICHMATERIALS_H_

#include "CpuHelfrichLayout.h"
#include "CpuHelfrichLoops.h"
#include "CacheLineAllocator.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include <memory>
#include <vector>

namespace HelfrichPlugin {

/**
 * What the species of the vertices mean to the CPU platform's loops: moduli of slots and line tensions of corners,
 * filled from the table of species, and which groups have neighbors of different species at all.  They follow when the
 * layout, the species or the table change, which costs no more than an evaluation.
 *
 * Points where three species meet are few, and computed by themselves.
 */
class CpuHelfrichMaterials {
public:
    /**
     * Make everything anew at the next update, for the layout has changed.
     */
    void invalidate() {
        areValid = false;
    }
    /**
     * Bring everything up to date.
     *
     * @param mesh        the connectivity, with the species of the vertices
     * @param layout      the layout of the same mesh
     * @param parts       the parts of the layout whose meetings are computed at a time
     * @param parameters  the moduli; those whose terms are off count as 0
     * @param isSingle    whether the loops compute in single precision
     * @param numThreads  the number of threads
     */
    void update(const HelfrichMesh& mesh, const CpuHelfrichLayout& layout,
                const std::vector<CpuHelfrichLayout::Part>& parts, const HelfrichParameters& parameters, bool isSingle,
                int numThreads);
    /**
     * Set the arrays that the loops read.
     */
    template <class Real>
    void setArrays(CpuHelfrichArrays<Real>& arrays);
    /**
     * Get the energy of the Gaussian curvature but for what the loops add where neighbors differ in their moduli.
     */
    double getGaussianConstant() const {
        return gaussianConstant;
    }
    /**
     * Get the energy of the boundaries around the points of a part where three species meet.
     */
    double computeMeetings(const double* positions, int part) const;
    /**
     * Add its gradient to that of each slot of the part.
     */
    void addGradientOfMeetings(const double* positions, int part, int firstSlot, double* gradients) const;
private:
    typedef std::vector<double, CacheLineAllocator<double>> Array;
    /**
     * A triangle of three species, as one of its vertices sees it: its slots, of which the first is the vertex's own,
     * and the line tensions between the two that are not at each of them.
     */
    struct Meeting {
        int slots[3];
        double tensions[3];
    };
    template <class Real>
    void fill(const HelfrichMesh& mesh, const CpuHelfrichLayout& layout, const HelfrichParameters& p, int numThreads);
    template <class Real>
    void fillRings(const CpuHelfrichLayout& layout, const HelfrichParameters& p, int g);
    void spreadMixed(const CpuHelfrichLayout& layout);
    void findMeetings(const CpuHelfrichLayout& layout, const CpuHelfrichLayout::Part& part, const HelfrichParameters& p,
                      std::vector<Meeting>& found) const;
    void addUpGaussian(const HelfrichMesh& mesh, const HelfrichParameters& p);
    bool areValid = false, hasLines = false, hasGaussian = false, isSingle = false;
    // what everything is of
    std::shared_ptr<const HelfrichSpeciesTable> table;
    long long speciesRevision = 0;
    double spontaneousCurvature = 0;
    TermMask terms;
    PeriodicBox box;
    double gaussianConstant = 0;
    /// of each slot
    std::vector<int> species;
    Array bendingModuli, spontaneousCurvatures, gaussianModuli, areaSlopes;
    /// of each corner
    Array lineTensions;
    /// of each group whether it is near neighbors of different species
    std::vector<char> areMixed;
    /// of each part
    std::vector<std::vector<Meeting>> meetings;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHMATERIALS_H_*/
