#ifndef MEMBRANES_H_
#define MEMBRANES_H_

/* Membranes for tests, and forces on them with every term at work. */

#include "openmm/Vec3.h"
#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <random>
#include <vector>

namespace HelfrichPlugin {

struct Membrane {
    std::vector<OpenMM::Vec3> positions;
    std::vector<std::array<int, 3>> triangles;
    /// of each vertex; without it, getSpecies() makes one up
    std::vector<int> species;
};

const int NUM_SPECIES = 3;

/**
 * The species of the vertices, by default such that there are triangles of one, two and three.
 */
inline std::vector<int> getSpecies(const Membrane& membrane) {
    std::vector<int> species = membrane.species;
    for (int i = species.size(); i < (int) membrane.positions.size(); i++)
        species.push_back(i / 4 % NUM_SPECIES);
    return species;
}

/**
 * Random numbers that are the same everywhere, which those of std::uniform_real_distribution are not.
 */
class TestRandom {
public:
    explicit TestRandom(int seed) : engine(seed) {
    }
    double uniform(double low, double high) {
        return low + (high - low) * (engine() / 4294967296.0);
    }
    int index(int n) {
        return (int) uniform(0, n);
    }
    OpenMM::Vec3 vector(double amplitude) {
        double x = uniform(-amplitude, amplitude), y = uniform(-amplitude, amplitude);
        return OpenMM::Vec3(x, y, uniform(-amplitude, amplitude));
    }
private:
    std::mt19937 engine;
};

/**
 * Divide each triangle of a surface on the unit sphere in four, a number of times.
 */
inline void subdivide(Membrane& sphere, int times) {
    for (int i = 0; i < times; i++) {
        std::map<std::pair<int, int>, int> middles;
        auto middle = [&](int a, int b) {
            auto edge = std::make_pair(std::min(a, b), std::max(a, b));
            if (middles.count(edge) == 0) {
                middles[edge] = sphere.positions.size();
                OpenMM::Vec3 x = sphere.positions[a] + sphere.positions[b];
                sphere.positions.push_back(x / std::sqrt(x.dot(x)));
            }
            return middles[edge];
        };
        std::vector<std::array<int, 3>> coarse = sphere.triangles;
        sphere.triangles.clear();
        for (auto& t : coarse) {
            int ab = middle(t[0], t[1]), bc = middle(t[1], t[2]), ca = middle(t[2], t[0]);
            for (std::array<int, 3> part :
                 {std::array<int, 3>{t[0], ab, ca}, {ab, t[1], bc}, {ca, bc, t[2]}, {ab, bc, ca}})
                sphere.triangles.push_back(part);
        }
    }
}

/**
 * An octahedron's triangles, each divided in four a number of times, on the unit sphere: 4^(n+1)+2 vertices.
 */
inline Membrane createSphere(int subdivisions) {
    Membrane sphere;
    sphere.positions = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-1, 0, 0}, {0, -1, 0}, {0, 0, -1}};
    sphere.triangles = {{0, 1, 2}, {1, 3, 2}, {3, 4, 2}, {4, 0, 2}, {1, 0, 5}, {3, 1, 5}, {4, 3, 5}, {0, 4, 5}};
    subdivide(sphere, subdivisions);
    return sphere;
}

/**
 * An icosahedron's triangles, each divided in four a number of times, on the unit sphere: 10*4^n+2 vertices.
 */
inline Membrane createIcosphere(int subdivisions) {
    Membrane sphere;
    // A pole, two rings of five and the other pole.
    sphere.positions.push_back({0, 0, 1});
    for (int n = 0; n < 10; n++) {
        double angle = (2 * (n % 5) + n / 5) * M_PI / 5, height = (n < 5 ? 1 : -1) / std::sqrt(5.0),
               radius = 2 / std::sqrt(5.0);
        sphere.positions.push_back({radius * std::cos(angle), radius * std::sin(angle), height});
    }
    sphere.positions.push_back({0, 0, -1});
    for (int i = 1; i <= 5; i++) {
        int j = i % 5 + 1;
        for (std::array<int, 3> t : {std::array<int, 3>{0, i, j}, {i, i + 5, j}, {j, i + 5, j + 5}, {11, j + 5, i + 5}})
            sphere.triangles.push_back(t);
    }
    subdivide(sphere, subdivisions);
    return sphere;
}

/**
 * Make a rough, flat ellipsoid away from the origin of a sphere, in which no two vertices, edges or angles are alike
 * and the two faces are close enough to repel each other.
 */
inline Membrane flatten(Membrane sphere, double noise, int seed = 1) {
    TestRandom random(seed);
    for (auto& x : sphere.positions)
        x = OpenMM::Vec3(x[0], 0.9 * x[1] + 0.1 * x[2], 0.4 * x[2] - 0.1 * x[0]) + random.vector(noise) +
            OpenMM::Vec3(0.3, -0.2, 0.5);
    return sphere;
}

/**
 * A rough, flat ellipsoid of 4^(n+1)+2 vertices.  The noise is relative to the length of the edges.
 */
