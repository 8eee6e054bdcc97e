#include "CpuHelfrichNeighborList.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include <algorithm>
#include <numeric>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

void HelfrichNeighborList::build(const vector<Vec3>& positions, double cutoff) {
    // In the order of their x coordinates, the partners of a vertex are near it.

    vector<int> order(positions.size());
    iota(order.begin(), order.end(), 0);
    sort(order.begin(), order.end(), [&](int a, int b) { return positions[a][0] < positions[b][0]; });
    vector<vector<int>> found(positions.size());
    for (auto a = order.begin(); a != order.end(); a++)
        for (auto b = a + 1; b != order.end() && positions[*b][0] - positions[*a][0] < cutoff; b++) {
            Vec3 d = positions[*b] - positions[*a];
            if (d.dot(d) < cutoff * cutoff) {
                found[*a].push_back(*b);
                found[*b].push_back(*a);
            }
        }
    lists.clear();
    partners.clear();
    for (auto& list : found) {
        lists.push_back({(int) partners.size(), 0, (int) list.size()});
        partners.insert(partners.end(), list.begin(), list.end());
    }
    revision = -1;
    numBuilds++;
}

void HelfrichNeighborList::divide(const HelfrichMesh& mesh) {
    if (revision == mesh.getRevision())
        return;
    for (int v = 0; v < mesh.getNumVertices(); v++) {
        auto first = partners.begin() + lists[v].start;
        lists[v].numApart = partition(first, first + lists[v].numPartners,
                                      [&](int partner) { return !mesh.areBonded(v, partner); }) -
                            first;
    }
    revision = mesh.getRevision();
}
