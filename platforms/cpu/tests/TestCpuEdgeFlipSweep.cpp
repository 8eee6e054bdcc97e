#include "HelfrichEquations.h"
#include "ExactGeometry.h"
#include "Membranes.h"
#include "NeighborLists.h"
#include "openmm/internal/AssertionUtilities.h"
#include "CpuEdgeFlipSweep.h"
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <map>
#include <stdexcept>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

long double getExactEnergy(const Membrane& membrane, const HelfrichMesh& mesh, const HelfrichParameters& p) {
    return computeExactly({membrane.positions, mesh.getTriangles(), membrane.species}, p).getTotal();
}

HelfrichMesh createMesh(const Membrane& membrane) {
    HelfrichMesh mesh(membrane.triangles, membrane.positions.size());
    mesh.setSpecies(getSpecies(membrane), NUM_SPECIES);
    return mesh;
}

/**
 * The threads of a sweep, with a copy of the membrane each unless they share one.
 */
struct Threads {
    Threads(int count, int maxCopied = CpuEdgeFlipSweep::MAX_COPIED) : count(count), maxCopied(maxCopied) {
    }
    int count, maxCopied;
};

Threads sharing(int count) {
    return Threads(count, 0);
}

/**
 * Sweeps over a membrane whose vertices stay where they are.
 */
class Sweep : public CpuEdgeFlipSweep {
public:
    Sweep(const Membrane& membrane, const ExactGeometry& geometry, HelfrichMesh& mesh, const HelfrichParameters& p,
          Threads threads = 1)
            : CpuEdgeFlipSweep(mesh, threads.count, threads.maxCopied) {
        if (needsNeighborList(p)) {
            neighborList = findNeighbors(membrane.positions, 1.1 * p.repulsionOnset);
            neighborList.partition(mesh);
        }
        setPositions(membrane.positions, geometry, needsNeighborList(p) ? &neighborList : NULL);
    }
    Sweep(const Membrane& membrane, HelfrichMesh& mesh, const HelfrichParameters& p, Threads threads = 1)
            : Sweep(membrane, ExactGeometry(membrane), mesh, p, threads) {
    }
private:
    CpuHelfrichNeighborList neighborList;
};

/**
 * A rough, flat ellipsoid of 10*4^n+2 vertices.
 */
Membrane createFlatIcosphere(int subdivisions) {
    return flatten(createIcosphere(subdivisions), 0.15 / (1 << subdivisions));
}

/**
 * Parameters for each combination of terms, repulsion at each level of exclusions.  Of those of neighboring species
 * there are all, or none, but for few others.
 */
vector<HelfrichParameters> createAllParameters(const Membrane& membrane) {
    vector<HelfrichParameters> all;
    const int SPECIES = 7 << int(Term::Gaussian);
    for (int bits = 1; bits < 1 << NUM_TERMS; bits++) {
        TermMask terms = getTermsOfBits(bits);
        int ofSpecies = bits & SPECIES, others = bits & ~SPECIES;
        if (ofSpecies != 0 && ofSpecies != SPECIES && others != 0 && others != 1)
            continue;
        for (int level = 0; level < (terms.contains(Term::Repulsion) ? 3 : 1); level++)
            all.push_back(createParameters(membrane, terms, level));
    }
    return all;
}

