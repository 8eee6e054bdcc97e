#include "CpuHelfrichLayout.h"
#include <algorithm>

using namespace HelfrichPlugin;
using namespace std;

void CpuHelfrichLayout::initialize(const HelfrichMesh& mesh, int width) {
    this->width = width;
    int numGroups = (mesh.getNumVertices()+width-1)/width;
    groups.resize(numGroups);
    vertices.resize(numGroups*width);
    valences.resize(numGroups*width);
    slots.resize(mesh.getNumVertices());
    // Some rings are padded, and how many changes with every flip: room that is left saves copies and memory.
    neighbors.reserve(mesh.getNumHalfedges()*9L/8+8*width);
}

void CpuHelfrichLayout::update(const HelfrichMesh& mesh) {
    fillSlots(mesh);
    fillRings(mesh);
}

void CpuHelfrichLayout::fillSlots(const HelfrichMesh& mesh) {
    fill(vertices.begin(), vertices.end(), 0);
    fill(valences.begin(), valences.end(), 0);
    const vector<int>& order = mesh.getOrder();
    const size_t PATCH = HelfrichMesh::PATCH;
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
    vector<int> firstHalfedges(mesh.getNumVertices());
    for (int h = mesh.getNumHalfedges()-1; h >= 0; h--)
        firstHalfedges[mesh.origin(h)] = h;
    neighbors.clear();
    for (int g = 0; g < getNumGroups(); g++) {
        const int* valence = &valences[g*width];
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
