#include "CpuHelfrichNeighborList.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include <algorithm>

using namespace HelfrichPlugin;
using namespace std;

void CpuHelfrichNeighborList::partition(const HelfrichMesh& mesh) {
    if (revision == mesh.getRevision())
        return;
    for (int v = 0; v < mesh.getNumVertices(); v++) {
        auto first = neighbors.begin() + lists[v].start;
        lists[v].numApart = std::partition(first, first + lists[v].numNeighbors,
                                           [&](int neighbor) { return !mesh.areBonded(v, neighbor); }) -
                            first;
    }
    revision = mesh.getRevision();
}