inline Membrane createBlob(int subdivisions, double noise = 0.15, int seed = 1) {
    return flatten(createSphere(subdivisions), noise * 1.3 / (1 << subdivisions), seed);
}

/**
 * The same membrane with its particles and its triangles in another order, and each triangle starting from another
 * corner.
 */
inline Membrane renumber(const Membrane& membrane, std::vector<int>& newIndex, int seed) {
    TestRandom random(seed);
    int n = membrane.positions.size();
    newIndex.resize(n);
    for (int i = 0; i < n; i++) {
        int j = random.index(i + 1);
        newIndex[i] = newIndex[j];
        newIndex[j] = i;
    }
    Membrane result;
    result.positions.resize(n);
    result.species.resize(n);
    for (int i = 0; i < n; i++) {
        result.positions[newIndex[i]] = membrane.positions[i];
        result.species[newIndex[i]] = getSpecies(membrane)[i];
    }
    for (auto& t : membrane.triangles) {
        int shift = random.index(3);
        result.triangles.push_back({newIndex[t[shift]], newIndex[t[(shift + 1) % 3]], newIndex[t[(shift + 2) % 3]]});
        std::swap(result.triangles.back(), result.triangles[random.index(result.triangles.size())]);
    }
    return result;
}

/**
 * Several membranes as one, whose particles and triangles follow each other.
 */
inline Membrane join(const std::vector<Membrane>& membranes) {
    Membrane result;
    for (auto& membrane : membranes) {
        int first = result.positions.size();
        std::vector<int> species = getSpecies(membrane);
        result.positions.insert(result.positions.end(), membrane.positions.begin(), membrane.positions.end());
        result.species.insert(result.species.end(), species.begin(), species.end());
        for (auto& t : membrane.triangles)
            result.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    }
    return result;
}

/**
 * The same membrane in another place and size.
 */
inline Membrane place(Membrane membrane, const OpenMM::Vec3& shift, double scale = 1) {
    for (auto& x : membrane.positions)
        x = x * scale + shift;
    return membrane;
}

constexpr TermMask Bending = Term::Bending, Area = Term::Area, Volume = Term::Volume,
                   AreaDifference = Term::AreaDifference, Tether = Term::Tether, Repulsion = Term::Repulsion,
                   Tension = Term::Tension, Pressure = Term::Pressure, Gaussian = Term::Gaussian, Line = Term::Line,
                   Pair = Term::Pair, EveryTerm = TermMask::ALL;

/// all terms of a membrane whose vertices are alike
constexpr TermMask AllTerms = ~(Gaussian | Line | Pair);

/**
 * The terms of the bits of a number, that of the lowest bit first.
 */
inline TermMask getTermsOfBits(unsigned int bits) {
    TermMask terms;
    for (int i = 0; i < NUM_TERMS; i++)
        if ((bits >> i & 1) != 0)
            terms = terms | Term(i);
    return terms;
}

/**
 * The mean length of the edges.
 */
inline double getMeanEdge(const Membrane& membrane) {
    double sum = 0;
    for (auto& t : membrane.triangles)
        for (int c = 0; c < 3; c++) {
            OpenMM::Vec3 edge = membrane.positions[t[(c + 1) % 3]] - membrane.positions[t[c]];
            sum += std::sqrt(edge.dot(edge));
        }
    return sum / (3 * membrane.triangles.size());
}

/**
 * Species that differ in everything, of which only some have a boundary with a line tension.
 */
inline std::shared_ptr<HelfrichSpeciesTable> createSpecies() {
    auto table = std::make_shared<HelfrichSpeciesTable>();
    table->add({20, 1.1, -37});
    table->add({7, -0.8, 12});
    table->add({33, 0, -9});
    table->lineTensions.set(0, 1, 11);
    table->lineTensions.set(2, 1, 17);
    table->pairEnergies.set(0, 1, 5);
    table->pairEnergies.set(2, 1, -3);
    table->pairEnergies.set(2, 2, 2.5);
    return table;
}

/**
 * Parameters with which the given terms are far from their minima, some edges are too long and some too short, and some
 * vertices repel each other at every exclusion level, on a surface of about the area and volume of a blob.  If terms of
 * neighbors are among them, the vertices are of different species.
 */
