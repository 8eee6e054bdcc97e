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

static const int NONE = -1;

/**
 * A block has at most one attempt for so many vertices, lest most of them be evaluated twice.
 */
static const int VERTICES_PER_ATTEMPT = 16;

EdgeFlipSweep::EdgeFlipSweep(HelfrichMesh& mesh, int numThreads) : mesh(mesh), evaluation(getEdgeFlipEvaluation()), numThreads(numThreads), random(0, 0),
        vertices(mesh.getNumVertices()), lastFlips(mesh.getNumVertices(), NONE) {
    int maxAttempts = max(8, mesh.getNumVertices()/VERTICES_PER_ATTEMPT);
    int maxBatches = (numThreads == 1 ? 1 : BATCHES_PER_THREAD*numThreads);
    batchSize = min(maxAttempts, EdgeFlipBatch::SIZE);
    batches.resize(min(maxBatches, max(1, maxAttempts/batchSize)));
    this->numThreads = min(numThreads, (int) batches.size());
}

void EdgeFlipSweep::setPositions(const vector<Vec3>& positions, const HelfrichGeometry& geometry, HelfrichNeighborList* neighbors) {
    this->neighbors = neighbors;
    totals.area = geometry.area;
    totals.volume = geometry.volume;
    totals.curvature = geometry.integratedMeanCurvature;
    const vector<int>& particles = mesh.getParticles();
    #pragma omp parallel for schedule(static) num_threads(numThreads)
    for (int v = 0; v < mesh.getNumVertices(); v++) {
        const Vec3& x = positions[particles[v]];
        vertices[v] = {x[0], x[1], x[2], geometry.vertexAreas[v], geometry.vertexMeanCurvatures[v], neighbors == NULL ? 0 : neighbors->lists[v].start, 0};
    }
}

EdgeFlipStatistics EdgeFlipSweep::execute(const HelfrichParameters& parameters, double kT, long long numAttempts, const Philox& random, long long sweep,
                                          const Observer& observer) {
    p = parameters;
    this->kT = kT;
    this->random = random;
    this->sweep = sweep;
    this->observer = &observer;
    updatePenalties();
    exception = NULL;
    statistics = EdgeFlipStatistics();
    long long attemptsPerBlock = batchSize*(long long) batches.size();
    bool isNeighborListNeeded = needsNeighborList(p);
    if (isNeighborListNeeded) {
        #pragma omp parallel for schedule(static) num_threads(numThreads)
        for (int v = 0; v < mesh.getNumVertices(); v++)
            findClosePartners(v);
    }
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
        #pragma omp for schedule(static)
        for (int i = 0; i < numBatches; i++)
            carryOut(batches[i]);
    }
    if (exception)
        rethrow_exception(exception);
    if (statistics.accepted > 0)
        mesh.markChanged();
    if (isNeighborListNeeded)
        neighbors->revision = mesh.getRevision();
    return statistics;
}

