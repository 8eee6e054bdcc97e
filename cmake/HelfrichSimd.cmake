# Some sources are compiled once for each instruction set, and the program chooses among them when it runs: see
# CpuInstructionSet.h.

include(CheckCXXSourceCompiles)
set(HELFRICH_SIMD Baseline)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64|amd64)$")
    set(HELFRICH_SIMD_FLAGS_AVX2 -mavx2 -mfma)
    set(HELFRICH_SIMD_FLAGS_AVX512 -mavx512f -mavx512dq -mavx512vl -mavx2 -mfma -mprefer-vector-width=512)
    foreach(simd AVX2 AVX512)
        list(JOIN HELFRICH_SIMD_FLAGS_${simd} " " CMAKE_REQUIRED_FLAGS)
        check_cxx_source_compiles("int main() {return 0;}" HELFRICH_COMPILER_HAS_${simd})
        if(HELFRICH_COMPILER_HAS_${simd})
            list(APPEND HELFRICH_SIMD ${simd})
        endif()
        unset(CMAKE_REQUIRED_FLAGS)
    endforeach()
endif()

# Adds src/NAME.cpp to a library, for each NAME given, once for each instruction set.  The source finds the set's name
# in HELFRICH_SIMD; the library and who uses it find those that there are in HELFRICH_HAS_BASELINE, HELFRICH_HAS_AVX2
# and HELFRICH_HAS_AVX512.
#
# Of an inline function that several objects define, the linker keeps the first it meets, which must run on every
# processor.  So these are static libraries, which follow the library's own objects, and those of the baseline are the
# first of them.
function(helfrich_add_simd_sources library)
    foreach(simd ${HELFRICH_SIMD})
        foreach(name ${ARGN})
            add_library(${name}${simd} STATIC src/${name}.cpp)
            target_include_directories(${name}${simd} PRIVATE include "${PROJECT_SOURCE_DIR}/openmmapi/include")
            target_link_libraries(${name}${simd} PRIVATE OpenMM::OpenMM)
            target_compile_definitions(${name}${simd} PRIVATE HELFRICH_SIMD=${simd})
            # How vectors wider than a register are handed over matters to nobody else.
            target_compile_options(${name}${simd} PRIVATE
                -Wno-psabi -fno-math-errno -fno-trapping-math -ffp-contract=fast ${HELFRICH_SIMD_FLAGS_${simd}})
            if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)
                # It takes its own intrinsics, and vectors that are filled lane by lane, for uninitialized.
                target_compile_options(${name}${simd} PRIVATE -Wno-uninitialized -Wno-maybe-uninitialized)
            endif()
            target_link_libraries(${library} PRIVATE ${name}${simd})
        endforeach()
        string(TOUPPER HELFRICH_HAS_${simd} has_simd)
        target_compile_definitions(${library} PUBLIC ${has_simd})
    endforeach()
endfunction()