inline HelfrichParameters createParameters(const Membrane& membrane, TermMask terms, int exclusionLevel = 1) {
    HelfrichParameters p;
    double edge = getMeanEdge(membrane);
    p.moduli[Term::Bending] = 20;
    p.moduli[Term::Area] = 3000;
    p.targetArea = 8;
    p.moduli[Term::Volume] = 2000;
    p.targetVolume = 1.8;
    p.moduli[Term::AreaDifference] = 1500;
    p.targetAreaDifference = 2.7;
    p.leafletSeparation = 0.1;
    p.moduli[Term::Tether] = 7;
    p.tetherMinLength = 0.9 * edge;
    p.tetherMaxLength = 1.1 * edge;
    p.tetherLengthScale = 0.8 * edge;
    p.tetherExponent = 3;
    p.moduli[Term::Repulsion] = 0.5;
    p.repulsionOnset = 2.6 * edge;
    p.repulsionLengthScale = 1.3 * edge;
    p.repulsionExponent = 2;
    p.repulsionExclusionLevel = exclusionLevel;
    p.moduli[Term::Tension] = 9;
    p.moduli[Term::Pressure] = -30;
    if (terms.contains(Term::Gaussian) || terms.contains(Term::Line) || terms.contains(Term::Pair)) {
        p.species = createSpecies();
        p.spontaneousCurvature = 0.3;
        p.moduli[Term::Bending] = p.species->getGreatest().bendingModulus;
        p.moduli[Term::Gaussian] = p.species->getGreatest().gaussianModulus;
        p.moduli[Term::Line] = p.species->lineTensions.getGreatest();
        p.moduli[Term::Pair] = p.species->pairEnergies.getGreatest();
    }
    return p.only(terms);
}

/**
 * Three blobs of different sizes, one in another and the third beside them, so close that all of them repel each other,
 * with their particles and triangles in disorder.
 */
inline Membrane createSeveralSurfaces() {
    Membrane outer = createBlob(2), inner = place(createBlob(1, 0.15, 2), OpenMM::Vec3(0.15, -0.1, 0.25), 0.5),
             beside = place(createBlob(1, 0.15, 3), OpenMM::Vec3(1.9, 0, 0));
    std::vector<int> newIndex;
    return renumber(join({beside, inner, outer}), newIndex, 5);
}

/**
 * The same parameters, where the surface 0 has a target volume of its own, 1 a target area and area difference, and 2
 * all of these.
 */
inline HelfrichParameters withSurfaceTargets(HelfrichParameters p) {
    p.surfaceTargets = {{{Term::Volume, 0}, 1.1},  {{Term::Area, 1}, 5.0}, {{Term::AreaDifference, 1}, 1.5},
                        {{Term::Volume, 2}, 0.45}, {{Term::Area, 2}, 3.3}, {{Term::AreaDifference, 2}, -2.1}};
    return p;
}

/**
 * The same parameters with a spontaneous curvature of all vertices.
 */
inline HelfrichParameters withSpontaneousCurvature(HelfrichParameters p, double curvature = 1.3) {
    p.spontaneousCurvature = curvature;
    return p;
}

/**
 * Give a force the species of parameters, with the moduli of those terms that are on.
 */
inline void setSpecies(HelfrichForce& force, const Membrane& membrane, const HelfrichParameters& p) {
    for (int i = 0; i < p.species->getNumSpecies(); i++) {
        HelfrichSpecies material = p.getMaterial(i);
        force.addSpecies(material.bendingModulus, (*p.species)[i].spontaneousCurvature, material.gaussianModulus);
    }
    for (int i = 0; i < p.species->getNumSpecies(); i++)
        for (int j = 0; j <= i; j++) {
            if (i != j)
                force.setLineTension(i, j, p.getLineTension(i, j));
            force.setPairEnergy(i, j, p.getPairEnergy(i, j));
        }
    force.setVertexSpecies(getSpecies(membrane));
}

/**
 * A force with given parameters on the particles of a membrane.
 */
inline HelfrichForce* createForce(const Membrane& membrane, const HelfrichParameters& p) {
    HelfrichForce* force = new HelfrichForce();
    force->setTriangles(membrane.triangles);
    if (p.species)
        setSpecies(*force, membrane, p);
    else {
        force->setBendingModulus(p.moduli[Term::Bending]);
        force->setGaussianModulus(p.moduli[Term::Gaussian]);
    }
    force->setSpontaneousCurvature(p.spontaneousCurvature);
    force->setAreaModulus(p.moduli[Term::Area]);
    force->setTargetArea(p.targetArea);
    force->setVolumeModulus(p.moduli[Term::Volume]);
    force->setTargetVolume(p.targetVolume);
    force->setAreaDifferenceModulus(p.moduli[Term::AreaDifference]);
    force->setTargetAreaDifference(p.targetAreaDifference);
    for (auto& target : p.surfaceTargets) {
        Term term = target.first.first;
        int surface = target.first.second;
        if (term == Term::Area)
            force->setTargetArea(target.second, surface);
        else if (term == Term::Volume)
            force->setTargetVolume(target.second, surface);
        else
            force->setTargetAreaDifference(target.second, surface);
    }
    force->setLeafletSeparation(p.leafletSeparation);
    force->setTether(p.moduli[Term::Tether], p.tetherMinLength, p.tetherMaxLength, p.tetherExponent);
    force->setTetherLengthScale(p.tetherLengthScale);
    force->setRepulsion(p.moduli[Term::Repulsion], p.repulsionOnset, p.repulsionExponent, p.repulsionExclusionLevel);
    force->setRepulsionLengthScale(p.repulsionLengthScale);
    force->setTension(p.moduli[Term::Tension]);
    force->setPressure(p.moduli[Term::Pressure]);
    return force;
}

} // namespace HelfrichPlugin

#endif /*MEMBRANES_H_*/
