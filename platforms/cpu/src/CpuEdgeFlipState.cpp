#include "CpuEdgeFlipState.h"
#include "CpuInstructionSet.h"
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

CpuEdgeFlipState::CpuEdgeFlipState(HelfrichMesh& mesh)
        : particles(mesh.getParticles()), surfaces(mesh.getSurfaces()), species(mesh.getSpecies()), mesh(mesh),
          evaluation(&getForProcessor<CpuEdgeFlipEvaluation>()), vertices(mesh.getNumVertices()), neighborList(NULL) {
}

void CpuEdgeFlipState::setPositions(const vector<Vec3>& positions, const CpuVertexGeometry& geometry, int first,
                                    int last) {
    for (int v = first; v < last; v++) {
        const Vec3& x = positions[particles[v]];
        vertices[v] = {x[0],
                       x[1],
                       x[2],
                       0,
                       surfaces[v],
                       geometry.getArea(v),
                       geometry.getCurvature(v),
                       0,
                       mesh.valence(v),
                       species.empty() ? 0 : species[v]};
    }
}

void CpuEdgeFlipState::setParameters(const HelfrichParameters& parameters) {
    p = parameters;
    if (p.box.exists())
        evaluation = &getForProcessor<CpuPeriodicEdgeFlipEvaluation>();
}

void CpuEdgeFlipState::setPositions(const CpuEdgeFlipState& other, int first, int last) {
    copy(other.vertices.begin() + first, other.vertices.begin() + last, vertices.begin() + first);
}

/**
 * Walks around vertices to see if they are bonded to others.  All go on at the same time, and those that are around
 * before the others begin again: no branch depends on a valence, which no processor could predict.
 */
