#include "openmmhelfrich/internal/EdgeFlipSweep.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include "openmmhelfrich/internal/InstructionSet.h"
#include <algorithm>
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * The number of batches of a block for each thread: so many that the threads rarely wait for each other.
 */
static const int BATCHES_PER_THREAD = 4;

/**
 * A block has at most one attempt for so many vertices, lest most of them be evaluated twice.
 */
static const int VERTICES_PER_ATTEMPT = 16;

EdgeFlipSweep::EdgeFlipSweep(HelfrichMesh& mesh, int numThreads) : mesh(mesh), evaluation(getEdgeFlipEvaluation()), numThreads(numThreads), block(0), random(0, 0),
        vertices(mesh.getNumVertices()), stamps(mesh.getNumVertices(), -1) {
    int maxAttempts = max(8, mesh.getNumVertices()/VERTICES_PER_ATTEMPT);
    int maxBatches = (numThreads == 1 ? 1 : BATCHES_PER_THREAD*numThreads);
    batchSize = min(maxAttempts, EdgeFlipBatch::SIZE);
    batches.resize(min(maxBatches, max(1, maxAttempts/batchSize)));
    this->numThreads = min(numThreads, (int) batches.size());
}

void EdgeFlipSweep::setPositions(const vector<Vec3>& positions, const HelfrichGeometry& geometry) {
    totals.area = geometry.area;
    totals.volume = geometry.volume;
    totals.curvature = geometry.integratedMeanCurvature;
    const vector<int>& particles = mesh.getParticles();
    #pragma omp parallel for schedule(static) num_threads(numThreads)
    for (int v = 0; v < mesh.getNumVertices(); v++) {
        const Vec3& x = positions[particles[v]];
        vertices[v] = {x[0], x[1], x[2], geometry.vertexAreas[v], geometry.vertexMeanCurvatures[v]};
    }
}

EdgeFlipStatistics EdgeFlipSweep::execute(const HelfrichParameters& parameters, double kT, long long numAttempts, const Philox& random, long long sweep,
                                          const Observer& observer) {
    p = parameters;
    this->kT = kT;
    this->random = random;
    this->sweep = sweep;
    this->observer = &observer;
    exception = NULL;
    statistics = EdgeFlipStatistics();
    long long attemptsPerBlock = batchSize*(long long) batches.size();
    #pragma omp parallel num_threads(numThreads)
    for (long long first = 0; first < numAttempts; first += attemptsPerBlock) {
        int numBatches = min((long long) batches.size(), (numAttempts-first+batchSize-1)/batchSize);
        #pragma omp for schedule(static)
        for (int i = 0; i < numBatches; i++) {
            long long firstAttempt = first+i*(long long) batchSize;
            batches[i].numAttempts = min((long long) batchSize, numAttempts-firstAttempt);
            prepare(batches[i], firstAttempt);
        }
        #pragma omp master
        decideBlock(numBatches);
        #pragma omp barrier
    }
    if (exception)
        rethrow_exception(exception);
    if (statistics.accepted > 0)
        mesh.markChanged();
    return statistics;
}

void EdgeFlipSweep::prepare(EdgeFlipBatch& batch, long long firstAttempt) const {
    evaluation.draw(random, sweep, firstAttempt, mesh.getNumHalfedges(), batch);
    findTriangles(batch);
    for (int n = 0; n < batch.numAttempts; n++)
        findStencil(batch, n);
    findForbidden(batch, 0, batch.numAttempts);
    evaluate(batch, 0, batch.numAttempts);
}

void EdgeFlipSweep::findTriangles(EdgeFlipBatch& batch) const {
    // Data of many attempts on its way from memory at the same time is what makes large membranes fast.

    for (int n = 0; n < batch.numAttempts; n++)
        mesh.prefetch(batch.halfedge[n]);
    for (int n = 0; n < batch.numAttempts; n++)
        mesh.prefetch(mesh.opposite(batch.halfedge[n]));
    for (int n = 0; n < batch.numAttempts; n++) {
        int h = batch.halfedge[n], o = mesh.opposite(h);
        for (int rim : {mesh.next(h), mesh.previous(h), mesh.next(o), mesh.previous(o)}) {
            mesh.prefetch(mesh.opposite(rim));
            __builtin_prefetch(&vertices[mesh.origin(rim)]);
        }
    }
}

void EdgeFlipSweep::findStencil(EdgeFlipBatch& batch, int n) const {
    int h = batch.halfedge[n], o = mesh.opposite(h);
    int rim[4] = {mesh.next(h), mesh.previous(h), mesh.next(o), mesh.previous(o)};
    batch.vertex[0][n] = mesh.origin(h);
    batch.vertex[1][n] = mesh.origin(o);
    batch.vertex[2][n] = mesh.origin(rim[1]);
    batch.vertex[3][n] = mesh.origin(rim[3]);
    for (int side = 0; side < 4; side++) {
        int outer = mesh.apex(mesh.opposite(rim[side]));
        batch.vertex[4+side][n] = outer;
        __builtin_prefetch(&vertices[outer]);
    }
}

