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
 * How long it sleeps where nobody would wake it.
 */
static const chrono::microseconds NAP(50);

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
void CpuThreads::Waiting::until(const Function& isReached) {
    for (int tries = 0; tries < MAX_TRIES; tries++) {
        if (isReached())
            return;
        rest();
    }
    unique_lock<std::mutex> lock(mutex);
    numSleepers++;
    condition.wait(lock, isReached);
    numSleepers--;
}

void CpuThreads::Waiting::changed() {
    if (numSleepers.load() == 0)
        return;
    lock_guard<std::mutex> lock(mutex);
    condition.notify_all();
}

CpuThreads::CpuThreads(int numThreads) : numWanted(numThreads) {
    for (int i = 0; i < numThreads; i++)
        members.emplace_back(new Member);
    for (int i = 1; i < numThreads; i++)
        try {
            members[i]->thread = thread(&CpuThreads::serve, this, i);
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
    numThreads = min(numThreads, numItems);
    numSharing.store(numThreads, memory_order_relaxed);
    numLeft.store(numItems, memory_order_relaxed);
    for (int i = 0; i < numThreads; i++) {
        uint64_t begin = (int64_t) numItems * i / numThreads, end = (int64_t) numItems * (i + 1) / numThreads;
        members[i]->share.store(end << 32 | begin, memory_order_release);
    }
    for (int i = 1; i < numThreads; i++) {
        members[i]->numBegun++;
        members[i]->beginning.changed();
    }
    work(0);
    end.until([&]() { return numLeft.load() == 0; });
}

void CpuThreads::serve(int index) {
    Member& member = *members[index];
    for (int numSeen = 0; !isEnding;) {
        member.beginning.until([&]() { return member.numBegun.load() != numSeen; });
        numSeen = member.numBegun;
        work(index);
    }
}

void CpuThreads::work(int index) {
    // An item that is claimed is one of the present loop, which goes on until it is done: only then is the task known.

    int numDone = 0, count = numSharing.load(memory_order_relaxed);
    for (int i = index; i < index + count; i++)
        for (int item; (item = claim(*members[i % count])) >= 0; numDone++)
            task.call(task.function, item);
    if (numDone > 0 && numLeft.fetch_sub(numDone) == numDone && index > 0)
        end.changed();
}

int CpuThreads::claim(Member& member) {
    uint64_t share = member.share.load(memory_order_acquire);
    do {
        if ((uint32_t) share >= share >> 32)
            return -1;
    } while (!member.share.compare_exchange_weak(share, share + 1, memory_order_acquire));
    return (uint32_t) share;
}
