#ifndef OPENMM_HELFRICH_EDGEFLIPSTATE_H_
#define OPENMM_HELFRICH_EDGEFLIPSTATE_H_

#include "CpuEdgeFlipEvaluation.h"
#include "CpuHalfedges.h"
#include "CpuHelfrichNeighborList.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include "openmm/Vec3.h"
#include <vector>

namespace HelfrichPlugin {

/**
 * A membrane as a sweep sees it: the connectivity, the areas and curvatures of the vertices, and which of them are
 * close to each other.  It evaluates what flips would change, and carries them out.  What it computes of an attempt is
 * the same in any state in which the same flips were carried out at the attempt's vertices.
 *
 * Other threads may evaluate while one carries out flips.  At the vertices of these flips, what they compute has no
 * meaning.
 */
class EdgeFlipState {
public:
    explicit EdgeFlipState(HelfrichMesh& mesh);
    /**
     * Get whether the energy depends on which vertices are close to each other and share no neighbor.
     */
    static bool needsNeighborList(const HelfrichParameters& parameters) {
        return parameters.repulsionModulus != 0 && parameters.repulsionExclusionLevel == 2;
    }
    /**
     * Set where the vertices from the first up to the last are.
     *
     * @param positions  the position of each particle
     * @param geometry   the areas and curvatures at these positions
     * @param first      the number of the first vertex
     * @param last       the number of the vertex after the last
     */
    void setPositions(const std::vector<OpenMM::Vec3>& positions, const HelfrichGeometry& geometry, int first,
                      int last);
    /**
     * Set the same as another state of the membrane has them.
     */
    void setPositions(const EdgeFlipState& other, int first, int last);
    /**
     * Set the list of each vertex's partners, which is needed if needsNeighborList().  Flips divide them as they do the
     * mesh.
     */
    void setNeighbors(HelfrichNeighborList* neighbors) {
        this->neighbors = neighbors;
    }
    void setParameters(const HelfrichParameters& parameters) {
        p = parameters;
    }
    /**
     * Find the partners of a vertex that are closer than the repulsion's onset.
     */
    void findClosePartners(int vertex);
    /**
     * Set the same as another state of the membrane has them.
     */
    void setClosePartners(const EdgeFlipState& other, int vertex);
    /**
     * Evaluate the attempts of a batch, whose halfedges are given: all but their thresholds.
     *
     * @param upcoming  the batch to be evaluated next, whose data is brought into the cache meanwhile; or NULL
     */
    void evaluate(EdgeFlipBatch& batch, const EdgeFlipBatch* upcoming = NULL) const;
    /**
     * Carry out a flip that was evaluated in this state, or in one that is the same at its vertices.
     */
    void carryOut(const EdgeFlip& flip);
    /**
     * Carry out flips that another thread may have evaluated: what they change may be in no cache.
     */
    void carryOut(const EdgeFlipList& flips);
    /**
     * Bring what flips would change into the cache.
     */
    void prefetch(const EdgeFlipList& flips) const;
    int getNumClose(int vertex) const {
        return vertices[vertex].numClose;
    }
    /**
     * Get the partners of a vertex, first the close ones of those apart, in ascending order.
     */
    const Relaxed<int>* getPartners(int vertex) const {
        return partnersOf(vertex);
    }
private:
    class Walks;
    struct ClosePairs;
    void prefetchStencils(const EdgeFlipBatch& batch, int first) const;
    void findStencil(EdgeFlipBatch& batch, int n) const;
    void beginWalk(Walks& walks, const EdgeFlipBatch& batch, int n, int corner, int wanted) const;
    void collect(EdgeFlipBatch& batch, int n, bool areBonded) const;
    void findRepulsion(EdgeFlipBatch& batch) const;
    void addRepulsion(EdgeFlipBatch& batch, ClosePairs& pairs) const;
    bool shareOtherNeighbor(int middle, int vertex1, int vertex2) const;
    double distance2(int vertex1, int vertex2) const;
    double pairEnergy(int vertex1, int vertex2) const;
    void setBonded(int vertex, int other);
    void setApart(int vertex, int other);
    Relaxed<int>* partnersOf(int vertex) const {
        return neighbors->partners.data() + vertices[vertex].firstPartner;
    }
    const std::vector<int>& particles;
    CpuHalfedges mesh;
    const EdgeFlipEvaluation& evaluation;
    HelfrichParameters p;
    std::vector<EdgeFlipVertex> vertices;
    HelfrichNeighborList* neighbors;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_EDGEFLIPSTATE_H_*/
