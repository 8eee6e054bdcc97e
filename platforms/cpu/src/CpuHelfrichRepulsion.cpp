#include "CpuHelfrichRepulsion.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <algorithm>
#include <cmath>

using namespace HelfrichPlugin;
using namespace std;

bool CpuHelfrichRepulsion::update(const HelfrichMesh& mesh, const CpuHelfrichLayout& layout, const double* positions, const HelfrichParameters& p) {
    bool isNew = (p.repulsionOnset != onset);
    if (isNew)
        skin = 0.5*p.repulsionOnset;
    numUpdates++;
    if (isNew || hasMoved(layout, positions)) {
        onset = p.repulsionOnset;
        adaptSkin();
        if (!findCandidates(layout, positions)) {
            onset = -1;
            return false;
        }
        isNew = true;
    }
    if (isNew || mesh.getRevision() != revision || p.repulsionExclusionLevel != exclusionLevel) {
        removeExclusions(mesh, layout, p.repulsionExclusionLevel);
        revision = mesh.getRevision();
        exclusionLevel = p.repulsionExclusionLevel;
    }
    return true;
}

void CpuHelfrichRepulsion::adaptSkin() {
    // A list costs as much as some 50 evaluations to build.

    if (numUpdates < 50)
        skin = min(1.25*skin, 1.2*onset);
    else if (numUpdates > 300)
        skin = max(0.8*skin, 0.1*onset);
    numUpdates = 0;
}

bool CpuHelfrichRepulsion::hasMoved(const CpuHelfrichLayout& layout, const double* positions) const {
    double limit = 0.25*skin*skin;
    for (size_t v = 0; v < reference.size(); v++) {
        const double* x = positions+4*layout.slots[v];
        double dx = x[0]-reference[v][0], dy = x[1]-reference[v][1], dz = x[2]-reference[v][2];
        if (!(dx*dx+dy*dy+dz*dz <= limit))
            return true;
    }
    return false;
}

CpuHelfrichRepulsion::Cell CpuHelfrichRepulsion::findCell(int vertex) const {
    // Far away all is one cell: that can make the list slow, but not wrong.

    Cell cell;
    for (int i = 0; i < 3; i++)
        cell[i] = (int) max(-1e9, min(1e9, floor(reference[vertex][i]/(onset+skin))));
    return cell;
}

unsigned int CpuHelfrichRepulsion::findBucket(const Cell& cell) const {
    unsigned int hash = 73856093u*(unsigned int) cell[0]^19349663u*(unsigned int) cell[1]^83492791u*(unsigned int) cell[2];
    return hash&(bucketStarts.size()-2);
}

void CpuHelfrichRepulsion::sortIntoBuckets() {
    int numVertices = reference.size();
    size_t numBuckets = 1;
    while (numBuckets < reference.size())
        numBuckets *= 2;
    bucketStarts.assign(numBuckets+1, 0);
    cells.resize(numVertices);
    for (int v = 0; v < numVertices; v++) {
        cells[v] = findCell(v);
        bucketStarts[findBucket(cells[v])+1]++;
    }
    for (size_t i = 1; i < bucketStarts.size(); i++)
        bucketStarts[i] += bucketStarts[i-1];
    vector<int> next(bucketStarts.begin(), bucketStarts.end()-1);
    bucketVertices.resize(numVertices);
    for (int v = 0; v < numVertices; v++)
        bucketVertices[next[findBucket(cells[v])]++] = v;
}

bool CpuHelfrichRepulsion::findCandidates(const CpuHelfrichLayout& layout, const double* positions) {
    reference.resize(layout.slots.size());
    for (size_t v = 0; v < reference.size(); v++)
        for (int i = 0; i < 3; i++) {
            reference[v][i] = positions[4*layout.slots[v]+i];
            if (!isfinite(reference[v][i]))
                return false;
        }
    sortIntoBuckets();
    candidateStarts.clear();
    candidates.clear();
    for (size_t v = 0; v < reference.size(); v++) {
        candidateStarts.push_back(candidates.size());
        addCandidates(v, (onset+skin)*(onset+skin));
    }
    candidateStarts.push_back(candidates.size());
    return true;
}

void CpuHelfrichRepulsion::addCandidates(int vertex, double cutoff2) {
    const array<double, 3>& x = reference[vertex];
    const Cell& center = cells[vertex];
    for (int n = 0; n < 27; n++) {
        Cell cell = {center[0]+n%3-1, center[1]+n/3%3-1, center[2]+n/9-1};
        unsigned int bucket = findBucket(cell);
        for (int i = bucketStarts[bucket]; i < bucketStarts[bucket+1]; i++) {
            int other = bucketVertices[i];
            double dx = reference[other][0]-x[0], dy = reference[other][1]-x[1], dz = reference[other][2]-x[2];
            if (dx*dx+dy*dy+dz*dz < cutoff2 && other != vertex && cells[other] == cell)
                candidates.push_back(other);
        }
    }
    // In an order that does not depend on where the list was made: the sums over it must not either, or a restart would change their last bits.
    sort(candidates.begin()+candidateStarts[vertex], candidates.end());
}

void CpuHelfrichRepulsion::markExclusions(const HelfrichMesh& mesh, int vertex, int level) {
    if (level == 0)
        return;
    int first = mesh.outgoing(vertex), h = first;
    do {
        int neighbor = mesh.tip(h);
        marks[neighbor] = vertex;
        if (level == 2) {
            int firstOfNeighbor = mesh.outgoing(neighbor), g = firstOfNeighbor;
            do {
                marks[mesh.tip(g)] = vertex;
                g = mesh.rotate(g);
            } while (g != firstOfNeighbor);
        }
        h = mesh.rotate(h);
    } while (h != first);
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
        if (candidateStarts[vertex] == candidateStarts[vertex+1])
            continue;
        markExclusions(mesh, vertex, level);
        for (int i = candidateStarts[vertex]; i < candidateStarts[vertex+1]; i++)
            if (marks[candidates[i]] != vertex)
                pairs.push_back(4*layout.slots[candidates[i]]);
    }
    pairStarts.push_back(pairs.size());
}

double CpuHelfrichRepulsion::compute(const double* positions, const HelfrichParameters& p, int firstSlot, int lastSlot, double* gradients) const {
    double energy = 0, onset2 = p.repulsionOnset*p.repulsionOnset;
    for (int slot = firstSlot; slot < lastSlot; slot++) {
        const double* x = positions+4*slot;
        for (int i = pairStarts[slot]; i < pairStarts[slot+1]; i++) {
            const double* y = positions+pairs[i];
            double dx = x[0]-y[0], dy = x[1]-y[1], dz = x[2]-y[2], r2 = dx*dx+dy*dy+dz*dz;
            if (r2 >= onset2)
                continue;
            double r = sqrt(r2), slope;
            energy += p.repulsionModulus*repulsionPotential(r, p.repulsionOnset, p.repulsionExponent, slope);
            if (gradients != NULL) {
                double* gradient = gradients+4*(slot-firstSlot);
                double scale = 2*p.repulsionModulus*slope/r;
                gradient[0] += scale*dx;
                gradient[1] += scale*dy;
                gradient[2] += scale*dz;
            }
        }
    }
    return energy;
}
