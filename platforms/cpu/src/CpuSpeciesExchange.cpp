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
 * The attempts of a block: as many as are worth drawing beforehand; on several threads more, but so few in a membrane
 * that few are evaluated twice.
 */
static const int MIN_ATTEMPTS_PER_BLOCK = 64, MAX_ATTEMPTS_PER_BLOCK = 1024, VERTICES_PER_ATTEMPT = 100;

/**
 * The attempts that a thread evaluates at a time.
 */
static const int ATTEMPTS_PER_PART = 32;

/**
 * The decisions of one thread do not keep more than these busy, and in a small membrane a block takes less time than
 * it would take to share it.
 */
static const int MAX_THREADS = 8, VERTICES_PER_THREAD = 12000;

/**
 * The number of vertices that a thread prepares at a time.
 */
static const int VERTICES_PER_PART = 256;

/**
 * The lengths of a ring that are asked for before they are needed, four to a cache line.
 */
static const int LENGTHS_AHEAD = 8;

static const int NONE = -1;

static int limitThreads(int numThreads, int numVertices) {
    return max(1, min({numThreads, MAX_THREADS, numVertices / VERTICES_PER_THREAD}));
}

CpuSpeciesExchange::CpuSpeciesExchange(HelfrichMesh& mesh, int numThreads)
        : mesh(mesh), numThreads(limitThreads(numThreads, mesh.getNumVertices())), vertices(mesh.getNumVertices()),
          species(mesh.getNumVertices()), rows(mesh.getNumVertices()), neighbors(mesh.getNumHalfedges()),
          revision(mesh.getRevision() - 1), random(0, 0), lastChanges(mesh.getNumVertices(), NONE) {
    int size = min(mesh.getNumVertices() / VERTICES_PER_ATTEMPT, MAX_ATTEMPTS_PER_BLOCK);
    for (Block& block : blocks)
        block.attempts.resize(this->numThreads == 1 ? MIN_ATTEMPTS_PER_BLOCK : max(size, MIN_ATTEMPTS_PER_BLOCK));
}

void CpuSpeciesExchange::prepare(const vector<Vec3>& positions, const HelfrichGeometry& geometry,
                                 const HelfrichParameters& parameters, const SpeciesProposal& proposal) {
    this->positions = &positions;
    this->proposal = proposal;
    p = parameters;
    prepareMaterials();
    prepareRings();
    lengths.resize(p.has(Term::Line) ? neighbors.size() : 0);
    CpuThreads::forEachPart(numThreads, mesh.getNumVertices(), VERTICES_PER_PART, [&](int begin, int end) {
        for (int v = begin; v < end; v++) {
            species[v] = mesh.getSpecies(v);
            rows[v] = materials[species[v]].row;
            prepareVertex(geometry, v);
        }
    });
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
    if (revision == mesh.getRevision())
        return;
    for (int v = 0, start = 0; v < mesh.getNumVertices(); v++) {
        vertices[v].ring = start;
        vertices[v].valence = mesh.valence(v);
        start += vertices[v].valence;
    }
    CpuThreads::forEachPart(numThreads, mesh.getNumVertices(), VERTICES_PER_PART, [&](int begin, int end) {
        for (int v = begin; v < end; v++)
            collectRing(v);
    });
    revision = mesh.getRevision();
}

void CpuSpeciesExchange::collectRing(int vertex) {
    // A ring begins at the vertex's lowest halfedge: which one the mesh has at hand depends on its past.

    int *ring = &neighbors[vertices[vertex].ring], *next = ring, *start = ring, lowest = mesh.outgoing(vertex);
    for (int h : mesh.outgoingHalfedges(vertex)) {
        start = (h < lowest ? next : start);
        lowest = min(h, lowest);
        *next++ = mesh.tip(h);
    }
    rotate(ring, start, next);
}

Vec3 CpuSpeciesExchange::edge(int from, int to) const {
    return (*positions)[mesh.getParticles()[to]] - (*positions)[mesh.getParticles()[from]];
}

