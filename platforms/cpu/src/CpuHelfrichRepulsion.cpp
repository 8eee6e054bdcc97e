#include "CpuHelfrichRepulsion.h"
#include "CpuThreads.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <algorithm>
#include <cmath>

using namespace HelfrichPlugin;
using namespace std;

/**
 * How many vertices a thread takes at a time.
 */
static const int VERTICES_PER_PART = 1024;

static Vector3<double> getPoint(const double* x) {
    return {x[0], x[1], x[2]};
}

/**
 * The vector from a point to another.
 */
struct OpenDisplacement {
    Vector3<double> operator()(const Vector3<double>& from, const Vector3<double>& to) const {
        return displacement(from, to);
    }
};

/**
 * The vector from a point to the nearest image of another.
 */
struct PeriodicDisplacement {
    const PeriodicBox& box;
    Vector3<double> operator()(const Vector3<double>& from, const Vector3<double>& to) const {
        return nearestImage(displacement(from, to), box);
    }
};

void CpuHelfrichRepulsion::setBox(const PeriodicBox& newBox) {
    if (newBox != box)
        reference.clear();
    box = newBox;
}

void CpuHelfrichRepulsion::update(const HelfrichMesh& mesh, const CpuHelfrichLayout& layout, const double* positions,
                                  const HelfrichParameters& p, bool hasMoved) {
    updateCandidates(layout, positions, p.repulsionOnset, hasMoved);
    if (!hasPairs || p.repulsionExclusionLevel != exclusionLevel) {
        removeExclusions(mesh, layout, p.repulsionExclusionLevel);
        hasPairs = true;
        exclusionLevel = p.repulsionExclusionLevel;
    }
}

void CpuHelfrichRepulsion::updateCandidates(const CpuHelfrichLayout& layout, const double* positions, double newOnset,
                                            bool hasMoved) {
    numUpdates++;
    if (newOnset == onset && !hasMoved)
        return;
    if (newOnset != onset)
        skin = 0.5 * newOnset;
    onset = newOnset;
    adaptSkin();
    findCandidates(layout, positions);
    hasPairs = false;
}

CpuHelfrichNeighborList& CpuHelfrichRepulsion::getNeighborList(const HelfrichMesh& mesh,
                                                               const CpuHelfrichLayout& layout, const double* positions,
                                                               double newOnset, bool hasMoved) {
    updateCandidates(layout, positions, newOnset, hasMoved);
    candidates.partition(mesh);
    return candidates;
}

void CpuHelfrichRepulsion::adaptSkin() {
    // A list costs as much as some 50 evaluations to build.

    if (numUpdates < 50)
        skin = min(1.25 * skin, 1.2 * onset);
    else if (numUpdates > 300)
        skin = max(0.8 * skin, 0.1 * onset);
    // Of a pair in a list only one image may be close.
    if (box.exists())
        skin = min(skin, 0.45 * box.shortest() - onset);
    numUpdates = 0;
}

void CpuHelfrichRepulsion::followLayout(const CpuHelfrichLayout& layout, int numThreads) {
    hasPairs = false;
    if (placedVertices.empty())
        return;
    reference.resize(layout.getNumSlots());
    CpuThreads::forEachPart(numThreads, placedVertices.size(), VERTICES_PER_PART, [&](int begin, int end) {
        for (int i = begin; i < end; i++)
            if (!placedVertices[i].isImage)
                reference[layout.slots[placedVertices[i].vertex]] = placedVertices[i].x;
    });
}

bool CpuHelfrichRepulsion::hasMoved(const double* positions, int firstSlot, int lastSlot) const {
    return box.exists() ? hasMoved(positions, firstSlot, lastSlot, PeriodicDisplacement{box})
                        : hasMoved(positions, firstSlot, lastSlot, OpenDisplacement());
}