void checkEnergyChanges(const Membrane& blob) {
    vector<HelfrichParameters> all;
    for (TermMask terms : {Bending, Area, Volume, AreaDifference, Tether, Tension, Pressure})
        all.push_back(withSurfaceTargets(createParameters(blob, terms)));
    for (int bits = 1; bits < 16; bits++)
        all.push_back(createParameters(blob, EveryTerm)
                              .only(getTermsOfBits((bits & 1) | (bits >> 1) << int(Term::Gaussian))));
    for (TermMask terms : {Bending, AllTerms})
        all.push_back(withSpontaneousCurvature(createParameters(blob, terms)));
    for (TermMask terms : {Repulsion, AllTerms, EveryTerm})
        for (int level = 0; level < 3; level++)
            all.push_back(withSurfaceTargets(createParameters(blob, terms, level)));
    for (auto& p : all) {
        HelfrichMesh mesh = createMesh(blob);
        Sweep sweep(blob, mesh, p);
        long double energy = getExactEnergy(blob, mesh, p), scale = fabsl(energy);
        int numAccepted = 0, numChanged = 0;
        for (int i = 0; i < 1000; i++) {
            double change;
            if (sweep.execute(p, 100, 1, Philox(1, 2), i, [&](double accepted) { change = accepted; }).accepted == 0)
                continue;
            mesh.validate();
            long double after = getExactEnergy(blob, mesh, p);
            scale = max(scale, fabsl(after));
            ASSERT_EQUAL_TOL(0.0, (double) ((after - energy - change) / scale), 1e-12);
            numAccepted++;
            numChanged += (change != 0);
            energy = after;
        }
        ASSERT(numAccepted > 100);
        // With repulsion alone and nothing excluded, no flip changes the energy.
        bool isConstant = (p.getTerms() == Repulsion && p.repulsionExclusionLevel == 0);
        ASSERT(isConstant ? numChanged == 0 : numChanged > 50);
    }
}

void testEnergyChanges() {
    // The change of energy of each accepted flip is the difference of two evaluations of the whole membrane, with each
    // term alone and all together, at each level of exclusions; and the mesh is valid after it.

    for (const Membrane& membrane : {createBlob(2), createSeveralSurfaces()})
        checkEnergyChanges(membrane);
}

/**
 * What comes of sweeps.
 */
struct Outcome {
    vector<array<int, 3>> triangles;
    vector<double> changes;
    vector<long long> counts;
    void add(const EdgeFlipStatistics& statistics) {
        for (long long count : {statistics.attempted, statistics.accepted, statistics.forbidden})
            counts.push_back(count);
    }
};

const Philox FLIP_RANDOM(1, 2);

/**
 * Make sweeps one after the other.  The later ones begin with the totals that the earlier ones leave, and so does a
 * difference in their last bits.
 */
Outcome flip(const Membrane& membrane, const ExactGeometry& geometry, const HelfrichParameters& p, double kT,
             int numSweeps, int numAttempts, Threads threads) {
    HelfrichMesh mesh = createMesh(membrane);
    Sweep sweep(membrane, geometry, mesh, p, threads);
    Outcome outcome;
    for (int i = 0; i < numSweeps; i++)
        outcome.add(sweep.execute(p, kT, numAttempts, FLIP_RANDOM, i,
                                  [&](double change) { outcome.changes.push_back(change); }));
    outcome.triangles = mesh.getTriangles();
    return outcome;
}

/**
 * The definition of a sweep: one attempt after the other, each with the difference of two evaluations of the whole
 * membrane in extended precision.
 */
Outcome flipOneByOne(const Membrane& membrane, const HelfrichParameters& p, double kT, int numAttempts) {
    HelfrichMesh mesh = createMesh(membrane);
    EdgeFlipStatistics statistics;
    Outcome outcome;
    long double energy = getExactEnergy(membrane, mesh, p);
    for (statistics.attempted = 0; statistics.attempted < numAttempts; statistics.attempted++) {
        auto words = FLIP_RANDOM(0, statistics.attempted);
        int h = Philox::index(words[0], words[1], mesh.getNumHalfedges());
        if (!mesh.canFlip(h)) {
            statistics.forbidden++;
            continue;
        }
        HelfrichMesh flipped = mesh;
        flipped.flip(h);
        long double after = getExactEnergy(membrane, flipped, p), change = after - energy;
        if (change <= 0 || Philox::uniform(words[2], words[3]) < exp(-change / kT)) {
            mesh = flipped;
            energy = after;
            outcome.changes.push_back(change);
            statistics.accepted++;
        }
    }
    outcome.add(statistics);
    outcome.triangles = mesh.getTriangles();
    return outcome;
}

/**
 * Assert that a sweep decides each attempt as its definition does, with the same changes of energy.
 */
