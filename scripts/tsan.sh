#!/bin/bash
# Runs the tests of the threaded parts under the thread sanitizer: scripts/tsan.sh [TEST...]
# Needs the build of the preset cpu-tsan (or BUILD=folder) and libomp-14-dev.
#
# The sanitizer does not see how GCC's OpenMP library synchronises, so every loop would be reported.
# LLVM's library takes the calls that GCC compiles, too; its tool, Archer, tells the sanitizer of them.
set -euo pipefail
cd "$(dirname "$0")/.."
build=${BUILD:-build/cpu-tsan}
libraries=$(dirname "$(ls /usr/lib/llvm-*/lib/libarcher.so 2>/dev/null | tail -1)")
[ -e "$libraries/libomp.so" ] || { echo "tsan.sh: no libomp.so with libarcher.so; apt-get install libomp-14-dev" >&2; exit 5; }
# More than one thread, so that there is something to see.
export OMP_TOOL_LIBRARIES=$libraries/libarcher.so OMP_NUM_THREADS=${OMP_NUM_THREADS:-4}
export TSAN_OPTIONS="ignore_noninstrumented_modules=1 halt_on_error=1 ${TSAN_OPTIONS:-}"
tests=("$@")
[ ${#tests[@]} -gt 0 ] || tests=(test_core test_render test_tiles_and_blend test_photometric test_neighbours test_lists test_voting test_resume test_train test_stereo test_tsdf test_mesh_metrics test_io)
failed=()
for test in "${tests[@]}"; do
    [ -x "$build/bin/$test" ] || { echo "$test: not built"; failed+=("$test"); continue; }
    if LD_PRELOAD=$libraries/libomp.so "$build/bin/$test" >"$build/$test.log" 2>&1; then echo "$test: clean"; else
        failed+=("$test")
        echo "$test: see $build/$test.log"
    fi
done
[ ${#failed[@]} -eq 0 ]
