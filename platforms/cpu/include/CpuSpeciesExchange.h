#ifndef OPENMM_CPUSPECIESEXCHANGE_H_
#define OPENMM_CPUSPECIESEXCHANGE_H_

#include "CpuRelaxed.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include "openmm/Vec3.h"
#include <array>
#include <functional>
#include <vector>

namespace HelfrichPlugin {

/**
 * Metropolis sweeps of exchanges of species over a membrane whose vertices and triangles stay as they are.  All that
 * the energy needs of the geometry is computed once, for each vertex and its ring of neighbors.  Nothing of the energy
 * depends on totals, so that the change by an attempt comes from the two vertices and their neighbors alone.
 *
 * A sweep is by definition a sequential chain.  It is computed block by block: while one thread decides the attempts of
 * a block in their turn, the others evaluate those of the next one as if each were the next to be decided, and then it
 * helps them.  An attempt is evaluated again in its turn if the species of one of its vertices, or of a neighbor, has
 * changed in its own block or in the one before it.  What another thread saw of that at the time may be from before or
 * after, but no other attempt depends on it.  So the outcome is that of the sequential chain, to the last bit, for any
 * number of threads.  A single thread evaluates each attempt when its turn comes.
 */
class CpuSpeciesExchange {
public:
    /**
     * This is called for each accepted change, in their order, with the change of energy by which it was accepted.
     */
    typedef std::function<void(double)> Observer;
    CpuSpeciesExchange(HelfrichMesh& mesh, int numThreads);
    /**
     * Set all that does not change during a sweep.
     *
     * @param positions   the position of each particle
     * @param geometry    the areas and curvatures at these positions, which are needed where species have forces
     * @param parameters  the moduli
     * @param proposal    what an attempt proposes
     */
    void prepare(const std::vector<OpenMM::Vec3>& positions, const HelfrichGeometry& geometry,
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
        /// where its ring begins, and how long that is
        int ring, valence;
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
        const int* ring;
        const Relaxed<int>* rows;
        int other, rowOfOther;
        int operator[](int i) const {
            return ring[i] == other ? rowOfOther : int(rows[ring[i]]);
        }
    };
    /**
     * The lengths of an edge from a vertex to a neighbor, and from this to the next one around.
     */
    struct Lengths {
        double spoke, link;
    };
    struct Attempt {
        SpeciesDraw draw;
        double change;
        bool isAlike, isAccepted;
    };
    struct Block {
        std::vector<Attempt> attempts;
        /// the number of the first one in the sweep, and how many there are
        long long firstAttempt = 0;
        int numAttempts = 0;
    };
    void prepareMaterials();
    void prepareRings();
    void collectRing(int vertex);
    void prepareVertex(const HelfrichGeometry& geometry, int vertex);
    OpenMM::Vec3 edge(int from, int to) const;
    /**
     * Get the two vertices of an attempt, or twice the one that mutates.
     */
    std::array<int, 2> getVertices(const SpeciesDraw& draw) const {
        return {draw.first, proposal.kind == SpeciesProposal::Mutation ? draw.first : draw.second};
    }
    void drawAttempts(Block& block, int begin);
    void prefetchRing(int ring) const;
    bool isAlike(const SpeciesDraw& draw) const;
    void evaluate(Attempt& attempt) const;
    /**
     * Get the change of energy where a vertex changes its species, and another one has a given species.
     */
    double changeAt(int vertex, int from, int to, int other, int speciesOfOther) const;
    double changeOfPairs(const Vertex& vertex, const Surroundings& around, int rowFrom, int rowTo) const;
    double changeOfLines(int vertex, const Surroundings& around, int rowFrom, int rowTo) const;
    /**
     * Get the change by triangles of three species.
     */
    double changeOfMedians(int vertex, const Surroundings& around, int rowFrom, int rowTo) const;
    void decide(Block& block);
    bool isStale(const SpeciesDraw& draw) const;
    void accept(const Attempt& attempt);
    void setSpecies(int vertex, int species);
    HelfrichMesh& mesh;
    const int numThreads;
    const std::vector<OpenMM::Vec3>* positions;
    HelfrichParameters p;
    SpeciesProposal proposal;
    std::vector<Material> materials;
    /// half of the line tensions, and the pair energies, numRows to a row; row 0 is of the species that have neither
    std::vector<double> halfTensions, pairEnergies;
    int numRows;
    std::vector<Vertex> vertices;
    /// of each vertex its species, and the row of this
    std::vector<Relaxed<int>> species, rows;
    /// the neighbors around each vertex, from its lowest halfedge on
    std::vector<int> neighbors;
    std::vector<Lengths> lengths;
    long long revision;
    double kT;
    Philox random;
    long long sweep;
    /// the one that is evaluated, and the one that is decided
    Block blocks[2];
    /// the number of the block that is evaluated, counted on from sweep to sweep
    long long lastBlock = 0;
    /// of each vertex the number of the last block in which its species or a neighbor's changed
    std::vector<long long> lastChanges;
    SpeciesExchangeStatistics statistics;
    const Observer* observer;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUSPECIESEXCHANGE_H_*/
