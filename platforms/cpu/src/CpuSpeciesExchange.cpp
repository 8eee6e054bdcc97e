#include "CpuSpeciesExchange.h"
#include "CpuHalfedges.h"
#include "CpuThreads.h"
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
 * The number of vertices that a thread prepares at a time.
 */
static const int VERTICES_PER_PART = 256;

/**
 * The lengths of a ring that are asked for before they are needed, four to a cache line.
 */
static const int LENGTHS_AHEAD = 8;

static const int NONE = -1;

/**
 * The zone of what belongs to none.
 */
static const int BORDER = -1;

CpuSpeciesExchange::CpuSpeciesExchange(HelfrichMesh& mesh, int numThreads)
        : mesh(mesh), numThreads(max(1, min({numThreads, MAX_ZONES, mesh.getNumVertices() / VERTICES_PER_ZONE}))),
          ranks(mesh.getNumVertices()), vertices(mesh.getNumVertices()), species(mesh.getNumVertices()),
          rows(mesh.getNumVertices()), zones(mesh.getNumVertices()), neighbors(mesh.getNumHalfedges()),
          revision(mesh.getRevision() - 1), random(0, 0), blocked(mesh.getNumVertices(), NONE) {
}

template <class Function>
void CpuSpeciesExchange::forEachVertex(const Function& function) const {
    CpuThreads::forEachPart(numThreads, mesh.getNumVertices(), VERTICES_PER_PART, [&](int begin, int end) {
        for (int v = begin; v < end; v++)
            function(v);
    });
}

void CpuSpeciesExchange::prepare(const vector<Vec3>& positions, const CpuVertexGeometry* geometry,
                                 const HelfrichParameters& parameters, const SpeciesProposal& proposal) {
    this->proposal = proposal;
    p = parameters;
    prepareMaterials();
    prepareRings();
    bool needsPositions = (p.has(Term::Line) || p.hasGaussianForces());
    x.resize(needsPositions ? mesh.getNumVertices() : 0);
    lengths.resize(p.has(Term::Line) ? neighbors.size() : 0);
    forEachVertex([&](int v) {
        species[v] = mesh.getSpecies(order[v]);
        rows[v] = materials[species[v]].row;
        const Vec3& position = positions[mesh.getParticles()[order[v]]];
        if (needsPositions)
            x[v] = {position[0], position[1], position[2]};
    });
    forEachVertex([&](int v) { prepareVertex(geometry, v); });
}

void CpuSpeciesExchange::prepareMaterials() {
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
    if (revision == mesh.getRevision() && order == mesh.getOrder())
        return;
    order = mesh.getOrder();
    for (int v = 0, start = 0; v < mesh.getNumVertices(); v++) {
        ranks[order[v]] = v;
        vertices[v].ring = start;
        vertices[v].valence = mesh.valence(order[v]);
        start += vertices[v].valence;
    }
    forEachVertex([&](int v) { collectRing(v); });
    forEachVertex([&](int v) { zones[v] = findZone(v); });
    revision = mesh.getRevision();
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

void CpuSpeciesExchange::prepareVertex(const CpuVertexGeometry* geometry, int v) {
    Vertex& vertex = vertices[v];
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
    Vector3<double> spoke = displacement(x[v], x[ring[0]]);
    for (int i = 0; i < vertex.valence; i++) {
        Vector3<double> next = displacement(x[v], x[ring[i + 1 == vertex.valence ? 0 : i + 1]]), link = next - spoke;
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

    this->kT = kT;
    this->random = random;
    this->sweep = sweep;
    numZones = (proposal.kind == SpeciesProposal::Anywhere ? 1 : numThreads);
    int size = (numZones == 1 ? Part::SIZE : ATTEMPTS_PER_BLOCK);
    parts.resize(size / Part::SIZE);
    statistics = SpeciesExchangeStatistics();
    Interruption interruption(size);
    for (long long first = 0; first < numAttempts; first += size) {
        if (interruption.isRequested())
            throw StepInterrupted();
        int count = min<long long>(size, numAttempts - first);
        makeBlock(first, count);
        if (observer)
            observe(observer);
    }
    if (statistics.accepted > 0) {
        forEachVertex([&](int v) { mesh.changeSpecies(order[v], species[v]); });
        mesh.markSpeciesChanged();
    }
    return statistics;
}

void CpuSpeciesExchange::makeBlock(long long firstAttempt, int numAttempts) {
    numBlocks++;
    numParts = (numAttempts + Part::SIZE - 1) / Part::SIZE;
    CpuThreads::forEach(numZones, numParts, [&](int n) {
        int first = n * Part::SIZE;
        draw(parts[n], firstAttempt + first, min(Part::SIZE, numAttempts - first));
    });
    SpeciesExchangeStatistics ofZones[MAX_ZONES + 1];
    CpuThreads::forEach(numZones, numZones, [&](int zone) {
        for (int n = 0; n < numParts; n++)
            decide(parts[n], zone, ofZones[zone]);
    });
    if (numZones > 1)
        for (int n = 0; n < numParts; n++)
            for (int i = 0; i < parts[n].numAttempts; i++)
                if (parts[n].attempts[i].isDeferred)
                    decide(parts[n].attempts[i], ofZones[numZones]);
    for (auto& statistics : ofZones) {
        this->statistics.accepted += statistics.accepted;
        this->statistics.alike += statistics.alike;
    }
    this->statistics.attempted += numAttempts;
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
    fill(part.counts, part.counts + numZones, 0);
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
        attempt.isDeferred = (zone == BORDER);
        for (int z = 0; z < numZones; z++) {
            part.lists[z][part.counts[z]] = n;
            part.counts[z] += (zone == z || zone == BORDER);
        }
    }
}

void CpuSpeciesExchange::decide(Part& part, int zone, SpeciesExchangeStatistics& statistics) {
    // What belongs to an attempt on the border may be changing now, in another zone.

    const int* list = part.lists[zone];
    int different[Part::SIZE], numDifferent = 0;
    for (int i = 0; i < part.counts[zone]; i++) {
        const Attempt& attempt = part.attempts[list[i]];
        different[numDifferent] = list[i];
        numDifferent += (!attempt.isDeferred && !isAlike(attempt));
    }
    for (int i = 0; i < numDifferent; i++)
        for (int vertex : getVertices(part.attempts[different[i]]))
            __builtin_prefetch(&vertices[vertex]);
    for (int i = 0; i < numDifferent; i++)
        for (int vertex : getVertices(part.attempts[different[i]]))
            prefetchRing(vertices[vertex].ring);
    for (int i = 0; i < part.counts[zone]; i++) {
        Attempt& attempt = part.attempts[list[i]];
        if (numZones > 1 && (attempt.isDeferred || isBlocked(attempt)))
            defer(attempt, zone);
        else
            decide(attempt, statistics);
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

void CpuSpeciesExchange::defer(Attempt& attempt, int zone) {
    // Nobody else looks at what blocks this zone, but all look at attempts on the border.

    if (!attempt.isDeferred)
        attempt.isDeferred = true;
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

void CpuSpeciesExchange::decide(Attempt& attempt, SpeciesExchangeStatistics& statistics) {
    bool isMutation = (proposal.kind == SpeciesProposal::Mutation);
    int from = species[attempt.first], to = (isMutation ? attempt.second : species[attempt.second]);
    attempt.isAccepted = false;
    statistics.alike += (from == to);
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
    statistics.accepted++;
    setSpecies(attempt.first, to);
    if (!isMutation)
        setSpecies(attempt.second, from);
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

double CpuSpeciesExchange::changeAt(int v, int from, int to, int other, int speciesOfOther) const {
    const Material &before = materials[from], &after = materials[to];
    const Vertex& vertex = vertices[v];
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
        Vector3<double> toN = displacement(x[v], x[around.ring[i]]), toM = displacement(x[v], x[around.ring[j]]);
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
