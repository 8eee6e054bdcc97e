#include "CpuChosenVertices.h"
#include <algorithm>

using namespace HelfrichPlugin;
using namespace std;

CpuChosenVertices::CpuChosenVertices(const CpuHelfrichForceLoops<double>& loops, const HelfrichParameters& parameters,
                                     const CpuHelfrichLayout& layout, const double* positions)
        : loops(loops), p(parameters), layout(layout), positions(positions) {
    copies.width = loops.width;
    copies.groups.resize(1);
    copies.valences.resize(loops.width);
    bendingSlopes.resize(loops.width);
    ofCopies.resize(loops.width);
}

vector<int> CpuChosenVertices::sort(const CpuHelfrichLayout& layout, const vector<int>& slots) {
    vector<int> ends, sorted(slots.size());
    for (int slot : slots) {
        size_t valence = layout.valences[slot];
        if (ends.size() < valence + 2)
            ends.resize(valence + 2, 0);
        ends[valence + 1]++;
    }
    for (size_t i = 1; i < ends.size(); i++)
        ends[i] += ends[i - 1];
    for (int slot : slots)
        sorted[ends[layout.valences[slot]]++] = slot;
    return sorted;
}

int CpuChosenVertices::getOrigin(int slot) const {
    return layout.groups[slot / layout.width].origin;
}

void CpuChosenVertices::compute(const int* slots, int count, CpuVertexGeometry& geometry) {
    for (int first = 0, last; first < count; first = last) {
        for (last = first; last < min(first + copies.width, count) && getOrigin(slots[last]) == getOrigin(slots[first]);
             last++)
            ;
        computeGroup(slots + first, last - first, geometry);
    }
}

void CpuChosenVertices::computeGroup(const int* slots, int count, CpuVertexGeometry& geometry) {
    int width = copies.width, length = 0;
    for (int i = 0; i < count; i++)
        length = max(length, layout.valences[slots[i]]);
    makeRoom(length);
    copies.groups[0] = {0, length, false, (length + 1) * width};
    copyPosition(getOrigin(slots[0]), copies.groups[0].origin);
    for (int lane = 0; lane < width; lane++)
        copyRing(slots[min(lane, count - 1)], lane);
    CpuHelfrichArrays<double> arrays = {copiedPositions.data(),     bendingSlopes.data(),    ofCopies.areas.data(),
                                        ofCopies.curvatures.data(), ofCopies.volumes.data(), anglesPerLength.data()};
    arrays.box = p.box;
    CpuHelfrichSums sums;
    loops.computeEnergy(copies, p, arrays, 0, 1, sums);
    for (int i = 0; i < count; i++) {
        geometry.areas[slots[i]] = ofCopies.areas[i];
        geometry.curvatures[slots[i]] = ofCopies.curvatures[i];
        geometry.volumes[slots[i]] = ofCopies.volumes[i];
    }
}

void CpuChosenVertices::makeRoom(int length) {
    size_t numCorners = length * copies.width;
    if (copies.neighbors.size() >= numCorners)
        return;
    copies.neighbors.clear();
    for (size_t corner = 0; corner < numCorners; corner++)
        copies.neighbors.push_back(4 * (copies.width + corner));
    anglesPerLength.resize(numCorners);
    copiedPositions.resize(4 * (copies.width + numCorners + 1));
}

void CpuChosenVertices::copyRing(int slot, int lane) {
    CpuHelfrichLayout::Group& group = copies.groups[0];
    const int* ring = &layout.neighbors[layout.groups[slot / layout.width].start + slot % layout.width];
    int valence = layout.valences[slot];
    copies.valences[lane] = valence;
    group.isPadded = group.isPadded || valence != group.length;
    copyPosition(slot, lane);
    for (int i = 0; i < group.length; i++)
        copyPosition(ring[(i < valence ? i : 0) * layout.width] / 4, copies.width * (i + 1) + lane);
}

void CpuChosenVertices::copyPosition(int slot, int copy) {
    copy_n(positions + 4 * slot, 4, &copiedPositions[4 * copy]);
}
