#ifndef OPENMM_HELFRICH_CHECKS_H_
#define OPENMM_HELFRICH_CHECKS_H_

#include "openmm/OpenMMException.h"
#include <cmath>
#include <sstream>
#include <string>

/* Checks of what users pass. */

namespace HelfrichPlugin {

/**
 * Throw an OpenMMException unless a value is finite and positive, or zero where that is allowed.
 */
inline void requirePositive(const std::string& item, double value, bool allowZero = false) {
    if (std::isfinite(value) && (value > 0 || (allowZero && value == 0)))
        return;
    std::stringstream message;
    message << item << " is " << value << "; it must be finite and " << (allowZero ? "not negative" : "positive");
    throw OpenMM::OpenMMException(message.str());
}

/**
 * Throw an OpenMMException if a value is greater than what is allowed.
 */
inline void requireAtMost(const std::string& item, double value, double greatest) {
    if (value <= greatest)
        return;
    std::stringstream message;
    message << item << " is " << value << "; it must be at most " << greatest;
    throw OpenMM::OpenMMException(message.str());
}

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_CHECKS_H_*/
