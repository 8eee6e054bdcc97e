// This file is compiled once for each instruction set and space; HELFRICH_SIMD and HELFRICH_SPACE are their names.

#include "CpuHelfrichRings.h"
#include "CpuInstructionSet.h"
#include <algorithm>

using namespace HelfrichPlugin;

namespace {

typedef std::conditional_t<HELFRICH_SPACE::IS_PERIODIC, CpuPeriodicHelfrichLoops, CpuHelfrichLoops> LoopsInSpace;

template <class Real>
void chooseEnergy(const CpuHelfrichLayout& layout, const HelfrichParameters& p, const CpuHelfrichArrays<Real>& arrays,
                  int firstGroup, int lastGroup, CpuHelfrichSums& sums) {
    bool hasTether = p.has(Term::Tether);
    auto compute = hasTether ? computeEnergy<Edges, true, Real> : computeEnergy<Edges, false, Real>;
    if (p.needsCurvature())
        compute = hasTether ? computeEnergy<Angles, true, Real> : computeEnergy<Angles, false, Real>;
    else if (p.needsTriangles())
        compute = hasTether ? computeEnergy<Triangles, true, Real> : computeEnergy<Triangles, false, Real>;
    compute(layout, Parameters<Real>(p), arrays, firstGroup, lastGroup, sums);
}

template <class Real>
void chooseGradient(const CpuHelfrichLayout& layout, const HelfrichParameters& p, const HelfrichTotals& slopes,
                    const CpuHelfrichArrays<Real>& arrays, int firstGroup, int lastGroup, double* gradients) {
    bool hasTether = p.has(Term::Tether);
    auto compute = hasTether ? computeGradient<Edges, true, Real> : computeGradient<Edges, false, Real>;
    if (p.needsCurvature())
        compute = hasTether ? computeGradient<Angles, true, Real> : computeGradient<Angles, false, Real>;
    else if (p.needsTriangles())
        compute = hasTether ? computeGradient<Triangles, true, Real> : computeGradient<Triangles, false, Real>;
    compute(layout, Parameters<Real>(p), slopes, arrays, firstGroup, lastGroup, gradients);
}

CpuHelfrichBox findBox(const double* positions, int firstSlot, int lastSlot) {
    // Several rows of points beside each other keep the processor busy.  Comparisons leave out what is not a number, a
    // sum does not.

    const int ROWS = 4;
    double lower[4 * ROWS], upper[4 * ROWS], zero[4 * ROWS] = {};
    for (int i = 0; i < 4 * ROWS; i++)
        lower[i] = upper[i] = positions[4 * firstSlot + i % 4];
    auto add = [&](const double* x, int count) {
        for (int i = 0; i < count; i++) {
            lower[i] = (x[i] < lower[i] ? x[i] : lower[i]);
            upper[i] = (x[i] > upper[i] ? x[i] : upper[i]);
            zero[i] += 0 * x[i];
        }
    };
    int slot = firstSlot;
    for (; slot + ROWS <= lastSlot; slot += ROWS)
        add(positions + 4 * slot, 4 * ROWS);
    for (; slot < lastSlot; slot++)
        add(positions + 4 * slot, 4);
    CpuHelfrichBox box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int row = 0; row < ROWS; row++)
        for (int i = 0; i < 3; i++) {
            box.lower[i] = std::min(box.lower[i], lower[4 * row + i]) + zero[4 * row + i];
            box.upper[i] = std::max(box.upper[i], upper[4 * row + i]) + zero[4 * row + i];
        }
    return box;
}

void roundPositions(const double* positions, int firstSlot, int lastSlot, const double* corner, double scale,
                    int* fixedPositions) {
    for (int slot = firstSlot; slot < lastSlot; slot++)
        for (int i = 0; i < 3; i++)
            fixedPositions[4 * slot + i] = int((positions[4 * slot + i] - corner[i]) * scale);
}

} // namespace

namespace HelfrichPlugin {

namespace loops = HELFRICH_SIMD::HELFRICH_SPACE;

template <>
const LoopsInSpace& getCompiledFor<LoopsInSpace, CpuInstructionSet::HELFRICH_SIMD>() {
    static const LoopsInSpace functions = {
            CpuHelfrichLoops{{SimdOf<double>::WIDTH, chooseEnergy<double>, chooseGradient<double>,
                              loops::computeEnergyOfMaterials<double>, loops::computeGradientOfMaterials<double>},
                             {SimdOf<float>::WIDTH, chooseEnergy<float>, chooseGradient<float>,
                              loops::computeEnergyOfMaterials<float>, loops::computeGradientOfMaterials<float>},
                             findBox,
                             roundPositions}};
    return functions;
}

} // namespace HelfrichPlugin
