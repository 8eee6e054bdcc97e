#ifndef NEIGHBORLISTS_H_
#define NEIGHBORLISTS_H_

#include "CpuHelfrichNeighborList.h"
#include "openmm/Vec3.h"
#include <algorithm>
#include <numeric>
#include <vector>

namespace HelfrichPlugin {

/**
 * Find for each vertex all others that are closer than a cutoff, none of them taken for bonded.
 */
inline CpuHelfrichNeighborList findNeighbors(const std::vector<OpenMM::Vec3>& positions, double cutoff) {
    // In the order of their x coordinates, the neighbors of a vertex are near it.

    std::vector<int> order(positions.size());
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(), [&](int a, int b) { return positions[a][0] < positions[b][0]; });
    std::vector<std::vector<int>> found(positions.size());
    for (auto a = order.begin(); a != order.end(); a++)
        for (auto b = a + 1; b != order.end() && positions[*b][0] - positions[*a][0] < cutoff; b++) {
            OpenMM::Vec3 d = positions[*b] - positions[*a];
            if (d.dot(d) < cutoff * cutoff) {
                found[*a].push_back(*b);
                found[*b].push_back(*a);
            }
        }
    CpuHelfrichNeighborList result;
    for (auto& list : found) {
        result.lists.push_back({(int) result.neighbors.size(), 0, (int) list.size()});
        result.neighbors.insert(result.neighbors.end(), list.begin(), list.end());
    }
    result.numBuilds = 1;
    return result;
}

} // namespace HelfrichPlugin

#endif /*NEIGHBORLISTS_H_*/
