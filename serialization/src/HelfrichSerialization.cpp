#include "openmmhelfrich/HelfrichSerialization.h"
#include "openmm/OpenMMException.h"
#include <charconv>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

void HelfrichPlugin::requireVersion(const SerializationNode& node, int version, const string& typeName) {
    int found = node.getIntProperty("version");
    if (found != version)
        throw OpenMMException(typeName+": unsupported version "+to_string(found)+" of the serialized object; this library reads version "+to_string(version));
}

void HelfrichPlugin::storeTriangles(const vector<array<int, 3> >& triangles, SerializationNode& node) {
    string particles;
    char digits[16];
    for (const array<int, 3>& triangle : triangles)
        for (int particle : triangle) {
            if (!particles.empty())
                particles += ' ';
            particles.append(digits, to_chars(digits, digits+sizeof(digits), particle).ptr);
        }
    node.setLongProperty("count", triangles.size());
    node.setStringProperty("particles", particles);
}

vector<array<int, 3> > HelfrichPlugin::loadTriangles(const SerializationNode& node) {
    const string particles = node.getStringProperty("particles");
    const char* next = particles.data();
    const char* end = next+particles.size();
    vector<array<int, 3> > triangles;
    array<int, 3> triangle;
    int corner = 0;
    while (next != end) {
        from_chars_result number = from_chars(next, end, triangle[corner]);
        bool isSeparated = (number.ptr == end || (*number.ptr == ' ' && number.ptr+1 != end));
        if (number.ec != errc() || !isSeparated)
            throw OpenMMException("HelfrichForce: the serialized triangles hold something else than an integer near '"+string(next, min(next+16, end))+"'");
        next = (number.ptr == end ? end : number.ptr+1);
        corner = (corner+1)%3;
        if (corner == 0)
            triangles.push_back(triangle);
    }
    long long count = node.getLongProperty("count");
    if (corner != 0 || count != (long long) triangles.size())
        throw OpenMMException("HelfrichForce: the serialized triangles are not complete: "+to_string(3*triangles.size()+corner)+
                " particles for "+to_string(count)+" triangles");
    return triangles;
}
