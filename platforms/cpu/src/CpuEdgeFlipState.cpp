#include "CpuEdgeFlipState.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <algorithm>
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * The attempts that are computed in turn with other things: as many as the widest vector has.
 */
static const int GROUP = 8;

EdgeFlipState::EdgeFlipState(HelfrichMesh& mesh)
        : particles(mesh.getParticles()), mesh(mesh), evaluation(getEdgeFlipEvaluation()),
          vertices(mesh.getNumVertices()), neighbors(NULL) {
}

void EdgeFlipState::setPositions(const vector<Vec3>& positions, const HelfrichGeometry& geometry, int first, int last) {
    for (int v = first; v < last; v++) {
        const Vec3& x = positions[particles[v]];
        vertices[v] = {x[0], x[1],           x[2], 0, geometry.vertexAreas[v], geometry.vertexMeanCurvatures[v],
                       0,    mesh.valence(v)};
    }
}

void EdgeFlipState::setPositions(const EdgeFlipState& other, int first, int last) {
    copy(other.vertices.begin() + first, other.vertices.begin() + last, vertices.begin() + first);
}

/**
 * Walks around vertices to see if they are bonded to others.  All go on at the same time, and those that are around
 * before the others begin again: no branch depends on a valence, which no processor could predict.
 */
class EdgeFlipState::Walks {
public:
    static const int MAX = EdgeFlipBatch::SIZE;
    /**
     * Begin a walk.
     *
     * @param mesh      the connectivity
     * @param halfedge  starts from the vertex to go around; the apex of the triangle after its own is the first
     * neighbor on the way
     * @param numSteps  the number of neighbors to see
     * @param wanted    the vertex to look for
     * @param isFound   whether it is known to be there
     */
    void begin(const CpuHalfedges& mesh, int halfedge, int numSteps, int wanted, bool isFound = false) {
        mesh.prefetch(halfedge);
        halfedges[count] = halfedge;
        this->wanted[count] = wanted;
        this->isFound[count++] = isFound;
        stepsLeft = max(stepsLeft, numSteps);
    }
    /**
     * Make a step of all walks, unless they are done.
     */
    void step(const CpuHalfedges& mesh) {
        if (stepsLeft == 0)
            return;
        stepsLeft--;
        for (int n = 0; n < count; n++) {
            int last = mesh.previous(halfedges[n]);
            isFound[n] |= (mesh.oppositeApex(last) == wanted[n]);
            halfedges[n] = mesh.opposite(last);
            mesh.prefetch(halfedges[n]);
        }
    }
    void finish(const CpuHalfedges& mesh) {
        while (stepsLeft > 0)
            step(mesh);
    }
    void clear() {
        count = stepsLeft = 0;
    }
    bool isFound[MAX];
    int count = 0;
private:
    int halfedges[MAX], wanted[MAX], stepsLeft = 0;
};

void EdgeFlipState::evaluate(EdgeFlipBatch& batch, const EdgeFlipBatch* upcoming) const {
    // In large membranes nearly everything is in no near cache.  Vectors, steps of the walks and requests for the
    // upcoming batch take turns, so that what is needed later comes from memory while the vectors are computed.

    Walks walks;
    if (upcoming != NULL)
        for (int n = 0; n < upcoming->numAttempts; n++)
            mesh.prefetch(upcoming->halfedge[n]);
    for (int n = 0; n < batch.numAttempts; n++)
        findStencil(batch, n);
    for (int n = 0; n < batch.numAttempts; n++) {
        // The vertices k and l may not be bonded already.  Go around the one with fewer neighbors.
        const int *k = &batch.vertex[2][n], *l = &batch.vertex[3][n];
        bool aroundK = (vertices[*k].valence <= vertices[*l].valence);
        beginWalk(walks, batch, n, aroundK ? 2 : 3, aroundK ? *l : *k);
    }
    for (int group = 0; group < batch.numAttempts; group += GROUP) {
        if (upcoming != NULL)
            prefetchStencils(*upcoming, group);
        evaluation.evaluate(p, vertices.data(), batch, group, min(group + GROUP, batch.numAttempts));
        walks.step(mesh);
    }
    if (upcoming != NULL)
        prefetchStencils(*upcoming, batch.numAttempts);
    walks.finish(mesh);
    for (int n = 0; n < batch.numAttempts; n++)
        collect(batch, n, walks.isFound[n]);
    if (needsNeighborList(p))
        findRepulsion(batch);
    else if (p.repulsionModulus != 0 && p.repulsionExclusionLevel == 1)
        for (int n = 0; n < batch.numAttempts; n++)
            batch.attempts[n].energy += pairEnergy(batch.vertex[0][n], batch.vertex[1][n]) -
                                        pairEnergy(batch.vertex[2][n], batch.vertex[3][n]);
}

