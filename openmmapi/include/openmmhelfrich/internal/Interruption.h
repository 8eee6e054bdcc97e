#ifndef OPENMM_HELFRICH_INTERRUPTION_H_
#define OPENMM_HELFRICH_INTERRUPTION_H_

#include "windowsExportHelfrich.h"
#include <chrono>
#include <exception>

namespace HelfrichPlugin {

/**
 * This is thrown by an Integrator's step that ends early.  All is as it was before it.  It is no OpenMMException: a
 * trajectory that ends by one of those has diverged.
 */
class OPENMM_EXPORT_HELFRICH StepInterrupted : public std::exception {
public:
    const char* what() const noexcept;
};

/**
 * What a long step asks now and then: whether it is to end early.  One lives as long as the step.
 */
class OPENMM_EXPORT_HELFRICH Interruption {
public:
    /**
     * Set what is asked, a few times a second, on the thread that called step(); NULL for nothing.
     */
    static void setQuestion(bool (*isRequested)());
    /**
     * Create an Interruption.
     *
     * @param numItems  the number of vertices, attempts or the like that are dealt with between two calls of
     * isRequested(): it looks at the clock only when enough of them are
     */
    explicit Interruption(int numItems);
    /**
     * Get whether the step is to end.
     */
    bool isRequested() {
        return --numCallsLeft < 0 && ask();
    }
private:
    bool ask();
    int numCallsPerLook, numCallsLeft;
    std::chrono::steady_clock::time_point nextTime;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_INTERRUPTION_H_*/
