#ifndef OPENMM_CPUTHREADS_H_
#define OPENMM_CPUTHREADS_H_

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace HelfrichPlugin {

/**
 * The threads that share the loops that one thread, their first, makes.
 *
 * The items of a loop are shared out evenly, so that a thread finds in its cache what it had in the loop before.  A
 * thread that has done its share helps the others.  Nobody waits for a thread that has no item under way: one that
 * other programs keep from its processor costs no more time than it would have saved.  Threads that wait look for
 * something to do for some ten microseconds, which is longer than most waits, and then sleep.  A thread for
 * which the first one had to sleep is left out for a while.
 */
class CpuThreads {
public:
    /**
     * Call a function with each number from 0 to another one, on several threads, and wait for all calls.  None of
     * them may depend on another one, make a loop, or throw.
     *
     * @param numThreads  the number of threads, with the one that calls this; they are fewer if the system has no more
     * @param numItems    the number of calls
     * @param function    what to call with each number
     */
    template <class Function>
    static void forEach(int numThreads, int numItems, const Function& function) {
        if (numThreads <= 1 || numItems <= 1)
            for (int item = 0; item < numItems; item++)
                function(item);
        else
            ofThisThread(numThreads).run(numThreads, numItems, {&call<Function>, &function});
    }
    /**
     * Call a function with the beginning and the end of each part of a range from 0 to another number.
     *
     * @param size  the size of the parts, but for the last one
     */
    template <class Function>
    static void forEachPart(int numThreads, int numItems, int size, const Function& function) {
        forEach(numThreads, (numItems + size - 1) / size, [&](int part) {
            int begin = part * size;
            function(begin, numItems - begin < size ? numItems : begin + size);
        });
    }
    /**
     * Let some time pass, the longer the more often it was called since it had something to wait for.
     *
     * @param tries  how often it was called
     */
    static void wait(int& tries);
    ~CpuThreads();
private:
    /**
     * Where threads wait until something that others change is as they want it.
     */
    class Waiting {
    public:
        /**
         * Look for a while whether a function returns true.
         */
        template <class Function>
        static bool look(const Function& isReached);
        /**
         * Sleep until a function returns true.
         */
        template <class Function>
        void sleep(const Function& isReached);
        /**
         * Say that a sequentially consistent change was made.
         */
        void changed();
    private:
        std::atomic<int> numSleepers{0};
        std::mutex mutex;
        std::condition_variable condition;
    };
    /**
     * What to call with the items of a loop.
     */
    struct Task {
        void (*call)(const void* function, int item);
        const void* function;
    };
    /**
     * A share of the items of a loop: from the lower half of the number to its upper half.
     */
    struct alignas(64) Share {
        std::atomic<uint64_t> items{0};
    };
    /**
     * One of the threads.
     */
    struct alignas(64) Member {
        /// the number of loops that it was to take part in, and its share of the last one
        std::atomic<int> numBegun{0}, share{0};
        std::atomic<bool> hasItem{false};
        Waiting beginning;
        std::thread thread;
        /// until when it is left out
        std::chrono::steady_clock::time_point returns;
    };
    explicit CpuThreads(int numThreads);
    /**
     * Get the threads of the thread that calls this, at least so many if the system has them.
     */
    static CpuThreads& ofThisThread(int numThreads);
    template <class Function>
    static void call(const void* function, int item) {
        (*static_cast<const Function*>(function))(item);
    }
    void run(int numThreads, int numItems, Task task);
    void choose(int numThreads);
    void waitForLate();
    void work(Member& member);
    void serve(Member& member);
    static int claim(Share& share);
    const int numWanted;
    std::vector<std::unique_ptr<Member>> members;
    std::vector<Share> shares;
    /// those that take part in the present loop
    std::vector<Member*> chosen;
    bool isAnyoneLeftOut = false;
    std::atomic<bool> isEnding{false};
    Task task;
    alignas(64) std::atomic<int> numShares{0};
    alignas(64) std::atomic<int> numLeft{0};
    Waiting end;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUTHREADS_H_*/