template <class Displacement>
bool CpuHelfrichRepulsion::hasMoved(const double* positions, int firstSlot, int lastSlot,
                                    const Displacement& displacement) const {
    if (reference.empty())
        return true;
    double limit = 0.25 * skin * skin;
    for (int slot = firstSlot; slot < lastSlot; slot++) {
        Vector3<double> moved = displacement(reference[slot], getPoint(positions + 4 * slot));
        if (!(dot(moved, moved) <= limit))
            return true;
    }
    return false;
}

CpuHelfrichRepulsion::Cell CpuHelfrichRepulsion::findCell(const Point& x) const {
    // Far away all is one cell: that can make the list slow, but not wrong.

    auto number = [&](double coordinate) { return (int) max(-1e9, min(1e9, floor(coordinate / (onset + skin)))); };
    return {number(x.x), number(x.y), number(x.z)};
}

unsigned int CpuHelfrichRepulsion::findBucket(const Cell& cell) const {
    // Cells in a row along x have consecutive buckets.

    unsigned int hash =
            (unsigned int) cell[0] + 73856093u * (unsigned int) cell[1] + 19349663u * (unsigned int) cell[2];
    return hash & (bucketStarts.size() - 2);
}

void CpuHelfrichRepulsion::addImages(vector<PlacedVertex>& vertices) const {
    // All vertices come into one box, and beyond each border of it images of those near the opposite one.

    auto coordinateOf = [](Point& x, int axis) -> double& { return axis == 0 ? x.x : axis == 1 ? x.y : x.z; };
    for (int axis = 0; axis < 3; axis++) {
        double side = box.lengths[axis], cutoff = onset + skin;
        for (size_t i = 0, count = vertices.size(); i < count; i++) {
            PlacedVertex image = vertices[i];
            double &x = coordinateOf(vertices[i].x, axis), &ofImage = coordinateOf(image.x, axis);
            x -= side * floor(x / side);
            image.isImage = true;
            ofImage = (x < cutoff ? x + side : x - side);
            if (x < cutoff || x > side - cutoff)
                vertices.push_back(image);
        }
    }
}

void CpuHelfrichRepulsion::sortIntoBuckets(const vector<PlacedVertex>& vertices) {
    size_t numBuckets = 1;
    while (numBuckets < vertices.size())
        numBuckets *= 2;
    bucketStarts.assign(numBuckets + 1, 0);
    for (const PlacedVertex& placed : vertices)
        bucketStarts[findBucket(findCell(placed.x)) + 1]++;
    for (size_t i = 1; i < bucketStarts.size(); i++)
        bucketStarts[i] += bucketStarts[i - 1];
    vector<int> next(bucketStarts.begin(), bucketStarts.end() - 1);
    placedVertices.resize(vertices.size());
    for (const PlacedVertex& placed : vertices)
        placedVertices[next[findBucket(findCell(placed.x))]++] = placed;
}

void CpuHelfrichRepulsion::findCandidates(const CpuHelfrichLayout& layout, const double* positions) {
    reference.resize(layout.getNumSlots());
    for (int slot = 0; slot < layout.getNumSlots(); slot++)
        reference[slot] = getPoint(positions + 4 * slot);
    vector<PlacedVertex> vertices;
    vertices.reserve(layout.slots.size());
    for (size_t v = 0; v < layout.slots.size(); v++)
        vertices.push_back({reference[layout.slots[v]], (int) v, false});
    if (box.exists())
        addImages(vertices);
    sortIntoBuckets(vertices);
    for (const PlacedVertex& placed : placedVertices)
        if (!placed.isImage)
            reference[layout.slots[placed.vertex]] = placed.x;
    candidates.lists.resize(layout.slots.size());
    candidates.neighbors.clear();
    candidates.revision = -1;
    candidates.numBuilds++;
    for (size_t v = 0; v < layout.slots.size(); v++) {
        int start = candidates.neighbors.size();
        addCandidates({reference[layout.slots[v]], (int) v, false}, (onset + skin) * (onset + skin));
        candidates.lists[v] = {start, 0, int(candidates.neighbors.size() - start)};
    }
}

