#include "CpuEdgeFlipSweep.h"
#include "CpuInstructionSet.h"
#include "openmmhelfrich/internal/Interruption.h"
#include <algorithm>
#include <cmath>
#include <limits>

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
 * Membranes of fewer vertices are in a processor's second-level cache even after a trajectory, and to ask for what
 * comes next costs more time than it saves.
 */
static const int MIN_FETCHED_AHEAD = 5000;

/**
 * What a copy has seen that takes no part in a sweep, for its thread came too late: nobody waits for it.
 */
static const int EVERYTHING = numeric_limits<int>::max();

CpuEdgeFlipSweep::CpuEdgeFlipSweep(HelfrichMesh& mesh, int numThreads, int maxCopied)
        : CpuSweep(mesh, numThreads, VERTICES_PER_ATTEMPT * CpuEdgeFlipBatch::SIZE),
          evaluation(getForProcessor<CpuEdgeFlipEvaluation>()), state(mesh),
          places(this->numThreads == 1 ? 2 : BATCHES_PER_THREAD * this->numThreads), renewed(),
          lastFlips(mesh.getNumVertices()) {
    batchSize = min(max(8, mesh.getNumVertices() / VERTICES_PER_ATTEMPT), CpuEdgeFlipBatch::SIZE);
    if (mesh.getNumVertices() <= maxCopied)
        for (int i = 1; i < this->numThreads; i++)
            copies.emplace_back(new Copy(mesh));
}

void CpuEdgeFlipSweep::setPositions(const vector<Vec3>& positions, const CpuVertexGeometry& geometry,
                                    CpuHelfrichNeighborList* neighborList) {
    this->neighborList = neighborList;
    totals = geometry.totals;
    state.setNeighborList(neighborList);
    forEachPart([&](int begin, int end) {
        // To gather them once for the states of all threads takes less time than to let each thread fill its own.

        state.setPositions(positions, geometry, begin, end);
        for (auto& copy : copies)
            copy->state.setPositions(state, begin, end);
    });
}

EdgeFlipStatistics CpuEdgeFlipSweep::execute(const HelfrichParameters& parameters, double kT, long long numAttempts,
                                             const Philox& random, long long sweep, const Observer& observer) {
    p = parameters;
    begin(kT, numAttempts, random, sweep);
    this->observer = &observer;
    changes.clear();
    flippedVertices.clear();
    for (size_t surface = 0; surface < totals.size(); surface++)
        changes.emplace_back(p, surface, totals[surface]);
    exception = NULL;
    isAbandoned = false;
    statistics = EdgeFlipStatistics();
    numBatches = (numAttempts + batchSize - 1) / batchSize;
    numClaimed = numDecided = 0;
    for (Place& place : places)
        place.evaluated = NONE;
    fill(lastFlips.begin(), lastFlips.end(), NONE);
    state.setParameters(p);
    CpuThreads::forEach(numThreads, copies.size(), [&](int i) { prepare(*copies[i]); });
    if (needsNeighborList(p))
        findCloseNeighbors();
    CpuThreads::forEach(numThreads, numThreads, [&](int thread) {
        if (thread == 0)
            decideAll();
        else
            help(copies.empty() ? NULL : copies[thread - 1].get());
    });
    if (exception)
        rethrow_exception(exception);
    if (needsNeighborList(p))
        neighborList->revision = mesh.getRevision();
    return statistics;
}

void CpuEdgeFlipSweep::prepare(Copy& copy) const {
    // The flips of earlier sweeps in which it took part are carried out in a copy, but triangles may have been replaced
    // since, and neighbors found anew or partitioned.

    if (copy.mesh.getRevision() != mesh.getRevision()) {
        copy.mesh = mesh;
        copy.state.setPositions(state, 0, mesh.getNumVertices());
    }
    copy.state.setParameters(p);
    if (needsNeighborList(p) &&
        (copy.neighborList.numBuilds != neighborList->numBuilds || copy.neighborList.revision != mesh.getRevision()))
        copy.neighborList = *neighborList;
    copy.numSeen = NONE;
}

