#ifndef OPENMM_HELFRICH_SERIALIZATION_H_
#define OPENMM_HELFRICH_SERIALIZATION_H_

#include "openmm/serialization/SerializationNode.h"
#include <array>
#include <limits>
#include <string>
#include <vector>

namespace HelfrichPlugin {

/**
 * Throw an exception unless a node is of a version that this library reads.
 *
 * @param node      the node to check
 * @param version   the version that this library writes
 * @param typeName  the type of the object that the node describes, for the message
 * @param oldestVersion  the first version that this library reads; by default only the one that it writes
 */
void requireVersion(const OpenMM::SerializationNode& node, int version, const std::string& typeName,
                    int oldestVersion = std::numeric_limits<int>::max());
/**
 * Write integers to a node as a property: in order, separated by blanks.
 */
void storeIntegers(const std::vector<int>& values, const std::string& property, OpenMM::SerializationNode& node);
/**
 * Read the integers that storeIntegers() wrote.  An exception is thrown if the text holds anything else.
 */
std::vector<int> loadIntegers(const std::string& property, const OpenMM::SerializationNode& node);
/**
 * Write triangles to a node, as properties "count" and "particles": the particles' indices in order, separated by
 * blanks.
 */
void storeTriangles(const std::vector<std::array<int, 3>>& triangles, OpenMM::SerializationNode& node);
/**
 * Read the triangles that storeTriangles() wrote.  An exception is thrown if the text holds anything but integers, or
 * another number of them than the node announces.
 */
std::vector<std::array<int, 3>> loadTriangles(const OpenMM::SerializationNode& node);

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_SERIALIZATION_H_*/
