#include "CpuSpeciesExchange.h"
#include "CpuHalfedges.h"
#include "openmmhelfrich/internal/Interruption.h"
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * The attempts of a block, if several threads share it: so many that a thread rarely waits for the others.
 */
static const int ATTEMPTS_PER_BLOCK = 4096;

/**
 * A zone has at least so many vertices: few of them are on its border then.
 */
static const int VERTICES_PER_ZONE = 8000;

/**
 * The lengths of a ring that are asked for before they are needed, four to a cache line.
 */
static const int LENGTHS_AHEAD = 8;

/**
 * Rings that outgrow their room are moved to the end, until all take so many times as much as at first.
 */
static const double MAX_GROWTH = 1.25;

/**
 * The zone of what belongs to none.
 */
static const int BORDER = -1;

CpuSpeciesExchange::CpuSpeciesExchange(HelfrichMesh& mesh, int numThreads)
        : CpuSweep(mesh, numThreads, VERTICES_PER_ZONE), ranks(mesh.getNumVertices()), vertices(mesh.getNumVertices()),
          species(mesh.getNumVertices()), rows(mesh.getNumVertices()), zones(mesh.getNumVertices()),
          blocked(mesh.getNumVertices(), NONE) {
}

void CpuSpeciesExchange::prepare(const vector<Vec3>& positions, const CpuVertexGeometry* geometry,
                                 const HelfrichParameters& parameters, const SpeciesProposal& proposal) {
    bool areMaterialsSame =
            (!materials.empty() && p.species == parameters.species && p.getTerms() == parameters.getTerms() &&
             p.spontaneousCurvature == parameters.spontaneousCurvature &&
             this->proposal.chemicalPotentials == proposal.chemicalPotentials);
    this->proposal = proposal;
    this->geometry = geometry;
    p = parameters;
    prepareRings();
    if (!areMaterialsSame)
        prepareMaterials();
    if (!areMaterialsSame || (geometry != NULL && geometry->number != numberOfGeometry))
        preparePositions(positions);
    if (speciesRevision != mesh.getSpeciesRevision())
        prepareSpecies();
}

void CpuSpeciesExchange::prepareMaterials() {
    speciesRevision = NONE;
    materials.clear();
    for (int species = 0; species < (int) proposal.chemicalPotentials.size(); species++) {
        HelfrichSpecies material = p.getMaterial(species);
        double kappa = material.bendingModulus, c = material.spontaneousCurvature;
        materials.push_back(
                {{2 * kappa, -2 * kappa * c, 0.5 * kappa * c * c, p.hasGaussianForces() ? material.gaussianModulus : 0},
                 proposal.chemicalPotentials[species],
                 0});
    }
    vector<int> acting = {NONE};
    auto addRow = [&](int a, int b, double) {
        for (int species : {a, b})
            if (materials[species].row == 0) {
                materials[species].row = acting.size();
                acting.push_back(species);
            }
    };
    if (p.has(Term::Line))
        p.species->lineTensions.forEach(addRow);
    if (p.has(Term::Pair))
        p.species->pairEnergies.forEach(addRow);
    numRows = acting.size();
    halfTensions.assign(numRows * numRows, 0);
    pairEnergies.assign(numRows * numRows, 0);
    for (int i = 1; i < numRows; i++)
        for (int j = 1; j < numRows; j++) {
            halfTensions[i * numRows + j] = 0.5 * p.getLineTension(acting[i], acting[j]);
            pairEnergies[i * numRows + j] = p.getPairEnergy(acting[i], acting[j]);
        }
}

void CpuSpeciesExchange::prepareRings() {
    vector<int> changed;
    bool areKnown = (revision != NONE && mesh.findChanges(revision, changed));
    revision = mesh.getRevision();
    if (!areKnown || !changed.empty())
        numberOfGeometry = NONE;
    for (int vertex : changed)
        renewRing(ranks[vertex]);
    if (!areKnown || neighbors.size() > MAX_GROWTH * (mesh.getNumHalfedges() + mesh.getNumVertices()))
        collectRings();
}

