#include "openmmhelfrich/internal/HelfrichMesh.h"
#include "openmm/OpenMMException.h"
#include <algorithm>
#include <sstream>

using namespace HelfrichPlugin;
using OpenMM::OpenMMException;
using namespace std;

static string describeTriangle(int index, const array<int, 3>& t) {
    stringstream text;
    text << "triangle " << index << " (" << t[0] << ", " << t[1] << ", " << t[2] << ")";
    return text.str();
}

static void checkTriangles(const vector<array<int, 3>>& triangles, int numParticles) {
    if (triangles.empty())
        throw OpenMMException("HelfrichForce: there are no triangles; add them with addTriangle() or setTriangles()");
    for (int i = 0; i < (int) triangles.size(); i++) {
        const array<int, 3>& t = triangles[i];
        for (int particle : t)
            if (particle < 0 || particle >= numParticles)
                throw OpenMMException("HelfrichForce: " + describeTriangle(i, t) + " has the particle index " +
                                      to_string(particle) + ", but the System's particles have indices from 0 to " +
                                      to_string(numParticles - 1));
        if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0])
            throw OpenMMException("HelfrichForce: " + describeTriangle(i, t) +
                                  " repeats a particle; a triangle has three different ones");
    }
}

/**
 * Collects the vertices surface by surface, and of each patch by patch.  A patch grows breadth-first from a vertex
 * beside an earlier one.
 */
class PatchOrder {
public:
    explicit PatchOrder(const HelfrichMesh& mesh) : mesh(mesh), isCollected(mesh.getNumVertices(), 0) {
        order.reserve(mesh.getNumVertices());
        for (int v = 0; v < mesh.getNumVertices(); v++) {
            // Vertices that wait beside a patch come before those of other surfaces.

            surfaceStart = order.size();
            growPatch(v);
            for (size_t next = 0; next < border.size(); next++)
                growPatch(border[next]);
            border.clear();
        }
    }
    vector<int> order;
private:
    void growPatch(int seed) {
        if (isCollected[seed])
            return;
        size_t next = order.size(), end = next - (next - surfaceStart) % HelfrichMesh::PATCH + HelfrichMesh::PATCH;
        add(seed);
        for (; next < order.size(); next++) {
            for (int neighbor : mesh.neighbors(order[next]))
                if (!isCollected[neighbor]) {
                    if (order.size() < end)
                        add(neighbor);
                    else
                        border.push_back(neighbor);
                }
        }
    }
    void add(int vertex) {
        isCollected[vertex] = 1;
        order.push_back(vertex);
    }
    const HelfrichMesh& mesh;
    vector<char> isCollected;
    vector<int> border;
    size_t surfaceStart = 0;
};

HelfrichMesh::HelfrichMesh(const vector<array<int, 3>>& triangles, int numParticles) : numParticles(numParticles) {
    checkTriangles(triangles, numParticles);
    findParticles(triangles);
    findVertices(triangles);
    connect();
    findSurfaces();
    order = PatchOrder(*this).order;
}

void HelfrichMesh::findSurfaces() {
    const int NONE = -1;
    surfaces.assign(getNumVertices(), NONE);
    vector<int> found;
    for (int h = 0; h < getNumHalfedges(); h += 3) {
        if (surfaces[origin(h)] != NONE)
            continue;
        int surface = surfaceSizes.size();
        surfaces[origin(h)] = surface;
        found.assign(1, origin(h));
        for (size_t next = 0; next < found.size(); next++)
            for (int neighbor : neighbors(found[next]))
                if (surfaces[neighbor] == NONE) {
                    surfaces[neighbor] = surface;
                    found.push_back(neighbor);
                }
        surfaceSizes.push_back(found.size());
    }
}

void HelfrichMesh::chooseOutgoings() {
    for (int h = getNumHalfedges() - 1; h >= 0; h--)
        arrays.vertices[origin(h)].outgoing = h;
}

void HelfrichMesh::renewOrder() {
    // The order must follow from the triangles alone, and not from the flips that led to them.

    chooseOutgoings();
    order = PatchOrder(*this).order;
    markChanged();
}

void HelfrichMesh::setOrder(const vector<int>& order) {
    vector<char> isThere(particles.size(), 0);
    for (int vertex : order)
        if (vertex >= 0 && vertex < getNumVertices())
            isThere[vertex] = 1;
    if (order.size() != particles.size() || count(isThere.begin(), isThere.end(), 1) != getNumVertices())
        throw OpenMMException("HelfrichMesh: an order of the vertices must have each of them once");
    int numChanges = 0;
    for (size_t i = 1; i < order.size(); i++)
        numChanges += (surfaces[order[i]] != surfaces[order[i - 1]]);
    if (numChanges != getNumSurfaces() - 1)
        throw OpenMMException("HelfrichMesh: an order of the vertices must have those of a surface together");
    this->order = order;
    markChanged();
}

void HelfrichMesh::markChanged() {
    revision++;
    changes.clear();
    changeEnds.clear();
}

