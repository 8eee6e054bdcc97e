#include "CpuHelfrichLayout.h"
#include "CpuHalfedges.h"
#include "CpuThreads.h"
#include <algorithm>
#include <numeric>

using namespace HelfrichPlugin;
using namespace std;

/**
 * The number of rings that are found together, and how many before its turn a vertex's first triangle is asked for: it
 * may be in no cache.
 */
static const int RINGS = 8, AHEAD = 32;

/**
 * Rings of a patch may grow by one part in so many, and at least by so many neighbors of each vertex of a group.
 */
static const int ROOM = 16;

void CpuHelfrichLayout::initialize(const HelfrichMesh& mesh, int width) {
    this->width = width;
    int numGroups = 0;
    for (int size : mesh.getSurfaceSizes())
        numGroups += (size + width - 1) / width;
    groups.resize(numGroups);
    vertices.resize(numGroups * width, 0);
    valences.resize(numGroups * width, 0);
    slots.resize(mesh.getNumVertices());
    // Some rings are padded, and how many changes with every flip: room that is left saves copies and memory.
    neighbors.reserve(mesh.getNumHalfedges() * 5L / 4 + 8 * width);
    revision = NONE;
}

void CpuHelfrichLayout::update(const HelfrichMesh& mesh, int numThreads) {
    patches = divide(mesh, HelfrichMesh::PATCH);
    isMoved = (revision != NONE && mesh.findChanges(revision, filled) && moveAll(mesh, numThreads));
    if (isMoved) {
        for (int& chosen : filled)
            chosen = slots[chosen];
        fillRings(mesh, filled);
    }
    else
        fillAll(mesh, numThreads);
    revision = mesh.getRevision();
}

void CpuHelfrichLayout::moveNumbers(double* numbers, int numThreads) const {
    CpuThreads::forEach(numThreads, patches.size(), [&](int i) {
        double old[HelfrichMesh::PATCH];
        int first = patches[i].firstSlot;
        copy_n(numbers + first, patches[i].size, old);
        for (int n = 0; n < patches[i].size; n++)
            numbers[moves[first + n]] = old[n];
    });
}

void CpuHelfrichLayout::fillAll(const HelfrichMesh& mesh, int numThreads) {
    CpuThreads::forEach(numThreads, patches.size(), [&](int i) { fillSlots(mesh, patches[i]); });
    patchStarts.assign(1, 0);
    for (const Part& patch : patches) {
        int size = measureRings(patch);
        patchStarts.push_back(patchStarts.back() + size + (size / width / ROOM + ROOM) * width);
    }
    neighbors.resize(patchStarts.back());
    CpuThreads::forEach(numThreads, patches.size(), [&](int i) {
        placeGroups(patches[i], patchStarts[i]);
        vector<int> all(findLastGroup(patches[i]) * width - patches[i].firstSlot);
        iota(all.begin(), all.end(), patches[i].firstSlot);
        fillRings(mesh, all);
    });
}

bool CpuHelfrichLayout::moveAll(const HelfrichMesh& mesh, int numThreads) {
    moves.resize(getNumSlots());
    CpuThreads::forEach(numThreads, patches.size(), [&](int i) {
        int first = patches[i].firstSlot, end = patches[i].getEnd();
        copy(vertices.begin() + first, vertices.begin() + end, moves.begin() + first);
        fillSlots(mesh, patches[i]);
        for (int slot = first; slot < end; slot++)
            moves[slot] = slots[moves[slot]];
        for (int slot = end; slot % width != 0; slot++)
            moves[slot] = slot;
    });
    for (size_t i = 0; i < patches.size(); i++)
        if (measureRings(patches[i]) > patchStarts[i + 1] - patchStarts[i])
            return false;
    CpuThreads::forEach(numThreads, patches.size(), [&](int i) { moveRings(patches[i], patchStarts[i]); });
    return true;
}

vector<CpuHelfrichLayout::Part> CpuHelfrichLayout::divide(const HelfrichMesh& mesh, int size) const {
    vector<Part> parts;
    for (int first = 0, origin = 0; first < mesh.getNumVertices();) {
        int surface = mesh.getSurface(mesh.getOrder()[first]), surfaceSize = mesh.getSurfaceSizes()[surface];
        for (int begin = 0; begin < surfaceSize; begin += size)
            parts.push_back({surface, origin, first + begin, origin + begin, min(size, surfaceSize - begin)});
        first += surfaceSize;
        origin += (surfaceSize + width - 1) / width * width;
    }
    return parts;
}

