// The CPU platform's loops over a noisy icosphere, one thread, by instruction set, precision and number of vertices: a
// tool for work on them.  Time is per vertex.

#include "CpuHelfrichLayout.h"
#include "CpuHelfrichLoops.h"
#include "CpuInstructionSet.h"
#include "Membranes.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include "openmmhelfrich/internal/HelfrichParameters.h"
#include <benchmark/benchmark.h>
#include <cmath>
#include <memory>
#include <vector>

using namespace HelfrichPlugin;
using namespace std;

/**
 * A rough sphere whose connectivity random flips have melted, with every array that the loops need.  Real is the type
 * in which they compute.
 */
template <class Real>
struct Scene {
    Scene(int subdivisions, bool hasTether) : membrane(createSphere(subdivisions)) {
        int numVertices = membrane.positions.size();
        double edge = sqrt(8 * M_PI / sqrt(3) / numVertices);
        TestRandom random(1);
        for (auto& x : membrane.positions)
            x += random.vector(0.05 * edge);
        mesh.reset(new HelfrichMesh(membrane.triangles, numVertices));
        for (int i = 0; i < mesh->getNumEdges() / 2; i++) {
            int h = random.index(mesh->getNumHalfedges());
            if (mesh->canFlip(h))
                mesh->flip(h);
        }
        layout.initialize(*mesh, getForProcessor<CpuHelfrichLoops>().in<Real>().width);
        layout.update(*mesh, 1);
        parameters.moduli[Term::Bending] = 20;
        if (hasTether) {
            parameters.moduli[Term::Tether] = 1;
            parameters.tetherMinLength = 0.7 * edge;
            parameters.tetherMaxLength = 1.5 * edge;
            parameters.tetherExponent = 2;
        }
        for (size_t i = 0; i < data.size(); i++)
            data[i].reset(static_cast<double*>(aligned_alloc(
                    64, 64 + sizeof(double) * max(4 * layout.getNumSlots(), (int) layout.neighbors.size()) / 64 * 64 +
                                64)));
        auto array = [&](int i) { return reinterpret_cast<Real*>(data[i].get()); };
        int* fixedPositions = reinterpret_cast<int*>(data[5].get());
        const double corner[] = {-2, -2, -2}, unit = ldexp(1, -29);
        arrays = {data[0].get(), array(1), array(2), array(3), array(4), fixedPositions, float(unit)};
        for (int slot = 0; slot < layout.getNumSlots(); slot++)
            for (int i = 0; i < 3; i++)
                arrays.positions[4 * slot + i] = membrane.positions[layout.vertices[slot]][i];
        getForProcessor<CpuHelfrichLoops>().roundPositions(arrays.positions, 0, layout.getNumSlots(), corner, 1 / unit,
                                                           fixedPositions);
    }
    Membrane membrane;
    unique_ptr<HelfrichMesh> mesh;
    CpuHelfrichLayout layout;
    HelfrichParameters parameters;
    CpuHelfrichArrays<Real> arrays;
    struct Free {
        void operator()(double* pointer) const {
            free(pointer);
        }
    };
    array<unique_ptr<double, Free>, 6> data;
};

static void reportPerVertex(benchmark::State& state, int numVertices) {
    state.counters["vertices"] = numVertices;
    state.counters["perVertex"] = benchmark::Counter(numVertices, benchmark::Counter::kIsIterationInvariantRate |
                                                                          benchmark::Counter::kInvert);
}

template <class Real>
static void energy(benchmark::State& state) {
    Scene<Real> scene(state.range(0), state.range(1));
    auto& loops = getForProcessor<CpuHelfrichLoops>().in<Real>();
    CpuHelfrichSums sums;
    for (auto _ : state)
        loops.computeEnergy(scene.layout, scene.parameters, scene.arrays, 0, scene.layout.getNumGroups(), sums);
    reportPerVertex(state, scene.mesh->getNumVertices());
}

template <class Real>
static void gradient(benchmark::State& state) {
    Scene<Real> scene(state.range(0), state.range(1));
    auto& loops = getForProcessor<CpuHelfrichLoops>().in<Real>();
    CpuHelfrichSums sums;
    HelfrichTotals slopes;
    slopes.area = slopes.volume = slopes.curvature = 1;
    alignas(64) double gradients[4 * CpuHelfrichLayout::MAX_WIDTH];
    loops.computeEnergy(scene.layout, scene.parameters, scene.arrays, 0, scene.layout.getNumGroups(), sums);
    for (auto _ : state)
        for (int g = 0; g < scene.layout.getNumGroups(); g++)
            loops.computeGradient(scene.layout, scene.parameters, slopes, scene.arrays, g, g + 1, gradients);
    reportPerVertex(state, scene.mesh->getNumVertices());
}

template <class Real>
static void layout(benchmark::State& state) {
    Scene<Real> scene(state.range(0), false);
    for (auto _ : state)
        scene.layout.update(*scene.mesh, 1);
    reportPerVertex(state, scene.mesh->getNumVertices());
}

BENCHMARK(energy<double>)->ArgsProduct({{4, 6, 8}, {0, 1}})->ArgNames({"subdivisions", "tether"});
BENCHMARK(energy<float>)->ArgsProduct({{4, 6, 8}, {0, 1}})->ArgNames({"subdivisions", "tether"});
BENCHMARK(gradient<double>)->ArgsProduct({{4, 6, 8}, {0, 1}})->ArgNames({"subdivisions", "tether"});
BENCHMARK(gradient<float>)->ArgsProduct({{4, 6, 8}, {0, 1}})->ArgNames({"subdivisions", "tether"});
BENCHMARK(layout<double>)->ArgsProduct({{4, 6, 8}})->ArgNames({"subdivisions"});

BENCHMARK_MAIN();
