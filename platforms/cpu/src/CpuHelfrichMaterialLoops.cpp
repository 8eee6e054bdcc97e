// This file is compiled once for each instruction set and space; HELFRICH_SIMD and HELFRICH_SPACE are their names.

#include "CpuHelfrichRings.h"

namespace HelfrichPlugin {

namespace HELFRICH_SIMD {

namespace HELFRICH_SPACE {

template <class Real>
void computeEnergyOfMaterials(const CpuHelfrichLayout& layout, const HelfrichParameters& p,
                              const CpuHelfrichArrays<Real>& arrays, int firstGroup, int lastGroup,
                              CpuHelfrichSums& sums) {
    auto compute = p.has(Term::Tether) ? computeEnergy<Materials, true, Real> : computeEnergy<Materials, false, Real>;
    compute(layout, Parameters<Real>(p), arrays, firstGroup, lastGroup, sums);
}

template <class Real>
void computeGradientOfMaterials(const CpuHelfrichLayout& layout, const HelfrichParameters& p,
                                const HelfrichTotals& slopes, const CpuHelfrichArrays<Real>& arrays, int firstGroup,
                                int lastGroup, double* gradients) {
    auto compute =
            p.has(Term::Tether) ? computeGradient<Materials, true, Real> : computeGradient<Materials, false, Real>;
    compute(layout, Parameters<Real>(p), slopes, arrays, firstGroup, lastGroup, gradients);
}

template void computeEnergyOfMaterials(const CpuHelfrichLayout&, const HelfrichParameters&,
                                       const CpuHelfrichArrays<double>&, int, int, CpuHelfrichSums&);
template void computeEnergyOfMaterials(const CpuHelfrichLayout&, const HelfrichParameters&,
                                       const CpuHelfrichArrays<float>&, int, int, CpuHelfrichSums&);
template void computeGradientOfMaterials(const CpuHelfrichLayout&, const HelfrichParameters&, const HelfrichTotals&,
                                         const CpuHelfrichArrays<double>&, int, int, double*);
template void computeGradientOfMaterials(const CpuHelfrichLayout&, const HelfrichParameters&, const HelfrichTotals&,
                                         const CpuHelfrichArrays<float>&, int, int, double*);

} // namespace HELFRICH_SPACE

} // namespace HELFRICH_SIMD

} // namespace HelfrichPlugin
