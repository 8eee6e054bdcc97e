#include "openmmhelfrich/internal/EdgeFlipState.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <algorithm>
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

EdgeFlipState::EdgeFlipState(HelfrichMesh& mesh) : mesh(mesh), evaluation(getEdgeFlipEvaluation()), vertices(mesh.getNumVertices()), neighbors(NULL) {
}

void EdgeFlipState::setPositions(const vector<Vec3>& positions, const HelfrichGeometry& geometry, int first, int last) {
    const vector<int>& particles = mesh.getParticles();
    for (int v = first; v < last; v++) {
        const Vec3& x = positions[particles[v]];
        vertices[v] = {x[0], x[1], x[2], geometry.vertexAreas[v], geometry.vertexMeanCurvatures[v], 0, 0, mesh.valence(v)};
    }
}

void EdgeFlipState::setPositions(const EdgeFlipState& other, int first, int last) {
    copy(other.vertices.begin()+first, other.vertices.begin()+last, vertices.begin()+first);
}

void EdgeFlipState::evaluate(EdgeFlipBatch& batch, int first, int last) const {
    prefetchStencils(batch, first, last);
    for (int n = first; n < last; n++)
        findStencil(batch, n);
    findForbidden(batch, first, last);
    evaluation.evaluate(p, vertices.data(), batch, first, last);
    for (int n = first; n < last; n++) {
        EdgeFlipAttempt& attempt = batch.attempts[n];
        attempt.energy = batch.energy[n];
        attempt.area = batch.area[n];
        attempt.volume = batch.volume[n];
        attempt.curvature = batch.curvature[n];
        for (int i = 0; i < 4; i++)
            attempt.vertex[i] = batch.vertex[i][n];
        attempt.dependsOnPartners = false;
    }
    if (needsNeighborList(p))
        findRepulsion(batch, first, last);
    else if (p.repulsionModulus != 0 && p.repulsionExclusionLevel == 1)
        for (int n = first; n < last; n++)
            batch.attempts[n].energy += pairEnergy(batch.vertex[0][n], batch.vertex[1][n])-pairEnergy(batch.vertex[2][n], batch.vertex[3][n]);
}