void checkDefinition(const Membrane& membrane, const HelfrichParameters& p, double kT, int numAttempts,
                     const vector<Threads>& all) {
    Outcome expected = flipOneByOne(membrane, p, kT, numAttempts);
    double scale = fabs((double) computeExactly(membrane, p).getTotal());
    ASSERT(expected.changes.size() > 0);
    for (double change : expected.changes)
        scale = max(scale, fabs(change));
    for (Threads threads : all) {
        Outcome outcome = flip(membrane, ExactGeometry(membrane), p, kT, 1, numAttempts, threads);
        ASSERT_EQUAL_CONTAINERS(expected.counts, outcome.counts);
        ASSERT(expected.triangles == outcome.triangles);
        for (size_t i = 0; i < expected.changes.size(); i++)
            ASSERT_EQUAL_TOL(0.0, (expected.changes[i] - outcome.changes[i]) / scale, 1e-12);
    }
}

const double COLD = 20, HOT = 1000;

void testDefinition() {
    // Batches of a few attempts on small membranes, and two threads on the largest, whose repulsion would take too long
    // here.

    for (int subdivisions : {0, 1}) {
        Membrane blob = createFlatIcosphere(subdivisions);
        for (auto& p : createAllParameters(blob))
            for (double kT : {COLD, HOT})
                checkDefinition(blob, p, kT, 40, {1, 2});
    }
    Membrane blob = createFlatIcosphere(3);
    for (TermMask terms : {AllTerms, EveryTerm})
        checkDefinition(blob, createParameters(blob, terms, 2), HOT, 100, {1, 2, 4});
    blob = createFlatIcosphere(4);
    checkDefinition(blob, createParameters(blob, ~Repulsion), HOT, 160, {1, 2, 4, sharing(2)});
    Membrane several = createSeveralSurfaces();
    for (int level = 0; level < 3; level++)
        checkDefinition(several, withSurfaceTargets(createParameters(several, AllTerms, level)), HOT, 100, {1, 2});
}

/**
 * Assert that any number of threads, more than there are processors too, gives what one gives to the last bit, with
 * copies of the membrane and without.
 */
void checkThreads(const Membrane& membrane, const ExactGeometry& geometry, const HelfrichParameters& p, double kT,
                  int numSweeps, int numAttempts,
                  const vector<Threads>& all = {2, 3, 4, 8, sharing(2), sharing(3), sharing(8)}) {
    Outcome expected = flip(membrane, geometry, p, kT, numSweeps, numAttempts, 1);
    ASSERT(expected.changes.size() > 0);
    HelfrichMesh(expected.triangles, membrane.positions.size()).validate();
    for (Threads threads : all) {
        Outcome outcome = flip(membrane, geometry, p, kT, numSweeps, numAttempts, threads);
        ASSERT_EQUAL_CONTAINERS(expected.counts, outcome.counts);
        ASSERT(expected.changes == outcome.changes);
        ASSERT(expected.triangles == outcome.triangles);
    }
}

void testThreads() {
    // Every combination of terms on membranes of 12 to 2562 vertices, some of them up to 40,962.  Below 2048 vertices
    // there is work for one thread only.

    for (int subdivisions : {0, 1, 2, 4}) {
        Membrane blob = createFlatIcosphere(subdivisions);
        ExactGeometry geometry(blob);
        for (auto& p : createAllParameters(blob))
            checkThreads(blob, geometry, p, HOT, 2, subdivisions < 4 ? 101 : 301, {2, sharing(2)});
    }
    for (int subdivisions : {3, 5, 6}) {
        Membrane blob = createFlatIcosphere(subdivisions);
        ExactGeometry geometry(blob);
        vector<HelfrichParameters> some = {createParameters(blob, Bending | Area | Volume)};
        for (int level = 0; level < 3; level++)
            some.push_back(createParameters(blob, AllTerms, level));
        some.push_back(createParameters(blob, EveryTerm, 1));
        for (auto& p : some)
            for (double kT : {COLD, HOT})
                checkThreads(blob, geometry, p, kT, 2, 10001);
    }
    Membrane several = join({createFlatIcosphere(3), place(createFlatIcosphere(4), Vec3(3, 0, 0)),
                             place(createFlatIcosphere(2), Vec3(3, 0, 0), 0.4)});
    for (int level = 0; level < 3; level++)
        checkThreads(several, ExactGeometry(several), withSurfaceTargets(createParameters(several, AllTerms, level)),
                     HOT, 2, 10001);
}