void CpuSpeciesExchange::collectRings() {
    order = mesh.getOrder();
    speciesRevision = NONE;
    int start = 0;
    for (int v = 0; v < mesh.getNumVertices(); v++) {
        int valence = mesh.valence(order[v]);
        ranks[order[v]] = v;
        vertices[v] = {{}, start, valence, valence + 1};
        start += vertices[v].room;
    }
    neighbors.reserve(MAX_GROWTH * start);
    neighbors.resize(start);
    forEachVertex([&](int v) { collectRing(v); });
    forEachVertex([&](int v) { zones[v] = findZone(v); });
}

void CpuSpeciesExchange::renewRing(int v) {
    Vertex& vertex = vertices[v];
    vertex.valence = mesh.valence(order[v]);
    if (vertex.valence > vertex.room) {
        vertex.ring = neighbors.size();
        vertex.room = vertex.valence + 1;
        neighbors.resize(vertex.ring + vertex.room);
    }
    collectRing(v);
    zones[v] = findZone(v);
}

void CpuSpeciesExchange::collectRing(int v) {
    // A ring begins at the vertex's lowest halfedge: which one the mesh has at hand depends on its past.

    int *ring = &neighbors[vertices[v].ring], *next = ring, *start = ring, lowest = mesh.outgoing(order[v]);
    for (int h : mesh.outgoingHalfedges(order[v])) {
        start = (h < lowest ? next : start);
        lowest = min(h, lowest);
        *next++ = ranks[mesh.tip(h)];
    }
    rotate(ring, start, next);
}

int CpuSpeciesExchange::findZone(int v) const {
    auto zoneOf = [&](int vertex) { return int(vertex * (long long) numThreads / mesh.getNumVertices()); };
    int zone = zoneOf(v);
    for (int neighbor : getRing(v))
        if (zoneOf(neighbor) != zone)
            return BORDER;
    return zone;
}

void CpuSpeciesExchange::preparePositions(const vector<Vec3>& positions) {
    geometryNumber++;
    numberOfGeometry = (geometry == NULL ? NONE : geometry->number);
    bool areNeeded = (p.has(Term::Line) || p.hasGaussianForces());
    x.resize(areNeeded ? mesh.getNumVertices() : 0);
    lengths.reserve(p.has(Term::Line) ? neighbors.capacity() : 0);
    lengths.resize(p.has(Term::Line) ? neighbors.size() : 0);
    if (areNeeded)
        forEachVertex([&](int v) {
            const Vec3& position = positions[mesh.getParticles()[order[v]]];
            x[v] = {position[0], position[1], position[2]};
        });
}

void CpuSpeciesExchange::prepareSpecies() {
    forEachVertex([&](int v) { setSpecies(v, mesh.getSpecies(order[v])); });
    speciesRevision = mesh.getSpeciesRevision();
}

void CpuSpeciesExchange::prepareVertices(const int* chosen, int count) {
    for (int i = 0; i < count; i++) {
        if (p.has(Term::Bending))
            geometry->prefetch(order[chosen[i]]);
        if (!x.empty())
            for (int neighbor : getRing(chosen[i]))
                __builtin_prefetch(&x[neighbor]);
    }
    for (int i = 0; i < count; i++)
        if (vertices[chosen[i]].geometry != geometryNumber)
            prepareVertex(chosen[i]);
}

void CpuSpeciesExchange::prepareVertex(int v) {
    Vertex& vertex = vertices[v];
    vertex.geometry = geometryNumber;
    if (p.has(Term::Bending)) {
        double A = geometry->getArea(order[v]), M = (A == 0 ? 0 : geometry->getCurvature(order[v]));
        vertex.factors = {A == 0 ? 0 : M * M / A, M, A, 0};
    }
    else
        vertex.factors = {};
    if (x.empty())
        return;
    double defect = 2 * M_PI;
    const int* ring = &neighbors[vertex.ring];
    Vector3<double> spoke = displacement(x[v], x[ring[0]], p.box);
    for (int i = 0; i < vertex.valence; i++) {
        Vector3<double> next = displacement(x[v], x[ring[i + 1 == vertex.valence ? 0 : i + 1]], p.box),
                        link = next - spoke;
        if (p.has(Term::Line))
            lengths[vertex.ring + i] = {sqrt(dot(spoke, spoke)), sqrt(dot(link, link))};
        if (p.hasGaussianForces()) {
            Vector3<double> normal = cross(spoke, next);
            defect -= atan2(sqrt(dot(normal, normal)), dot(spoke, next));
        }
        spoke = next;
    }
    vertex.factors[3] = defect;
}