void EdgeFlipState::prefetchStencils(const EdgeFlipBatch& batch, int first, int last) const {
    // Data of many attempts on its way from memory at the same time is what makes large membranes fast.

    for (int n = first; n < last; n++)
        mesh.prefetch(batch.halfedge[n]);
    for (int n = first; n < last; n++)
        mesh.prefetch(mesh.opposite(batch.halfedge[n]));
    for (int n = first; n < last; n++) {
        int h = batch.halfedge[n], o = mesh.opposite(h);
        for (int rim : {mesh.next(h), mesh.previous(h), mesh.next(o), mesh.previous(o)}) {
            mesh.prefetch(mesh.opposite(rim));
            __builtin_prefetch(&vertices[mesh.origin(rim)]);
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
    for (int side = 0; side < 4; side++) {
        int outer = mesh.apex(mesh.opposite(rim[side]));
        batch.vertex[4+side][n] = outer;
        __builtin_prefetch(&vertices[outer]);
    }
}

namespace {

/**
 * Walks around vertices to see if they are bonded to others.  All go on at the same time, and those that are around before the others begin again: no branch depends on a valence,
 * which no processor could predict.
 */
class Walks {
public:
    static const int MAX = EdgeFlipBatch::SIZE;
    /**
     * Begin a walk.
     *
     * @param halfedge  starts from the vertex to go around; its apex is the first neighbor on the way
     * @param numSteps  the number of neighbors to see
     * @param wanted    the vertex to look for
     */
    void begin(int halfedge, int numSteps, int wanted) {
        halfedges[count] = halfedge;
        this->wanted[count] = wanted;
        isFound[count++] = false;
        maxSteps = max(maxSteps, numSteps);
    }
    void finish(const HelfrichMesh& mesh) {
        for (int step = 0; step < maxSteps; step++)
            for (int n = 0; n < count; n++) {
                isFound[n] |= (mesh.apex(halfedges[n]) == wanted[n]);
                halfedges[n] = mesh.rotate(halfedges[n]);
            }
    }
    void clear() {
        count = maxSteps = 0;
    }
    bool isFound[MAX];
    int count = 0;
private:
    int halfedges[MAX], wanted[MAX], maxSteps = 0;
};

} // namespace

void EdgeFlipState::findForbidden(EdgeFlipBatch& batch, int first, int last) const {
    // The vertices k and l may not be bonded already.  Go around the one with fewer neighbors, from j on: i and j are known.

    Walks walks;
    for (int n = first; n < last; n++) {
        int h = batch.halfedge[n], o = mesh.opposite(h), k = batch.vertex[2][n], l = batch.vertex[3][n];
        if (vertices[k].valence <= vertices[l].valence)
            walks.begin(mesh.opposite(mesh.next(h)), vertices[k].valence-2, l);
        else
            walks.begin(mesh.opposite(mesh.next(o)), vertices[l].valence-2, k);
        batch.attempts[n].isForbidden = (mesh.isFixed(h) || vertices[batch.vertex[0][n]].valence <= 3 || vertices[batch.vertex[1][n]].valence <= 3);
    }
    walks.finish(mesh);
    for (int n = first; n < last; n++)
        batch.attempts[n].isForbidden |= walks.isFound[n-first];
}

/**
 * Pairs of a flip's vertex and a vertex that is close to it, and the walks that tell whether this one is bonded to the vertex opposite in the flip.
 */
struct EdgeFlipState::ClosePairs {
    Walks walks;
    int attempt[Walks::MAX], corner[Walks::MAX], partner[Walks::MAX];
};

void EdgeFlipState::findRepulsion(EdgeFlipBatch& batch, int first, int last) const {
    // Few vertices are close to any that they are not bonded to.

    ClosePairs pairs;
    for (int n = first; n < last; n++) {
        for (int corner = 0; corner < 4; corner++) {
            int vertex = batch.vertex[corner][n], middle = batch.vertex[corner^1][n];
            for (int m = 0; m < vertices[vertex].numClose; m++) {
                int partner = partnersOf(vertex)[m];
                bool aroundPartner = (mesh.valence(partner) <= mesh.valence(middle));
                int center = (aroundPartner ? partner : middle);
                pairs.attempt[pairs.walks.count] = n;
                pairs.corner[pairs.walks.count] = corner;
                pairs.partner[pairs.walks.count] = partner;
                pairs.walks.begin(mesh.outgoing(center), mesh.valence(center), aroundPartner ? middle : partner);
                if (pairs.walks.count == Walks::MAX)
                    addRepulsion(batch, pairs);
            }
        }
    }
    addRepulsion(batch, pairs);
}

void EdgeFlipState::addRepulsion(EdgeFlipBatch& batch, ClosePairs& pairs) const {
    // The flip takes from i and j, and gives to k and l, the paths to the neighbors of the opposite vertex.  It matters where there is no other path of two edges.

    pairs.walks.finish(mesh);
    for (int m = 0; m < pairs.walks.count; m++)
        if (pairs.walks.isFound[m]) {
            int n = pairs.attempt[m], corner = pairs.corner[m], vertex = batch.vertex[corner][n];
            batch.attempts[n].dependsOnPartners = true;
            if (!shareOtherNeighbor(batch.vertex[corner^1][n], vertex, pairs.partner[m]))
                batch.attempts[n].energy += (corner < 2 ? 1 : -1)*pairEnergy(vertex, pairs.partner[m]);
        }
    pairs.walks.clear();
}

bool EdgeFlipState::shareOtherNeighbor(int middle, int vertex1, int vertex2) const {
    int first = mesh.outgoing(vertex1), h = first;
    do {
        if (mesh.tip(h) != middle && mesh.areBonded(mesh.tip(h), vertex2))
            return true;
        h = mesh.rotate(h);
    } while (h != first);
    return false;
}

void EdgeFlipState::carryOut(const EdgeFlipBatch& batch, int n) {
    for (int i = 0; i < 4; i++) {
        EdgeFlipVertex& vertex = vertices[batch.vertex[i][n]];
        vertex.area += batch.vertexArea[i][n];
        if (p.needsCurvature())
            vertex.curvature += batch.vertexCurvature[i][n];
        vertex.valence += (i < 2 ? -1 : 1);
    }
    if (needsNeighborList(p)) {
        int i = batch.vertex[0][n], j = batch.vertex[1][n], k = batch.vertex[2][n], l = batch.vertex[3][n];
        setApart(i, j);
        setApart(j, i);
        setBonded(k, l);
        setBonded(l, k);
    }
    mesh.flip(batch.halfedge[n]);
}

void EdgeFlipState::findClosePartners() {
    for (int v = 0; v < mesh.getNumVertices(); v++)
        findClosePartners(v);
}

void EdgeFlipState::findClosePartners(int vertex) {
    vertices[vertex].firstPartner = neighbors->lists[vertex].start;
    int *partners = partnersOf(vertex), numClose = 0;
    for (int n = 0; n < neighbors->lists[vertex].numApart; n++)
        if (distance2(vertex, partners[n]) < p.repulsionOnset*p.repulsionOnset)
            swap(partners[n], partners[numClose++]);
    sort(partners, partners+numClose);
    vertices[vertex].numClose = numClose;
}

static int* findPartner(int* first, int* last, int partner) {
    // It costs less to look at all than to stop.

    int* found = last;
    for (int* other = first; other != last; other++)
        found = (*other == partner ? other : found);
    return found;
}

void EdgeFlipState::setApart(int vertex, int other) {
    HelfrichNeighborList::List& list = neighbors->lists[vertex];
    int &numClose = vertices[vertex].numClose, *partners = partnersOf(vertex), *end = partners+list.numPartners, *found = findPartner(partners+list.numApart, end, other);
    if (found == end)
        return;
    swap(*found, partners[list.numApart]);
    if (distance2(vertex, other) < p.repulsionOnset*p.repulsionOnset) {
        swap(partners[numClose], partners[list.numApart]);
        inplace_merge(partners, partners+numClose, partners+numClose+1);
        numClose++;
    }
    list.numApart++;
}

void EdgeFlipState::setBonded(int vertex, int other) {
    HelfrichNeighborList::List& list = neighbors->lists[vertex];
    int &numClose = vertices[vertex].numClose, *partners = partnersOf(vertex), *end = partners+list.numApart, *found = findPartner(partners, end, other);
    if (found == end)
        return;
    if (found < partners+numClose) {
        rotate(found, found+1, partners+numClose);
        found = partners+--numClose;
    }
    swap(*found, partners[--list.numApart]);
}

double EdgeFlipState::distance2(int vertex1, int vertex2) const {
    const EdgeFlipVertex& a = vertices[vertex1], &b = vertices[vertex2];
    Vector3<double> d = {b.x-a.x, b.y-a.y, b.z-a.z};
    return dot(d, d);
}

double EdgeFlipState::pairEnergy(int vertex1, int vertex2) const {
    double r2 = distance2(vertex1, vertex2), slope;
    if (r2 >= p.repulsionOnset*p.repulsionOnset)
        return 0;
    return 2*p.repulsionModulus*repulsionPotential(sqrt(r2), p.repulsionOnset, p.repulsionExponent, slope);
}