void CpuEdgeFlipSweep::findCloseNeighbors() {
    // As with positions, to find them once for all states takes less time.

    forEachVertex([&](int v) {
        state.findCloseNeighbors(v);
        for (auto& copy : copies)
            copy->state.setCloseNeighbors(state, v);
    });
}

void CpuEdgeFlipSweep::decideAll() {
    Interruption interruption(batchSize);
    bool isLong = SweepEdgeFlipsKernel::isLong(numAttempts, mesh);
    for (int batch = 0, upcoming = NONE; batch < numBatches && !exception; batch++) {
        int tries = 0;
        while (getPlace(batch).evaluated.load(memory_order_acquire) != batch)
            if (!evaluateNext(state, batch, upcoming, false))
                CpuThreads::wait(tries);
        decide(batch);
        numDecided.store(batch + 1, memory_order_release);
        if (isLong && interruption.isRequested())
            exception = make_exception_ptr(StepInterrupted());
    }
    if (exception)
        isAbandoned = true;
    if (statistics.accepted > 0)
        mesh.markChanged(flippedVertices);
}

void CpuEdgeFlipSweep::help(Copy* copy) {
    int none = NONE;
    if (copy != NULL && !copy->numSeen.compare_exchange_strong(none, 0))
        return;
    const CpuEdgeFlipState& state = (copy == NULL ? this->state : copy->state);
    int tries = 0, upcoming = NONE, numSeen;
    while ((numSeen = numDecided.load(memory_order_acquire)) < numBatches && !isAbandoned) {
        if (copy != NULL)
            carryOut(*copy, numSeen);
        if (evaluateNext(state, numSeen, upcoming, true))
            tries = 0;
        else
            CpuThreads::wait(tries);
    }
    if (copy != NULL)
        finish(*copy);
}

void CpuEdgeFlipSweep::carryOut(Copy& copy, int numDecided) {
    for (int batch = copy.numSeen; batch < numDecided; batch++) {
        const Place& place = getPlace(batch);
        copy.state.carryOut(place.acceptedFlips);
    }
    copy.numSeen.store(numDecided, memory_order_release);
}

void CpuEdgeFlipSweep::finish(Copy& copy) {
    carryOut(copy, numDecided.load(memory_order_acquire));
    if (statistics.accepted > 0)
        copy.mesh.markChanged();
    if (needsNeighborList(p))
        copy.neighborList.revision = copy.mesh.getRevision();
}

bool CpuEdgeFlipSweep::evaluateNext(const CpuEdgeFlipState& state, int numSeen, int& upcoming, bool isAhead) {
    int number = (upcoming == NONE ? claimNext() : upcoming);
    if (number == NONE)
        return false;
    upcoming = (mesh.getNumVertices() < MIN_FETCHED_AHEAD ? NONE : claimNext());
    Place& place = getPlace(number);
    CpuEdgeFlipBatch& batch = place.batch;
    state.evaluate(batch, upcoming == NONE ? NULL : &getPlace(upcoming).batch);
    for (int n = 0; n < batch.numAttempts; n++)
        batch.attempts[n].threshold = -kT * log(batch.uniform[n]);
    collectLikelyFlips(place, isAhead);
    place.firstUnseen = numSeen;
    place.acceptedFlips.count = 0;
    place.evaluated.store(number, memory_order_release);
    return true;
}

void CpuEdgeFlipSweep::collectLikelyFlips(Place& place, bool isAhead) {
    // They are few, and the first thread takes less time to get them from another one's cache than from all over the
    // batch.  What it evaluated itself is at hand.

    const CpuEdgeFlipBatch& batch = place.batch;
    place.likelyFlips.count = 0;
    place.isLikely = 0;
    if (!isAhead)
        return;
    for (int n = 0; n < batch.numAttempts; n++)
        place.isLikely |= uint64_t(batch.attempts[n].energy < batch.attempts[n].threshold) << n;
    for (uint64_t bits = place.isLikely; bits != 0; bits &= bits - 1)
        place.likelyFlips.add(batch.getFlip(__builtin_ctzll(bits)));
}

