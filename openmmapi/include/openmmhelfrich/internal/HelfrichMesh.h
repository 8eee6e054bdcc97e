#ifndef OPENMM_HELFRICHMESH_H_
#define OPENMM_HELFRICHMESH_H_

#include "Relaxed.h"
#include "windowsExportHelfrich.h"
#include <array>
#include <string>
#include <vector>

namespace HelfrichPlugin {

/**
 * The halfedges around a vertex, for loops: each is a rotation of the one before.  There are as many as the valence
 * says, so that a loop ends whatever a mesh looks like.
 */
template <class Mesh>
class HalfedgeCirculator {
public:
    HalfedgeCirculator(const Mesh& mesh, int halfedge, int count) : mesh(mesh), halfedge(halfedge), count(count) {
    }
    struct End {};
    HalfedgeCirculator begin() const {
        return *this;
    }
    End end() const {
        return {};
    }
    bool operator!=(End) const {
        return count > 0;
    }
    HalfedgeCirculator& operator++() {
        if (--count > 0)
            halfedge = mesh.rotate(halfedge);
        return *this;
    }
    int operator*() const {
        return halfedge;
    }
protected:
    const Mesh& mesh;
    int halfedge, count;
};

/**
 * The vertices to which they lead.
 */
template <class Mesh>
class NeighborCirculator : public HalfedgeCirculator<Mesh> {
public:
    using HalfedgeCirculator<Mesh>::HalfedgeCirculator;
    NeighborCirculator begin() const {
        return *this;
    }
    int operator*() const {
        return this->mesh.tip(this->halfedge);
    }
};

/**
 * The connectivity of a closed, oriented, triangulated surface, which edge flips change in place.
 *
 * Vertices are numbered from 0 in ascending order of their particles.  Halfedge 3t+c runs along triangle t from its
 * corner c to the next one.  The ordered triangles are the complete state: everything else here derives from them.
 *
 * Threads may look at a mesh while another one flips edges.  What they find at the vertices of a flip may be from
 * before or after it, and not fit together; but every number is that of a vertex or halfedge, and every search comes to
 * an end.
 */
class OPENMM_EXPORT_HELFRICH HelfrichMesh {
public:
    /**
     * Create a mesh.  Throws an OpenMMException that names the item unless the triangles form closed, consistently
     * oriented manifolds, with at most one edge between two vertices and at least three at each.
     *
     * @param triangles     the particles of each triangle, in counter-clockwise order seen from outside
     * @param numParticles  the number of particles in the System
     */
    HelfrichMesh(const std::vector<std::array<int, 3>>& triangles, int numParticles);
    int getNumVertices() const {
        return particles.size();
    }
    int getNumTriangles() const {
        return halfedges.size() / 3;
    }
    int getNumEdges() const {
        return halfedges.size() / 2;
    }
    int getNumHalfedges() const {
        return halfedges.size();
    }
    /**
     * Get the number of edges that a flip may be attempted at, each in two directions.
     */
    int getNumDirectedEdges() const {
        return 2 * getNumEdges();
    }
    /**
     * Get the halfedge that runs along an edge in one of its directions.
     */
    static int halfedgeOf(int directedEdge) {
        return directedEdge;
    }
    /**
     * Get the particle of each vertex.
     */
    const std::vector<int>& getParticles() const {
        return particles;
    }
    /**
     * Get the number of times that the connectivity has changed.
     */
    long long getRevision() const {
        return revision;
    }
    /**
     * Get the particles of each triangle.
     */
    std::vector<std::array<int, 3>> getTriangles() const;
    /**
     * Replace the triangles.  Throws an OpenMMException, and leaves the mesh as it was, unless they are valid, connect
     * the same particles as before and have every fixed edge.
     */
    void setTriangles(const std::vector<std::array<int, 3>>& triangles);
    /**
     * Set the edges that never flip, as pairs of particles in either order.  They remain those of the mesh when its
     * triangles are replaced.  Throws an OpenMMException that names the edge, and leaves the mesh as it was, unless
     * each is an edge of the triangles and appears once.
     */
    void setFixedEdges(const std::vector<std::array<int, 2>>& edges);
    /**
     * The number of vertices in a patch of the order: their positions fit in a processor's first-level cache.
     */
    static constexpr int PATCH = 512;
    /**
     * Get all vertices in an order that keeps neighbors close to each other: patch by patch, each of which grew
     * breadth-first from a vertex beside an earlier one.
     */
    const std::vector<int>& getOrder() const {
        return order;
    }
    /**
     * Make a new order, for flips scramble the patches.  When this is done must not depend on when a simulation was
     * restarted: the order of the vertices is that of the kernels' sums, and shows in their last bits.
     */
    void renewOrder();
    /**
     * Set the order of an earlier mesh with the same vertices.  Throws an OpenMMException unless it has every vertex
     * once.
     */
    void setOrder(const std::vector<int>& order);
    /**
     * Get the next halfedge of the same triangle.  No branch depends on the corner, which no processor could predict.
     */
    static int next(int h) {
        static constexpr int STEPS[3] = {1, 1, -2};
        return h + STEPS[unsigned(h) % 3];
    }
    /**
     * Get the previous halfedge of the same triangle.
     */
    static int previous(int h) {
        static constexpr int STEPS[3] = {2, -1, -1};
        return h + STEPS[unsigned(h) % 3];
    }
    /**
     * Get the vertex that a halfedge starts from.
     */
    int origin(int h) const {
        return halfedges[h].origin;
    }
    /**
     * Get the vertex that a halfedge leads to.
     */
    int tip(int h) const {
        return origin(next(h));
    }
    /**
     * Get the vertex of a halfedge's triangle that is not on the halfedge.
     */
    int apex(int h) const {
        return origin(previous(h));
    }
    /**
     * Get the halfedge that runs along the same edge in the other direction.
     */
    int opposite(int h) const {
        return halfedges[h].opposite;
    }
    /**
     * Get the vertex beyond a halfedge: the apex of its opposite, at less cost.
     */
    int outer(int h) const {
        return halfedges[h].outer;
    }
    /**
     * Get the halfedge that follows h, counter-clockwise, among those that start from the same vertex.
     */
    int rotate(int h) const {
        return opposite(previous(h));
    }
    /**
     * Get one of the halfedges that start from a vertex.  Which one depends on the flips made so far.
     */
    int outgoing(int vertex) const {
        return vertices[vertex].outgoing;
    }
    /**
     * Get the number of edges at a vertex.
     */
    int valence(int vertex) const {
        return vertices[vertex].valence;
    }
    /**
     * Get the halfedges that start from a vertex, counter-clockwise.
     */
    HalfedgeCirculator<HelfrichMesh> outgoingHalfedges(int vertex) const {
        return {*this, outgoing(vertex), valence(vertex)};
    }
    /**
     * Get the bonded neighbors of a vertex, counter-clockwise.
     */
    NeighborCirculator<HelfrichMesh> neighbors(int vertex) const {
        return {*this, outgoing(vertex), valence(vertex)};
    }
    /**
     * Get whether an edge connects two vertices.
     */
    bool areBonded(int vertex1, int vertex2) const {
        return valence(vertex1) <= valence(vertex2) ? isAround(vertex1, vertex2) : isAround(vertex2, vertex1);
    }
    /**
     * Get the same, but look around the first vertex only.
     */
    bool isAround(int vertex1, int vertex2) const {
        for (int neighbor : neighbors(vertex1))
            if (neighbor == vertex2)
                return true;
        return false;
    }
    /**
     * Visit the vertices that are excluded from the repulsion of a vertex, some of them more than once.
     *
     * @param level  0 for none, 1 for bonded neighbors, 2 for their bonded neighbors too
     */
    template <class Visitor>
    void forEachExcluded(int vertex, int level, Visitor visit) const {
        if (level > 0)
            for (int neighbor : neighbors(vertex)) {
                visit(neighbor);
                if (level > 1)
                    for (int second : neighbors(neighbor))
                        visit(second);
            }
    }
    /**
     * Get whether a pair of different vertices is left out of the repulsion.  See forEachExcluded() for the level.
     */
    bool areExcluded(int vertex1, int vertex2, int level) const {
        bool isFound = false;
        forEachExcluded(vertex1, level, [&](int vertex) { isFound |= (vertex == vertex2); });
        return isFound;
    }
    /**
     * Get whether a halfedge's edge may never flip.
     */
    bool isFixed(int h) const {
        return !fixedHalfedges.empty() && fixedHalfedges[h];
    }
    /**
     * Get whether a halfedge's edge is not fixed and its flip leaves a valid mesh.
     */
    bool canFlip(int h) const {
        int o = opposite(h);
        return !isFixed(h) && valence(origin(h)) > 3 && valence(origin(o)) > 3 && !areBonded(apex(h), apex(o));
    }
    /**
     * Bring what the mesh knows of a halfedge's triangle, which may be on two lines, into the cache.
     */
    void prefetch(int h) const {
        int first = h - unsigned(h) % 3;
        __builtin_prefetch(&halfedges[first]);
        __builtin_prefetch(&halfedges[first + 2].outer);
    }
    /**
     * Bring what the mesh knows of a vertex into the cache.
     */
    void prefetchVertex(int vertex) const {
        __builtin_prefetch(&vertices[vertex]);
    }
    /**
     * Replace an edge by the other diagonal of its two triangles.  canFlip(h) must be true.
     *
     * Afterwards previous(h) and previous(opposite(h)) as they were are the halfedges of the new edge.
     */
    void flip(int h);
    /**
     * Undo flip(h), the last change of the mesh.
     */
    void unflip(int h);
    /**
     * Make known to the kernels that the connectivity changed.  flip() does not, so that a sweep of flips counts as one
     * change.
     */
    void markChanged() {
        revision++;
    }
    /**
     * Throw an OpenMMException unless the mesh is valid and everything derived from the triangles is right.  This is
     * meant for tests.
     */
    void validate() const;
private:
    // What is nearly always needed together is next to each other.
    struct Vertex {
        Relaxed<int> outgoing, valence;
    };
    struct Halfedge {
        Relaxed<int> origin, opposite, outer;
    };
    void findParticles(const std::vector<std::array<int, 3>>& triangles);
    void findVertices(const std::vector<std::array<int, 3>>& triangles);
    void connect();
    void pair(const int* sameEdge, int count);
    void chooseOutgoings();
    int findHalfedge(int particle1, int particle2) const;
    void checkVertices() const;
    std::string describeEdge(int vertex1, int vertex2) const;
    int numParticles;
    std::vector<int> particles, order;
    std::vector<Vertex> vertices;
    std::vector<Halfedge> halfedges;
    std::vector<std::array<int, 2>> fixedEdges;
    /// for each halfedge whether its edge is fixed; empty when none is
    std::vector<Relaxed<char>> fixedHalfedges;
    long long revision = 0;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHMESH_H_*/