void CpuSpeciesExchange::prepareVertex(const HelfrichGeometry& geometry, int v) {
    Vertex& vertex = vertices[v];
    if (p.has(Term::Bending)) {
        double A = geometry.vertexAreas[v], M = (A == 0 ? 0 : geometry.vertexMeanCurvatures[v]);
        vertex.factors = {A == 0 ? 0 : M * M / A, M, A, 0};
    }
    else
        vertex.factors = {};
    if (!p.has(Term::Line) && !p.hasGaussianForces())
        return;
    double defect = 2 * M_PI;
    const int* ring = &neighbors[vertex.ring];
    Vec3 spoke = edge(v, ring[0]);
    for (int i = 0; i < vertex.valence; i++) {
        Vec3 nextSpoke = edge(v, ring[i + 1 == vertex.valence ? 0 : i + 1]), link = nextSpoke - spoke;
        if (p.has(Term::Line))
            lengths[vertex.ring + i] = {sqrt(spoke.dot(spoke)), sqrt(link.dot(link))};
        if (p.hasGaussianForces()) {
            Vec3 normal = spoke.cross(nextSpoke);
            defect -= atan2(sqrt(normal.dot(normal)), spoke.dot(nextSpoke));
        }
        spoke = nextSpoke;
    }
    vertex.factors[3] = defect;
}

SpeciesExchangeStatistics CpuSpeciesExchange::execute(double kT, long long numAttempts, const Philox& random,
                                                      long long sweep, const Observer& observer) {
    this->kT = kT;
    this->random = random;
    this->sweep = sweep;
    this->observer = &observer;
    statistics = SpeciesExchangeStatistics();
    int size = blocks[0].attempts.size();
    long long numBlocks = (numAttempts + size - 1) / size;
    lastBlock += 2;
    Interruption interruption(size);
    for (long long n = 0; n <= numBlocks; n++) {
        if (interruption.isRequested())
            throw StepInterrupted();
        lastBlock++;
        Block &present = blocks[n % 2], &previous = blocks[(n + 1) % 2];
        present.firstAttempt = n * size;
        present.numAttempts = min<long long>(size, numAttempts - present.firstAttempt);
        int numParts = (max(present.numAttempts, 0) + ATTEMPTS_PER_PART - 1) / ATTEMPTS_PER_PART;
        CpuThreads::forEach(numThreads, numParts + 1, [&](int item) {
            if (item > 0)
                drawAttempts(present, (item - 1) * ATTEMPTS_PER_PART);
            else if (n > 0)
                decide(previous);
        });
    }
    if (statistics.accepted > 0)
        mesh.markSpeciesChanged();
    return statistics;
}

void CpuSpeciesExchange::drawAttempts(Block& block, int begin) {
    // In large membranes nearly everything is in no near cache: what is needed is asked for long before, step by step.

    int numAttempts = min(ATTEMPTS_PER_PART, block.numAttempts - begin);
    Attempt* attempts = &block.attempts[begin];
    for (int n = 0; n < numAttempts; n++) {
        attempts[n].draw = proposal.drawNumbers(random, sweep, block.firstAttempt + begin + n, mesh);
        if (proposal.kind == SpeciesProposal::Neighbors)
            prefetchTriangle(mesh.getArrays(), attempts[n].draw.first);
    }
    int different[ATTEMPTS_PER_PART], numDifferent = 0;
    for (int n = 0; n < numAttempts; n++) {
        attempts[n].draw = proposal.findVertices(attempts[n].draw, mesh);
        different[numDifferent] = n;
        numDifferent += !isAlike(attempts[n].draw);
    }
    for (int i = 0; i < numDifferent; i++)
        for (int vertex : getVertices(attempts[different[i]].draw))
            __builtin_prefetch(&vertices[vertex]);
    for (int i = 0; i < numDifferent; i++)
        for (int vertex : getVertices(attempts[different[i]].draw))
            prefetchRing(vertices[vertex].ring);
    if (numThreads > 1)
        for (int n = 0; n < numAttempts; n++)
            evaluate(attempts[n]);
}

