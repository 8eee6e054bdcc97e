#ifndef OPENMM_HELFRICHMESH_H_
#define OPENMM_HELFRICHMESH_H_

#include "HalfedgeConnectivity.h"
#include "windowsExportHelfrich.h"
#include <array>
#include <string>
#include <utility>
#include <vector>

namespace HelfrichPlugin {

/**
 * The connectivity of closed, oriented, triangulated surfaces, which edge flips change in place.
 *
 * Vertices are numbered from 0 in ascending order of their particles, connected surfaces in the order of their first
 * triangles.  The ordered triangles and the species of the vertices are the complete state: everything else here
 * derives from them.  Flips change neither which surface a vertex belongs to nor which one a triangle is a part of.
 */
class OPENMM_EXPORT_HELFRICH HelfrichMesh : public HalfedgeConnectivity<PlainAccess> {
public:
    /**
     * Create a mesh.  Throws an OpenMMException that names the item unless the triangles form closed, consistently
     * oriented manifolds, with at most one edge between two vertices and at least three at each.
     *
     * @param triangles     the particles of each triangle, in counter-clockwise order seen from outside
     * @param numParticles  the number of particles in the System
     */
    HelfrichMesh(const std::vector<std::array<int, 3>>& triangles, int numParticles);
    /**
     * Get the particle of each vertex.
     */
    const std::vector<int>& getParticles() const {
        return particles;
    }
    /**
     * Get the number of connected surfaces.
     */
    int getNumSurfaces() const {
        return surfaceSizes.size();
    }
    /**
     * Get the number of the surface that a vertex belongs to.
     */
    int getSurface(int vertex) const {
        return surfaces[vertex];
    }
    /**
     * Get the same of each vertex.
     */
    const std::vector<int>& getSurfaces() const {
        return surfaces;
    }
    /**
     * Get the number of vertices of each surface.
     */
    const std::vector<int>& getSurfaceSizes() const {
        return surfaceSizes;
    }
    /**
     * Get the species of each vertex; none if all vertices are alike.
     */
    const std::vector<int>& getSpecies() const {
        return species;
    }
    /**
     * Get the species of a vertex, 0 if all are alike.
     */
    int getSpecies(int vertex) const {
        return species.empty() ? 0 : species[vertex];
    }
    /**
     * Set the species of each vertex.  Throws an OpenMMException, and leaves the mesh as it was, unless there is one
     * for each, from 0 to numSpecies-1.
     */
    void setSpecies(const std::vector<int>& species, int numSpecies);
    /**
     * Exchange the species of two vertices.  markSpeciesChanged() makes it known, so that a sweep of exchanges counts
     * as one change.
     */
    void exchangeSpecies(int vertex1, int vertex2) {
        std::swap(species[vertex1], species[vertex2]);
    }
    /**
     * Change the species of a vertex, likewise.
     */
    void changeSpecies(int vertex, int newSpecies) {
        species[vertex] = newSpecies;
    }
    void markSpeciesChanged() {
        speciesRevision++;
    }
    /**
     * Get the number of times that the species of vertices have changed.
     */
    long long getSpeciesRevision() const {
        return speciesRevision;
    }
    /**
     * Get the Euler characteristic V-E+F of all surfaces together: 2 for each sphere, less 2 for each handle.
     */
    int getEulerCharacteristic() const {
        return getNumVertices() - getNumEdges() + getNumTriangles();
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
     * the same particles as before to the same surfaces, and have every fixed edge.
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
     * Get all vertices in an order that keeps neighbors close to each other: surface by surface, and each patch by
     * patch, which grew breadth-first from a vertex beside an earlier one.
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
     * once, and those of a surface together.
     */
    void setOrder(const std::vector<int>& order);
    /**
     * Get the numbers of the connectivity, for those who read and change them in another way.
     */
    const HalfedgeArrays& getArrays() const {
        return arrays;
    }
    HalfedgeArrays& getArrays() {
        return arrays;
    }
    /**
     * Make known to the kernels that the connectivity changed.  flip() does not, so that a sweep of flips counts as one
     * change.
     */
    void markChanged();
    /**
     * Make known that the connectivity changed around some of the vertices only: at the ends of edges that flipped, or
     * were made by flips.
     */
    void markChanged(const std::vector<int>& vertices);
    /**
     * Find the vertices around which the connectivity has changed since a revision.
     *
     * @param since          the number of that revision
     * @param[out] vertices  these vertices, in ascending order
     * @return whether they are known.  Where they are not, everything may have changed.
     */
    bool findChanges(long long since, std::vector<int>& vertices) const;
    /**
     * Throw an OpenMMException unless the mesh is valid and everything derived from the triangles is right.  This is
     * meant for tests.
     */
    void validate() const;
private:
    void findParticles(const std::vector<std::array<int, 3>>& triangles);
    void findVertices(const std::vector<std::array<int, 3>>& triangles);
    void connect();
    void pair(const int* sameEdge, int count);
    void chooseOutgoings();
    void findSurfaces();
    int findHalfedge(int particle1, int particle2) const;
    void checkVertices() const;
    std::string describeEdge(int vertex1, int vertex2) const;
    int numParticles;
    std::vector<int> particles, order;
    /// the surface of each vertex, and the number of vertices of each surface
    std::vector<int> surfaces, surfaceSizes;
    /// empty if all vertices are alike
    std::vector<int> species;
    std::vector<std::array<int, 2>> fixedEdges;
    long long revision = 0, speciesRevision = 0;
    /// the vertices around which the last revisions changed the connectivity, and where those of each of them end
    std::vector<int> changes;
    std::vector<size_t> changeEnds;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHMESH_H_*/
