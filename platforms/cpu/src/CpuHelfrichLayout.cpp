#include "CpuHelfrichLayout.h"
#include <algorithm>

using namespace HelfrichPlugin;
using namespace std;

/**
 * The number of vertices in a patch: their positions fit in the first-level cache.
 */
static const int PATCH = 512;

/**
 * Collects the vertices patch by patch.  A patch grows breadth-first from a vertex beside an earlier one.
 */
class PatchOrder {
public:
    explicit PatchOrder(const HelfrichMesh& mesh) : mesh(mesh), isCollected(mesh.getNumVertices(), 0) {
        order.reserve(mesh.getNumVertices());
        for (int v = 0; v < mesh.getNumVertices(); v++) {
            // Vertices that wait beside a patch come before those of other surfaces.

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
        size_t next = order.size(), end = next-next%PATCH+PATCH;
        add(seed);
        for (; next < order.size(); next++) {
            int first = mesh.outgoing(order[next]), h = first;
            do {
                int neighbor = mesh.tip(h);
                if (!isCollected[neighbor]) {
                    if (order.size() < end)
                        add(neighbor);
                    else
                        border.push_back(neighbor);
                }
                h = mesh.rotate(h);
            } while (h != first);
        }
    }
    void add(int vertex) {
        isCollected[vertex] = 1;
        order.push_back(vertex);
    }
    const HelfrichMesh& mesh;
    vector<char> isCollected;
    vector<int> border;
};

void CpuHelfrichLayout::initialize(const HelfrichMesh& mesh, int width) {
    this->width = width;
    order = PatchOrder(mesh).order;
    int numGroups = (mesh.getNumVertices()+width-1)/width;
    groups.resize(numGroups);
    vertices.resize(numGroups*width);
    valences.resize(numGroups*width);
    slots.resize(mesh.getNumVertices());
    firstHalfedges.resize(mesh.getNumVertices());
    update(mesh);
}

void CpuHelfrichLayout::update(const HelfrichMesh& mesh) {
    fillSlots(mesh);
    fillRings(mesh);
}

void CpuHelfrichLayout::fillSlots(const HelfrichMesh& mesh) {
    fill(vertices.begin(), vertices.end(), 0);
    fill(valences.begin(), valences.end(), 0.0);
    vector<int> start;
    for (size_t begin = 0; begin < order.size(); begin += PATCH) {
        // Sort the patch by valence, keeping the order of vertices with equal ones.

        size_t end = min(begin+PATCH, order.size());
        start.clear();
        for (size_t i = begin; i < end; i++) {
            size_t valence = mesh.valence(order[i]);
            if (start.size() < valence+2)
                start.resize(valence+2, 0);
            start[valence+1]++;
        }
        for (size_t i = 1; i < start.size(); i++)
            start[i] += start[i-1];
        for (size_t i = begin; i < end; i++) {
            int v = order[i], slot = begin+start[mesh.valence(v)]++;
            vertices[slot] = v;
            slots[v] = slot;
            valences[slot] = mesh.valence(v);
        }
    }
}

void CpuHelfrichLayout::fillRings(const HelfrichMesh& mesh) {
    for (int h = mesh.getNumHalfedges()-1; h >= 0; h--)
        firstHalfedges[mesh.origin(h)] = h;
    neighbors.clear();
    for (int g = 0; g < getNumGroups(); g++) {
        const double* valence = &valences[g*width];
        Group& group = groups[g];
        group.start = neighbors.size();
        group.length = *max_element(valence, valence+width);
        group.isPadded = (*min_element(valence, valence+width) != group.length);
        neighbors.resize(group.start+group.length*width);
        for (int lane = 0; lane < width; lane++) {
            int* ring = &neighbors[group.start+lane];
            int slot = g*width+lane, h = firstHalfedges[vertices[slot]];
            int pad = valence[lane] == 0 ? slot : slots[mesh.tip(h)];
            for (int i = 0; i < group.length; i++) {
                ring[i*width] = 4*(i < valence[lane] ? slots[mesh.tip(h)] : pad);
                h = mesh.rotate(h);
            }
        }
    }
}
