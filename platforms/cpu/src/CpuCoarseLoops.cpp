// This file is compiled once for each instruction set; HELFRICH_SIMD is its name.

#include "CpuCoarseLoops.h"
#include "CpuInstructionSet.h"

using namespace HelfrichPlugin;

namespace {

template <class Real>
void multiply(const CpuSparseRow* rows, const CpuSparseEntry* entries, const Real* source, Real* target, int firstRow,
              int lastRow) {
    typedef Real Vector __attribute__((vector_size(4 * sizeof(Real))));
    for (int i = firstRow; i < lastRow; i++, target += 4) {
        Vector sum = {};
        const CpuSparseEntry* entry = entries + rows[i].start;
        for (const CpuSparseEntry* end = entry + rows[i].size; entry != end; entry++)
            sum += Real(entry->value) * *reinterpret_cast<const Vector*>(source + entry->offset);
        *reinterpret_cast<Vector*>(target) = sum;
    }
}

} // namespace

namespace HelfrichPlugin {

template <>
const CpuCoarseLoops& getCompiledFor<CpuCoarseLoops, CpuInstructionSet::HELFRICH_SIMD>() {
    static const CpuCoarseLoops functions = {multiply<double>, multiply<float>};
    return functions;
}

} // namespace HelfrichPlugin