void EdgeFlipSweep::findForbidden(EdgeFlipBatch& batch, int first, int last) const {
    // The vertices k and l may not be bonded already.  Of all attempts at the same time, go around the one with fewer neighbors, from j on: i and j are known.  Who is
    // around before the others goes on, for it costs less than to stop.

    int halfedge[EdgeFlipBatch::SIZE], wanted[EdgeFlipBatch::SIZE], maxSteps = 0;
    for (int n = first; n < last; n++) {
        int h = batch.halfedge[n], o = mesh.opposite(h), k = batch.vertex[2][n], l = batch.vertex[3][n];
        bool aroundK = mesh.valence(k) <= mesh.valence(l);
        halfedge[n] = mesh.opposite(aroundK ? mesh.next(h) : mesh.next(o));
        wanted[n] = (aroundK ? l : k);
        maxSteps = max(maxSteps, mesh.valence(aroundK ? k : l)-2);
        batch.isForbidden[n] = (mesh.isFixed(h) || mesh.valence(batch.vertex[0][n]) <= 3 || mesh.valence(batch.vertex[1][n]) <= 3);
    }
    for (int step = 0; step < maxSteps; step++)
        for (int n = first; n < last; n++) {
            batch.isForbidden[n] |= (mesh.apex(halfedge[n]) == wanted[n]);
            halfedge[n] = mesh.rotate(halfedge[n]);
        }
}

void EdgeFlipSweep::evaluate(EdgeFlipBatch& batch, int first, int last) const {
    evaluation.evaluate(p, vertices.data(), batch, first, last);
    if (hasRepulsion()) {
        findClosePairs(batch, first, last);
        for (int n = first; n < last; n++)
            batch.repulsion[n] = repulsionChange(batch, n);
    }
}

void EdgeFlipSweep::decideBlock(int numBatches) {
    block++;
    isBlockChanged = false;
    try {
        for (int i = 0; i < numBatches && !exception; i++)
            for (int n = 0; n < batches[i].numAttempts; n++) {
                if (i+1 < numBatches)
                    __builtin_prefetch(reinterpret_cast<const char*>(&batches[i+1])+64*n);
                decide(batches[i], n);
            }
    }
    catch (...) {
        exception = current_exception();
    }
}

void EdgeFlipSweep::decide(EdgeFlipBatch& batch, int n) {
    if (isBlockChanged && isStale(batch, n)) {
        findStencil(batch, n);
        findForbidden(batch, n, n+1);
        evaluate(batch, n, n+1);
    }
    else if (isBlockChanged && hasRepulsion() && batch.hasClosePairs[n])
        batch.repulsion[n] = repulsionChange(batch, n);
    statistics.attempted++;
    if (batch.isForbidden[n]) {
        statistics.forbidden++;
        return;
    }
    double energy = batch.energy[n]+penaltyChange(batch, n)+(hasRepulsion() ? batch.repulsion[n] : 0);
    if (energy <= 0 || batch.uniform[n] < exp(-energy/kT))
        accept(batch, n, energy);
}

bool EdgeFlipSweep::isStale(const EdgeFlipBatch& batch, int n) const {
    for (int i = 0; i < 4; i++)
        if (stamps[batch.vertex[i][n]] == block)
            return true;
    return false;
}

void EdgeFlipSweep::accept(const EdgeFlipBatch& batch, int n, double energy) {
    for (int i = 0; i < 4; i++) {
        EdgeFlipVertex& vertex = vertices[batch.vertex[i][n]];
        vertex.area += batch.vertexArea[i][n];
        if (p.needsCurvature())
            vertex.curvature += batch.vertexCurvature[i][n];
        stamps[batch.vertex[i][n]] = block;
    }
    totals.area += batch.area[n];
    totals.volume += batch.volume[n];
    totals.curvature += batch.curvature[n];
    isBlockChanged = true;
    mesh.flip(batch.halfedge[n]);
    statistics.accepted++;
    if (*observer)
        (*observer)(energy);
}

double EdgeFlipSweep::penaltyChange(const EdgeFlipBatch& batch, int n) const {
    // (x+d)^2-x^2 = d (2x+d): the small change does not come from the difference of two large energies.

    auto change = [] (double modulus, double before, double difference, double target) {
        return modulus == 0 ? 0 : modulus*(difference/target)*(2*(before/target-1)+difference/target);
    };
    double h = p.leafletSeparation;
    return change(p.areaModulus, totals.area, batch.area[n], p.targetArea)+
           change(p.volumeModulus, totals.volume, batch.volume[n], p.targetVolume)+
           change(p.areaDifferenceModulus, 2*h*totals.curvature, 2*h*batch.curvature[n], p.targetAreaDifference);
}

bool EdgeFlipSweep::hasRepulsion() const {
    return p.repulsionModulus != 0 && p.repulsionExclusionLevel != 0;
}

