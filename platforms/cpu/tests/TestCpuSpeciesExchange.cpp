#include "HelfrichEquations.h"
#include "ExactGeometry.h"
#include "Membranes.h"
#include "openmm/internal/AssertionUtilities.h"
#include "CpuSpeciesExchange.h"
#include <iostream>
#include <stdexcept>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

const double HOT = 20;

const Philox EXCHANGE_RANDOM(1, RandomStream::SpeciesExchanges);

const vector<SpeciesProposal::Kind> KINDS = {SpeciesProposal::Neighbors, SpeciesProposal::Anywhere,
                                             SpeciesProposal::Mutation};

const vector<double> CHEMICAL_POTENTIALS = {3, -5, 1};

HelfrichMesh createMesh(const Membrane& membrane) {
    HelfrichMesh mesh(membrane.triangles, membrane.positions.size());
    mesh.setSpecies(getSpecies(membrane), NUM_SPECIES);
    return mesh;
}

/**
 * The energy less the chemical potentials, which only mutations feel.
 */
long double getExactEnergy(const Membrane& membrane, const HelfrichMesh& mesh, const HelfrichParameters& p,
                           bool isMutation) {
    long double energy = computeExactly({membrane.positions, mesh.getTriangles(), mesh.getSpecies()}, p).getTotal();
    for (int species : mesh.getSpecies())
        energy -= isMutation ? CHEMICAL_POTENTIALS[species] : 0;
    return energy;
}

/**
 * Sweeps over a membrane whose vertices stay where they are.
 */
class Sweep : public CpuSpeciesExchange {
public:
    Sweep(const Membrane& membrane, const ExactGeometry& geometry, HelfrichMesh& mesh, const HelfrichParameters& p,
          SpeciesProposal::Kind kind, int numThreads = 1)
            : CpuSpeciesExchange(mesh, numThreads) {
        prepare(membrane.positions, &geometry, p, {kind, CHEMICAL_POTENTIALS});
    }
};

/**
 * Parameters for each combination of the terms that depend on species.
 */
vector<HelfrichParameters> createAllParameters(const Membrane& membrane) {
    vector<HelfrichParameters> all;
    const TermMask terms[] = {Bending, Gaussian, Line, Pair};
    for (int bits = 1; bits < 1 << 4; bits++) {
        TermMask off;
        for (int i = 0; i < 4; i++)
            if ((bits >> i & 1) == 0)
                off = off | terms[i];
        all.push_back(createParameters(membrane, EveryTerm).only(~off));
    }
    return all;
}

/**
 * What comes of sweeps.
 */
struct Outcome {
    vector<int> species;
    vector<double> changes;
    vector<long long> counts;
    void add(const SpeciesExchangeStatistics& statistics) {
        for (long long count : {statistics.attempted, statistics.accepted, statistics.alike})
            counts.push_back(count);
    }
};

void testEnergyChanges() {
    // The change of energy of each accepted attempt is the difference of two evaluations of the whole membrane, with
    // every combination of the terms that depend on species, and all others.

    Membrane blob = createBlob(2);
    ExactGeometry geometry(blob);
    for (auto& p : createAllParameters(blob))
        for (auto kind : KINDS) {
            bool isMutation = (kind == SpeciesProposal::Mutation);
            HelfrichMesh mesh = createMesh(blob);
            Sweep sweep(blob, geometry, mesh, p, kind);
            long double energy = getExactEnergy(blob, mesh, p, isMutation), scale = fabsl(energy);
            int numAccepted = 0;
            for (int i = 0; i < 100; i++) {
                double change;
                if (sweep.execute(HOT, 1, EXCHANGE_RANDOM, i, [&](double accepted) { change = accepted; }).accepted ==
                    0)
                    continue;
                long double after = getExactEnergy(blob, mesh, p, isMutation);
                scale = max(scale, fabsl(after));
                ASSERT_EQUAL_TOL(0.0, (double) ((after - energy - change) / scale), 1e-13);
                numAccepted++;
                energy = after;
            }
            ASSERT(numAccepted > 20);
        }
}

/**
 * Make sweeps one after the other.
 */
Outcome exchange(const Membrane& membrane, const ExactGeometry& geometry, const HelfrichParameters& p,
                 SpeciesProposal::Kind kind, int numSweeps, int numAttempts, int numThreads) {
    HelfrichMesh mesh = createMesh(membrane);
    Sweep sweep(membrane, geometry, mesh, p, kind, numThreads);
    Outcome outcome;
    for (int i = 0; i < numSweeps; i++)
        outcome.add(sweep.execute(HOT, numAttempts, EXCHANGE_RANDOM, i,
                                  [&](double change) { outcome.changes.push_back(change); }));
    outcome.species = mesh.getSpecies();
    return outcome;
}

/**
 * The definition of a sweep: one attempt after the other, each with the difference of two evaluations of the whole
 * membrane in extended precision.
 */