SpeciesExchangeStatistics CpuSpeciesExchange::execute(double kT, long long numAttempts, const Philox& random,
                                                      long long sweep, const Observer& observer) {
    // Two vertices that may be anywhere are rarely in one zone.

    begin(kT, numAttempts, random, sweep);
    numZones = (proposal.kind == SpeciesProposal::Anywhere ? 1 : numThreads);
    int size = (numZones == 1 ? Part::SIZE : ATTEMPTS_PER_BLOCK);
    parts.resize(size / Part::SIZE);
    for (Outcome& outcome : outcomes) {
        outcome.accepted = outcome.alike = 0;
        outcome.changed.clear();
    }
    // What ends a sweep early leaves the mesh as it was.
    speciesRevision = NONE;
    Interruption interruption(size);
    for (long long first = 0; first < numAttempts; first += size) {
        if (interruption.isRequested())
            throw StepInterrupted();
        makeBlock(first, min<long long>(size, numAttempts - first));
        if (observer)
            observe(observer);
    }
    storeSpecies();
    SpeciesExchangeStatistics statistics;
    statistics.attempted = numAttempts;
    for (const Outcome& outcome : outcomes) {
        statistics.accepted += outcome.accepted;
        statistics.alike += outcome.alike;
    }
    return statistics;
}

void CpuSpeciesExchange::storeSpecies() {
    bool isChanged = false;
    for (const Outcome& outcome : outcomes)
        for (int v : outcome.changed) {
            mesh.changeSpecies(order[v], species[v]);
            isChanged = true;
        }
    if (isChanged)
        mesh.markSpeciesChanged();
    speciesRevision = mesh.getSpeciesRevision();
}

void CpuSpeciesExchange::makeBlock(long long firstAttempt, int numAttempts) {
    numBlocks++;
    numParts = (numAttempts + Part::SIZE - 1) / Part::SIZE;
    CpuThreads::forEach(numZones, numParts, [&](int n) {
        int first = n * Part::SIZE;
        draw(parts[n], firstAttempt + first, min(Part::SIZE, numAttempts - first));
    });
    CpuThreads::forEach(numZones, numZones, [&](int zone) {
        for (int n = 0; n < numParts; n++)
            decide(parts[n], zone);
    });
    if (numZones > 1)
        decideDeferred();
}

void CpuSpeciesExchange::decideDeferred() {
    for (int n = 0; n < numParts; n++) {
        uint64_t bits = parts[n].border;
        for (int zone = 0; zone < numZones; zone++)
            bits |= parts[n].deferred[zone];
        for (; bits != 0; bits &= bits - 1)
            decide(parts[n].attempts[__builtin_ctzll(bits)], outcomes[numZones]);
    }
}

void CpuSpeciesExchange::draw(Part& part, long long firstAttempt, int numAttempts) const {
    // In large membranes nearly everything is in no near cache: what is needed is asked for long before.

    SpeciesDraw draws[Part::SIZE];
    for (int n = 0; n < numAttempts; n++) {
        draws[n] = proposal.drawNumbers(random, sweep, firstAttempt + n, mesh);
        if (proposal.kind == SpeciesProposal::Neighbors)
            prefetchTriangle(mesh.getArrays(), draws[n].first);
    }
    bool isMutation = (proposal.kind == SpeciesProposal::Mutation);
    part.numAttempts = numAttempts;
    part.border = 0;
    fill(part.counts, part.counts + numZones, 0);
    fill(part.deferred, part.deferred + numZones, 0);
    for (int n = 0; n < numAttempts; n++) {
        SpeciesDraw draw = proposal.findVertices(draws[n], mesh);
        Attempt& attempt = part.attempts[n];
        attempt.first = ranks[draw.first];
        attempt.second = (isMutation ? draw.second : ranks[draw.second]);
        attempt.uniform = draw.uniform;
        int zone = zones[attempt.first];
        if (numZones == 1)
            zone = 0;
        else if (!isMutation && zones[attempt.second] != zone)
            zone = BORDER;
        part.border |= uint64_t(zone == BORDER) << n;
        for (int z = 0; z < numZones; z++) {
            part.lists[z][part.counts[z]] = n;
            part.counts[z] += (zone == z || zone == BORDER);
        }
    }
}

