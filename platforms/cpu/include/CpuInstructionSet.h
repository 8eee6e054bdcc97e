#ifndef OPENMM_CPUINSTRUCTIONSET_H_
#define OPENMM_CPUINSTRUCTIONSET_H_

namespace HelfrichPlugin {

/**
 * The instruction sets for which the inner loops are compiled, the best last.
 */
enum class CpuInstructionSet { Baseline, AVX2, AVX512 };

/**
 * Get the best instruction set that the processor and this build have, or the one that the environment variable
 * OPENMM_HELFRICH_SIMD names: Baseline, AVX2 or AVX512. Throws an OpenMMException if it names another.
 */
CpuInstructionSet getCpuInstructionSet();

/**
 * Get the name of this instruction set, or the text of the exception, for programs that load the library by its name.
 */
extern "C" const char* getHelfrichInstructionSet();

/**
 * Get the functions that a source compiled for each instruction set has, a struct of pointers to them.  The source
 * defines this for its own set, which is in HELFRICH_SIMD.
 */
template <class Functions, CpuInstructionSet set>
const Functions& getCompiledFor();

/**
 * Get those for the processor.  See getCpuInstructionSet().
 */
template <class Functions>
const Functions& getForProcessor() {
    switch (getCpuInstructionSet()) {
#ifdef HELFRICH_HAS_AVX512
        case CpuInstructionSet::AVX512:
            return getCompiledFor<Functions, CpuInstructionSet::AVX512>();
#endif
#ifdef HELFRICH_HAS_AVX2
        case CpuInstructionSet::AVX2:
            return getCompiledFor<Functions, CpuInstructionSet::AVX2>();
#endif
        default:
            return getCompiledFor<Functions, CpuInstructionSet::Baseline>();
    }
}

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUINSTRUCTIONSET_H_*/