void EdgeFlipSweep::findClosePairs(EdgeFlipBatch& batch, int first, int last) const {
    // A flip changes whether pairs of one of its vertices and a neighbor of the opposite one are excluded.  Hardly any of them is so close that it matters.

    fill(batch.hasClosePairs+first, batch.hasClosePairs+last, false);
    if (p.repulsionExclusionLevel < 2)
        return;
    for (int corner = 0; corner < 4; corner++) {
        // Go around the vertex opposite to the corner, in all attempts at the same time, past those of its neighbors that belong to the flip.

        int halfedge[EdgeFlipBatch::SIZE], steps[EdgeFlipBatch::SIZE], active[EdgeFlipBatch::SIZE], numActive = 0;
        for (int n = first; n < last; n++) {
            int h = batch.halfedge[n], o = mesh.opposite(h), center = batch.vertex[corner^1][n];
            halfedge[n] = (corner == 0 ? mesh.rotate(o) : corner == 1 ? mesh.rotate(h) : mesh.opposite(mesh.next(corner == 2 ? o : h)));
            steps[n] = mesh.valence(center)-(corner < 2 ? 3 : 2);
            active[numActive] = n;
            numActive += (steps[n] > 0);
        }
        while (numActive > 0) {
            int numLeft = 0;
            for (int m = 0; m < numActive; m++) {
                int n = active[m];
                batch.hasClosePairs[n] |= (distance2(batch.vertex[corner][n], mesh.apex(halfedge[n])) < p.repulsionOnset*p.repulsionOnset);
                halfedge[n] = mesh.rotate(halfedge[n]);
                active[numLeft] = n;
                numLeft += (--steps[n] > 0);
            }
            numActive = numLeft;
        }
    }
}

double EdgeFlipSweep::repulsionChange(const EdgeFlipBatch& batch, int n) const {
    int i = batch.vertex[0][n], j = batch.vertex[1][n], k = batch.vertex[2][n], l = batch.vertex[3][n];
    if (p.repulsionExclusionLevel == 1)
        return pairEnergy(i, j)-pairEnergy(k, l);
    if (!batch.hasClosePairs[n])
        return 0;
    int h = batch.halfedge[n], o = mesh.opposite(h);
    return repulsionOfPairsSeparated(h)+repulsionOfPairsSeparated(o)-repulsionOfPairsJoined(k, mesh.previous(o))-repulsionOfPairsJoined(l, mesh.previous(h));
}

double EdgeFlipSweep::repulsionOfPairsSeparated(int h) const {
    // The flip removes the edge i-j, and with it the path from i over j to each neighbor of j.

    int i = mesh.origin(h), j = mesh.tip(h), k = mesh.apex(h), l = mesh.apex(mesh.opposite(h));
    double sum = 0;
    int first = mesh.opposite(h);
    for (int g = mesh.rotate(first); g != first; g = mesh.rotate(g)) {
        int other = mesh.tip(g);
        if (other == k || other == l)
            continue;
        double energy = pairEnergy(i, other);
        if (energy != 0 && !isExcludedWithout(i, other, j))
            sum += energy;
    }
    return sum;
}

double EdgeFlipSweep::repulsionOfPairsJoined(int vertex, int outgoing) const {
    // The flip bonds the vertex to the origin of the outgoing halfedge, and so makes a path from it to each neighbor of that origin.

    double sum = 0;
    int g = outgoing;
    do {
        int other = mesh.tip(g);
        double energy = pairEnergy(vertex, other);
        if (energy != 0 && !mesh.areExcluded(vertex, other, 2))
            sum += energy;
        g = mesh.rotate(g);
    } while (g != outgoing);
    return sum;
}

bool EdgeFlipSweep::isExcludedWithout(int vertex, int other, int removedNeighbor) const {
    int first = mesh.outgoing(vertex), h = first;
    do {
        int neighbor = mesh.tip(h);
        if (neighbor == other || (neighbor != removedNeighbor && mesh.areBonded(neighbor, other)))
            return true;
        h = mesh.rotate(h);
    } while (h != first);
    return false;
}

double EdgeFlipSweep::distance2(int vertex1, int vertex2) const {
    const EdgeFlipVertex& a = vertices[vertex1], &b = vertices[vertex2];
    Vector3<double> d = {b.x-a.x, b.y-a.y, b.z-a.z};
    return dot(d, d);
}

double EdgeFlipSweep::pairEnergy(int vertex1, int vertex2) const {
    double r2 = distance2(vertex1, vertex2), slope;
    if (r2 >= p.repulsionOnset*p.repulsionOnset)
        return 0;
    return 2*p.repulsionModulus*repulsionPotential(sqrt(r2), p.repulsionOnset, p.repulsionExponent, slope);
}

namespace HelfrichPlugin {

extern const EdgeFlipEvaluation edgeFlipEvaluationBaseline, edgeFlipEvaluationAVX2, edgeFlipEvaluationAVX512;

const EdgeFlipEvaluation& getEdgeFlipEvaluation() {
    switch (getInstructionSet()) {
#ifdef HELFRICH_HAS_AVX512
        case InstructionSet::AVX512:
            return edgeFlipEvaluationAVX512;
#endif
#ifdef HELFRICH_HAS_AVX2
        case InstructionSet::AVX2:
            return edgeFlipEvaluationAVX2;
#endif
        default:
            return edgeFlipEvaluationBaseline;
    }
}

} // namespace HelfrichPlugin