void testThreadsAfterInterruptions() {
    // All threads know the flips of a sweep that an observer ends early, and triangles that are replaced between
    // sweeps.

    Membrane blob = createFlatIcosphere(4);
    ExactGeometry geometry(blob);
    HelfrichParameters p = createParameters(blob, Bending | Area | Volume);
    auto run = [&](Threads threads) {
        HelfrichMesh mesh = createMesh(blob);
        Sweep sweep(blob, geometry, mesh, p, threads);
        Outcome outcome;
        int countdown = 100;
        try {
            sweep.execute(p, HOT, 1001, FLIP_RANDOM, 0, [&](double) {
                if (--countdown == 0)
                    throw runtime_error("enough");
            });
        }
        catch (const runtime_error&) {
        }
        ASSERT_EQUAL(0, countdown);
        auto observe = [&](double change) { outcome.changes.push_back(change); };
        outcome.add(sweep.execute(p, HOT, 1001, FLIP_RANDOM, 1, observe));
        mesh.validate();
        mesh.setTriangles(blob.triangles);
        sweep.setPositions(blob.positions, geometry, NULL);
        outcome.add(sweep.execute(p, HOT, 1001, FLIP_RANDOM, 2, observe));
        outcome.triangles = mesh.getTriangles();
        return outcome;
    };
    Outcome expected = run(1);
    ASSERT(expected.changes.size() > 200);
    for (Threads threads : {Threads(2), sharing(2)}) {
        Outcome outcome = run(threads);
        ASSERT_EQUAL_CONTAINERS(expected.counts, outcome.counts);
        ASSERT(expected.changes == outcome.changes);
        ASSERT(expected.triangles == outcome.triangles);
    }
}

void testRunningTotals() {
    // The totals that one sweep of many flips updates do not drift from those of the surface, nor does the sum of the
    // changes of energy from its energy.

    bool isLong = (getenv("OPENMM_HELFRICH_LARGE_TESTS") != NULL);
    long long numAttempts = isLong ? 1000000000 : 4000000;
    Membrane blob = join({createBlob(3), place(createBlob(2), Vec3(3, 0, 0))});
    HelfrichParameters p = withSurfaceTargets(createParameters(blob, ~(Repulsion | Tension | Pressure)));
    HelfrichMesh mesh = createMesh(blob);
    Sweep sweep(blob, mesh, p);
    long double before = getExactEnergy(blob, mesh, p), sum = 0;
    EdgeFlipStatistics statistics =
            sweep.execute(p, HOT, numAttempts, Philox(1, 2), 3, [&](double change) { sum += change; });
    ASSERT(statistics.accepted > numAttempts / 4);
    auto exact = computeExactly({blob.positions, mesh.getTriangles(), blob.species}, p);
    long double after = exact.getTotal();
    double drift = (after - before - sum) / max(fabsl(after), fabsl(before));
    if (isLong)
        printf("%lld flips of %lld attempts: E drifts by %.1e\n", statistics.accepted, numAttempts, drift);
    ASSERT_EQUAL_TOL(0.0, drift, 1e-10);
    for (size_t k = 0; k < exact.surfaces.size(); k++) {
        const HelfrichTotals& totals = sweep.getTotals()[k];
        double drifts[] = {(double) (totals.area / exact.surfaces[k].area - 1),
                           (double) (totals.volume / exact.surfaces[k].volume - 1),
                           (double) (totals.curvature / exact.surfaces[k].curvature - 1)};
        if (isLong)
            printf("A, V and M of surface %d drift by %.1e, %.1e, %.1e\n", (int) k, drifts[0], drifts[1], drifts[2]);
        for (double drift : drifts)
            ASSERT_EQUAL_TOL(0.0, drift, 1e-10);
    }
}

