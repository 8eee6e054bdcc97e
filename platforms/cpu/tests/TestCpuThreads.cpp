#include "CpuThreads.h"
#include "openmm/internal/AssertionUtilities.h"
#include <chrono>
#include <cstdlib>
#include <exception>
#include <iostream>
#include <numeric>
#include <sys/wait.h>
#include <unistd.h>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * Assert that many loops after each other call each item once, and that each sees what the one before it did.
 */
void checkLoops(int numThreads, int numItems, int numLoops) {
    vector<int> numbers(numItems);
    iota(numbers.begin(), numbers.end(), 0);
    for (int loop = 0; loop < numLoops; loop++) {
        vector<int> next(numItems);
        CpuThreads::forEach(numThreads, numItems, [&](int item) { next[item] += numbers[numItems - 1 - item] + 1; });
        numbers.swap(next);
    }
    for (int item = 0; item < numItems; item++)
        ASSERT_EQUAL((numLoops % 2 == 0 ? item : numItems - 1 - item) + numLoops, numbers[item]);
}

void testLoops() {
    // With more threads than processors, with fewer items than threads, and with none.

    for (int numThreads : {1, 2, 3, 8, 2, 16, 1})
        for (int numItems : {0, 1, 2, 7, 100})
            checkLoops(numThreads, numItems, 301);
}

void testParts() {
    for (int numItems : {0, 1, 63, 64, 65, 1000}) {
        vector<int> counts(numItems);
        CpuThreads::forEachPart(3, numItems, 64, [&](int begin, int end) {
            ASSERT(begin < end && end - begin <= 64);
            for (int item = begin; item < end; item++)
                counts[item]++;
        });
        ASSERT(counts == vector<int>(numItems, 1));
    }
}

void testUnevenItems() {
    // A thread that has done its share does that of one that is late.

    atomic<int> numDone(0);
    CpuThreads::forEach(2, 10, [&](int item) {
        for (int tries = 0; item == 0 && numDone < 9;)
            CpuThreads::wait(tries);
        numDone++;
    });
    ASSERT_EQUAL(10, numDone);
}

void testSleep() {
    // Threads that went to sleep between two loops wake up for the second one.

    atomic<int> numBegun(0);
    for (int loop = 0; loop < 5; loop++) {
        this_thread::sleep_for(chrono::milliseconds(20));
        numBegun = 0;
        CpuThreads::forEach(3, 3, [&](int) {
            numBegun++;
            for (int tries = 0; numBegun < 3;)
                CpuThreads::wait(tries);
        });
    }
}

void testSeveralAtOnce() {
    // Each thread that makes loops has threads of its own, and these end with it.

    vector<thread> threads;
    for (int i = 0; i < 4; i++)
        threads.emplace_back(checkLoops, 2 + i % 2, 50, 200);
    for (thread& t : threads)
        t.join();
}

void testFork() {
    // The child of a process has none of its threads, and gets new ones.

    checkLoops(3, 50, 10);
    pid_t child = fork();
    ASSERT(child >= 0);
    if (child == 0) {
        checkLoops(3, 50, 10);
        exit(7);
    }
    int status;
    ASSERT_EQUAL(child, waitpid(child, &status, 0));
    ASSERT(WIFEXITED(status));
    ASSERT_EQUAL(7, WEXITSTATUS(status));
    checkLoops(3, 50, 10);
}

int main() {
    try {
        testLoops();
        testParts();
        testUnevenItems();
        testSleep();
        testSeveralAtOnce();
        testFork();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
