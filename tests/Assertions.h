#ifndef HELFRICH_ASSERTIONS_H_
#define HELFRICH_ASSERTIONS_H_

#include "openmm/OpenMMException.h"
#include "openmm/internal/AssertionUtilities.h"
#include <string>
#include <vector>

/**
 * Assert that something throws an OpenMMException that says all of the given things.
 */
template <class Action>
void assertThrows(Action action, const std::vector<std::string>& details) {
    try {
        action();
    }
    catch (const OpenMM::OpenMMException& error) {
        for (auto& detail : details)
            if (std::string(error.what()).find(detail) == std::string::npos)
                OpenMM::throwException(__FILE__, __LINE__,
                                       "'" + std::string(error.what()) + "' does not say '" + detail + "'");
        return;
    }
    OpenMM::throwException(__FILE__, __LINE__, "no error that says '" + details[0] + "'");
}

#endif /*HELFRICH_ASSERTIONS_H_*/
