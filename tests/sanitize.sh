#!/bin/bash
# Run the C++ tests and the fuzzers under Clang's sanitizers: tests/sanitize.sh [memory|fuzz|thread [NAME...]]
#
#   memory  the C++ tests, or those named, under the sanitizers of addresses and of undefined behavior
#   fuzz    the fuzzers of tests/fuzz, or those named, under the same: their corpora, and new inputs for FUZZ_SECONDS
#           (10)
#   thread  the C++ tests that use threads, or those named, under the sanitizer of data races
#
# Without an argument it runs all three.  This needs Clang with its run-time libraries (Debian: clang libclang-rt-dev).
set -euo pipefail
root=$(realpath "$(dirname "${BASH_SOURCE[0]}")/..")
if [ $# = 0 ]; then
    for part in memory fuzz thread; do "${BASH_SOURCE[0]}" $part; done
    exit
fi
part=$1
shift
fuzzers="FuzzCheckpoint FuzzPositions FuzzSerialization FuzzTriangles"
tests="TestCpuEdgeFlipSweep TestHelfrichMesh TestHelfrichStencils TestCpuHelfrichForce TestCpuThreads"
case $part in
    memory)
        sanitizer=memory flags=address,undefined fuzzing=ON
        serialization=$(cd "$root/serialization/tests"; basename -s .cpp -- *.cpp | tr '\n' ' ')
        tests="$tests TestReferenceHelfrichForce $serialization"
        ;;
    fuzz) sanitizer=memory flags=address,undefined fuzzing=ON tests=$fuzzers;;
    thread) sanitizer=thread flags=thread fuzzing=OFF;;
    *) echo "There is no part '$part': it is memory, fuzz or thread" >&2; exit 2;;
esac
names=(${*:-$tests})
build=${BUILD_DIR:-$root/build-$sanitizer}
mkdir -p "$build"

# The libraries are those of this build, not installed ones without the sanitizer, which the environment may put first.
unset LD_LIBRARY_PATH

# OpenMM's own library comes from its wheel, without the sanitizer; and where an error ends a constructor of OpenMM's
# Context, what that had made is lost.
echo leak:assertThrows > "$build/leaks.supp"
export LSAN_OPTIONS="suppressions=$build/leaks.supp" UBSAN_OPTIONS="print_stacktrace=1"
export TSAN_OPTIONS="ignore_noninstrumented_modules=1 halt_on_error=1 die_after_fork=0 ${TSAN_OPTIONS:-}"

cmake -S "$root" -B "$build" -G Ninja --log-level=WARNING -DCMAKE_CXX_COMPILER=clang++ \
    -DHELFRICH_SANITIZER=$flags -DHELFRICH_FUZZERS=$fuzzing -DBUILD_TESTING=ON \
    ${PYTHON:+-DPython_EXECUTABLE=$PYTHON} > /dev/null
cmake --build "$build" --target "${names[@]}" -- --quiet
if [ $part = fuzz ]; then
    for fuzzer in "${names[@]}"; do
        corpus="$build/corpus/$fuzzer"
        mkdir -p "$corpus"
        # Leaks of OpenMM's Context are not ours.
        ASAN_OPTIONS=detect_leaks=0 "$build/tests/fuzz/$fuzzer" -detect_leaks=0 -timeout=20 -print_final_stats=1 \
            -max_total_time="${FUZZ_SECONDS:-10}" -artifact_prefix="$build/" \
            "$corpus" "$root/tests/fuzz/corpus/$fuzzer" > "$build/$fuzzer.log" 2>&1 \
            || { tail -n 60 "$build/$fuzzer.log"; exit 1; }
        echo "$fuzzer: $(sed -n 's/stat::number_of_executed_units: *//p' "$build/$fuzzer.log") inputs, no error"
    done
else
    cd "$build"
    ctest --output-on-failure --parallel 2 -R "^($(IFS="|"; echo "${names[*]}"))\$"
fi
