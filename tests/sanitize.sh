#!/bin/bash
# Run C++ tests under a sanitizer of Clang: tests/sanitize.sh thread|address|undefined [TEST...]
#
# This needs Clang with its OpenMP runtime (Debian: clang and libomp-dev).  That of GCC hides from the thread sanitizer how threads wait for each other, and so gets false
# reports; Clang's tells it through the library Archer.
set -e
sanitizer=$1
shift
tests=${*:-TestEdgeFlipSweep TestHelfrichMesh TestHelfrichStencils TestCpuHelfrichForce}
root=$(realpath "$(dirname "$0")/..")
build=${BUILD_DIR:-$root/build-$sanitizer}
archer=$(realpath "$(clang++ -print-resource-dir)/../../libarcher.so")

cmake -S "$root" -B "$build" -G Ninja -DCMAKE_CXX_COMPILER=clang++ -DHELFRICH_SANITIZER="$sanitizer" -DBUILD_TESTING=ON ${PYTHON:+-DPython_EXECUTABLE=$PYTHON} > /dev/null
ninja -C "$build" $tests
cd "$build"
# OpenMM's own library comes from its wheel, without the sanitizer.
export TSAN_OPTIONS="ignore_noninstrumented_modules=1 halt_on_error=1 $TSAN_OPTIONS" OMP_TOOL_LIBRARIES=$archer
# The OpenMP runtime keeps what it knows of threads until the end.
echo "leak:libomp" > leaks.supp
export LSAN_OPTIONS="suppressions=$PWD/leaks.supp"
ctest --output-on-failure -R "^($(echo $tests | tr ' ' '|'))\$"