void CpuHelfrichRepulsion::addCandidates(const PlacedVertex& vertex, double cutoff2) {
    Cell center = findCell(vertex.x);
    for (int dy = -1; dy <= 1; dy++)
        for (int dz = -1; dz <= 1; dz++)
            addCandidatesInRow(vertex, {center[0] - 1, center[1] + dy, center[2] + dz}, cutoff2);
}

void CpuHelfrichRepulsion::addCandidatesInRow(const PlacedVertex& vertex, const Cell& first, double cutoff2) {
    // Points of other cells can have the same buckets: they are found in their own row, or are too far away.

    int numBuckets = bucketStarts.size() - 1, begin = findBucket(first), end = min(begin + 3, numBuckets);
    auto addRange = [&](int start, int stop) {
        for (int i = start; i < stop; i++) {
            const PlacedVertex& other = placedVertices[i];
            Vector3<double> d = displacement(vertex.x, other.x);
            if (dot(d, d) >= cutoff2 || other.vertex == vertex.vertex)
                continue;
            Cell cell = findCell(other.x);
            if (cell[1] == first[1] && cell[2] == first[2])
                candidates.neighbors.push_back(other.vertex);
        }
    };
    addRange(bucketStarts[begin], bucketStarts[end]);
    if (begin + 3 > numBuckets)
        addRange(0, bucketStarts[min(begin + 3 - numBuckets, begin)]);
}

void CpuHelfrichRepulsion::removeExclusions(const HelfrichMesh& mesh, const CpuHelfrichLayout& layout, int level) {
    marks.assign(mesh.getNumVertices(), -1);
    pairStarts.clear();
    pairs.clear();
    for (int slot = 0; slot < layout.getNumSlots(); slot++) {
        pairStarts.push_back(pairs.size());
        if (layout.valences[slot] == 0)
            continue;
        int vertex = layout.vertices[slot];
        const CpuHelfrichNeighborList::List& list = candidates.lists[vertex];
        if (list.numNeighbors == 0)
            continue;
        mesh.forEachExcluded(vertex, level, [&](int excluded) { marks[excluded] = vertex; });
        for (int i = list.start; i < list.start + list.numNeighbors; i++)
            if (marks[candidates.neighbors[i]] != vertex)
                pairs.push_back(candidates.neighbors[i]);
        // In the order of the vertices, which does not depend on where the list was built: a restart must add them up
        // in the same order.
        sort(pairs.begin() + pairStarts[slot], pairs.end());
        for (size_t i = pairStarts[slot]; i < pairs.size(); i++)
            pairs[i] = 4 * layout.slots[pairs[i]];
    }
    pairStarts.push_back(pairs.size());
}

double CpuHelfrichRepulsion::compute(const double* positions, const HelfrichParameters& p, int firstSlot, int lastSlot,
                                     double* gradients) const {
    return box.exists() ? compute(positions, p, firstSlot, lastSlot, gradients, PeriodicDisplacement{box})
                        : compute(positions, p, firstSlot, lastSlot, gradients, OpenDisplacement());
}

template <class Displacement>
double CpuHelfrichRepulsion::compute(const double* positions, const HelfrichParameters& p, int firstSlot, int lastSlot,
                                     double* gradients, const Displacement& displacement) const {
    double energy = 0, onset2 = p.repulsionOnset * p.repulsionOnset;
    for (int slot = firstSlot; slot < lastSlot; slot++) {
        Vector3<double> x = getPoint(positions + 4 * slot);
        for (int i = pairStarts[slot]; i < pairStarts[slot + 1]; i++) {
            Vector3<double> d = displacement(getPoint(positions + pairs[i]), x);
            double r2 = dot(d, d);
            if (r2 >= onset2)
                continue;
            double r = sqrt(r2), slope;
            energy += p.moduli[Term::Repulsion] * repulsionPotential(p, r, slope);
            if (gradients != NULL) {
                double* gradient = gradients + 4 * (slot - firstSlot);
                double scale = 2 * p.moduli[Term::Repulsion] * slope / r;
                gradient[0] += scale * d.x;
                gradient[1] += scale * d.y;
                gradient[2] += scale * d.z;
            }
        }
    }
    return energy;
}
