#include "openmmhelfrich/internal/EdgeFlipSweep.h"
#include "openmmhelfrich/internal/InstructionSet.h"
#include <algorithm>
#include <cmath>
#include <omp.h>
#include <thread>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * The number of batches in the pipeline for each thread: so many that the threads rarely wait for each other.
 */
static const int BATCHES_PER_THREAD = 4;

/**
 * A thread has at most one attempt for so many vertices under way, lest most of them be evaluated twice.
 */
static const int VERTICES_PER_ATTEMPT = 16;

/**
 * The decisions of one thread do not keep more than these busy, and each has a copy of the membrane.
 */
static const int MAX_THREADS = 8;

/**
 * How often a thread that waits looks whether it can go on, before it lets others have the processor in between.
 */
static const int MAX_TRIES = 1000;

/**
 * How long before its decision an attempt is asked for: another thread's cache may have it.
 */
static const int ATTEMPTS_AHEAD = 8;

static const int NONE = -1;

static int limitThreads(int numThreads, int numVertices) {
    return max(1, min({numThreads, MAX_THREADS, numVertices/(VERTICES_PER_ATTEMPT*EdgeFlipBatch::SIZE)}));
}

EdgeFlipSweep::EdgeFlipSweep(HelfrichMesh& mesh, int numThreads) : mesh(mesh), evaluation(getEdgeFlipEvaluation()), numThreads(limitThreads(numThreads, mesh.getNumVertices())),
        random(0, 0), state(mesh), slots(this->numThreads == 1 ? 1 : BATCHES_PER_THREAD*this->numThreads), lastFlips(mesh.getNumVertices()) {
    batchSize = min(max(8, mesh.getNumVertices()/VERTICES_PER_ATTEMPT), EdgeFlipBatch::SIZE);
    for (int i = 1; i < this->numThreads; i++)
        helpers.emplace_back(new Helper(mesh));
}

void EdgeFlipSweep::setPositions(const vector<Vec3>& positions, const HelfrichGeometry& geometry, HelfrichNeighborList* neighbors) {
    this->neighbors = neighbors;
    totals.area = geometry.area;
    totals.volume = geometry.volume;
    totals.curvature = geometry.integratedMeanCurvature;
    state.setNeighbors(neighbors);
    const int CHUNK = 256, numVertices = mesh.getNumVertices();
    #pragma omp parallel for schedule(static) num_threads(numThreads)
    for (int begin = 0; begin < numVertices; begin += CHUNK) {
        // To gather them once for the states of all threads takes less time than to let each thread fill its own.
        int end = min(begin+CHUNK, numVertices);
        state.setPositions(positions, geometry, begin, end);
        for (auto& helper : helpers)
            helper->state.setPositions(state, begin, end);
    }
}

EdgeFlipStatistics EdgeFlipSweep::execute(const HelfrichParameters& parameters, double kT, long long numAttempts, const Philox& random, long long sweep,
                                          const Observer& observer) {
    p = parameters;
    this->kT = kT;
    this->numAttempts = numAttempts;
    this->random = random;
    this->sweep = sweep;
    this->observer = &observer;
    updatePenalties();
    exception = NULL;
    statistics = EdgeFlipStatistics();
    numBatches = (numAttempts+batchSize-1)/batchSize;
    numClaimed = numDecided = 0;
    for (Slot& slot : slots)
        slot.evaluated = NONE;
    fill(lastFlips.begin(), lastFlips.end(), NONE);
    state.setParameters(p);
    #pragma omp parallel num_threads(numThreads)
    {
        int thread = omp_get_thread_num();
        if (thread == 0)
            numHelpers = omp_get_num_threads()-1;
        else
            prepare(*helpers[thread-1]);
        #pragma omp barrier
        if (needsNeighborList(p))
            (thread == 0 ? state : helpers[thread-1]->state).findClosePartners();
        if (thread == 0)
            decideAll();
        else
            help(*helpers[thread-1]);
    }
    if (exception)
        rethrow_exception(exception);
    if (needsNeighborList(p))
        neighbors->revision = mesh.getRevision();
    return statistics;
}

void EdgeFlipSweep::prepare(Helper& helper) const {
    // A helper has carried out all flips of earlier sweeps, but does not know of triangles that were replaced, nor of partners that were found anew or divided since.

    if (helper.mesh.getRevision() != mesh.getRevision())
        helper.mesh = mesh;
    helper.state.setParameters(p);
    if (needsNeighborList(p) && (helper.neighbors.numBuilds != neighbors->numBuilds || helper.neighbors.revision != mesh.getRevision()))
        helper.neighbors = *neighbors;
    helper.numSeen = 0;
}

static void waitForOthers(int& tries) {
    if (tries < MAX_TRIES)
        tries++;
    else
        this_thread::yield();
}