void CpuSpeciesExchange::decide(Part& part, int zone) {
    // What belongs to an attempt on the border may be changing now, in another zone.

    const int* list = part.lists[zone];
    int different[Part::SIZE], numDifferent = 0;
    auto isOnBorder = [&](int n) { return (part.border >> n & 1) != 0; };
    for (int i = 0; i < part.counts[zone]; i++) {
        different[numDifferent] = list[i];
        numDifferent += (!isOnBorder(list[i]) && !isAlike(part.attempts[list[i]]));
    }
    for (int i = 0; i < numDifferent; i++)
        for (int vertex : getVertices(part.attempts[different[i]]))
            __builtin_prefetch(&vertices[vertex]);
    int unprepared[2 * Part::SIZE] = {}, numUnprepared = 0;
    for (int i = 0; i < numDifferent; i++)
        for (int vertex : getVertices(part.attempts[different[i]])) {
            prefetchRing(vertices[vertex].ring);
            unprepared[numUnprepared] = vertex;
            numUnprepared += (vertices[vertex].geometry != geometryNumber);
        }
    prepareVertices(unprepared, numUnprepared);
    for (int i = 0; i < part.counts[zone]; i++) {
        int n = list[i];
        Attempt& attempt = part.attempts[n];
        if (numZones > 1 && (isOnBorder(n) || isBlocked(attempt))) {
            part.deferred[zone] |= uint64_t(1) << n;
            defer(attempt, zone);
        }
        else
            decide(attempt, outcomes[zone]);
    }
}

void CpuSpeciesExchange::prefetchRing(int ring) const {
    __builtin_prefetch(&neighbors[ring]);
    if (!lengths.empty())
        for (int i = 0; i < LENGTHS_AHEAD; i += 4)
            __builtin_prefetch(&lengths[min<size_t>(ring + i, lengths.size() - 1)]);
}

bool CpuSpeciesExchange::isBlocked(const Attempt& attempt) const {
    auto vertices = getVertices(attempt);
    return blocked[vertices[0]] == numBlocks || blocked[vertices[1]] == numBlocks;
}

void CpuSpeciesExchange::defer(const Attempt& attempt, int zone) {
    // Nobody else looks at what blocks this zone.

    auto block = [&](int vertex) {
        if (zones[vertex] == zone)
            blocked[vertex] = numBlocks;
    };
    for (int vertex : getVertices(attempt)) {
        block(vertex);
        for (int neighbor : getRing(vertex))
            block(neighbor);
    }
}

void CpuSpeciesExchange::decide(Attempt& attempt, Outcome& outcome) {
    bool isMutation = (proposal.kind == SpeciesProposal::Mutation);
    int from = species[attempt.first], to = (isMutation ? attempt.second : species[attempt.second]);
    attempt.isAccepted = false;
    outcome.alike += (from == to);
    if (from == to)
        return;
    attempt.change = changeAt(attempt.first, from, to, NONE, 0);
    if (isMutation)
        attempt.change -= materials[to].chemicalPotential - materials[from].chemicalPotential;
    else
        attempt.change += changeAt(attempt.second, to, from, attempt.first, to);
    attempt.isAccepted = (attempt.change <= 0 || attempt.uniform < exp(-attempt.change / kT));
    if (!attempt.isAccepted)
        return;
    outcome.accepted++;
    outcome.changed.push_back(attempt.first);
    setSpecies(attempt.first, to);
    if (!isMutation) {
        outcome.changed.push_back(attempt.second);
        setSpecies(attempt.second, from);
    }
}

bool CpuSpeciesExchange::isAlike(const Attempt& attempt) const {
    bool isMutation = (proposal.kind == SpeciesProposal::Mutation);
    return species[attempt.first] == (isMutation ? attempt.second : species[attempt.second]);
}