class CpuEdgeFlipState::Walks {
public:
    static const int MAX = CpuEdgeFlipBatch::SIZE;
    /**
     * Begin a walk.
     *
     * @param mesh      the connectivity
     * @param halfedge  starts from the vertex to go around; the apex of the triangle after its own is the first
     * neighbor on the way
     * @param numSteps  the number of bonded neighbors to see
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

void CpuEdgeFlipState::evaluate(CpuEdgeFlipBatch& batch, const CpuEdgeFlipBatch* upcoming) const {
    // In large membranes nearly everything is in no near cache.  Vectors, steps of the walks and requests for the
    // upcoming batch take turns, so that what is needed later comes from memory while the vectors are computed.

    Walks walks;
    if (upcoming != NULL)
        for (int n = 0; n < upcoming->numAttempts; n++)
            mesh.prefetch(upcoming->halfedge[n]);
    for (int n = 0; n < batch.numAttempts; n++)
        findStencil(batch, n);
    for (int n = 0; n < batch.numAttempts; n++) {
        // The vertices k and l may not be bonded already.  Go around the one with fewer bonded neighbors.
        const int *k = &batch.vertex[2][n], *l = &batch.vertex[3][n];
        bool aroundK = (vertices[*k].valence <= vertices[*l].valence);
        beginWalk(walks, batch, n, aroundK ? 2 : 3, aroundK ? *l : *k);
    }
    for (int group = 0; group < batch.numAttempts; group += GROUP) {
        if (upcoming != NULL)
            prefetchStencils(*upcoming, group);
        evaluation->evaluate(p, vertices.data(), batch, group, min(group + GROUP, batch.numAttempts));
        walks.step(mesh);
    }
    if (upcoming != NULL)
        prefetchStencils(*upcoming, batch.numAttempts);
    walks.finish(mesh);
    for (int n = 0; n < batch.numAttempts; n++)
        collect(batch, n, walks.isFound[n]);
    if (needsNeighborList(p))
        findRepulsion(batch);
    else if (p.has(Term::Repulsion) && p.repulsionExclusionLevel == 1)
        for (int n = 0; n < batch.numAttempts; n++)
            batch.attempts[n].energy += pairEnergy(batch.vertex[0][n], batch.vertex[1][n]) -
                                        pairEnergy(batch.vertex[2][n], batch.vertex[3][n]);
}

void CpuEdgeFlipState::collect(CpuEdgeFlipBatch& batch, int n, bool areBonded) const {
    CpuEdgeFlipAttempt& attempt = batch.attempts[n];
    attempt.energy = batch.energy[n];
    attempt.area = batch.area[n];
    attempt.volume = batch.volume[n];
    attempt.curvature = batch.curvature[n];
    for (int i = 0; i < 4; i++)
        attempt.vertex[i] = batch.vertex[i][n];
    attempt.surface = vertices[attempt.vertex[0]].surface;
    attempt.isForbidden = (areBonded || mesh.isFixed(batch.halfedge[n]) || vertices[attempt.vertex[0]].valence <= 3 ||
                           vertices[attempt.vertex[1]].valence <= 3);
    attempt.dependsOnCloseNeighbors = false;
}

void CpuEdgeFlipState::prefetchStencils(const CpuEdgeFlipBatch& batch, int first) const {
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

void CpuEdgeFlipState::findStencil(CpuEdgeFlipBatch& batch, int n) const {
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

void CpuEdgeFlipState::beginWalk(Walks& walks, const CpuEdgeFlipBatch& batch, int n, int corner, int wanted) const {
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
struct CpuEdgeFlipState::ClosePairs {
    Walks walks;
    int attempt[Walks::MAX], corner[Walks::MAX], neighbor[Walks::MAX];
};

void CpuEdgeFlipState::findRepulsion(CpuEdgeFlipBatch& batch) const {
    // Few vertices are close to any that they are not bonded to.  The walks are around the vertices opposite, j, i, l
    // and k: while another thread flips, one around a neighbor might miss it.

    ClosePairs pairs;
    for (int n = 0; n < batch.numAttempts; n++) {
        for (int corner = 0; corner < 4; corner++) {
            int vertex = batch.vertex[corner][n];
            for (int m = 0; m < vertices[vertex].numClose; m++) {
                int neighbor = neighborsOf(vertex)[m];
                pairs.attempt[pairs.walks.count] = n;
                pairs.corner[pairs.walks.count] = corner;
                pairs.neighbor[pairs.walks.count] = neighbor;
                beginWalk(pairs.walks, batch, n, corner ^ 1, neighbor);
                if (pairs.walks.count == Walks::MAX)
                    addRepulsion(batch, pairs);
            }
        }
    }
    addRepulsion(batch, pairs);
}

void CpuEdgeFlipState::addRepulsion(CpuEdgeFlipBatch& batch, ClosePairs& pairs) const {
    // The flip takes from i and j, and gives to k and l, the paths to the bonded neighbors of the opposite vertex.  It
    // matters where nothing else excludes the pair.

    pairs.walks.finish(mesh);
    for (int m = 0; m < pairs.walks.count; m++)
        if (pairs.walks.isFound[m]) {
            int n = pairs.attempt[m], corner = pairs.corner[m], vertex = batch.vertex[corner][n];
            batch.attempts[n].dependsOnCloseNeighbors = true;
            int opposite = batch.vertex[corner ^ 1][n];
            if (!mesh.areExcluded(vertex, pairs.neighbor[m], p.repulsionExclusionLevel, opposite))
                batch.attempts[n].energy += (corner < 2 ? 1 : -1) * pairEnergy(vertex, pairs.neighbor[m]);
        }
    pairs.walks.clear();
}

void CpuEdgeFlipState::carryOut(const CpuEdgeFlipList& flips) {
    prefetch(flips);
    for (const CpuEdgeFlip& flip : flips)
        carryOut(flip);
}

void CpuEdgeFlipState::prefetch(const CpuEdgeFlipList& flips) const {
    for (const CpuEdgeFlip& flip : flips) {
        mesh.prefetch(flip.halfedge);
        for (int vertex : flip.vertex) {
            __builtin_prefetch(&vertices[vertex]);
            mesh.prefetchVertex(vertex);
        }
    }
    for (const CpuEdgeFlip& flip : flips) {
        int h = flip.halfedge;
        for (int inner : {h, mesh.next(h), mesh.previous(h)})
            mesh.prefetch(mesh.opposite(inner));
    }
    for (const CpuEdgeFlip& flip : flips) {
        int o = mesh.opposite(flip.halfedge);
        for (int rim : {mesh.next(o), mesh.previous(o)})
            mesh.prefetch(mesh.opposite(rim));
    }
}

void CpuEdgeFlipState::carryOut(const CpuEdgeFlip& flip) {
    for (int i = 0; i < 4; i++) {
        CpuEdgeFlipVertex& vertex = vertices[flip.vertex[i]];
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

void CpuEdgeFlipState::findCloseNeighbors(int vertex) {
    vertices[vertex].firstNeighbor = neighborList->lists[vertex].start;
    Relaxed<int>* neighbors = neighborsOf(vertex);
    int numClose = 0;
    for (int n = 0; n < neighborList->lists[vertex].numApart; n++)
        if (distance2(vertex, neighbors[n]) < p.repulsionOnset * p.repulsionOnset)
            swap(neighbors[n], neighbors[numClose++]);
    sort(neighbors, neighbors + numClose);
    vertices[vertex].numClose = numClose;
}

void CpuEdgeFlipState::setCloseNeighbors(const CpuEdgeFlipState& other, int vertex) {
    vertices[vertex].firstNeighbor = other.vertices[vertex].firstNeighbor;
    vertices[vertex].numClose = other.vertices[vertex].numClose;
    // Where none is close, as nearly always, the order of the others does not matter.

    if (vertices[vertex].numClose > 0)
        copy_n(other.neighborsOf(vertex), neighborList->lists[vertex].numApart, neighborsOf(vertex));
}

static Relaxed<int>* findNeighbor(Relaxed<int>* first, Relaxed<int>* last, int neighbor) {
    // It costs less to look at all than to stop.

    Relaxed<int>* found = last;
    for (Relaxed<int>* other = first; other != last; other++)
        found = (*other == neighbor ? other : found);
    return found;
}

void CpuEdgeFlipState::setApart(int vertex, int other) {
    CpuHelfrichNeighborList::List& list = neighborList->lists[vertex];
    Relaxed<int>*neighbors = neighborsOf(vertex), *end = neighbors + list.numNeighbors,
    *found = findNeighbor(neighbors + list.numApart, end, other);
    if (found == end)
        return;
    swap(*found, neighbors[list.numApart]);
    if (distance2(vertex, other) < p.repulsionOnset * p.repulsionOnset) {
        int numClose = vertices[vertex].numClose;
        swap(neighbors[numClose], neighbors[list.numApart]);
        rotate(upper_bound(neighbors, neighbors + numClose, other), neighbors + numClose, neighbors + numClose + 1);
        vertices[vertex].numClose = numClose + 1;
    }
    list.numApart++;
}

void CpuEdgeFlipState::setBonded(int vertex, int other) {
    CpuHelfrichNeighborList::List& list = neighborList->lists[vertex];
    int numClose = vertices[vertex].numClose;
    Relaxed<int>*neighbors = neighborsOf(vertex), *end = neighbors + list.numApart,
    *found = findNeighbor(neighbors, end, other);
    if (found == end)
        return;
    if (found < neighbors + numClose) {
        rotate(found, found + 1, neighbors + numClose);
        found = neighbors + numClose - 1;
        vertices[vertex].numClose = numClose - 1;
    }
    swap(*found, neighbors[--list.numApart]);
}

Vector3<double> CpuEdgeFlipState::getPosition(int vertex) const {
    return {vertices[vertex].x, vertices[vertex].y, vertices[vertex].z};
}

double CpuEdgeFlipState::distance2(int vertex1, int vertex2) const {
    Vector3<double> d = displacement(getPosition(vertex1), getPosition(vertex2), p.box);
    return dot(d, d);
}

double CpuEdgeFlipState::pairEnergy(int vertex1, int vertex2) const {
    double r2 = distance2(vertex1, vertex2), slope;
    if (r2 >= p.repulsionOnset * p.repulsionOnset)
        return 0;
    return 2 * p.moduli[Term::Repulsion] * repulsionPotential(p, sqrt(r2), slope);
}