void EdgeFlipSweep::decideAll() {
    for (int batch = 0; batch < numBatches; batch++) {
        int tries = 0;
        while (getSlot(batch).evaluated.load(memory_order_acquire) != batch)
            if (!evaluateNext(state, batch))
                waitForOthers(tries);
        decide(batch);
        numDecided.store(batch+1, memory_order_release);
    }
    if (statistics.accepted > 0)
        mesh.markChanged();
}

void EdgeFlipSweep::help(Helper& helper) {
    int numSeen = 0, tries = 0;
    while (numSeen < numBatches) {
        for (int end = numDecided.load(memory_order_acquire); numSeen < end; numSeen++) {
            const Slot& slot = getSlot(numSeen);
            for (uint64_t bits = slot.accepted; bits != 0; bits &= bits-1)
                helper.state.carryOut(slot.batch, __builtin_ctzll(bits));
        }
        helper.numSeen.store(numSeen, memory_order_release);
        if (evaluateNext(helper.state, numSeen))
            tries = 0;
        else
            waitForOthers(tries);
    }
    if (statistics.accepted > 0)
        helper.mesh.markChanged();
    if (needsNeighborList(p))
        helper.neighbors.revision = helper.mesh.getRevision();
}

bool EdgeFlipSweep::evaluateNext(const EdgeFlipState& state, int numSeen) {
    int number = numClaimed.load(memory_order_relaxed);
    do {
        if (number == numBatches || !hasSlot(number))
            return false;
    } while (!numClaimed.compare_exchange_weak(number, number+1, memory_order_relaxed));
    Slot& slot = getSlot(number);
    EdgeFlipBatch& batch = slot.batch;
    long long firstAttempt = number*(long long) batchSize;
    batch.numAttempts = min((long long) batchSize, numAttempts-firstAttempt);
    evaluation.draw(random, sweep, firstAttempt, mesh.getNumHalfedges(), batch);
    state.evaluate(batch, 0, batch.numAttempts);
    for (int n = 0; n < batch.numAttempts; n++)
        batch.attempts[n].threshold = -kT*log(batch.uniform[n]);
    slot.firstUnseen = numSeen;
    slot.accepted = 0;
    slot.evaluated.store(number, memory_order_release);
    return true;
}

bool EdgeFlipSweep::hasSlot(int batch) const {
    int previous = batch-(int) slots.size();
    if (numDecided.load(memory_order_acquire) <= previous)
        return false;
    for (int i = 0; i < numHelpers; i++)
        if (helpers[i]->numSeen.load(memory_order_acquire) <= previous)
            return false;
    return true;
}

void EdgeFlipSweep::decide(int batch) {
    Slot& slot = getSlot(batch);
    try {
        for (int n = 0; n < slot.batch.numAttempts && !exception; n++) {
            __builtin_prefetch(&slot.batch.attempts[n+ATTEMPTS_AHEAD]);
            decide(slot, batch, n);
        }
    }
    catch (...) {
        exception = current_exception();
    }
}

void EdgeFlipSweep::decide(Slot& slot, int batch, int n) {
    const EdgeFlipAttempt& attempt = slot.batch.attempts[n];
    if (isStale(attempt, slot.firstUnseen))
        state.evaluate(slot.batch, n, n+1);
    statistics.attempted++;
    if (attempt.isForbidden) {
        statistics.forbidden++;
        return;
    }
    double energy = attempt.energy+areaPenalty.change(attempt.area)+volumePenalty.change(attempt.volume)+areaDifferencePenalty.change(attempt.curvature);
    if (energy <= 0 || energy < attempt.threshold)
        accept(slot, batch, n, energy);
}

void EdgeFlipSweep::accept(Slot& slot, int batch, int n, double energy) {
    const EdgeFlipAttempt& attempt = slot.batch.attempts[n];
    totals.area += attempt.area;
    totals.volume += attempt.volume;
    totals.curvature += attempt.curvature;
    updatePenalties();
    for (int vertex : attempt.vertex)
        lastFlips[vertex] = batch;
    state.carryOut(slot.batch, n);
    slot.accepted |= uint64_t(1)<<n;
    statistics.accepted++;
    if (*observer)
        (*observer)(energy);
}

bool EdgeFlipSweep::isStale(const EdgeFlipAttempt& attempt, int firstUnseen) const {
    const int* v = attempt.vertex;
    return max(max(lastFlips[v[0]], lastFlips[v[1]]), max(lastFlips[v[2]], lastFlips[v[3]])) >= firstUnseen || (attempt.dependsOnPartners && isPartnerFlipped(attempt, firstUnseen));
}

bool EdgeFlipSweep::isPartnerFlipped(const EdgeFlipAttempt& attempt, int firstUnseen) const {
    for (int vertex : attempt.vertex)
        for (int n = 0; n < state.getNumClose(vertex); n++)
            if (lastFlips[state.getPartners(vertex)[n]] >= firstUnseen)
                return true;
    return false;
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