void CpuSpeciesExchange::observe(const Observer& observer) const {
    for (int n = 0; n < numParts; n++)
        for (int i = 0; i < parts[n].numAttempts; i++)
            if (parts[n].attempts[i].isAccepted)
                observer(parts[n].attempts[i].change);
}

double CpuSpeciesExchange::changeAt(int v, int from, int to, int other, int speciesOfOther) {
    const Material &before = materials[from], &after = materials[to];
    const Vertex& vertex = vertices[v];
    if (vertex.geometry != geometryNumber)
        prepareVertex(v);
    double change = 0;
    for (int i = 0; i < 4; i++)
        change += (after.factors[i] - before.factors[i]) * vertex.factors[i];
    if (before.row != after.row) {
        Surroundings around = {&neighbors[vertex.ring], rows.data(), other, materials[speciesOfOther].row};
        if (p.has(Term::Line))
            change += changeOfLines(v, around, before.row, after.row);
        if (p.has(Term::Pair))
            change += changeOfPairs(vertex, around, before.row, after.row);
    }
    return change;
}

double CpuSpeciesExchange::changeOfPairs(const Vertex& vertex, const Surroundings& around, int a, int b) const {
    const double *ofA = &pairEnergies[a * numRows], *ofB = &pairEnergies[b * numRows];
    double change = 0;
    for (int i = 0; i < vertex.valence; i++)
        change += ofB[around[i]] - ofA[around[i]];
    return change;
}

/**
 * Get a number, or 0 unless a condition is true, without a branch, which no processor could predict.
 */
static double onlyIf(bool condition, double number) {
    uint64_t bits;
    memcpy(&bits, &number, sizeof(bits));
    bits &= -uint64_t(condition);
    memcpy(&number, &bits, sizeof(bits));
    return number;
}

double CpuSpeciesExchange::changeOfLines(int v, const Surroundings& around, int a, int b) const {
    // Half of a triangle's like edge is a boundary: around the vertex the links between two neighbors that are alike,
    // and the spokes to those that are as the vertex is.  Of what is alike in a triangle there is no tension.

    const Vertex& vertex = vertices[v];
    const double *ofA = &halfTensions[a * numRows], *ofB = &halfTensions[b * numRows];
    const Lengths* length = &lengths[vertex.ring];
    int previous = around[vertex.valence - 1], present = around[0];
    double change = 0;
    bool hasThree = false;
    for (int i = 0; i < vertex.valence; i++) {
        int next = around[i + 1 == vertex.valence ? 0 : i + 1];
        change += length[i].link * onlyIf(present == next, ofB[present] - ofA[present]) +
                  length[i].spoke * (onlyIf(present == b, ofB[previous] + ofB[next]) -
                                     onlyIf(present == a, ofA[previous] + ofA[next]));
        hasThree |= (present != next) & (((present != a) & (next != a)) | ((present != b) & (next != b)));
        previous = present;
        present = next;
    }
    return hasThree ? change + changeOfMedians(v, around, a, b) : change;
}

double CpuSpeciesExchange::changeOfMedians(int v, const Surroundings& around, int a, int b) const {
    const Vertex& vertex = vertices[v];
    double change = 0;
    for (int i = 0; i < vertex.valence; i++) {
        int j = (i + 1 == vertex.valence ? 0 : i + 1), n = around[i], m = around[j];
        Vector3<double> toN = displacement(x[v], x[around.ring[i]], p.box),
                        toM = displacement(x[v], x[around.ring[j]], p.box);
        auto energy = [&](int row) {
            if (row == n || n == m || m == row)
                return 0.0;
            auto piece = [&](int row1, int row2, const Vector3<double>& median) {
                return 2 / 3.0 * halfTensions[row1 * numRows + row2] * sqrt(dot(median, median));
            };
            return piece(n, m, (toN + toM) * 0.5) + piece(row, n, toM - toN * 0.5) + piece(row, m, toN - toM * 0.5);
        };
        change += energy(b) - energy(a);
    }
    return change;
}

void CpuSpeciesExchange::setSpecies(int vertex, int newSpecies) {
    species[vertex] = newSpecies;
    rows[vertex] = materials[newSpecies].row;
}
