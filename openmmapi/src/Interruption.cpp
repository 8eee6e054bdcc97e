#include "openmmhelfrich/internal/Interruption.h"
#include <atomic>

using namespace HelfrichPlugin;
using namespace std;

/**
 * So many items take longer than to look at the clock a thousand times, and less than a tenth of a second.
 */
static const int ITEMS_PER_LOOK = 20000;

static const auto TIME_BETWEEN_QUESTIONS = chrono::milliseconds(200);

static atomic<bool (*)()> question(nullptr);

const char* StepInterrupted::what() const noexcept {
    return "the step was interrupted; everything is as it was before it";
}

void Interruption::setQuestion(bool (*isRequested)()) {
    question = isRequested;
}

Interruption::Interruption(int numItems)
        : numCallsPerLook(ITEMS_PER_LOOK / (numItems + 1)), numCallsLeft(numCallsPerLook),
          nextTime(chrono::steady_clock::now() + TIME_BETWEEN_QUESTIONS) {
}

bool Interruption::ask() {
    numCallsLeft = numCallsPerLook;
    auto now = chrono::steady_clock::now();
    if (now < nextTime)
        return false;
    nextTime = now + TIME_BETWEEN_QUESTIONS;
    bool (*isRequested)() = question;
    return isRequested != nullptr && isRequested();
}
