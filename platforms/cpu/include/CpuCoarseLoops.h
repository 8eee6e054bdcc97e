#ifndef OPENMM_CPUCOARSELOOPS_H_
#define OPENMM_CPUCOARSELOOPS_H_

namespace HelfrichPlugin {

/**
 * The entries of a row of a sparse matrix: a part of an array.
 */
struct CpuSparseRow {
    int start, size;
};

/**
 * An entry of a sparse matrix: four times its column, which is the offset of a vector (x, y, z, unused), and its value.
 */
struct CpuSparseEntry {
    int offset;
    float value;
};

/**
 * The loops of the coarser meshes, compiled for one instruction set.
 */
struct CpuCoarseLoops {
    /// compute rows of the product of a sparse matrix and vectors (x, y, z, unused), on cache lines; the first row is
    /// written to the target's beginning
    void (*multiplyDoubles)(const CpuSparseRow* rows, const CpuSparseEntry* entries, const double* source,
                            double* target, int firstRow, int lastRow);
    void (*multiplyFloats)(const CpuSparseRow* rows, const CpuSparseEntry* entries, const float* source, float* target,
                           int firstRow, int lastRow);
    void multiply(const CpuSparseRow* rows, const CpuSparseEntry* entries, const double* source, double* target,
                  int firstRow, int lastRow) const {
        multiplyDoubles(rows, entries, source, target, firstRow, lastRow);
    }
    void multiply(const CpuSparseRow* rows, const CpuSparseEntry* entries, const float* source, float* target,
                  int firstRow, int lastRow) const {
        multiplyFloats(rows, entries, source, target, firstRow, lastRow);
    }
};

} // namespace HelfrichPlugin

#endif /*OPENMM_CPUCOARSELOOPS_H_*/
