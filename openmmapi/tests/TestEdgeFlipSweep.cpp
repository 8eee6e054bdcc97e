#include "HelfrichEquations.h"
#include "Membranes.h"
#include "openmm/internal/AssertionUtilities.h"
#include "openmmhelfrich/internal/EdgeFlipSweep.h"
#include <algorithm>
#include <cstdint>
#include <iostream>
#include <map>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

long double getExactEnergy(const Membrane& membrane, const HelfrichMesh& mesh, const HelfrichParameters& p) {
    return computeExactly({membrane.positions, mesh.getTriangles()}, p).getTotal();
}

void testEnergyChanges() {
    // The change of energy of each accepted flip is the difference of two evaluations of the whole membrane, with each term alone and all together, at each level
    // of exclusions; and the mesh is valid after it.

    Membrane blob = createBlob(2);
    vector<HelfrichParameters> all;
    for (int terms : {Bending, Area, Volume, AreaDifference, Tether})
        all.push_back(createParameters(blob, terms));
    for (int terms : {Repulsion, AllTerms})
        for (int level = 0; level < 3; level++)
            all.push_back(createParameters(blob, terms, level));
    for (auto& p : all) {
        HelfrichMesh mesh(blob.triangles, blob.positions.size());
        EdgeFlipSweep sweep(mesh);
        long double energy = getExactEnergy(blob, mesh, p), scale = fabsl(energy);
        int numChanged = 0;
        auto check = [&] (double change) {
            mesh.validate();
            long double after = getExactEnergy(blob, mesh, p);
            scale = max(scale, fabsl(after));
            ASSERT_EQUAL_TOL(0.0, (double) ((after-energy-change)/scale), 1e-12);
            numChanged += (change != 0);
            energy = after;
        };
        EdgeFlipStatistics statistics = sweep.execute(blob.positions, p, 100, 1000, Philox(1, 2), 3, check);
        ASSERT(statistics.accepted > 100);
        // With repulsion alone and nothing excluded, no flip changes the energy.
        bool isConstant = (p.bendingModulus == 0 && p.repulsionModulus != 0 && p.repulsionExclusionLevel == 0);
        ASSERT(isConstant ? numChanged == 0 : numChanged > 50);
    }
}

void testRunningTotals() {
    // The totals that a long sweep updates do not drift from those of the surface.

    Membrane blob = createBlob(3);
    HelfrichParameters p = createParameters(blob, Bending | Area | Volume | AreaDifference | Tether);
    HelfrichMesh mesh(blob.triangles, blob.positions.size());
    EdgeFlipSweep sweep(mesh);
    long double before = getExactEnergy(blob, mesh, p), sum = 0;
    EdgeFlipStatistics statistics = sweep.execute(blob.positions, p, 1000, 500000, Philox(1, 2), 3, [&] (double change) { sum += change; });
    ASSERT(statistics.accepted > 100000);
    long double after = getExactEnergy(blob, mesh, p);
    ASSERT_EQUAL_TOL(0.0, (double) ((after-before-sum)/max(fabsl(after), fabsl(before))), 1e-10);
}

void testStatisticsAndRandomNumbers() {
    Membrane blob = createBlob(2);
    HelfrichParameters p = createParameters(blob, AllTerms, 1);
    auto flip = [&] (int seed, int sweepIndex, double kT, EdgeFlipStatistics& statistics) {
        HelfrichMesh mesh(blob.triangles, blob.positions.size());
        EdgeFlipSweep sweep(mesh);
        int numObserved = 0;
        statistics = sweep.execute(blob.positions, p, kT, 500, Philox(seed, 2), sweepIndex, [&] (double change) {
            numObserved++;
            ASSERT(kT > 0 || change <= 0);
        });
        ASSERT_EQUAL(500, statistics.attempted);
        ASSERT_EQUAL(numObserved, statistics.accepted);
        ASSERT(statistics.forbidden > 0 && statistics.accepted > 0);
        ASSERT(statistics.accepted+statistics.forbidden < statistics.attempted);
        ASSERT_EQUAL(1, mesh.getRevision());
        return mesh.getTriangles();
    };
    EdgeFlipStatistics first, second;
    auto triangles = flip(1, 7, 5, first);
    ASSERT_EQUAL_CONTAINERS(triangles, flip(1, 7, 5, second));
    ASSERT_EQUAL(first.accepted, second.accepted);
    ASSERT(triangles != flip(2, 7, 5, second));
    ASSERT(triangles != flip(1, 8, 5, second));
    flip(1, 7, 0, second);
    ASSERT(second.accepted < first.accepted);
}

void testSweepThatChangesNothing() {
    Membrane sphere = createSphere(1);
    HelfrichMesh mesh(sphere.triangles, sphere.positions.size());
    EdgeFlipSweep sweep(mesh);
    EdgeFlipStatistics statistics = sweep.execute(sphere.positions, createParameters(sphere, Bending), 1e-9, 1000, Philox(1, 2), 0);
    ASSERT_EQUAL(0, statistics.accepted);
    ASSERT_EQUAL(0, mesh.getRevision());
    ASSERT_EQUAL_CONTAINERS(sphere.triangles, mesh.getTriangles());
}

