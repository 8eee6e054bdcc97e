#include "CpuInstructionSet.h"
#include "openmm/OpenMMException.h"
#include "openmm/internal/windowsExport.h"
#include "openmm/internal/windowsExport.h"
#include <cstdlib>
#include <string>
#include <utility>
#include <vector>

using OpenMM::OpenMMException;
using namespace std;

namespace HelfrichPlugin {

typedef pair<string, CpuInstructionSet> NamedSet;

static vector<NamedSet> findSupportedSets() {
    vector<NamedSet> sets = {{"Baseline", CpuInstructionSet::Baseline}};
#ifdef HELFRICH_HAS_AVX2
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        sets.push_back({"AVX2", CpuInstructionSet::AVX2});
#endif
#ifdef HELFRICH_HAS_AVX512
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
        sets.push_back({"AVX512", CpuInstructionSet::AVX512});
#endif
    return sets;
}

static NamedSet findSet() {
    vector<NamedSet> supported = findSupportedSets();
    const char* wanted = getenv("OPENMM_HELFRICH_SIMD");
    if (wanted == NULL || *wanted == 0)
        return supported.back();
    string names;
    for (auto& set : supported) {
        if (wanted == set.first)
            return set;
        names += (names.empty() ? "" : ", ") + set.first;
    }
    throw OpenMMException("HelfrichForce: OPENMM_HELFRICH_SIMD is '" + string(wanted) +
                          "'; this processor and build support " + names);
}

CpuInstructionSet getCpuInstructionSet() {
    return findSet().second;
}

extern "C" OPENMM_EXPORT const char* getHelfrichInstructionSet() {
    static string answer;
    try {
        answer = findSet().first;
    }
    catch (const OpenMMException& error) {
        answer = error.what();
    }
    return answer.c_str();
}

} // namespace HelfrichPlugin
