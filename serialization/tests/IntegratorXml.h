#ifndef INTEGRATORXML_H_
#define INTEGRATORXML_H_

/* What tests of serialized integrators have in common. */

#include "openmm/Integrator.h"
#include "openmm/internal/AssertionUtilities.h"
#include "openmm/serialization/XmlSerializer.h"
#include <memory>
#include <sstream>
#include <string>

namespace HelfrichPlugin {

using OpenMM::throwException; // which ASSERT() calls

inline std::string toXml(const OpenMM::Integrator& integrator) {
    std::stringstream stream;
    OpenMM::XmlSerializer::serialize<OpenMM::Integrator>(&integrator, "Integrator", stream);
    return stream.str();
}

inline std::unique_ptr<OpenMM::Integrator> fromXml(const std::string& xml) {
    std::stringstream stream(xml);
    return std::unique_ptr<OpenMM::Integrator>(OpenMM::XmlSerializer::deserialize<OpenMM::Integrator>(stream));
}

/**
 * Copy an integrator through XML, and require that the copy has the same XML.
 */
template <class T>
std::unique_ptr<T> copyThroughXml(const T& integrator) {
    std::string xml = toXml(integrator);
    std::unique_ptr<OpenMM::Integrator> copy = fromXml(xml);
    ASSERT_EQUAL(xml, toXml(*copy));
    ASSERT(dynamic_cast<T*>(copy.get()) != NULL);
    return std::unique_ptr<T>(dynamic_cast<T*>(copy.release()));
}

/**
 * Require that a text in which one piece is replaced cannot be read, with an error that says a message.
 */
inline void assertRejected(std::string xml, const std::string& old, const std::string& with,
                           const std::string& message) {
    size_t position = xml.find(old);
    ASSERT(position != std::string::npos);
    try {
        fromXml(xml.replace(position, old.size(), with));
    }
    catch (const OpenMM::OpenMMException& error) {
        ASSERT(std::string(error.what()).find(message) != std::string::npos);
        return;
    }
    throwException(__FILE__, __LINE__, "no exception that says '" + message + "'");
}

} // namespace HelfrichPlugin

#endif /*INTEGRATORXML_H_*/