int CpuEdgeFlipSweep::claimNext() {
    int number = numClaimed.load(memory_order_relaxed);
    do {
        if (number == numBatches || !hasPlace(number))
            return NONE;
    } while (!numClaimed.compare_exchange_weak(number, number + 1, memory_order_relaxed));
    CpuEdgeFlipBatch& batch = getPlace(number).batch;
    long long firstAttempt = number * (long long) batchSize;
    batch.numAttempts = min((long long) batchSize, numAttempts - firstAttempt);
    evaluation.draw(random, sweep, firstAttempt, mesh.getNumDirectedEdges(), batch);
    return number;
}

bool CpuEdgeFlipSweep::hasPlace(int batch) {
    int previous = batch - (int) places.size();
    if (previous < 0)
        return true;
    if (numDecided.load(memory_order_acquire) <= previous)
        return false;
    for (auto& copy : copies) {
        int numSeen = copy->numSeen.load(memory_order_acquire);
        if (numSeen == NONE && copy->numSeen.compare_exchange_strong(numSeen, EVERYTHING))
            continue;
        if (numSeen <= previous)
            return false;
    }
    return true;
}

void CpuEdgeFlipSweep::decide(int batch) {
    Place& place = getPlace(batch);
    state.prefetch(place.likelyFlips);
    try {
        for (int n = 0; n < place.batch.numAttempts && !exception; n++)
            decide(place, batch, n);
    }
    catch (...) {
        exception = current_exception();
    }
}

void CpuEdgeFlipSweep::decide(Place& place, int batch, int n) {
    const CpuEdgeFlipAttempt* attempt = &place.batch.attempts[n];
    double threshold = attempt->threshold;
    bool isRenewed = isStale(*attempt, place.firstUnseen);
    if (isRenewed) {
        renewed.numAttempts = 1;
        renewed.halfedge[0] = place.batch.halfedge[n];
        state.evaluate(renewed);
        attempt = &renewed.attempts[0];
    }
    statistics.attempted++;
    if (attempt->isForbidden) {
        statistics.forbidden++;
        return;
    }
    double energy =
            changes[attempt->surface].addTo(attempt->energy, {attempt->area, attempt->volume, attempt->curvature});
    if (energy <= 0 || energy < threshold)
        accept(place, batch, *attempt, isRenewed ? renewed.getFlip(0) : getFlip(place, n), energy);
}

CpuEdgeFlip CpuEdgeFlipSweep::getFlip(const Place& place, int n) {
    uint64_t bit = uint64_t(1) << n;
    return (place.isLikely & bit) != 0 ? place.likelyFlips.flips[__builtin_popcountll(place.isLikely & (bit - 1))]
                                       : place.batch.getFlip(n);
}

void CpuEdgeFlipSweep::accept(Place& place, int batch, const CpuEdgeFlipAttempt& attempt, const CpuEdgeFlip& flip,
                              double energy) {
    HelfrichTotals& ofSurface = totals[attempt.surface];
    ofSurface += {attempt.area, attempt.volume, attempt.curvature};
    changes[attempt.surface] = ChangeByTotals(p, attempt.surface, ofSurface);
    for (int vertex : attempt.vertex) {
        lastFlips[vertex] = batch;
        flippedVertices.push_back(vertex);
    }
    state.carryOut(flip);
    place.acceptedFlips.add(flip);
    statistics.accepted++;
    if (*observer)
        (*observer)(energy);
}

bool CpuEdgeFlipSweep::isStale(const CpuEdgeFlipAttempt& attempt, int firstUnseen) const {
    const int* v = attempt.vertex;
    return max(max(lastFlips[v[0]], lastFlips[v[1]]), max(lastFlips[v[2]], lastFlips[v[3]])) >= firstUnseen ||
           (attempt.dependsOnCloseNeighbors && isCloseNeighborFlipped(attempt, firstUnseen));
}

bool CpuEdgeFlipSweep::isCloseNeighborFlipped(const CpuEdgeFlipAttempt& attempt, int firstUnseen) const {
    for (int vertex : attempt.vertex)
        for (int n = 0; n < state.getNumClose(vertex); n++)
            if (lastFlips[state.getNeighbors(vertex)[n]] >= firstUnseen)
                return true;
    return false;
}
