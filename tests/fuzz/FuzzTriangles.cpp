/* Triangles that are nearly those of a surface, flips of any of their edges, and sweeps. */

#include "Fuzzing.h"
#include "NeighborLists.h"
#include "CpuEdgeFlipSweep.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include <numeric>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static void editTriangles(FuzzedDataProvider& data, vector<array<int, 3>>& triangles) {
    int numEdits = data.ConsumeIntegralInRange(0, 6);
    for (int i = 0; i < numEdits && !triangles.empty(); i++) {
        auto triangle = triangles.begin() + data.ConsumeIntegralInRange<size_t>(0, triangles.size() - 1);
        switch (data.ConsumeIntegralInRange(0, 4)) {
            case 0:
                (*triangle)[data.ConsumeIntegralInRange(0, 2)] = data.ConsumeIntegral<int>();
                break;
            case 1:
                (*triangle)[data.ConsumeIntegralInRange(0, 2)] = data.ConsumeIntegralInRange(-1, 24);
                break;
            case 2:
                triangles.erase(triangle);
                break;
            case 3:
                triangles.push_back(*triangle);
                break;
            default:
                swap((*triangle)[0], (*triangle)[1]);
        }
    }
}

static void flip(FuzzedDataProvider& data, HelfrichMesh& mesh) {
    int numFlips = data.ConsumeIntegralInRange(0, 30);
    for (int i = 0; i < numFlips; i++) {
        int h = data.ConsumeIntegralInRange(0, mesh.getNumHalfedges() - 1);
        if (mesh.canFlip(h))
            mesh.flip(h);
    }
    mesh.validate();
}

static void sweep(FuzzedDataProvider& data, HelfrichMesh& mesh, const Membrane& membrane) {
    // Energies need not make sense here: what becomes of the connectivity does.

    HelfrichParameters p = createParameters(membrane, getTermsOfBits(data.ConsumeIntegral<uint8_t>()),
                                            data.ConsumeIntegralInRange(0, 2));
    vector<Vec3> positions = membrane.positions;
    for (auto& x : positions)
        if (data.remaining_bytes() > 8 && data.ConsumeBool())
            x[0] = data.ConsumeFloatingPoint<double>();
    vector<int> slots(mesh.getNumVertices());
    iota(slots.begin(), slots.end(), 0);
    CpuVertexGeometry geometry;
    geometry.totals.assign(mesh.getNumSurfaces(), {1, 1, 1});
    geometry.areas.assign(slots.size(), data.ConsumeFloatingPointInRange(0.0, 1.0));
    geometry.curvatures.assign(slots.size(), data.ConsumeFloatingPointInRange(-10.0, 10.0));
    geometry.volumes.assign(slots.size(), 1);
    geometry.slots = slots.data();
    CpuEdgeFlipSweep sweep(mesh);
    CpuHelfrichNeighborList neighborList = findNeighbors(positions, 1.1 * p.repulsionOnset);
    neighborList.partition(mesh);
    sweep.setPositions(positions, geometry, CpuEdgeFlipSweep::needsNeighborList(p) ? &neighborList : NULL);
    EdgeFlipStatistics statistics = sweep.execute(p, data.ConsumeFloatingPointInRange(0.0, 1e6), 200,
                                                  Philox(data.ConsumeIntegral<int>(), 1), 0);
    require(statistics.attempted == 200 && statistics.accepted + statistics.forbidden <= 200, "the counts of a sweep");
    mesh.validate();
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* bytes, size_t size) {
    FuzzedDataProvider data(bytes, size);
    static const Membrane blob = createBlob(1), octahedra = join({createBlob(0), createBlob(0, 0.15, 2)});
    const Membrane& membrane = data.ConsumeBool() ? blob : octahedra;
    vector<array<int, 3>> triangles = membrane.triangles;
    editTriangles(data, triangles);
    try {
        HelfrichMesh mesh(triangles, membrane.positions.size());
        flip(data, mesh);
        // What a mesh says of itself makes the same mesh, in a mesh that had others.
        HelfrichMesh other(triangles, membrane.positions.size());
        other.setTriangles(mesh.getTriangles());
        other.validate();
        if (mesh.getNumVertices() == (int) membrane.positions.size())
            sweep(data, mesh, membrane);
    }
    catch (const OpenMMException& error) {
        require(string(error.what()).find("HelfrichForce: ") == 0, error.what());
    }
    return 0;
}
