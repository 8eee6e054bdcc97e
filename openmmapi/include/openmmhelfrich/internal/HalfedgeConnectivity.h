#ifndef OPENMM_HELFRICH_HALFEDGECONNECTIVITY_H_
#define OPENMM_HELFRICH_HALFEDGECONNECTIVITY_H_

#include <vector>

namespace HelfrichPlugin {

/**
 * The numbers of a connectivity.  What is nearly always needed together is next to each other.
 */
struct HalfedgeArrays {
    struct Vertex {
        int outgoing, valence;
    };
    struct Halfedge {
        int origin, opposite, oppositeApex;
    };
    std::vector<Vertex> vertices;
    std::vector<Halfedge> halfedges;
    /// for each halfedge whether its edge is fixed; empty when none is
    std::vector<char> fixedHalfedges;
};

/**
 * Numbers that are read and written as they are.
 */
struct PlainAccess {
    template <class T>
    static T get(const T& number) {
        return number;
    }
    template <class T>
    static void set(T& number, T value) {
        number = value;
    }
};

/**
 * The halfedges around a vertex, for loops: each is a rotation of the one before.  There are as many as the valence
 * says, so that every loop ends.
 */
template <class Connectivity>
class HalfedgeCirculator {
public:
    HalfedgeCirculator(const Connectivity& connectivity, int vertex)
            : connectivity(connectivity), halfedge(connectivity.outgoing(vertex)), count(connectivity.valence(vertex)) {
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
        count--;
        halfedge = connectivity.rotate(halfedge);
        return *this;
    }
    int operator*() const {
        return halfedge;
    }
protected:
    const Connectivity& connectivity;
    int halfedge, count;
};

/**
 * The vertices to which these halfedges lead.
 */
template <class Connectivity>
class NeighborCirculator : public HalfedgeCirculator<Connectivity> {
public:
    using HalfedgeCirculator<Connectivity>::HalfedgeCirculator;
    NeighborCirculator begin() const {
        return *this;
    }
    int operator*() const {
        return this->connectivity.tip(this->halfedge);
    }
};

/**
 * The words in which the connectivity of a closed, oriented, triangulated surface is read and changed.  Halfedge 3t+c
 * runs along triangle t from its corner c to the next one.
 *
 * Access is how numbers are read and written: PlainAccess, or one that lets threads look while another one flips edges.
 * Arrays is HalfedgeArrays, or a reference to those of another connectivity.
 */
template <class Access, class Arrays = HalfedgeArrays>
class HalfedgeConnectivity {
public:
    int getNumVertices() const {
        return arrays.vertices.size();
    }
    int getNumTriangles() const {
        return arrays.halfedges.size() / 3;
    }
    int getNumEdges() const {
        return arrays.halfedges.size() / 2;
    }
    int getNumHalfedges() const {
        return arrays.halfedges.size();
    }
    /**
     * Get the number of edges, each in its two directions.
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
     * Get whether a halfedge's triangle is exterior: a part of the connectivity where there is no surface.  None is,
     * for every surface is closed.
     */
    static constexpr bool isExterior(int h) {
        return false;
    }
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
        return Access::get(arrays.halfedges[h].origin);
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
        return Access::get(arrays.halfedges[h].opposite);
    }
    /**
     * Get the apex of a halfedge's opposite, the vertex beyond the edge, at less cost.
     */
    int oppositeApex(int h) const {
        return Access::get(arrays.halfedges[h].oppositeApex);
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
        return Access::get(arrays.vertices[vertex].outgoing);
    }
    /**
     * Get the number of edges at a vertex.
     */
    int valence(int vertex) const {
        return Access::get(arrays.vertices[vertex].valence);
    }
    /**
     * Get the halfedges that start from a vertex, counter-clockwise.
     */
    HalfedgeCirculator<HalfedgeConnectivity> outgoingHalfedges(int vertex) const {
        return {*this, vertex};
    }
    /**
     * Get the bonded neighbors of a vertex, counter-clockwise.
     */
    NeighborCirculator<HalfedgeConnectivity> neighbors(int vertex) const {
        return {*this, vertex};
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
     * Get whether a pair of different vertices is excluded from the repulsion.  It looks around these two only, not
     * around their bonded neighbors, where another thread may flip edges.
     *
     * @param level    0 for no pair, 1 for bonded neighbors, 2 for those that share a bonded neighbor too
     * @param ignored  a vertex that does not count as a shared one, or -1
     */
    bool areExcluded(int vertex1, int vertex2, int level, int ignored = -1) const {
        for (int neighbor : neighbors(vertex1))
            if ((level > 0 && neighbor == vertex2) || (level > 1 && neighbor != ignored && isAround(vertex2, neighbor)))
                return true;
        return false;
    }
    /**
     * Visit the vertices for which areExcluded() is true, some of them more than once, and perhaps the vertex itself.
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
     * Get whether a halfedge's edge may never flip.
     */
    bool isFixed(int h) const {
        return !arrays.fixedHalfedges.empty() && Access::get(arrays.fixedHalfedges[h]);
    }
    /**
     * Get whether a halfedge's edge is not fixed and its flip leaves a valid mesh.
     */
    bool canFlip(int h) const {
        int o = opposite(h);
        return !isFixed(h) && valence(origin(h)) > 3 && valence(origin(o)) > 3 && !areBonded(apex(h), apex(o));
    }
    /**
     * Replace an edge by the other diagonal of its two triangles.  canFlip(h) must be true.
     *
     * Afterwards previous(h) and previous(opposite(h)) as they were are the halfedges of the new edge.
     */
    void flip(int h) {
        int o = opposite(h), hPrevious = previous(h), oPrevious = previous(o);
        int i = origin(h), j = origin(o), k = origin(hPrevious), l = origin(oPrevious);
        setOutgoing(i, next(o));
        setOutgoing(j, next(h));
        for (int vertex : {i, j})
            setValence(vertex, valence(vertex) - 1);
        for (int vertex : {k, l})
            setValence(vertex, valence(vertex) + 1);
        setHalfedge(h, l, opposite(oPrevious), oppositeApex(oPrevious));
        setHalfedge(o, k, opposite(hPrevious), oppositeApex(hPrevious));
        setHalfedge(hPrevious, k, oPrevious, i);
        setHalfedge(oPrevious, l, hPrevious, j);
        setBeyond(h, k);
        setBeyond(next(o), k);
        setBeyond(o, l);
        setBeyond(next(h), l);
        if (!arrays.fixedHalfedges.empty()) {
            setFixed(h, isFixed(oPrevious));
            setFixed(o, isFixed(hPrevious));
            setFixed(hPrevious, false);
            setFixed(oPrevious, false);
        }
    }
    /**
     * Undo flip(h), the last change of the mesh.
     */
    void unflip(int h) {
        int hPrevious = previous(h), oPrevious = opposite(hPrevious), o = next(oPrevious);
        int i = origin(next(o)), j = origin(next(h)), k = origin(hPrevious), l = origin(oPrevious);
        setOutgoing(k, hPrevious);
        setOutgoing(l, oPrevious);
        for (int vertex : {i, j})
            setValence(vertex, valence(vertex) + 1);
        for (int vertex : {k, l})
            setValence(vertex, valence(vertex) - 1);
        setHalfedge(hPrevious, k, opposite(o), oppositeApex(o));
        setHalfedge(oPrevious, l, opposite(h), oppositeApex(h));
        setHalfedge(h, i, o, l);
        setHalfedge(o, j, h, k);
        setBeyond(hPrevious, j);
        setBeyond(next(o), j);
        setBeyond(oPrevious, i);
        setBeyond(next(h), i);
        if (!arrays.fixedHalfedges.empty()) {
            setFixed(hPrevious, isFixed(o));
            setFixed(oPrevious, isFixed(h));
            setFixed(h, false);
            setFixed(o, false);
        }
    }
protected:
    HalfedgeConnectivity() = default;
    explicit HalfedgeConnectivity(Arrays arrays) : arrays(arrays) {
    }
    void setOutgoing(int vertex, int h) {
        Access::set(arrays.vertices[vertex].outgoing, h);
    }
    void setValence(int vertex, int valence) {
        Access::set(arrays.vertices[vertex].valence, valence);
    }
    void setHalfedge(int h, int origin, int opposite, int oppositeApex) {
        Access::set(arrays.halfedges[h].origin, origin);
        Access::set(arrays.halfedges[h].opposite, opposite);
        Access::set(arrays.halfedges[h].oppositeApex, oppositeApex);
    }
    /**
     * Tell a halfedge's opposite what is beyond it: the halfedge, and the apex of its triangle.
     */
    void setBeyond(int h, int apex) {
        HalfedgeArrays::Halfedge& beyond = arrays.halfedges[opposite(h)];
        Access::set(beyond.opposite, h);
        Access::set(beyond.oppositeApex, apex);
    }
    void setFixed(int h, bool isFixed) {
        Access::set(arrays.fixedHalfedges[h], char(isFixed));
    }
    Arrays arrays;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_HALFEDGECONNECTIVITY_H_*/
