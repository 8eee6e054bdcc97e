#ifndef OPENMM_HELFRICH_CHECKS_H_
#define OPENMM_HELFRICH_CHECKS_H_

#include "openmm/OpenMMException.h"
#include <cmath>
#include <cstdlib>
#include <sstream>
#include <string>

/* Checks of what users pass. */

namespace HelfrichPlugin {

/**
 * Get a number as text, with as many digits as it takes to tell it from what is allowed.
 */
inline std::string toText(double value) {
    std::stringstream brief, whole;
    brief << value;
    whole.precision(17);
    whole << value;
    return (std::strtod(brief.str().c_str(), NULL) == value ? brief : whole).str();
}

/**
 * Throw an OpenMMException unless a value is finite and positive, or zero where that is allowed.
 */
inline void requirePositive(const std::string& item, double value, bool allowZero = false) {
    if (std::isfinite(value) && (value > 0 || (allowZero && value == 0)))
        return;
    throw OpenMM::OpenMMException(item + " is " + toText(value) + "; it must be finite and " +
                                  (allowZero ? "not negative" : "positive"));
}

/**
 * Throw an OpenMMException if a value is greater than what is allowed.
 */
inline void requireAtMost(const std::string& item, double value, double greatest) {
    if (value <= greatest)
        return;
    throw OpenMM::OpenMMException(item + " is " + toText(value) + "; it must be at most " + toText(greatest));
}

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_CHECKS_H_*/