void CpuHelfrichLayout::fillSlots(const HelfrichMesh& mesh, const Part& patch) {
    // Sort the patch by valence, keeping the order of vertices with equal ones.

    const int* order = &mesh.getOrder()[patch.firstVertex];
    int valence[HelfrichMesh::PATCH];
    vector<int> start;
    for (int i = 0; i < patch.size; i++) {
        valence[i] = mesh.valence(order[i]);
        if ((int) start.size() < valence[i] + 2)
            start.resize(valence[i] + 2, 0);
        start[valence[i] + 1]++;
    }
    start[0] = patch.firstSlot;
    for (size_t i = 1; i < start.size(); i++)
        start[i] += start[i - 1];
    for (int i = 0; i < patch.size; i++) {
        int slot = start[valence[i]]++;
        vertices[slot] = order[i];
        slots[order[i]] = slot;
        valences[slot] = valence[i];
    }
    for (int slot = patch.getEnd(); slot % width != 0; slot++)
        vertices[slot] = valences[slot] = 0;
}

int CpuHelfrichLayout::measureRings(const Part& patch) const {
    int size = 0;
    for (int first = patch.firstSlot; first < patch.getEnd(); first += width)
        size += valences[min(first + width, patch.getEnd()) - 1] * width;
    return size;
}

void CpuHelfrichLayout::placeGroups(const Part& patch, int start) {
    for (int first = patch.firstSlot; first < patch.getEnd(); first += width) {
        int length = valences[min(first + width, patch.getEnd()) - 1];
        bool isPadded = (valences[first] != length || first + width > patch.getEnd());
        groups[first / width] = {start, length, isPadded, patch.origin};
        start += length * width;
    }
}

void CpuHelfrichLayout::moveRings(const Part& patch, int start) {
    // The new rings are where the old ones were.

    int firstGroup = patch.firstSlot / width, lastGroup = findLastGroup(patch);
    vector<Group> oldGroups(groups.begin() + firstGroup, groups.begin() + lastGroup);
    vector<int> oldRings(neighbors.begin() + start,
                         neighbors.begin() + oldGroups.back().start + oldGroups.back().length * width);
    placeGroups(patch, start);
    int ringStarts[HelfrichMesh::PATCH];
    for (int g = firstGroup, i = 0; g < lastGroup; g++)
        for (int lane = 0; lane < width; lane++)
            ringStarts[i++] = groups[g].start + lane;
    int slot = patch.firstSlot;
    for (const Group& old : oldGroups)
        for (int lane = 0; lane < width; lane++, slot++) {
            const int* from = &oldRings[old.start - start + lane];
            int* to = &neighbors[ringStarts[moves[slot] - patch.firstSlot]];
            for (int i = 0, valence = max(1, min(valences[moves[slot]], old.length)); i < valence; i++)
                to[i * width] = 4 * moves[unsigned(from[i * width]) / 4];
        }
    for (int g = firstGroup; g < lastGroup; g++)
        if (groups[g].isPadded)
            for (int lane = 0; lane < width; lane++)
                padRing(g * width + lane);
}

void CpuHelfrichLayout::padRing(int slot) {
    const Group& group = groups[slot / width];
    int* ring = getRing(slot);
    for (int i = max(1, valences[slot]); i < group.length; i++)
        ring[i * width] = ring[0];
}

void CpuHelfrichLayout::fillRings(const HelfrichMesh& mesh, const vector<int>& chosen) {
    int size = chosen.size();
    for (int first = 0; first < size; first += RINGS) {
        for (int i = first + AHEAD; i < min(first + AHEAD + RINGS, size); i++)
            prefetchTriangle(mesh.getArrays(), mesh.outgoing(vertices[chosen[i]]));
        fillRings(mesh, &chosen[first], min(RINGS, size - first));
    }
}

void CpuHelfrichLayout::fillRings(const HelfrichMesh& mesh, const int* chosen, int count) {
    // A ring begins at the vertex's lowest halfedge: which one the mesh has at hand depends on its past.  Vertices of
    // lower valence go round again, for it costs less than to stop.  Padding has no valence, and yet one neighbor.

    int halfedge[MAX_WIDTH], lowest[MAX_WIDTH], start[MAX_WIDTH] = {}, longest = 1;
    for (int lane = 0; lane < count; lane++) {
        halfedge[lane] = lowest[lane] = mesh.outgoing(vertices[chosen[lane]]);
        longest = max(longest, valences[chosen[lane]]);
    }
    static thread_local vector<int> tips;
    tips.resize(longest * count);
    for (int i = 0; i < longest; i++)
        for (int lane = 0; lane < count; lane++) {
            int h = halfedge[lane];
            tips[i * count + lane] = 4 * slots[mesh.tip(h)];
            start[lane] = (h < lowest[lane] ? i : start[lane]);
            lowest[lane] = min(h, lowest[lane]);
            halfedge[lane] = mesh.rotate(h);
        }
    for (int lane = 0; lane < count; lane++) {
        int slot = chosen[lane], valence = max(1, valences[slot]);
        int* ring = getRing(slot);
        for (int i = 0, n = start[lane]; i < valence; i++, n++)
            ring[i * width] = tips[(n < valence ? n : n - valence) * count + lane];
        padRing(slot);
    }
}