void EdgeFlipState::collect(EdgeFlipBatch& batch, int n, bool areBonded) const {
    EdgeFlipAttempt& attempt = batch.attempts[n];
    attempt.energy = batch.energy[n];
    attempt.area = batch.area[n];
    attempt.volume = batch.volume[n];
    attempt.curvature = batch.curvature[n];
    for (int i = 0; i < 4; i++)
        attempt.vertex[i] = batch.vertex[i][n];
    attempt.isForbidden = (areBonded || mesh.isFixed(batch.halfedge[n]) || vertices[attempt.vertex[0]].valence <= 3 ||
                           vertices[attempt.vertex[1]].valence <= 3);
    attempt.dependsOnPartners = false;
}

void EdgeFlipState::prefetchStencils(const EdgeFlipBatch& batch, int first) const {
    // Each group asks for the triangles opposite, and, as soon as these are there, for the vertices.

    for (int n = first, last = min(first + GROUP, batch.numAttempts); n < last; n++)
        mesh.prefetch(mesh.opposite(batch.halfedge[n]));
    for (int n = max(0, first - GROUP), last = min(first, batch.numAttempts); n < last; n++) {
        int h = batch.halfedge[n], o = mesh.opposite(h);
        for (int rim : {mesh.next(h), mesh.previous(h), mesh.next(o), mesh.previous(o)}) {
            __builtin_prefetch(&vertices[mesh.origin(rim)]);
            __builtin_prefetch(&vertices[mesh.oppositeApex(rim)]);
        }
    }
}

void EdgeFlipState::findStencil(EdgeFlipBatch& batch, int n) const {
    int h = batch.halfedge[n], o = mesh.opposite(h);
    int rim[4] = {mesh.next(h), mesh.previous(h), mesh.next(o), mesh.previous(o)};
    batch.vertex[0][n] = mesh.origin(h);
    batch.vertex[1][n] = mesh.origin(o);
    batch.vertex[2][n] = mesh.origin(rim[1]);
    batch.vertex[3][n] = mesh.origin(rim[3]);
    for (int side = 0; side < 4; side++)
        batch.vertex[4 + side][n] = mesh.oppositeApex(rim[side]);
    for (auto& vertex : batch.vertex)
        __builtin_prefetch(&vertices[vertex[n]]);
}

void EdgeFlipState::beginWalk(Walks& walks, const EdgeFlipBatch& batch, int n, int corner, int wanted) const {
    // Nobody looks for the flip's own vertices, and those beyond the edges around it are known.

    static const int BEYOND[4][2] = {{5, 6}, {4, 7}, {4, 5}, {6, 7}}, NUM_KNOWN[4] = {5, 5, 4, 4};
    int h = (corner % 2 == 0 ? batch.halfedge[n] : mesh.opposite(batch.halfedge[n])),
        rim = (corner < 2 ? mesh.previous(h) : mesh.next(h));
    bool isFound = (batch.vertex[BEYOND[corner][0]][n] == wanted || batch.vertex[BEYOND[corner][1]][n] == wanted);
    walks.begin(mesh, mesh.opposite(rim), vertices[batch.vertex[corner][n]].valence - NUM_KNOWN[corner], wanted,
                isFound);
}

