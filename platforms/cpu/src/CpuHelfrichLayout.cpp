#include "CpuHelfrichLayout.h"
#include "CpuHalfedges.h"
#include "CpuThreads.h"
#include <algorithm>

using namespace HelfrichPlugin;
using namespace std;

/**
 * How long before its turn a vertex's first triangle is asked for: it may be in no cache.
 */
static const int SLOTS_AHEAD = 32;

/**
 * The number of groups whose rings a thread fills at a time.
 */
static const int GROUPS_PER_PART = 64;

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
    neighbors.reserve(mesh.getNumHalfedges() * 9L / 8 + 8 * width);
}

void CpuHelfrichLayout::update(const HelfrichMesh& mesh, int numThreads) {
    const vector<Part> patches = divide(mesh, HelfrichMesh::PATCH);
    CpuThreads::forEach(numThreads, patches.size(), [&](int i) {
        fillSlots(mesh, patches[i]);
        for (int g = patches[i].firstSlot / width; g * width < patches[i].getEnd(); g++)
            measureGroup(g, patches[i]);
    });
    placeGroups();
    CpuThreads::forEachPart(numThreads, getNumGroups(), GROUPS_PER_PART, [&](int begin, int end) {
        vector<int> tips;
        for (int g = begin; g < end; g++)
            fillRings(mesh, g, tips);
    });
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

    const vector<int>& order = mesh.getOrder();
    int begin = patch.firstVertex, end = begin + patch.size;
    vector<int> start;
    for (int i = begin; i < end; i++) {
        size_t valence = mesh.valence(order[i]);
        if (start.size() < valence + 2)
            start.resize(valence + 2, 0);
        start[valence + 1]++;
    }
    for (size_t i = 1; i < start.size(); i++)
        start[i] += start[i - 1];
    for (int i = begin; i < end; i++) {
        int v = order[i], slot = patch.firstSlot + start[mesh.valence(v)]++;
        vertices[slot] = v;
        slots[v] = slot;
        valences[slot] = mesh.valence(v);
    }
    for (int slot = patch.getEnd(); slot % width != 0; slot++)
        vertices[slot] = valences[slot] = 0;
}

void CpuHelfrichLayout::measureGroup(int g, const Part& patch) {
    const int* valence = &valences[g * width];
    groups[g].length = *max_element(valence, valence + width);
    groups[g].isPadded = (*min_element(valence, valence + width) != groups[g].length);
    groups[g].origin = patch.origin;
}

void CpuHelfrichLayout::placeGroups() {
    int start = 0;
    for (Group& group : groups) {
        group.start = start;
        start += group.length * width;
    }
    neighbors.resize(start);
}

void CpuHelfrichLayout::fillRings(const HelfrichMesh& mesh, int g, vector<int>& tips) {
    // A ring begins at the vertex's lowest halfedge: which one the mesh has at hand depends on its past.  Vertices of
    // lower valence go round again, for it costs less than to stop.

    const Group& group = groups[g];
    int* ring = &neighbors[group.start];
    int halfedge[MAX_WIDTH], lowest[MAX_WIDTH], start[MAX_WIDTH] = {};
    tips.resize(group.length * width);
    for (int slot = min(g * width + SLOTS_AHEAD, (int) vertices.size() - width), last = slot + width; slot < last;
         slot++)
        prefetchTriangle(mesh.getArrays(), mesh.outgoing(vertices[slot]));
    for (int lane = 0; lane < width; lane++)
        halfedge[lane] = lowest[lane] = mesh.outgoing(vertices[g * width + lane]);
    for (int i = 0; i < group.length; i++)
        for (int lane = 0; lane < width; lane++) {
            int h = halfedge[lane];
            tips[i * width + lane] = 4 * slots[mesh.tip(h)];
            start[lane] = (h < lowest[lane] ? i : start[lane]);
            lowest[lane] = min(h, lowest[lane]);
            halfedge[lane] = mesh.rotate(h);
        }
    for (int i = 0; i < group.length; i++)
        for (int lane = 0; lane < width; lane++) {
            int slot = g * width + lane, valence = valences[slot], n = start[lane] + (i < valence ? i : 0);
            n -= (n < valence ? 0 : valence);
            ring[i * width + lane] = tips[n * width + lane];
        }
}