void EdgeFlipSweep::prepare(EdgeFlipBatch& batch, long long firstAttempt) const {
    evaluation.draw(random, sweep, firstAttempt, mesh.getNumHalfedges(), batch);
    findTriangles(batch);
    for (int n = 0; n < batch.numAttempts; n++)
        findStencil(batch, n);
    for (int n = 0; n < batch.numAttempts; n++)
        batch.attempts[n].threshold = -kT*log(batch.uniform[n]);
    findForbidden(batch, 0, batch.numAttempts);
    evaluate(batch, 0, batch.numAttempts);
    batch.waiting = 0;
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

namespace {

/**
 * Walks around vertices to see if they are bonded to others.  All go on at the same time, and those that are around before the others begin again: no branch depends on a valence,
 * which no processor could predict.
 */
class Walks {
public:
    static const int MAX = EdgeFlipBatch::SIZE;
    /**
     * Begin a walk.
     *
     * @param halfedge  starts from the vertex to go around; its apex is the first neighbor on the way
     * @param numSteps  the number of neighbors to see
     * @param wanted    the vertex to look for
     */
    void begin(int halfedge, int numSteps, int wanted) {
        halfedges[count] = halfedge;
        this->wanted[count] = wanted;
        isFound[count++] = false;
        maxSteps = max(maxSteps, numSteps);
    }
    void finish(const HelfrichMesh& mesh) {
        for (int step = 0; step < maxSteps; step++)
            for (int n = 0; n < count; n++) {
                isFound[n] |= (mesh.apex(halfedges[n]) == wanted[n]);
                halfedges[n] = mesh.rotate(halfedges[n]);
            }
    }
    void clear() {
        count = maxSteps = 0;
    }
    bool isFound[MAX];
    int count = 0;
private:
    int halfedges[MAX], wanted[MAX], maxSteps = 0;
};

} // namespace

void EdgeFlipSweep::findForbidden(EdgeFlipBatch& batch, int first, int last) const {
    // The vertices k and l may not be bonded already.  Go around the one with fewer neighbors, from j on: i and j are known.

    Walks walks;
    for (int n = first; n < last; n++) {
        int h = batch.halfedge[n], o = mesh.opposite(h), k = batch.vertex[2][n], l = batch.vertex[3][n];
        if (mesh.valence(k) <= mesh.valence(l))
            walks.begin(mesh.opposite(mesh.next(h)), mesh.valence(k)-2, l);
        else
            walks.begin(mesh.opposite(mesh.next(o)), mesh.valence(l)-2, k);
        batch.attempts[n].isForbidden = (mesh.isFixed(h) || mesh.valence(batch.vertex[0][n]) <= 3 || mesh.valence(batch.vertex[1][n]) <= 3);
    }
    walks.finish(mesh);
    for (int n = first; n < last; n++)
        batch.attempts[n].isForbidden |= walks.isFound[n-first];
}

void EdgeFlipSweep::evaluate(EdgeFlipBatch& batch, int first, int last) const {
    evaluation.evaluate(p, vertices.data(), batch, first, last);
    for (int n = first; n < last; n++) {
        EdgeFlipAttempt& attempt = batch.attempts[n];
        attempt.energy = batch.energy[n];
        attempt.area = batch.area[n];
        attempt.volume = batch.volume[n];
        attempt.curvature = batch.curvature[n];
        for (int i = 0; i < 4; i++)
            attempt.vertex[i] = batch.vertex[i][n];
        attempt.dependsOnPartners = false;
    }
    if (needsNeighborList(p))
        findRepulsion(batch, first, last);
    else if (p.repulsionModulus != 0 && p.repulsionExclusionLevel == 1)
        for (int n = first; n < last; n++)
            batch.attempts[n].energy += pairEnergy(batch.vertex[0][n], batch.vertex[1][n])-pairEnergy(batch.vertex[2][n], batch.vertex[3][n]);
}

void EdgeFlipSweep::decideBlock(int numBatches) {
    try {
        for (int i = 0; i < numBatches && !exception; i++)
            for (int n = 0; n < batches[i].numAttempts; n++) {
                if (i+1 < numBatches)
                    __builtin_prefetch(&batches[i+1].attempts[n]);
                decide(i*EdgeFlipBatch::SIZE+n);
            }
    }
    catch (...) {
        exception = current_exception();
    }
    for (int attempt : flips)
        for (int vertex : getAttempt(attempt).vertex)
            lastFlips[vertex] = NONE;
    flips.clear();
}

void EdgeFlipSweep::decide(int index) {
    EdgeFlipBatch& batch = batches[index/EdgeFlipBatch::SIZE];
    EdgeFlipAttempt& attempt = getAttempt(index);
    if (isStale(attempt))
        renew(batch, index%EdgeFlipBatch::SIZE);
    statistics.attempted++;
    if (attempt.isForbidden) {
        statistics.forbidden++;
        return;
    }
    double energy = attempt.energy+areaPenalty.change(attempt.area)+volumePenalty.change(attempt.volume)+areaDifferencePenalty.change(attempt.curvature);
    if (energy <= 0 || energy < attempt.threshold)
        accept(index, energy);
}

bool EdgeFlipSweep::isStale(const EdgeFlipAttempt& attempt) const {
    // NONE has all bits.

    const int* v = attempt.vertex;
    return (lastFlips[v[0]]&lastFlips[v[1]]&lastFlips[v[2]]&lastFlips[v[3]]) != NONE || (attempt.dependsOnPartners && isPartnerFlipped(attempt));
}

bool EdgeFlipSweep::isPartnerFlipped(const EdgeFlipAttempt& attempt) const {
    for (int vertex : attempt.vertex)
        for (int n = 0; n < vertices[vertex].numClose; n++)
            if (lastFlips[partnersOf(vertex)[n]] != NONE)
                return true;
    return false;
}

void EdgeFlipSweep::renew(EdgeFlipBatch& batch, int n) {
    bool isChanged;
    do {
        findStencil(batch, n);
        isChanged = false;
        for (int i = 0; i < 4; i++)
            isChanged |= carryOutAt(batch.vertex[i][n]);
    } while (isChanged);
    for (int i = 0; i < 4; i++) {
        int vertex = batch.vertex[i][n];
        for (int m = 0; m < vertices[vertex].numClose; m++)
            carryOutAt(partnersOf(vertex)[m]);
    }
    findForbidden(batch, n, n+1);
    evaluate(batch, n, n+1);
}

bool EdgeFlipSweep::carryOutAt(int vertex) {
    int flip = lastFlips[vertex];
    if (flip == NONE)
        return false;
    EdgeFlipBatch& batch = batches[flip/EdgeFlipBatch::SIZE];
    uint64_t bit = uint64_t(1)<<flip%EdgeFlipBatch::SIZE;
    if ((batch.waiting&bit) == 0)
        return false;
    batch.waiting ^= bit;
    carryOut(batch, flip%EdgeFlipBatch::SIZE);
    return true;
}

void EdgeFlipSweep::accept(int index, double energy) {
    const EdgeFlipAttempt& attempt = getAttempt(index);
    totals.area += attempt.area;
    totals.volume += attempt.volume;
    totals.curvature += attempt.curvature;
    updatePenalties();
    for (int vertex : attempt.vertex)
        lastFlips[vertex] = index;
    flips.push_back(index);
    batches[index/EdgeFlipBatch::SIZE].waiting |= uint64_t(1)<<index%EdgeFlipBatch::SIZE;
    statistics.accepted++;
    if (*observer)
        (*observer)(energy);
}

void EdgeFlipSweep::carryOut(EdgeFlipBatch& batch) {
    for (uint64_t bits = batch.waiting; bits != 0; bits &= bits-1)
        carryOut(batch, __builtin_ctzll(bits));
}

void EdgeFlipSweep::carryOut(const EdgeFlipBatch& batch, int n) {
    for (int i = 0; i < 4; i++) {
        EdgeFlipVertex& vertex = vertices[batch.vertex[i][n]];
        vertex.area += batch.vertexArea[i][n];
        if (p.needsCurvature())
            vertex.curvature += batch.vertexCurvature[i][n];
    }
    if (needsNeighborList(p)) {
        int i = batch.vertex[0][n], j = batch.vertex[1][n], k = batch.vertex[2][n], l = batch.vertex[3][n];
        setApart(i, j);
        setApart(j, i);
        setBonded(k, l);
        setBonded(l, k);
    }
    mesh.flip(batch.halfedge[n]);
}

void EdgeFlipSweep::updatePenalties() {
    auto update = [] (Penalty& penalty, double modulus, double total, double target) {
        penalty = {modulus, modulus == 0 ? 0 : 1/target, modulus == 0 ? 0 : total/target-1};
    };
    update(areaPenalty, p.areaModulus, totals.area, p.targetArea);
    update(volumePenalty, p.volumeModulus, totals.volume, p.targetVolume);
    update(areaDifferencePenalty, p.areaDifferenceModulus, totals.curvature, p.targetAreaDifference/(2*p.leafletSeparation));
}

double EdgeFlipSweep::Penalty::change(double difference) const {
    // (x+d)^2-x^2 = d (2x+d): the small change does not come from the difference of two large energies.

    double relative = difference*inverseTarget;
    return modulus*relative*(2*deviation+relative);
}

/**
 * Pairs of a flip's vertex and a vertex that is close to it, and the walks that tell whether this one is bonded to the vertex opposite in the flip.
 */
struct EdgeFlipSweep::ClosePairs {
    Walks walks;
    int attempt[Walks::MAX], corner[Walks::MAX], partner[Walks::MAX];
};

void EdgeFlipSweep::findRepulsion(EdgeFlipBatch& batch, int first, int last) const {
    // Few vertices are close to any that they are not bonded to.

    ClosePairs pairs;
    for (int n = first; n < last; n++) {
        for (int corner = 0; corner < 4; corner++) {
            int vertex = batch.vertex[corner][n], middle = batch.vertex[corner^1][n];
            for (int m = 0; m < vertices[vertex].numClose; m++) {
                int partner = partnersOf(vertex)[m];
                bool aroundPartner = (mesh.valence(partner) <= mesh.valence(middle));
                int center = (aroundPartner ? partner : middle);
                pairs.attempt[pairs.walks.count] = n;
                pairs.corner[pairs.walks.count] = corner;
                pairs.partner[pairs.walks.count] = partner;
                pairs.walks.begin(mesh.outgoing(center), mesh.valence(center), aroundPartner ? middle : partner);
                if (pairs.walks.count == Walks::MAX)
                    addRepulsion(batch, pairs);
            }
        }
    }
    addRepulsion(batch, pairs);
}

void EdgeFlipSweep::addRepulsion(EdgeFlipBatch& batch, ClosePairs& pairs) const {
    // The flip takes from i and j, and gives to k and l, the paths to the neighbors of the opposite vertex.  It matters where there is no other path of two edges.

    pairs.walks.finish(mesh);
    for (int m = 0; m < pairs.walks.count; m++)
        if (pairs.walks.isFound[m]) {
            int n = pairs.attempt[m], corner = pairs.corner[m], vertex = batch.vertex[corner][n];
            batch.attempts[n].dependsOnPartners = true;
            if (!shareOtherNeighbor(batch.vertex[corner^1][n], vertex, pairs.partner[m]))
                batch.attempts[n].energy += (corner < 2 ? 1 : -1)*pairEnergy(vertex, pairs.partner[m]);
        }
    pairs.walks.clear();
}

bool EdgeFlipSweep::shareOtherNeighbor(int middle, int vertex1, int vertex2) const {
    int first = mesh.outgoing(vertex1), h = first;
    do {
        if (mesh.tip(h) != middle && mesh.areBonded(mesh.tip(h), vertex2))
            return true;
        h = mesh.rotate(h);
    } while (h != first);
    return false;
}

void EdgeFlipSweep::findClosePartners(int vertex) {
    int *partners = partnersOf(vertex), numClose = 0;
    for (int n = 0; n < neighbors->lists[vertex].numApart; n++)
        if (distance2(vertex, partners[n]) < p.repulsionOnset*p.repulsionOnset)
            swap(partners[n], partners[numClose++]);
    sort(partners, partners+numClose);
    vertices[vertex].numClose = numClose;
}

static int* findPartner(int* first, int* last, int partner) {
    // It costs less to look at all than to stop.

    int* found = last;
    for (int* other = first; other != last; other++)
        found = (*other == partner ? other : found);
    return found;
}

void EdgeFlipSweep::setApart(int vertex, int other) {
    HelfrichNeighborList::List& list = neighbors->lists[vertex];
    int &numClose = vertices[vertex].numClose, *partners = partnersOf(vertex), *end = partners+list.numPartners, *found = findPartner(partners+list.numApart, end, other);
    if (found == end)
        return;
    swap(*found, partners[list.numApart]);
    if (distance2(vertex, other) < p.repulsionOnset*p.repulsionOnset) {
        swap(partners[numClose], partners[list.numApart]);
        inplace_merge(partners, partners+numClose, partners+numClose+1);
        numClose++;
    }
    list.numApart++;
}

void EdgeFlipSweep::setBonded(int vertex, int other) {
    HelfrichNeighborList::List& list = neighbors->lists[vertex];
    int &numClose = vertices[vertex].numClose, *partners = partnersOf(vertex), *end = partners+list.numApart, *found = findPartner(partners, end, other);
    if (found == end)
        return;
    if (found < partners+numClose) {
        rotate(found, found+1, partners+numClose);
        found = partners+--numClose;
    }
    swap(*found, partners[--list.numApart]);
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
