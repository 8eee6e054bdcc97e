#include "CpuThreads.h"
#include <algorithm>
#include <chrono>
#include <pthread.h>
#include <system_error>

using namespace HelfrichPlugin;
using namespace std;

/**
 * How often a thread that waits looks whether it can go on, before it sleeps.
 */
static const int MAX_TRIES = 2000;

/**
 * A thread is left out for so many times the delay that it caused, of which no more than the longest counts.
 */
static const int TIMES_LEFT_OUT = 3;
static const chrono::milliseconds LONGEST_DELAY(20);

/**
 * How long it sleeps where nobody would wake it.
 */
static const chrono::microseconds NAP(50);

/**
 * After this long a thread that waits to be woken looks by itself.  To wait without an end is another function of the
 * C++ library, which GCC 12 and newer take from its version 3.4.30; OpenMM, and so a wheel for it, needs 3.4.29.
 */
static const chrono::hours LONG_SLEEP(1);

/**
 * How often this process is the child of one that had threads, which a child does not have.
 */
static int numForks = 0;

static void rest() {
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    asm volatile("yield");
#endif
}

void CpuThreads::wait(int& tries) {
    if (tries++ < MAX_TRIES)
        rest();
    else
        this_thread::sleep_for(NAP);
}

template <class Function>
bool CpuThreads::Waiting::look(const Function& isReached) {
    for (int tries = 0; tries < MAX_TRIES; tries++) {
        if (isReached())
            return true;
        rest();
    }
    return false;
}

template <class Function>
void CpuThreads::Waiting::sleep(const Function& isReached) {
    unique_lock<std::mutex> lock(mutex);
    numSleepers++;
    while (!condition.wait_for(lock, LONG_SLEEP, isReached)) {
    }
    numSleepers--;
}

void CpuThreads::Waiting::changed() {
    if (numSleepers.load() == 0)
        return;
    lock_guard<std::mutex> lock(mutex);
    condition.notify_all();
}

CpuThreads::CpuThreads(int numThreads) : numWanted(numThreads), shares(numThreads) {
    for (int i = 0; i < numThreads; i++)
        members.emplace_back(new Member);
    for (int i = 1; i < numThreads; i++)
        try {
            members[i]->thread = thread(&CpuThreads::serve, this, ref(*members[i]));
        }
        catch (const system_error&) {
            break; // others do its share
        }
}

CpuThreads::~CpuThreads() {
    isEnding = true;
    for (auto& member : members) {
        member->numBegun++;
        member->beginning.changed();
        if (member->thread.joinable())
            member->thread.join();
    }
}

CpuThreads& CpuThreads::ofThisThread(int numThreads) {
    struct Own {
        unique_ptr<CpuThreads> threads;
        int fork = 0;
        void forget() {
            if (fork != numForks)
                threads.release();
        }
        ~Own() {
            forget();
        }
    };
    static const bool isWatchingForks = (pthread_atfork(NULL, NULL, []() { numForks++; }) == 0);
    thread_local Own own;
    own.forget();
    if (!own.threads || own.threads->numWanted < numThreads) {
        own.threads.reset();
        own.threads.reset(new CpuThreads(numThreads));
        own.fork = (isWatchingForks ? numForks : 0);
    }
    return *own.threads;
}

void CpuThreads::run(int numThreads, int numItems, Task task) {
    this->task = task;
    choose(min(numThreads, numItems));
    int count = chosen.size();
    numShares.store(count, memory_order_relaxed);
    numLeft.store(numItems, memory_order_relaxed);
    for (int i = 0; i < count; i++) {
        uint64_t begin = (int64_t) numItems * i / count, end = (int64_t) numItems * (i + 1) / count;
        chosen[i]->share.store(i, memory_order_relaxed);
        shares[i].items.store(end << 32 | begin, memory_order_release);
    }
    for (int i = 1; i < count; i++) {
        chosen[i]->numBegun++;
        chosen[i]->beginning.changed();
    }
    work(*chosen[0]);
    if (!Waiting::look([&]() { return numLeft.load() == 0; }))
        waitForLate();
}

void CpuThreads::choose(int numThreads) {
    auto now = isAnyoneLeftOut ? chrono::steady_clock::now() : chrono::steady_clock::time_point();
    isAnyoneLeftOut = false;
    chosen.clear();
    for (auto& member : members) {
        if (member->returns > now)
            isAnyoneLeftOut = true;
        else {
            member->returns = {};
            if ((int) chosen.size() < numThreads)
                chosen.push_back(member.get());
        }
    }
}

void CpuThreads::waitForLate() {
    vector<Member*> late;
    for (Member* member : chosen)
        if (member->hasItem.load(memory_order_relaxed))
            late.push_back(member);
    auto begin = chrono::steady_clock::now();
    end.sleep([&]() { return numLeft.load() == 0; });
    auto now = chrono::steady_clock::now();
    for (Member* member : late)
        member->returns = now + TIMES_LEFT_OUT * min<chrono::steady_clock::duration>(now - begin, LONGEST_DELAY);
    isAnyoneLeftOut |= !late.empty();
}

void CpuThreads::serve(Member& member) {
    for (int numSeen = 0; !isEnding;) {
        auto hasBegun = [&]() { return member.numBegun.load() != numSeen; };
        if (!Waiting::look(hasBegun))
            member.beginning.sleep(hasBegun);
        numSeen = member.numBegun;
        work(member);
    }
}

void CpuThreads::work(Member& member) {
    // An item that is claimed is one of the present loop, which goes on until it is done: only then is the task known.

    int numDone = 0, count = numShares.load(memory_order_relaxed), first = member.share.load(memory_order_relaxed);
    for (int i = first; i < first + count; i++)
        for (int item; (item = claim(shares[i % count])) >= 0; numDone++) {
            if (numDone == 0)
                member.hasItem.store(true, memory_order_relaxed);
            task.call(task.function, item);
        }
    member.hasItem.store(false, memory_order_relaxed);
    if (numDone > 0 && numLeft.fetch_sub(numDone) == numDone)
        end.changed();
}

int CpuThreads::claim(Share& share) {
    uint64_t items = share.items.load(memory_order_acquire);
    do {
        if ((uint32_t) items >= items >> 32)
            return -1;
    } while (!share.items.compare_exchange_weak(items, items + 1, memory_order_acquire));
    return (uint32_t) items;
}
