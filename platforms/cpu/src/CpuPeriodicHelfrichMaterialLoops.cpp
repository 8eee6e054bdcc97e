// This file is compiled once for each instruction set; HELFRICH_SIMD is its name.

#define HELFRICH_SPACE Periodic
#include "CpuHelfrichMaterialLoops.cpp"