void CpuSpeciesExchange::prefetchRing(int ring) const {
    __builtin_prefetch(&neighbors[ring]);
    if (!lengths.empty())
        for (int i = 0; i < LENGTHS_AHEAD; i += 4)
            __builtin_prefetch(&lengths[min<size_t>(ring + i, lengths.size() - 1)]);
}

bool CpuSpeciesExchange::isAlike(const SpeciesDraw& draw) const {
    bool isMutation = (proposal.kind == SpeciesProposal::Mutation);
    return species[draw.first] == (isMutation ? draw.second : int(species[draw.second]));
}

void CpuSpeciesExchange::evaluate(Attempt& attempt) const {
    const SpeciesDraw& draw = attempt.draw;
    bool isMutation = (proposal.kind == SpeciesProposal::Mutation);
    int from = species[draw.first], to = (isMutation ? draw.second : int(species[draw.second]));
    attempt.isAlike = (from == to);
    attempt.isAccepted = false;
    if (attempt.isAlike)
        return;
    attempt.change = changeAt(draw.first, from, to, NONE, 0);
    if (isMutation)
        attempt.change -= materials[to].chemicalPotential - materials[from].chemicalPotential;
    else
        attempt.change += changeAt(draw.second, to, from, draw.first, to);
    attempt.isAccepted = (attempt.change <= 0 || draw.uniform < exp(-attempt.change / kT));
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
        Vec3 toN = edge(v, around.ring[i]), toM = edge(v, around.ring[j]);
        auto energy = [&](int row) {
            if (row == n || n == m || m == row)
                return 0.0;
            auto piece = [&](int row1, int row2, const Vec3& median) {
                return 2 / 3.0 * halfTensions[row1 * numRows + row2] * sqrt(median.dot(median));
            };
            return piece(n, m, (toN + toM) * 0.5) + piece(row, n, toM - toN * 0.5) + piece(row, m, toN - toM * 0.5);
        };
        change += energy(b) - energy(a);
    }
    return change;
}

void CpuSpeciesExchange::decide(Block& block) {
    for (int n = 0; n < block.numAttempts; n++) {
        Attempt& attempt = block.attempts[n];
        if (numThreads == 1 || isStale(attempt.draw))
            evaluate(attempt);
        statistics.attempted++;
        statistics.alike += attempt.isAlike;
        if (attempt.isAccepted)
            accept(attempt);
    }
}

bool CpuSpeciesExchange::isStale(const SpeciesDraw& draw) const {
    // The block that is decided was evaluated while the one before it was decided.

    auto vertices = getVertices(draw);
    return max(lastChanges[vertices[0]], lastChanges[vertices[1]]) >= lastBlock - 2;
}

void CpuSpeciesExchange::accept(const Attempt& attempt) {
    const SpeciesDraw& draw = attempt.draw;
    statistics.accepted++;
    int before = species[draw.first];
    if (proposal.kind == SpeciesProposal::Mutation)
        setSpecies(draw.first, draw.second);
    else {
        setSpecies(draw.first, species[draw.second]);
        setSpecies(draw.second, before);
    }
    if (*observer)
        (*observer)(attempt.change);
}

void CpuSpeciesExchange::setSpecies(int vertex, int newSpecies) {
    mesh.changeSpecies(vertex, newSpecies);
    species[vertex] = newSpecies;
    rows[vertex] = materials[newSpecies].row;
    if (numThreads == 1)
        return;
    long long block = lastBlock - 1;
    lastChanges[vertex] = block;
    const int* ring = &neighbors[vertices[vertex].ring];
    for (int i = 0; i < vertices[vertex].valence; i++)
        lastChanges[ring[i]] = block;
}