/**
 * Pairs of a flip's vertex and a vertex that is close to it, and the walks that tell whether this one is bonded to the
 * vertex opposite in the flip.
 */
struct EdgeFlipState::ClosePairs {
    Walks walks;
    int attempt[Walks::MAX], corner[Walks::MAX], partner[Walks::MAX];
};

void EdgeFlipState::findRepulsion(EdgeFlipBatch& batch) const {
    // Few vertices are close to any that they are not bonded to.  The walks are around the vertices opposite, j, i, l
    // and k: while another thread flips, one around a partner might miss it.

    ClosePairs pairs;
    for (int n = 0; n < batch.numAttempts; n++) {
        for (int corner = 0; corner < 4; corner++) {
            int vertex = batch.vertex[corner][n];
            for (int m = 0; m < vertices[vertex].numClose; m++) {
                int partner = partnersOf(vertex)[m];
                pairs.attempt[pairs.walks.count] = n;
                pairs.corner[pairs.walks.count] = corner;
                pairs.partner[pairs.walks.count] = partner;
                beginWalk(pairs.walks, batch, n, corner ^ 1, partner);
                if (pairs.walks.count == Walks::MAX)
                    addRepulsion(batch, pairs);
            }
        }
    }
    addRepulsion(batch, pairs);
}

void EdgeFlipState::addRepulsion(EdgeFlipBatch& batch, ClosePairs& pairs) const {
    // The flip takes from i and j, and gives to k and l, the paths to the neighbors of the opposite vertex.  It matters
    // where there is no other path of two edges.

    pairs.walks.finish(mesh);
    for (int m = 0; m < pairs.walks.count; m++)
        if (pairs.walks.isFound[m]) {
            int n = pairs.attempt[m], corner = pairs.corner[m], vertex = batch.vertex[corner][n];
            batch.attempts[n].dependsOnPartners = true;
            if (!shareOtherNeighbor(batch.vertex[corner ^ 1][n], vertex, pairs.partner[m]))
                batch.attempts[n].energy += (corner < 2 ? 1 : -1) * pairEnergy(vertex, pairs.partner[m]);
        }
    pairs.walks.clear();
}

bool EdgeFlipState::shareOtherNeighbor(int middle, int vertex1, int vertex2) const {
    // Only flips at the two vertices may matter, so it looks around these, and not around the neighbors.

    for (int neighbor : mesh.neighbors(vertex1))
        if (neighbor != middle && mesh.isAround(vertex2, neighbor))
            return true;
    return false;
}

void EdgeFlipState::carryOut(const EdgeFlipList& flips) {
    prefetch(flips);
    for (const EdgeFlip& flip : flips)
        carryOut(flip);
}

void EdgeFlipState::prefetch(const EdgeFlipList& flips) const {
    for (const EdgeFlip& flip : flips) {
        mesh.prefetch(flip.halfedge);
        for (int vertex : flip.vertex) {
            __builtin_prefetch(&vertices[vertex]);
            mesh.prefetchVertex(vertex);
        }
    }
    for (const EdgeFlip& flip : flips) {
        int h = flip.halfedge;
        for (int inner : {h, mesh.next(h), mesh.previous(h)})
            mesh.prefetch(mesh.opposite(inner));
    }
    for (const EdgeFlip& flip : flips) {
        int o = mesh.opposite(flip.halfedge);
        for (int rim : {mesh.next(o), mesh.previous(o)})
            mesh.prefetch(mesh.opposite(rim));
    }
}