void HelfrichMesh::markChanged(const vector<int>& vertices) {
    // Those who look at every revision find at least its own changes.  What all of a long past have in common is little
    // less than everything.

    if (changes.size() + vertices.size() > particles.size() / 2) {
        changes.clear();
        changeEnds.clear();
    }
    revision++;
    changes.insert(changes.end(), vertices.begin(), vertices.end());
    changeEnds.push_back(changes.size());
}

bool HelfrichMesh::findChanges(long long since, vector<int>& vertices) const {
    long long numRevisions = changeEnds.size(), first = numRevisions - (revision - since);
    if (first < 0 || since > revision)
        return false;
    vertices.assign(changes.begin() + (first == 0 ? 0 : changeEnds[first - 1]), changes.end());
    sort(vertices.begin(), vertices.end());
    vertices.erase(unique(vertices.begin(), vertices.end()), vertices.end());
    return true;
}

void HelfrichMesh::findParticles(const vector<array<int, 3>>& triangles) {
    vector<char> isVertex(numParticles, 0);
    for (auto& triangle : triangles)
        for (int particle : triangle)
            isVertex[particle] = 1;
    for (int i = 0; i < numParticles; i++)
        if (isVertex[i])
            particles.push_back(i);
}

void HelfrichMesh::findVertices(const vector<array<int, 3>>& triangles) {
    bool areContiguous = (particles.back() == (int) particles.size() - 1);
    arrays.halfedges.reserve(3 * triangles.size());
    for (auto& triangle : triangles)
        for (int particle : triangle) {
            int vertex = areContiguous ? particle
                                       : lower_bound(particles.begin(), particles.end(), particle) - particles.begin();
            arrays.halfedges.push_back({vertex, -1, -1});
        }
}

string HelfrichMesh::describeEdge(int vertex1, int vertex2) const {
    return to_string(particles[vertex1]) + "-" + to_string(particles[vertex2]);
}

void HelfrichMesh::pair(const int* sameEdge, int count) {
    int h1 = sameEdge[0], h2 = sameEdge[count - 1];
    if (count == 2 && origin(h1) != origin(h2)) {
        arrays.halfedges[h1].opposite = h2;
        arrays.halfedges[h2].opposite = h1;
        return;
    }
    string edge = "HelfrichForce: the edge " + describeEdge(min(origin(h1), tip(h1)), max(origin(h1), tip(h1)));
    if (count == 1)
        throw OpenMMException(edge + " belongs to triangle " + to_string(h1 / 3) +
                              " only; the surface must be closed, with two triangles at each edge");
    for (int i = 0; i < count; i++)
        for (int j = 0; j < i; j++)
            if (origin(sameEdge[i]) == origin(sameEdge[j]) && apex(sameEdge[i]) == apex(sameEdge[j]))
                throw OpenMMException("HelfrichForce: triangle " + to_string(sameEdge[i] / 3) + " repeats triangle " +
                                      to_string(sameEdge[j] / 3) + "; each triangle may appear once");
    if (count > 2)
        throw OpenMMException(edge + " belongs to " + to_string(count) + " triangles, among them " + to_string(h1 / 3) +
                              " and " + to_string(h2 / 3) + "; an edge belongs to exactly two");
    throw OpenMMException(edge + " runs the same way in triangles " + to_string(h1 / 3) + " and " + to_string(h2 / 3) +
                          "; all triangles must be counter-clockwise seen from outside");
}

void HelfrichMesh::connect() {
    // Sort the halfedges into buckets by the lower vertex of their edge, then pair those with the same other vertex.

    int numHalfedges = arrays.halfedges.size();
    vector<int> start(particles.size() + 1, 0), bucket(numHalfedges);
    for (int h = 0; h < numHalfedges; h++)
        start[min(origin(h), tip(h)) + 1]++;
    for (size_t i = 1; i < start.size(); i++)
        start[i] += start[i - 1];
    vector<int> end(start.begin(), start.end() - 1);
    for (int h = 0; h < numHalfedges; h++)
        bucket[end[min(origin(h), tip(h))]++] = h;
    auto upper = [&](int h) { return max(origin(h), tip(h)); };
    for (size_t v = 0; v < particles.size(); v++) {
        sort(bucket.begin() + start[v], bucket.begin() + end[v],
             [&](int a, int b) { return make_pair(upper(a), a) < make_pair(upper(b), b); });
        for (int first = start[v], last; first < end[v]; first = last) {
            for (last = first + 1; last < end[v] && upper(bucket[last]) == upper(bucket[first]); last++)
                ;
            pair(&bucket[first], last - first);
        }
    }
    for (HalfedgeArrays::Halfedge& halfedge : arrays.halfedges)
        halfedge.oppositeApex = apex(halfedge.opposite);
    arrays.vertices.assign(particles.size(), HalfedgeArrays::Vertex());
    chooseOutgoings();
    for (int h = 0; h < numHalfedges; h++)
        arrays.vertices[origin(h)].valence += 1;
    checkVertices();
}