Outcome exchangeOneByOne(const Membrane& membrane, const HelfrichParameters& p, SpeciesProposal::Kind kind,
                         int numAttempts) {
    bool isMutation = (kind == SpeciesProposal::Mutation);
    HelfrichMesh mesh = createMesh(membrane);
    SpeciesExchangeStatistics statistics;
    Outcome outcome;
    long double energy = getExactEnergy(membrane, mesh, p, isMutation);
    for (statistics.attempted = 0; statistics.attempted < numAttempts; statistics.attempted++) {
        auto words = EXCHANGE_RANDOM(0, 2 * statistics.attempted),
             more = EXCHANGE_RANDOM(0, 2 * statistics.attempted + 1);
        HelfrichMesh changed = mesh;
        if (kind == SpeciesProposal::Neighbors) {
            int h = Philox::index(words[0], words[1], mesh.getNumHalfedges());
            changed.exchangeSpecies(mesh.origin(h), mesh.tip(h));
        }
        else {
            int v = Philox::index(words[0], words[1], mesh.getNumVertices());
            if (isMutation)
                changed.changeSpecies(v, Philox::index(more[0], more[1], NUM_SPECIES));
            else
                changed.exchangeSpecies(v, Philox::index(more[0], more[1], mesh.getNumVertices()));
        }
        if (changed.getSpecies() == mesh.getSpecies()) {
            statistics.alike++;
            continue;
        }
        long double after = getExactEnergy(membrane, changed, p, isMutation), change = after - energy;
        if (change <= 0 || Philox::uniform(words[2], words[3]) < exp(-change / HOT)) {
            mesh = changed;
            energy = after;
            outcome.changes.push_back(change);
            statistics.accepted++;
        }
    }
    outcome.add(statistics);
    outcome.species = mesh.getSpecies();
    return outcome;
}

void testDefinition() {
    // A sweep decides each attempt as its definition does, with the same changes of energy, on one thread or on two,
    // and on surfaces beside each other.

    for (auto& membrane : {createIcosphere(1), createBlob(2), createSeveralSurfaces()}) {
        ExactGeometry geometry(membrane);
        for (auto& p : createAllParameters(membrane))
            for (auto kind : KINDS) {
                Outcome expected = exchangeOneByOne(membrane, p, kind, 100),
                        outcome = exchange(membrane, geometry, p, kind, 1, 100, 1);
                double scale = fabs((double) computeExactly(membrane, p).getTotal());
                ASSERT(expected.changes.size() > 0);
                ASSERT_EQUAL_CONTAINERS(expected.counts, outcome.counts);
                ASSERT_EQUAL_CONTAINERS(expected.species, outcome.species);
                for (size_t i = 0; i < expected.changes.size(); i++)
                    ASSERT_EQUAL_TOL(0.0, (expected.changes[i] - outcome.changes[i]) / scale, 1e-12);
            }
    }
}

void testThreads() {
    // Any number of threads, more than there are processors too, gives what one gives to the last bit.  A membrane of
    // fewer vertices has work for one thread only.

    Membrane blob = createBlob(6);
    ExactGeometry geometry(blob);
    for (TermMask terms : {Pair, Bending | Line, EveryTerm})
        for (auto kind : KINDS) {
            HelfrichParameters p = createParameters(blob, terms);
            Outcome expected = exchange(blob, geometry, p, kind, 2, 20001, 1);
            ASSERT(expected.changes.size() > 3000);
            for (int numThreads : {2, 3, 5}) {
                Outcome outcome = exchange(blob, geometry, p, kind, 2, 20001, numThreads);
                ASSERT_EQUAL_CONTAINERS(expected.counts, outcome.counts);
                ASSERT(expected.changes == outcome.changes);
                ASSERT(expected.species == outcome.species);
            }
        }
}

void testRevisions() {
    // The species count as changed once a sweep, and not if no attempt was accepted.

    Membrane blob = createBlob(2);
    HelfrichParameters p = createParameters(blob, Pair);
    HelfrichMesh mesh = createMesh(blob);
    ExactGeometry geometry(blob);
    Sweep sweep(blob, geometry, mesh, p, SpeciesProposal::Neighbors);
    long long revision = mesh.getSpeciesRevision();
    ASSERT(sweep.execute(HOT, 500, EXCHANGE_RANDOM, 0).accepted > 100);
    ASSERT_EQUAL(revision + 1, mesh.getSpeciesRevision());
    for (int i = 1; i < 20; i++)
        sweep.execute(0, 5000, EXCHANGE_RANDOM, i);
    revision = mesh.getSpeciesRevision();
    vector<int> species = mesh.getSpecies();
    if (sweep.execute(0, 1, EXCHANGE_RANDOM, 20).accepted == 0) {
        ASSERT_EQUAL(revision, mesh.getSpeciesRevision());
        ASSERT_EQUAL_CONTAINERS(species, mesh.getSpecies());
    }
    ASSERT_EQUAL(0, sweep.execute(HOT, 0, EXCHANGE_RANDOM, 21).attempted);
    ASSERT_EQUAL(revision, mesh.getSpeciesRevision());
}

int main() {
    try {
        testEnergyChanges();
        testDefinition();
        testThreads();
        testRevisions();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