void EdgeFlipState::carryOut(const EdgeFlip& flip) {
    for (int i = 0; i < 4; i++) {
        EdgeFlipVertex& vertex = vertices[flip.vertex[i]];
        vertex.area += flip.area[i];
        if (p.needsCurvature())
            vertex.curvature += flip.curvature[i];
        vertex.valence += (i < 2 ? -1 : 1);
    }
    if (needsNeighborList(p)) {
        int i = flip.vertex[0], j = flip.vertex[1], k = flip.vertex[2], l = flip.vertex[3];
        setApart(i, j);
        setApart(j, i);
        setBonded(k, l);
        setBonded(l, k);
    }
    mesh.flip(flip.halfedge);
}

void EdgeFlipState::findClosePartners(int vertex) {
    vertices[vertex].firstPartner = neighbors->lists[vertex].start;
    Relaxed<int>* partners = partnersOf(vertex);
    int numClose = 0;
    for (int n = 0; n < neighbors->lists[vertex].numApart; n++)
        if (distance2(vertex, partners[n]) < p.repulsionOnset * p.repulsionOnset)
            swap(partners[n], partners[numClose++]);
    sort(partners, partners + numClose);
    vertices[vertex].numClose = numClose;
}

void EdgeFlipState::setClosePartners(const EdgeFlipState& other, int vertex) {
    vertices[vertex].firstPartner = other.vertices[vertex].firstPartner;
    vertices[vertex].numClose = other.vertices[vertex].numClose;
    // Where none is close, as nearly always, the order of the others does not matter.

    if (vertices[vertex].numClose > 0)
        copy_n(other.partnersOf(vertex), neighbors->lists[vertex].numApart, partnersOf(vertex));
}

static Relaxed<int>* findPartner(Relaxed<int>* first, Relaxed<int>* last, int partner) {
    // It costs less to look at all than to stop.

    Relaxed<int>* found = last;
    for (Relaxed<int>* other = first; other != last; other++)
        found = (*other == partner ? other : found);
    return found;
}

void EdgeFlipState::setApart(int vertex, int other) {
    HelfrichNeighborList::List& list = neighbors->lists[vertex];
    Relaxed<int>*partners = partnersOf(vertex), *end = partners + list.numPartners,
    *found = findPartner(partners + list.numApart, end, other);
    if (found == end)
        return;
    swap(*found, partners[list.numApart]);
    if (distance2(vertex, other) < p.repulsionOnset * p.repulsionOnset) {
        int numClose = vertices[vertex].numClose;
        swap(partners[numClose], partners[list.numApart]);
        rotate(upper_bound(partners, partners + numClose, other), partners + numClose, partners + numClose + 1);
        vertices[vertex].numClose = numClose + 1;
    }
    list.numApart++;
}

void EdgeFlipState::setBonded(int vertex, int other) {
    HelfrichNeighborList::List& list = neighbors->lists[vertex];
    int numClose = vertices[vertex].numClose;
    Relaxed<int>*partners = partnersOf(vertex), *end = partners + list.numApart,
    *found = findPartner(partners, end, other);
    if (found == end)
        return;
    if (found < partners + numClose) {
        rotate(found, found + 1, partners + numClose);
        found = partners + numClose - 1;
        vertices[vertex].numClose = numClose - 1;
    }
    swap(*found, partners[--list.numApart]);
}

double EdgeFlipState::distance2(int vertex1, int vertex2) const {
    const EdgeFlipVertex &a = vertices[vertex1], &b = vertices[vertex2];
    Vector3<double> d = {b.x - a.x, b.y - a.y, b.z - a.z};
    return dot(d, d);
}

double EdgeFlipState::pairEnergy(int vertex1, int vertex2) const {
    double r2 = distance2(vertex1, vertex2), slope;
    if (r2 >= p.repulsionOnset * p.repulsionOnset)
        return 0;
    return 2 * p.repulsionModulus * repulsionPotential(sqrt(r2), p.repulsionOnset, p.repulsionExponent, slope);
}
