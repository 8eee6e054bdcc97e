#ifndef OPENMM_HELFRICHSPECIES_H_
#define OPENMM_HELFRICHSPECIES_H_

#include <algorithm>
#include <cmath>
#include <vector>

namespace HelfrichPlugin {

/**
 * The material around a vertex, in OpenMM's units: what the vertices of a species have in common.
 */
struct HelfrichSpecies {
    double bendingModulus = 0, spontaneousCurvature = 0, gaussianModulus = 0;
};

/**
 * A symmetric table of numbers of pairs of species, which are 0 until they are set.  It takes room for those species
 * only that a number was set for, so that there may be as many species as vertices.
 */
class HelfrichSpeciesPairs {
public:
    double get(int species1, int species2) const {
        return values[getRow(species1) * stride + getRow(species2)];
    }
    void set(int species1, int species2, double value) {
        if (value == 0 && get(species1, species2) == 0)
            return;
        int row1 = addRow(species1), row2 = addRow(species2);
        double old = values[row1 * stride + row2];
        values[row1 * stride + row2] = values[row2 * stride + row1] = value;
        if (std::fabs(value) >= std::fabs(greatest))
            greatest = value;
        else if (std::fabs(old) == std::fabs(greatest))
            greatest = *std::max_element(values.begin(), values.end(),
                                         [](double a, double b) { return std::fabs(a) < std::fabs(b); });
    }
    /**
     * Get the number that is greatest in size, and 0 if none was set.
     */
    double getGreatest() const {
        return greatest;
    }
    /**
     * Call a function with every pair whose number is not 0, the lower species first, and the number.
     */
    template <class Visitor>
    void forEach(Visitor visit) const {
        for (int a = 0; a < (int) rows.size(); a++)
            for (int b = a; b < (int) rows.size() && rows[a] != 0; b++)
                if (get(a, b) != 0)
                    visit(a, b, get(a, b));
    }
private:
    int getRow(int species) const {
        return species < (int) rows.size() ? rows[species] : 0;
    }
    int addRow(int species) {
        if (species >= (int) rows.size())
            rows.resize(species + 1, 0);
        if (rows[species] == 0)
            rows[species] = numRows++;
        if (numRows > stride)
            widen();
        return rows[species];
    }
    void widen() {
        std::vector<double> wider(4 * stride * stride, 0.0);
        for (size_t i = 0; i < stride; i++)
            std::copy_n(&values[i * stride], stride, &wider[i * 2 * stride]);
        values.swap(wider);
        stride *= 2;
    }
    /// of each species its row; row 0 is of those without numbers
    std::vector<int> rows;
    std::vector<double> values = {0.0};
    size_t stride = 1, numRows = 1;
    double greatest = 0;
};

/**
 * All species, and what acts between those of neighbors.
 */
class HelfrichSpeciesTable {
public:
    int getNumSpecies() const {
        return species.size();
    }
    const HelfrichSpecies& operator[](int index) const {
        return species[index];
    }
    void add(const HelfrichSpecies& added) {
        species.push_back(added);
        summarize(species.size() - 1);
    }
    void set(int index, const HelfrichSpecies& changed) {
        species[index] = changed;
        summarize(index);
    }
    /**
     * Get of each of the moduli that which is greatest in size.
     */
    const HelfrichSpecies& getGreatest() const {
        return summaries.back()[0].greatest;
    }
    /**
     * Get whether there are two species of different Gaussian moduli: only then do they act on the vertices.
     */
    bool hasDifferentGaussianModuli() const {
        return summaries.back()[0].leastGaussian < summaries.back()[0].mostGaussian;
    }
    /// the line tension and the energy of an edge, by the species on both sides
    HelfrichSpeciesPairs lineTensions, pairEnergies;
private:
    /**
     * Of several species the moduli that are greatest in size, and the bounds of the Gaussian ones.
     */
    struct Summary {
        HelfrichSpecies greatest;
        double leastGaussian = INFINITY, mostGaussian = -INFINITY;
        void include(const HelfrichSpecies& each) {
            include({each, each.gaussianModulus, each.gaussianModulus});
        }
        void include(const Summary& other) {
            auto takeGreater = [](double& a, double b) { a = (std::fabs(b) > std::fabs(a) ? b : a); };
            takeGreater(greatest.bendingModulus, other.greatest.bendingModulus);
            takeGreater(greatest.spontaneousCurvature, other.greatest.spontaneousCurvature);
            takeGreater(greatest.gaussianModulus, other.greatest.gaussianModulus);
            leastGaussian = std::min(leastGaussian, other.leastGaussian);
            mostGaussian = std::max(mostGaussian, other.mostGaussian);
        }
    };
    static constexpr size_t BLOCK = 16;
    template <class Item>
    static Summary summarizeBlock(const std::vector<Item>& items, size_t block) {
        Summary summary;
        for (size_t i = BLOCK * block; i < std::min(BLOCK * (block + 1), items.size()); i++)
            summary.include(items[i]);
        return summary;
    }
    /**
     * Bring the summaries of the blocks that a species is in up to date.
     */
    void summarize(size_t index) {
        size_t block = index / BLOCK, level = 0;
        do {
            if (summaries.size() == level)
                summaries.emplace_back();
            if (summaries[level].size() == block)
                summaries[level].emplace_back();
            summaries[level][block] =
                    level == 0 ? summarizeBlock(species, block) : summarizeBlock(summaries[level - 1], block);
            block /= BLOCK;
        } while (summaries[level++].size() > 1);
    }
    std::vector<HelfrichSpecies> species;
    /// of each block of species, of each block of these blocks, and so on up to that of all: where each species has
    /// moduli of its own, to change them one by one does not take the square of their number
    std::vector<std::vector<Summary>> summaries = {{Summary()}};
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHSPECIES_H_*/
