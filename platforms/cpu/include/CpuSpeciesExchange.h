#ifndef OPENMM_CPUSPECIESEXCHANGE_H_
#define OPENMM_CPUSPECIESEXCHANGE_H_

#include "CpuSweep.h"
#include "CpuVertexGeometry.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include "openmm/Vec3.h"
#include <array>
#include <cstdint>
#include <vector>

namespace HelfrichPlugin {

/**
 * Metropolis sweeps of exchanges of species over a membrane whose vertices and triangles stay as they are.  All that
 * the energy needs of the geometry is computed once, for each vertex and its ring of neighbors, when an attempt first
 * asks for it; and not again until the vertices move.  Nothing of the energy
 * depends on totals, so that the change by an attempt comes from the two vertices and their neighbors alone.
 *
 * A sweep is by definition a sequential chain, but attempts that are not at neighbors do not know of each other, and
 * may be made in any order.  So several threads have a zone of the membrane each.  Of a block of attempts a thread
 * makes those whose vertices, and all neighbors of these, are in its zone, one after the other.  It defers those on the
 * border of zones, and any that comes after one that is deferred and has a vertex beside it or in common with it.  At
 * the end of the block one thread makes these in their order.  The outcome is that of the sequential chain, to the last
 * bit, for any number of threads.
 *
 * Here vertices are numbered in the mesh's order, which keeps zones together, also in memory.
 */
class CpuSpeciesExchange : public CpuSweep {
public:
    CpuSpeciesExchange(HelfrichMesh& mesh, int numThreads);
    /**
     * Set all that does not change during a sweep.  Positions and geometry must last until the sweep is made.
     *
     * @param positions   the position of each particle
     * @param geometry    the areas and curvatures at these positions where species have forces, else NULL
     * @param parameters  the moduli
     * @param proposal    what an attempt proposes
     */
    void prepare(const std::vector<OpenMM::Vec3>& positions, const CpuVertexGeometry* geometry,
                 const HelfrichParameters& parameters, const SpeciesProposal& proposal);
    /**
     * Make a sweep.  See ExchangeSpeciesKernel::execute() for the parameters.
     *
     * @param observer  called for each accepted change, unless empty
     */
    SpeciesExchangeStatistics execute(double kT, long long numAttempts, const Philox& random, long long sweep,
                                      const Observer& observer = Observer());
private:
    /**
     * A vertex's energy but for its edges and triangles is the scalar product of these numbers with those of its
     * species, of which its chemical potential is one: 2 kappa (M-CA/2)^2/A + kappabar (2 pi-sum theta) is
     * 2 kappa M^2/A - 2 kappa C M + kappa C^2/2 A + kappabar (2 pi-sum theta).
     */
    typedef std::array<double, 4> Factors;
    struct alignas(64) Vertex {
        Factors factors;
        /// where its ring begins, how long that is, and how long it may become
        int ring, valence, room;
        /// the number of the geometry that the factors and the ring's lengths are of
        int geometry = NONE;
    };
    struct Material {
        Factors factors;
        double chemicalPotential;
        /// its row in the tables of pairs
        int row;
    };
    /**
     * The rows of the neighbors around a vertex, of which one may have another than it has.
     */
    struct Surroundings {
        const int *ring, *rows;
        int other, rowOfOther;
        int operator[](int i) const {
            return ring[i] == other ? rowOfOther : rows[ring[i]];
        }
    };
    /**
     * The lengths of an edge from a vertex to a neighbor, and from this to the next one around.
     */
    struct Lengths {
        double spoke, link;
    };
    struct Attempt {
        /// two vertices, or one and the species that it is to have
        int first, second;
        /// the number to compare with the probability
        double uniform;
        double change;
        bool isAccepted;
    };
    /**
     * A part of a block, with a list for each zone of the attempts that are in it or on the border.
     */
    struct Part {
        static constexpr int SIZE = 64;
        Attempt attempts[SIZE];
        int numAttempts, counts[MAX_THREADS], lists[MAX_THREADS][SIZE];
        /// a bit for each attempt on the border, and for those that a zone defers
        uint64_t border, deferred[MAX_THREADS];
    };
    /**
     * What comes of the attempts in a zone, or of those that are deferred.
     */
    struct alignas(64) Outcome {
        long long accepted, alike;
        /// the vertices that have another species, some of them more than once
        std::vector<int> changed;
    };
    /**
     * The neighbors around a vertex, for loops.
     */
    struct Ring {
        const int *first, *last;
        const int* begin() const {
            return first;
        }
        const int* end() const {
            return last;
        }
    };
    Ring getRing(int vertex) const {
        const int* first = &neighbors[vertices[vertex].ring];
        return {first, first + vertices[vertex].valence};
    }
    /**
     * Get the two vertices of an attempt, or twice the one that mutates.
     */
    std::array<int, 2> getVertices(const Attempt& attempt) const {
        return {attempt.first, proposal.kind == SpeciesProposal::Mutation ? attempt.first : attempt.second};
    }
    void prepareMaterials();
    void prepareRings();
    void collectRings();
    void renewRing(int vertex);
    void collectRing(int vertex);
    int findZone(int vertex) const;
    void preparePositions(const std::vector<OpenMM::Vec3>& positions);
    void prepareSpecies();
    void prepareVertices(const int* chosen, int count);
    void prepareVertex(int vertex);
    void makeBlock(long long firstAttempt, int numAttempts);
    void draw(Part& part, long long firstAttempt, int numAttempts) const;
    void decide(Part& part, int zone);
    void prefetchRing(int ring) const;
    bool isAlike(const Attempt& attempt) const;
    bool isBlocked(const Attempt& attempt) const;
    void defer(const Attempt& attempt, int zone);
    void decide(Attempt& attempt, Outcome& outcome);
    void decideDeferred();
    void observe(const Observer& observer) const;
    void storeSpecies();
    /**
     * Get the change of energy where a vertex changes its species, and another one has a given species.
     */
    double changeAt(int vertex, int from, int to, int other, int speciesOfOther);
    double changeOfPairs(const Vertex& vertex, const Surroundings& around, int rowFrom, int rowTo) const;
    double changeOfLines(int vertex, const Surroundings& around, int rowFrom, int rowTo) const;
    /**
     * Get the change by triangles of three species.
     */
    double changeOfMedians(int vertex, const Surroundings& around, int rowFrom, int rowTo) const;
    void setSpecies(int vertex, int species);
    SpeciesProposal proposal;
    std::vector<Material> materials;
    /// half of the line tensions, and the pair energies, numRows to a row; row 0 is of the species that have neither
    std::vector<double> halfTensions, pairEnergies;
    int numRows;
    /// the vertices in their order, and the place of each there: its number from here on
    std::vector<int> order, ranks;
    std::vector<Vector3<double>> x;
    std::vector<Vertex> vertices;
    /// of each vertex its species, the row of this, and the zone that all its neighbors are in
    std::vector<int> species, rows, zones;
    /// the neighbors around each vertex, from its lowest halfedge on
    std::vector<int> neighbors;
    std::vector<Lengths> lengths;
    const CpuVertexGeometry* geometry = NULL;
    /// the number of the geometry, which is another one whenever a vertex must be prepared anew
    int geometryNumber = 0;
    /// what all this is of
    long long revision = NONE, speciesRevision = NONE, numberOfGeometry = NONE;
    int numZones, numParts;
    std::vector<Part> parts;
    long long numBlocks = 0;
    /// of each vertex the number of the last block in which an attempt beside it was deferred
    std::vector<long long> blocked;
    /// of each zone, and of what was deferred
    Outcome outcomes[MAX_THREADS + 1];
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUSPECIESEXCHANGE_H_*/
