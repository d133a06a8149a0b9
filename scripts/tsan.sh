#!/bin/bash
# Runs the tests of the threaded parts under the thread sanitizer: scripts/tsan.sh [TEST...]
# Needs the build of the preset cpu-tsan (or BUILD=folder) and libomp-14-dev.
#
# GCC's OpenMP library hides its synchronisation from the sanitizer, which would report every loop. LLVM's library
# accepts the calls that GCC compiles; its tool Archer reports them to the sanitizer.
set -euo pipefail
cd "$(dirname "$0")/.."
build=${BUILD:-build/cpu-tsan}
libraries=$(dirname "$(ls /usr/lib/llvm-*/lib/libarcher.so 2>/dev/null | tail -1)")
[ -e "$libraries/libomp.so" ] || { echo "tsan.sh: no libomp.so with libarcher.so; apt-get install libomp-14-dev" >&2; exit 5; }
# Races need more than one thread.
export OMP_TOOL_LIBRARIES=$libraries/libarcher.so OMP_NUM_THREADS=${OMP_NUM_THREADS:-4}
export TSAN_OPTIONS="ignore_noninstrumented_modules=1 halt_on_error=1 ${TSAN_OPTIONS:-}"
tests=("$@")
[ ${#tests[@]} -gt 0 ] || tests=(test_core test_render test_tiles_and_blend test_photometric test_neighbours test_lists test_voting test_resume test_train test_stereo test_tsdf test_mesh_metrics test_io)
failed=()
for test in "${tests[@]}"; do
    [ -x "$build/bin/$test" ] || { echo "$test: not built"; failed+=("$test"); continue; }
    if "$build/bin/$test" >"$build/$test.log" 2>&1; then echo "$test: clean"; else
        failed+=("$test")
        echo "$test: see $build/$test.log"
    fi
done
[ ${#failed[@]} -eq 0 ]