void HelfrichMesh::checkVertices() const {
    for (int v = 0; v < getNumVertices(); v++) {
        // One fan of all triangles comes to its first halfedge once, a smaller one again.
        int numTurns = 0;
        for (int h : outgoingHalfedges(v))
            numTurns += (h == outgoing(v));
        if (numTurns != 1)
            throw OpenMMException("HelfrichForce: the triangles around particle " + to_string(particles[v]) +
                                  " form more than one fan; surfaces must not touch at a vertex");
        if (valence(v) < 3)
            throw OpenMMException("HelfrichForce: particle " + to_string(particles[v]) + " has only " +
                                  to_string(valence(v)) + " neighbors; each vertex needs at least three");
    }
}

vector<array<int, 3>> HelfrichMesh::getTriangles() const {
    vector<array<int, 3>> triangles(getNumTriangles());
    for (int t = 0; t < getNumTriangles(); t++)
        for (int c = 0; c < 3; c++)
            triangles[t][c] = particles[origin(3 * t + c)];
    return triangles;
}

void HelfrichMesh::setTriangles(const vector<array<int, 3>>& triangles) {
    HelfrichMesh mesh(triangles, numParticles);
    if (mesh.particles != particles)
        throw OpenMMException("HelfrichForce: the new triangles must connect the same " + to_string(particles.size()) +
                              " particles as before");
    if (mesh.arrays.halfedges.size() != arrays.halfedges.size())
        throw OpenMMException("HelfrichForce: there are " + to_string(triangles.size()) +
                              " new triangles; their number must stay " + to_string(getNumTriangles()));
    auto moved = mismatch(surfaces.begin(), surfaces.end(), mesh.surfaces.begin());
    if (moved.first != surfaces.end())
        throw OpenMMException("HelfrichForce: by the new triangles, particle " +
                              to_string(particles[moved.first - surfaces.begin()]) + " belongs to surface " +
                              to_string(*moved.second) + ", and not to surface " + to_string(*moved.first) +
                              " as before; the surfaces must stay the same, in the same order");
    mesh.setFixedEdges(fixedEdges);
    mesh.revision = revision + 1;
    mesh.species = species;
    mesh.speciesRevision = speciesRevision;
    *this = mesh;
}

void HelfrichMesh::setSpecies(const vector<int>& species, int numSpecies) {
    if (species.size() != particles.size())
        throw OpenMMException("HelfrichForce: there are " + to_string(species.size()) + " species of vertices for " +
                              to_string(particles.size()) + " vertices; each vertex has one");
    for (size_t v = 0; v < species.size(); v++)
        if (species[v] < 0 || species[v] >= numSpecies)
            throw OpenMMException("HelfrichForce: vertex " + to_string(v) + " is of species " + to_string(species[v]) +
                                  ", but there are " + to_string(numSpecies) + " species, numbered from 0");
    this->species = species;
    speciesRevision++;
}

int HelfrichMesh::findHalfedge(int particle1, int particle2) const {
    auto found = lower_bound(particles.begin(), particles.end(), particle1);
    if (found == particles.end() || *found != particle1)
        return -1;
    for (int h : outgoingHalfedges(found - particles.begin()))
        if (particles[tip(h)] == particle2)
            return h;
    return -1;
}

void HelfrichMesh::setFixedEdges(const vector<array<int, 2>>& edges) {
    vector<char> isFixed(edges.empty() ? 0 : arrays.halfedges.size(), 0);
    for (size_t i = 0; i < edges.size(); i++) {
        string edge = "HelfrichForce: the fixed edge " + to_string(i) + " (" + to_string(edges[i][0]) + "-" +
                      to_string(edges[i][1]) + ")";
        int h = findHalfedge(edges[i][0], edges[i][1]);
        if (h == -1)
            throw OpenMMException(edge + " is not an edge of the triangles; only edges between two particles that they "
                                         "connect can be fixed");
        if (isFixed[h])
            throw OpenMMException(edge + " appears twice; each edge may be fixed once");
        isFixed[h] = isFixed[opposite(h)] = 1;
    }
    fixedEdges = edges;
    arrays.fixedHalfedges = isFixed;
}

void HelfrichMesh::validate() const {
    HelfrichMesh fresh(getTriangles(), numParticles);
    for (int h = 0; h < getNumHalfedges(); h++)
        if (fresh.opposite(h) != opposite(h) || fresh.oppositeApex(h) != oppositeApex(h))
            throw OpenMMException("HelfrichMesh: what is beyond halfedge " + to_string(h) + " is wrong");
    fresh.setFixedEdges(fixedEdges);
    if (fresh.arrays.fixedHalfedges != arrays.fixedHalfedges)
        throw OpenMMException("HelfrichMesh: the marks of fixed edges are wrong");
    if (fresh.surfaces != surfaces)
        throw OpenMMException("HelfrichMesh: the surfaces of the vertices are wrong");
    for (int v = 0; v < getNumVertices(); v++) {
        if (fresh.valence(v) != valence(v))
            throw OpenMMException("HelfrichMesh: the valence of vertex " + to_string(v) + " is wrong");
        if (origin(outgoing(v)) != v)
            throw OpenMMException("HelfrichMesh: the outgoing halfedge of vertex " + to_string(v) + " is wrong");
    }
}