/**
 * A triangulation of at most eleven labelled vertices: its edges as bits, and on which side of the surface its first triangle lies.  Up to its orientation,
 * the edges alone determine a triangulation of the sphere.
 */
uint64_t getState(const HelfrichMesh& mesh) {
    uint64_t edges = 0;
    array<int, 3> first = {99, 99, 99};
    bool isEven = false;
    for (int t = 0; t < mesh.getNumTriangles(); t++) {
        array<int, 3> sorted = {mesh.origin(3*t), mesh.origin(3*t+1), mesh.origin(3*t+2)};
        bool even = (sorted[0] < sorted[1])^(sorted[1] < sorted[2])^(sorted[2] < sorted[0]);
        sort(sorted.begin(), sorted.end());
        if (sorted < first) {
            first = sorted;
            isEven = even;
        }
        edges |= uint64_t(1)<<(sorted[1]*(sorted[1]-1)/2+sorted[0]) | uint64_t(1)<<(sorted[2]*(sorted[2]-1)/2+sorted[0]) |
                 uint64_t(1)<<(sorted[2]*(sorted[2]-1)/2+sorted[1]);
    }
    return edges | uint64_t(isEven)<<63;
}

/**
 * The triangulations that flips reach from that of a membrane with frozen vertices.  Paths end at those whose energy is so high that a run never goes there.
 */
class Ensemble {
public:
    Ensemble(const Membrane& membrane, const HelfrichParameters& p, double kT) : membrane(membrane) {
        HelfrichMesh start(membrane.triangles, membrane.positions.size());
        add(start);
        double limit = getExactEnergy(membrane, start, p)+40*kT;
        for (size_t i = 0; i < triangulations.size(); i++) {
            HelfrichMesh mesh(triangulations[i], membrane.positions.size());
            if (getExactEnergy(membrane, mesh, p) > limit)
                continue;
            for (int h = 0; h < mesh.getNumHalfedges(); h++)
                if (h < mesh.opposite(h) && mesh.canFlip(h)) {
                    HelfrichMesh neighbor = mesh;
                    neighbor.flip(h);
                    add(neighbor);
                }
        }
    }
    /**
     * The number of times that each triangulation is seen in a run.
     */
    vector<int> sample(const HelfrichParameters& p, double kT, int numSamples, int attemptsPerSample, int seed) const {
        HelfrichMesh mesh(membrane.triangles, membrane.positions.size());
        EdgeFlipSweep sweep(mesh);
        vector<int> counts(triangulations.size(), 0);
        for (int i = 0; i < numSamples; i++) {
            sweep.execute(membrane.positions, p, kT, attemptsPerSample, Philox(seed, RandomStream::EdgeFlips), i);
            counts[indices.at(getState(mesh))]++;
        }
        return counts;
    }
    vector<double> getProbabilities(const HelfrichParameters& p, double kT) const {
        vector<double> energies, probabilities;
        for (auto& triangles : triangulations)
            energies.push_back(computeExactly({membrane.positions, triangles}, p).getTotal());
        double lowest = *min_element(energies.begin(), energies.end()), sum = 0;
        for (double energy : energies)
            sum += exp((lowest-energy)/kT);
        for (double energy : energies)
            probabilities.push_back(exp((lowest-energy)/kT)/sum);
        return probabilities;
    }
private:
    void add(const HelfrichMesh& mesh) {
        if (indices.insert({getState(mesh), (int) triangulations.size()}).second)
            triangulations.push_back(mesh.getTriangles());
    }
    const Membrane membrane;
    map<uint64_t, int> indices;
    vector<vector<array<int, 3> > > triangulations;
};

/**
 * By how many standard deviations chi square is too large for counts drawn with the given probabilities (Wilson and Hilferty's approximation).  Rare
 * triangulations share a bin.
 */
double getDeviation(const vector<int>& counts, const vector<double>& probabilities) {
    int numSamples = 0, numBins = 0;
    for (int count : counts)
        numSamples += count;
    double chiSquare = 0, rareExpected = 0, rareCount = 0;
    auto addBin = [&] (double count, double expected) {
        chiSquare += (count-expected)*(count-expected)/expected;
        numBins++;
    };
    for (size_t i = 0; i < counts.size(); i++) {
        if (numSamples*probabilities[i] >= 10)
            addBin(counts[i], numSamples*probabilities[i]);
        else {
            rareCount += counts[i];
            rareExpected += numSamples*probabilities[i];
        }
    }
    if (rareExpected > 0)
        addBin(rareCount, rareExpected);
    ASSERT(numBins > 20);
    double freedom = numBins-1, variance = 2/(9*freedom);
    return (cbrt(chiSquare/freedom)-(1-variance))/sqrt(variance);
}
