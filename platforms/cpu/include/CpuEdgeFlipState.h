#ifndef OPENMM_CPUEDGEFLIPSTATE_H_
#define OPENMM_CPUEDGEFLIPSTATE_H_

#include "CpuEdgeFlipEvaluation.h"
#include "CpuHalfedges.h"
#include "CpuHelfrichNeighborList.h"
#include "CpuVertexGeometry.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
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
class CpuEdgeFlipState {
public:
    explicit CpuEdgeFlipState(HelfrichMesh& mesh);
    /**
     * Get whether the energy depends on which vertices are close to each other and share no bonded neighbor.
     */
    static bool needsNeighborList(const HelfrichParameters& parameters) {
        return parameters.has(Term::Repulsion) && parameters.repulsionExclusionLevel == 2;
    }
    /**
     * Set where the vertices from the first up to the last are.
     *
     * @param positions  the position of each particle
     * @param geometry   the areas and curvatures at these positions
     * @param first      the number of the first vertex
     * @param last       the number of the vertex after the last
     */
    void setPositions(const std::vector<OpenMM::Vec3>& positions, const CpuVertexGeometry& geometry, int first,
                      int last);
    /**
     * Set the same as another state of the membrane has them.
     */
    void setPositions(const CpuEdgeFlipState& other, int first, int last);
    /**
     * Set the list of each vertex's neighbors, which is needed if needsNeighborList().  Flips partition it as they do
     * the mesh.
     */
    void setNeighborList(CpuHelfrichNeighborList* neighborList) {
        this->neighborList = neighborList;
    }
    void setParameters(const HelfrichParameters& parameters);
    /**
     * Find the neighbors of a vertex that are closer than the repulsion's onset.
     */
    void findCloseNeighbors(int vertex);
    /**
     * Set the same as another state of the membrane has them.
     */
    void setCloseNeighbors(const CpuEdgeFlipState& other, int vertex);
    /**
     * Evaluate the attempts of a batch, whose halfedges are given: all but their thresholds.
     *
     * @param upcoming  the batch to be evaluated next, whose data is brought into the cache meanwhile; or NULL
     */
    void evaluate(CpuEdgeFlipBatch& batch, const CpuEdgeFlipBatch* upcoming = NULL) const;
    /**
     * Carry out a flip that was evaluated in this state, or in one that is the same at its vertices.
     */
    void carryOut(const CpuEdgeFlip& flip);
    /**
     * Carry out flips that another thread may have evaluated: what they change may be in no cache.
     */
    void carryOut(const CpuEdgeFlipList& flips);
    /**
     * Bring what flips would change into the cache.
     */
    void prefetch(const CpuEdgeFlipList& flips) const;
    int getNumClose(int vertex) const {
        return vertices[vertex].numClose;
    }
    /**
     * Get the neighbors of a vertex, first the close ones of those apart, in ascending order.
     */
    const Relaxed<int>* getNeighbors(int vertex) const {
        return neighborsOf(vertex);
    }
private:
    class Walks;
    struct ClosePairs;
    void prefetchStencils(const CpuEdgeFlipBatch& batch, int first) const;
    void findStencil(CpuEdgeFlipBatch& batch, int n) const;
    void beginWalk(Walks& walks, const CpuEdgeFlipBatch& batch, int n, int corner, int wanted) const;
    void collect(CpuEdgeFlipBatch& batch, int n, bool areBonded) const;
    /**
     * Add what flips change by changing which pairs are excluded at level 2.  (At level 1 they are i-j and k-l.)
     */
    void findRepulsion(CpuEdgeFlipBatch& batch) const;
    void addRepulsion(CpuEdgeFlipBatch& batch, ClosePairs& pairs) const;
    Vector3<double> getPosition(int vertex) const;
    double distance2(int vertex1, int vertex2) const;
    double pairEnergy(int vertex1, int vertex2) const;
    void setBonded(int vertex, int other);
    void setApart(int vertex, int other);
    Relaxed<int>* neighborsOf(int vertex) const {
        return neighborList->neighbors.data() + vertices[vertex].firstNeighbor;
    }
    const std::vector<int>&particles, &surfaces, &species;
    CpuHalfedges mesh;
    const CpuEdgeFlipEvaluation* evaluation;
    HelfrichParameters p;
    std::vector<CpuEdgeFlipVertex> vertices;
    CpuHelfrichNeighborList* neighborList;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUEDGEFLIPSTATE_H_*/
