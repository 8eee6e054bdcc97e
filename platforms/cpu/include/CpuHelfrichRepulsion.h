#ifndef OPENMM_CPUHELFRICHREPULSION_H_
#define OPENMM_CPUHELFRICHREPULSION_H_

#include "CpuHelfrichLayout.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include "CpuHelfrichNeighborList.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <array>
#include <vector>

namespace HelfrichPlugin {

/**
 * The repulsion between vertices, by a Verlet list: the pairs closer than the onset and a skin.  It is built in a time
 * proportional to the number of vertices when one has moved half the skin, so that no pair is ever missed.  The skin
 * follows how fast the vertices move.  The pairs that the live connectivity excludes are taken out whenever it changes.
 *
 * Every pair is in the lists of both its vertices, and a list is in the order of the vertices: a vertex's gradient
 * depends neither on what other threads do nor on when the list was built.
 */
class CpuHelfrichRepulsion {
public:
    /**
     * Set the periodic box, if there is one.
     */
    void setBox(const PeriodicBox& newBox);
    /**
     * Follow a change of the layout.
     */
    void followLayout(const CpuHelfrichLayout& layout, int numThreads);
    /**
     * Get whether a vertex in a range of slots has moved so far that there may be pairs which are not in the lists.
     *
     * @param positions  the position of each slot: x, y, z, unused
     */
    bool hasMoved(const double* positions, int firstSlot, int lastSlot) const;
    /**
     * Get the lists before exclusions, partitioned for the mesh and up to date.  See update() for the other parameters.
     */
    CpuHelfrichNeighborList& getNeighborList(const HelfrichMesh& mesh, const CpuHelfrichLayout& layout,
                                             const double* positions, double newOnset, bool hasMoved);
    /**
     * Bring the lists up to date.
     *
     * @param positions  the position of each slot: x, y, z, unused; all finite
     * @param hasMoved   hasMoved() of any slots
     */
    void update(const HelfrichMesh& mesh, const CpuHelfrichLayout& layout, const double* positions,
                const HelfrichParameters& parameters, bool hasMoved);
    /**
     * Compute the energy of the vertices in a range of slots, and add their gradients.
     *
     * @param gradients  of each slot of the range: x, y, z, unused; or NULL
     * @return the energy
     */
    double compute(const double* positions, const HelfrichParameters& parameters, int firstSlot, int lastSlot,
                   double* gradients) const;
private:
    typedef std::array<int, 3> Cell;
    typedef Vector3<double> Point;
    /// a vertex where it was when the list was built
    struct PlacedVertex {
        Point x;
        int vertex;
        /// whether it is an image, in a periodic box, of a vertex that is placed elsewhere
        bool isImage;
    };
    void updateCandidates(const CpuHelfrichLayout& layout, const double* positions, double newOnset, bool hasMoved);
    void adaptSkin();
    void findCandidates(const CpuHelfrichLayout& layout, const double* positions);
    void addImages(std::vector<PlacedVertex>& vertices) const;
    Cell findCell(const Point& x) const;
    unsigned int findBucket(const Cell& cell) const;
    void sortIntoBuckets(const std::vector<PlacedVertex>& vertices);
    void addCandidates(const PlacedVertex& vertex, double cutoff2);
    void addCandidatesInRow(const PlacedVertex& vertex, const Cell& first, double cutoff2);
    void removeExclusions(const HelfrichMesh& mesh, const CpuHelfrichLayout& layout, int level);
    template <class Displacement>
    bool hasMoved(const double* positions, int firstSlot, int lastSlot, const Displacement& displacement) const;
    template <class Displacement>
    double compute(const double* positions, const HelfrichParameters& p, int firstSlot, int lastSlot, double* gradients,
                   const Displacement& displacement) const;
    PeriodicBox box;
    double onset = -1, skin = 0;
    int numUpdates = 0;
    /// whether the pairs are those of the lists and the layout; and at which level of exclusions
    bool hasPairs = false;
    int exclusionLevel = -1;
    /// where the vertex of each slot was when the list was built: each step looks at all, in this order
    std::vector<Point> reference;
    /// the same of all vertices, and of their images near the borders of a periodic box, in the order of the buckets
    std::vector<PlacedVertex> placedVertices;
    std::vector<int> bucketStarts;
    CpuHelfrichNeighborList candidates;
    std::vector<int> pairStarts, pairs, marks;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUHELFRICHREPULSION_H_*/
