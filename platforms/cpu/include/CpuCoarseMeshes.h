#ifndef OPENMM_CPUCOARSEMESHES_H_
#define OPENMM_CPUCOARSEMESHES_H_

#include "CacheLineAllocator.h"
#include "CpuCoarseLoops.h"
#include "CpuInstructionSet.h"
#include "openmmhelfrich/internal/CoarseVelocities.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include <vector>

namespace HelfrichPlugin {

/**
 * The coarser meshes of one membrane, whose vertices have velocities that move those of the membrane.
 * ReferenceCoarseMeshes says how they are made; here they are numbered as the membrane's order has them, so that what
 * is close in space is close in memory.
 *
 * How a coarser mesh moves the next finer one is a sparse matrix, kept with its transpose, by which forces act.  The
 * vectors of the membrane's vertices are in places of the caller's choice.
 */
class CpuCoarseMeshes {
public:
    CpuCoarseMeshes(const HelfrichMesh& mesh, const std::vector<double>& masses);
    /**
     * Make the meshes anew if the connectivity has changed.
     */
    void update();
    /**
     * Choose where the vectors of the vertices are.
     *
     * @param newPlaces  the place of each vertex
     * @param numPlaces  the number of places
     */
    void setPlaces(const std::vector<int>& newPlaces, int numPlaces);
    /**
     * Get the particles for which the vertices of each level stand.
     */
    std::vector<const std::vector<int>*> getParticles() const;
    /**
     * Get the mass of each vertex of a coarser mesh: the mean of the vertices that move.
     */
    double getMass() const {
        return mass;
    }
    const HelfrichMesh& getMembrane() const {
        return mesh;
    }
    /**
     * Change the velocities of all levels by the forces on the vertices.  Real is the type of products with matrices.
     *
     * @param forces  the force (x, y, z, unused) in each place
     * @param time    the time for which the forces act
     * @param weight  the weight of a level, as a multiple of that of the next finer one
     * @param[in,out] velocities  the velocities
     */
    template <class Real>
    void kick(const Real* forces, double time, double weight, CoarseVelocities& velocities, int numThreads);
    /**
     * Compute what getMotion() needs.
     */
    template <class Real>
    void findMotion(double weight, CoarseVelocities& velocities, int numThreads);
    /**
     * Compute the velocity (x, y, z, unused) that the coarser meshes give the vertices in a range of places.
     */
    template <class Real>
    void getMotion(int firstPlace, int lastPlace, Real* motion) const;
private:
    typedef std::vector<double, CacheLineAllocator<double>> Array;
    /**
     * A mesh: for each vertex the one of the membrane that it stands for, and its bonded neighbors; and the vertices in
     * ascending order of those for which they stand.
     */
    struct Graph {
        std::vector<int> vertices, starts, neighbors, sequence;
        int size() const {
            return vertices.size();
        }
    };
    struct Matrix {
        std::vector<CpuSparseRow> rows;
        std::vector<CpuSparseEntry> entries;
    };
    /**
     * How a coarser mesh moves the next finer one, and the transpose; and the vectors of its vertices.
     */
    struct Level {
        std::vector<int> particles;
        Matrix prolongation, restriction;
        Array vectors;
        int size() const {
            return particles.size();
        }
        template <class Real>
        Real* getVectors() {
            return reinterpret_cast<Real*>(vectors.data());
        }
        template <class Real>
        const Real* getVectors() const {
            return reinterpret_cast<const Real*>(vectors.data());
        }
    };
    void makeFinestGraph();
    void findLargeSurfaces(const Graph& graph);
    void chooseVertices(const Graph& graph, Level& level, Graph& coarser);
    void findChosenNeighbors(const Graph& graph);
    void fillRows(const Graph& graph, Level& level);
    void connect(const Graph& graph, Graph& coarser);
    void transpose(Level& level, const int* places);
    template <class Real>
    void multiplyRows(const Level& level, int first, int last, Real* target) const;
    const HelfrichMesh& mesh;
    const CpuCoarseLoops& loops;
    std::vector<char> isFixed;
    double mass = 0;
    long long revision = -1;
    int numLevels = 0;
    std::vector<Level> levels;
    /// of the finest level, in the membrane's order
    std::vector<CpuSparseRow> orderedRows;
    bool havePlaces = false;
    std::vector<int> places;
    // What is needed while meshes are made: those of two levels, and for each vertex of the finer one whom it joined,
    // its number if it was chosen, and the chosen ones among itself and its neighbors.
    Graph finer, coarser;
    std::vector<int> ranks, joined, numbers, chosenStarts, chosen, counts, found;
    std::vector<char> isLarge;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUCOARSEMESHES_H_*/