void testStatisticsAndRandomNumbers() {
    Membrane blob = createBlob(2);
    HelfrichParameters p = createParameters(blob, AllTerms, 1);
    auto flip = [&](int seed, int sweepIndex, double kT, EdgeFlipStatistics& statistics) {
        HelfrichMesh mesh = createMesh(blob);
        Sweep sweep(blob, mesh, p);
        int numObserved = 0;
        statistics = sweep.execute(p, kT, 500, Philox(seed, 2), sweepIndex, [&](double change) {
            numObserved++;
            ASSERT(kT > 0 || change <= 0);
        });
        ASSERT_EQUAL(500, statistics.attempted);
        ASSERT_EQUAL(numObserved, statistics.accepted);
        ASSERT(statistics.forbidden > 0 && statistics.accepted > 0);
        ASSERT(statistics.accepted + statistics.forbidden < statistics.attempted);
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
    HelfrichParameters p = createParameters(sphere, Bending);
    Sweep sweep(sphere, mesh, p);
    EdgeFlipStatistics statistics = sweep.execute(p, 1e-9, 1000, Philox(1, 2), 0);
    ASSERT_EQUAL(0, statistics.accepted);
    ASSERT_EQUAL(0, mesh.getRevision());
    ASSERT_EQUAL_CONTAINERS(sphere.triangles, mesh.getTriangles());
}

void testFixedEdges() {
    // When all edges but one are fixed, all attempts but those on that one are forbidden, and its flips alternate.
    // With a path of fixed edges no sweep, however hot, takes one away, on one thread or on several.

    Membrane blob = createBlob(2);
    HelfrichParameters p = createParameters(blob, AllTerms, 1);
    const double hot = 1e6;
    HelfrichMesh all = createMesh(blob);
    vector<array<int, 2>> edges;
    int open = 0, numAttempts = 20000;
    while (!all.canFlip(open))
        open++;
    for (int h = 0; h < all.getNumHalfedges(); h++)
        if (h < all.opposite(h) && h != open && all.opposite(h) != open)
            edges.push_back({all.origin(h), all.tip(h)});
    all.setFixedEdges(edges);
    Sweep sweepOfAll(blob, all, p);
    EdgeFlipStatistics statistics = sweepOfAll.execute(p, hot, numAttempts, Philox(1, 2), 0);
    double expected = numAttempts / (double) all.getNumEdges();
    ASSERT(fabs(statistics.attempted - statistics.forbidden - expected) < 4 * sqrt(expected));
    ASSERT(statistics.accepted > 0.9 * (statistics.attempted - statistics.forbidden));
    all.validate();

    vector<array<int, 2>> path;
    for (size_t i = 0; i < edges.size(); i += 5)
        path.push_back(edges[i]);
    vector<vector<array<int, 3>>> results;
    long long forbidden = -1;
    for (int numThreads : {1, 2, 3}) {
        HelfrichMesh mesh = createMesh(blob);
        mesh.setFixedEdges(path);
        Sweep sweep(blob, mesh, p, numThreads);
        statistics = sweep.execute(p, hot, numAttempts, Philox(1, 2), 0);
        ASSERT(statistics.accepted > numAttempts / 4);
        ASSERT(statistics.forbidden > 0.9 * numAttempts * path.size() / mesh.getNumEdges());
        ASSERT(forbidden == -1 || forbidden == statistics.forbidden);
        forbidden = statistics.forbidden;
        for (auto& edge : path)
            ASSERT(mesh.areBonded(edge[0], edge[1]));
        mesh.validate();
        results.push_back(mesh.getTriangles());
    }
    ASSERT(results[0] == results[1] && results[0] == results[2]);
}

/**
 * A triangulation of at most eleven labeled vertices: its edges as bits, and on which side of the surface its first
 * triangle lies.  Up to its orientation, the edges alone determine a triangulation of the sphere.
 */
uint64_t getState(const vector<array<int, 3>>& triangles) {
    uint64_t edges = 0;
    array<int, 3> first = {99, 99, 99};
    bool isEven = false;
    for (array<int, 3> sorted : triangles) {
        bool even = (sorted[0] < sorted[1]) ^ (sorted[1] < sorted[2]) ^ (sorted[2] < sorted[0]);
        sort(sorted.begin(), sorted.end());
        if (sorted < first) {
            first = sorted;
            isEven = even;
        }
        edges |= uint64_t(1) << (sorted[1] * (sorted[1] - 1) / 2 + sorted[0]) |
                 uint64_t(1) << (sorted[2] * (sorted[2] - 1) / 2 + sorted[0]) |
                 uint64_t(1) << (sorted[2] * (sorted[2] - 1) / 2 + sorted[1]);
    }
    return edges | uint64_t(isEven) << 63;
}

/**
 * The triangulations that flips, but not of fixed edges, reach from that of a membrane with frozen vertices.  Paths end
 * at those whose energy is so high that a run never goes there.
 */
class Ensemble {
public:
    Ensemble(const Membrane& membrane, const HelfrichParameters& p, double kT,
             const vector<array<int, 2>>& fixedEdges = {})
            : membrane(membrane), fixedEdges(fixedEdges) {
        HelfrichMesh start(membrane.triangles, membrane.positions.size());
        add(start);
        double limit = getExactEnergy(membrane, start, p) + 30 * kT;
        for (size_t i = 0; i < triangulations.size(); i++) {
            HelfrichMesh mesh(triangulations[i], membrane.positions.size());
            mesh.setFixedEdges(fixedEdges);
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
     *
     * @param numCopies  how many copies of the membrane, far from each other, to flip together; the terms must be local
     * if there are several
     */
    vector<int> sample(const HelfrichParameters& p, double kT, int numSamples, int attemptsPerSample, int seed,
                       int numCopies = 1, Threads threads = 1) const {
        Membrane copies = createCopies(numCopies);
        HelfrichMesh mesh = createMesh(copies);
        mesh.setFixedEdges(copyFixedEdges(numCopies));
        Sweep sweep(copies, mesh, p, threads);
        vector<int> counts(triangulations.size(), 0);
        int numSweeps = numSamples / numCopies;
        for (int i = -BURN_IN; i < numSweeps; i++) {
            sweep.execute(p, kT, attemptsPerSample * numCopies, Philox(seed, RandomStream::EdgeFlips), BURN_IN + i);
            for (int copy = 0; copy < numCopies && i >= 0; copy++)
                counts[indices.at(getState(getCopy(mesh, copy)))]++;
        }
        return counts;
    }
    vector<double> getEnergies(const HelfrichParameters& p) const {
        vector<double> energies;
        for (auto& triangles : triangulations)
            energies.push_back(computeExactly({membrane.positions, triangles, membrane.species}, p).getTotal());
        return energies;
    }
private:
    static const int BURN_IN = 5;
    Membrane createCopies(int numCopies) const {
        Membrane copies;
        int numVertices = membrane.positions.size();
        for (int copy = 0; copy < numCopies; copy++) {
            for (auto& x : membrane.positions)
                copies.positions.push_back(x + Vec3(10 * copy, 0, 0));
            for (auto& t : membrane.triangles)
                copies.triangles.push_back(
                        {t[0] + copy * numVertices, t[1] + copy * numVertices, t[2] + copy * numVertices});
        }
        return copies;
    }
    vector<array<int, 2>> copyFixedEdges(int numCopies) const {
        vector<array<int, 2>> copies;
        int numVertices = membrane.positions.size();
        for (int copy = 0; copy < numCopies; copy++)
            for (auto& edge : fixedEdges)
                copies.push_back({edge[0] + copy * numVertices, edge[1] + copy * numVertices});
        return copies;
    }
    vector<array<int, 3>> getCopy(const HelfrichMesh& mesh, int copy) const {
        int numVertices = membrane.positions.size(), numTriangles = membrane.triangles.size();
        vector<array<int, 3>> triangles;
        for (int t = copy * numTriangles; t < (copy + 1) * numTriangles; t++)
            triangles.push_back({mesh.origin(3 * t) - copy * numVertices, mesh.origin(3 * t + 1) - copy * numVertices,
                                 mesh.origin(3 * t + 2) - copy * numVertices});
        return triangles;
    }
    void add(const HelfrichMesh& mesh) {
        if (indices.insert({getState(mesh.getTriangles()), (int) triangulations.size()}).second)
            triangulations.push_back(mesh.getTriangles());
    }
    const Membrane membrane;
    const vector<array<int, 2>> fixedEdges;
    map<uint64_t, int> indices;
    vector<vector<array<int, 3>>> triangulations;
};

vector<double> getProbabilities(const vector<double>& energies, double kT) {
    double lowest = *min_element(energies.begin(), energies.end()), sum = 0;
    vector<double> probabilities;
    for (double energy : energies) {
        probabilities.push_back(exp((lowest - energy) / kT));
        sum += probabilities.back();
    }
    for (double& probability : probabilities)
        probability /= sum;
    return probabilities;
}

/**
 * By how many standard deviations chi square is too large for counts drawn with the given probabilities (Wilson and
 * Hilferty's approximation).  Rare triangulations share a bin.
 */
double getDeviation(const vector<int>& counts, const vector<double>& probabilities, int minBins = 100) {
    int numSamples = 0, numBins = 0;
    for (int count : counts)
        numSamples += count;
    double chiSquare = 0, rareExpected = 0, rareCount = 0;
    auto addBin = [&](double count, double expected) {
        chiSquare += (count - expected) * (count - expected) / expected;
        numBins++;
    };
    for (size_t i = 0; i < counts.size(); i++) {
        if (numSamples * probabilities[i] >= 10)
            addBin(counts[i], numSamples * probabilities[i]);
        else {
            rareCount += counts[i];
            rareExpected += numSamples * probabilities[i];
        }
    }
    if (rareExpected > 0)
        addBin(rareCount, rareExpected);
    ASSERT(numBins > minBins);
    double freedom = numBins - 1, variance = 2 / (9 * freedom);
    return (cbrt(chiSquare / freedom) - (1 - variance)) / sqrt(variance);
}

/**
 * The largest deviation that a right run may have.  There are 21 runs in all, each of which has a larger one with the
 * probability 2.3e-4: one of all has it with 0.5%.
 */
const double LARGEST_DEVIATION = 3.5;

/**
 * The samples of a run, and the attempts from one to the next.  Samples 100 attempts apart are still correlated, which
 * raises the deviation by 0.4 on average.
 */
const int NUM_SAMPLES = 20000, ATTEMPTS_PER_SAMPLE = 200;

/**
 * Assert that a run visits triangulations as often as their Boltzmann weights say, at two temperatures, with and
 * without repulsion; and that this test would see the wrong temperature, or a run without repulsion.
 */
void checkDetailedBalance(const Membrane& membrane, const HelfrichParameters& repelling, int numCopies = 1,
                          Threads threads = 1) {
    HelfrichParameters plain = repelling;
    plain.moduli[Term::Repulsion] = 0;
    Ensemble ensemble(membrane, plain, 1);
    vector<double> energies = ensemble.getEnergies(plain), repellingEnergies = ensemble.getEnergies(repelling);
    auto check = [&](const HelfrichParameters& p, double kT, const vector<double>& right, const vector<double>& wrong) {
        vector<int> counts = ensemble.sample(p, kT, NUM_SAMPLES, ATTEMPTS_PER_SAMPLE, 11, numCopies, threads);
        ASSERT(getDeviation(counts, getProbabilities(right, kT)) < LARGEST_DEVIATION);
        ASSERT(getDeviation(counts, getProbabilities(right, 1.5 - kT)) > 6);
        ASSERT(getDeviation(counts, getProbabilities(wrong, kT)) > 6);
    };
    for (double kT : {1.0, 0.5}) {
        check(plain, kT, energies, repellingEnergies);
        check(repelling, kT, repellingEnergies, energies);
    }
}

/**
 * Parameters with which energies differ by a few kJ/mol among triangulations of few vertices.
 */
HelfrichParameters createSoftParameters(const Membrane& membrane, double scale, int exclusionLevel) {
    HelfrichParameters p = createParameters(membrane, AllTerms, exclusionLevel);
    auto geometry = computeExactly(membrane, p);
    p.moduli[Term::Bending] = 0.3 * scale;
    p.moduli[Term::Area] = 3 * scale;
    p.targetArea = geometry.area;
    p.moduli[Term::Volume] = scale;
    p.targetVolume = geometry.volume;
    p.moduli[Term::AreaDifference] = scale;
    p.leafletSeparation = 1;
    p.targetAreaDifference = 2 * geometry.curvature;
    p.moduli[Term::Tension] = scale;
    p.moduli[Term::Pressure] = 2 * scale;
    p.repulsionOnset = 3 * getMeanEdge(membrane);
    p.repulsionLengthScale = 1;
    return p;
}

/**
 * Parameters on the smallest membrane, whose six vertices have 390 triangulations.  An exclusion of level 2 leaves no
 * pair of so few.
 */
HelfrichParameters createOctahedronParameters(const Membrane& blob) {
    HelfrichParameters p = createSoftParameters(blob, 0.3, 1);
    p.moduli[Term::Tether] = 0.01;
    p.tetherMinLength = 0.8 * getMeanEdge(blob);
    p.tetherMaxLength = 1.2 * getMeanEdge(blob);
    p.tetherLengthScale = 1;
    p.tetherExponent = 2;
    p.moduli[Term::Repulsion] = 0.3;
    return p;
}

void testDetailedBalance() {
    Membrane blob = createBlob(0, 0.3);
    checkDetailedBalance(blob, createOctahedronParameters(blob));
}

void testDetailedBalanceOfThreads() {
    // Only large membranes have work for several threads, and only small ones so few triangulations: take many small
    // ones, each of which samples the same.

    Membrane blob = createBlob(0, 0.3);
    HelfrichParameters p = createOctahedronParameters(blob);
    p.moduli[Term::Area] = p.moduli[Term::Volume] = p.moduli[Term::AreaDifference] = 0;
    for (Threads threads : {Threads(2), Threads(3), sharing(2)})
        checkDetailedBalance(blob, p, 2000, threads);
}

void testDetailedBalanceWithFixedEdges() {
    // The triangulations of six vertices that flips reach without the fixed edges, visited as often as among all
    // others.

    Membrane blob = createBlob(0, 0.3);
    HelfrichParameters p = createSoftParameters(blob, 0.3, 1);
    p.moduli[Term::Tether] = 0;
    p.moduli[Term::Repulsion] = 0;
    vector<array<int, 2>> fixedEdges = {{0, 1}, {2, 0}};
    Ensemble ensemble(blob, p, 1, fixedEdges);
    vector<double> energies = ensemble.getEnergies(p);
    ASSERT(energies.size() > 40 && energies.size() < 390);
    vector<int> counts = ensemble.sample(p, 1, NUM_SAMPLES, ATTEMPTS_PER_SAMPLE, 11);
    ASSERT(getDeviation(counts, getProbabilities(energies, 1), 30) < LARGEST_DEVIATION);
    ASSERT(getDeviation(counts, getProbabilities(energies, 0.5), 20) > 6);
}

void testDetailedBalanceOfSecondNeighbors() {
    // Eight vertices, a tip, two rings of three and a tip, are the fewest among which some are three edges apart.  A
    // tether with a steep wall leaves a few hundred of their triangulations.

    Membrane rod;
    rod.positions.push_back(Vec3(0, 0, 1.5));
    for (int n = 0; n < 6; n++)
        rod.positions.push_back(
                Vec3(cos((2 * n + n / 3) * M_PI / 3), sin((2 * n + n / 3) * M_PI / 3), n < 3 ? 0.5 : -0.5));
    rod.positions.push_back(Vec3(0, 0, -1.5));
    for (int i = 1; i <= 3; i++) {
        int j = i % 3 + 1;
        for (array<int, 3> t : {array<int, 3>{0, i, j}, {j + 3, i + 3, 7}, {i, i + 3, j}, {j, i + 3, j + 3}})
            rod.triangles.push_back(t);
    }
    TestRandom random(7);
    for (auto& x : rod.positions)
        x += random.vector(0.15);
    HelfrichParameters p = createSoftParameters(rod, 0.2, 2);
    p.moduli[Term::Tether] = 10;
    p.tetherMinLength = 0.8 * getMeanEdge(rod);
    p.tetherMaxLength = 1.45 * getMeanEdge(rod);
    p.tetherLengthScale = 1;
    p.tetherExponent = 6;
    p.moduli[Term::Repulsion] = 20;
    checkDetailedBalance(rod, p);
}

int main() {
    try {
        testEnergyChanges();
        testDefinition();
        testThreads();
        testThreadsAfterInterruptions();
        testRunningTotals();
        testStatisticsAndRandomNumbers();
        testSweepThatChangesNothing();
        testFixedEdges();
        testDetailedBalance();
        testDetailedBalanceWithFixedEdges();
        testDetailedBalanceOfThreads();
        testDetailedBalanceOfSecondNeighbors();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
