#ifndef OPENMM_HELFRICH_SPECIESPROPOSAL_H_
#define OPENMM_HELFRICH_SPECIESPROPOSAL_H_

#include "HelfrichMesh.h"
#include "Philox.h"
#include <vector>

namespace HelfrichPlugin {

/**
 * The random numbers of an attempt to change species.
 */
struct SpeciesDraw {
    /// two vertices, or one and the species that it is to have
    int first, second;
    /// the number to compare with the probability
    double uniform;
};

/**
 * Which changes of species the attempts of a sweep propose.  Each is as likely as the one that undoes it.
 */
struct SpeciesProposal {
    enum Kind {
        /// the two ends of a uniformly drawn edge exchange their species
        Neighbors,
        /// two vertices do, each of which is drawn uniformly
        Anywhere,
        /// a uniformly drawn vertex gets a uniformly drawn species
        Mutation
    };
    Kind kind = Neighbors;
    /// of each species, measured in kJ/mol; exchanges do not depend on them
    std::vector<double> chemicalPotentials;
    /**
     * Draw the random numbers of an attempt.
     *
     * @param random   the source of random numbers
     * @param sweep    the number of the sweep
     * @param attempt  the number of the attempt in the sweep
     * @param mesh     the connectivity
     */
    SpeciesDraw draw(const Philox& random, long long sweep, long long attempt, const HelfrichMesh& mesh) const {
        return findVertices(drawNumbers(random, sweep, attempt, mesh), mesh);
    }
    /**
     * Draw the same, but of the ends of an edge only their halfedge, as the first number.
     */
    SpeciesDraw drawNumbers(const Philox& random, long long sweep, long long attempt, const HelfrichMesh& mesh) const {
        auto words = random(sweep, 2 * attempt);
        double uniform = Philox::uniform(words[2], words[3]);
        if (kind == Neighbors)
            return {mesh.halfedgeOf(Philox::index(words[0], words[1], mesh.getNumDirectedEdges())), -1, uniform};
        auto more = random(sweep, 2 * attempt + 1);
        int numSecond = (kind == Anywhere ? mesh.getNumVertices() : (int) chemicalPotentials.size());
        return {(int) Philox::index(words[0], words[1], mesh.getNumVertices()),
                (int) Philox::index(more[0], more[1], numSecond), uniform};
    }
    SpeciesDraw findVertices(const SpeciesDraw& numbers, const HelfrichMesh& mesh) const {
        if (kind != Neighbors)
            return numbers;
        return {mesh.origin(numbers.first), mesh.tip(numbers.first), numbers.uniform};
    }
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_SPECIESPROPOSAL_H_*/
