#ifndef OPENMM_HELFRICH_INSTRUCTIONSET_H_
#define OPENMM_HELFRICH_INSTRUCTIONSET_H_

namespace HelfrichPlugin {

/**
 * The instruction sets for which the inner loops are compiled, the best last.
 */
enum class InstructionSet { Baseline, AVX2, AVX512 };

/**
 * Get the best instruction set that the processor and this build have, or the one that the environment variable
 * OPENMM_HELFRICH_SIMD names: Baseline, AVX2 or AVX512. Throws an OpenMMException if it names another.
 */
InstructionSet getInstructionSet();

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_INSTRUCTIONSET_H_*/
