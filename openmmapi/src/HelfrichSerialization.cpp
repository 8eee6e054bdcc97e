#include "openmmhelfrich/internal/HelfrichSerialization.h"
#include "openmm/OpenMMException.h"
#include <algorithm>
#include <charconv>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

void HelfrichPlugin::requireVersion(const SerializationNode& node, int version, const string& typeName,
                                    int oldestVersion) {
    int found = node.getIntProperty("version");
    oldestVersion = min(version, oldestVersion);
    if (found > version || found < oldestVersion)
        throw OpenMMException(typeName + ": unsupported version " + to_string(found) +
                              " of the serialized object; this library reads version " +
                              (oldestVersion < version ? to_string(oldestVersion) + " to " : "") + to_string(version));
}

void HelfrichPlugin::storeIntegers(const vector<int>& values, const string& property, SerializationNode& node) {
    string text;
    char digits[16];
    for (int value : values) {
        if (!text.empty())
            text += ' ';
        text.append(digits, to_chars(digits, digits + sizeof(digits), value).ptr);
    }
    node.setStringProperty(property, text);
}

vector<int> HelfrichPlugin::loadIntegers(const string& property, const SerializationNode& node) {
    const string text = node.getStringProperty(property);
    const char* next = text.data();
    const char* end = next + text.size();
    vector<int> values;
    while (next != end) {
        int value;
        from_chars_result number = from_chars(next, end, value);
        bool isSeparated = (number.ptr == end || (*number.ptr == ' ' && number.ptr + 1 != end));
        if (number.ec != errc() || !isSeparated)
            throw OpenMMException("HelfrichForce: the serialized " + property +
                                  " hold something else than an integer near '" + string(next, min(next + 16, end)) +
                                  "'");
        next = (number.ptr == end ? end : number.ptr + 1);
        values.push_back(value);
    }
    return values;
}

void HelfrichPlugin::storeTriangles(const vector<array<int, 3>>& triangles, SerializationNode& node) {
    vector<int> particles;
    particles.reserve(3 * triangles.size());
    for (const array<int, 3>& triangle : triangles)
        particles.insert(particles.end(), triangle.begin(), triangle.end());
    node.setLongProperty("count", triangles.size());
    storeIntegers(particles, "particles", node);
}

vector<array<int, 3>> HelfrichPlugin::loadTriangles(const SerializationNode& node) {
    vector<int> particles = loadIntegers("particles", node);
    long long count = node.getLongProperty("count");
    if (count != (long long) particles.size() / 3 || particles.size() % 3 != 0)
        throw OpenMMException("HelfrichForce: the serialized triangles are not complete: " +
                              to_string(particles.size()) + " particles for " + to_string(count) + " triangles");
    vector<array<int, 3>> triangles(count);
    for (size_t i = 0; i < particles.size(); i++)
        triangles[i / 3][i % 3] = particles[i];
    return triangles;
}
