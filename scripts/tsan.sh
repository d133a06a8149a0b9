#!/bin/bash
# Runs the tests of the threaded parts under the thread sanitizer: scripts/tsan.sh [TEST...]
# Needs the build of the preset cpu-tsan, hence clang++ and its OpenMP (libomp-14-dev).
set -euo pipefail
cd "$(dirname "$0")/.."
bin=build/cpu-tsan/bin
# Archer comes with LLVM's OpenMP and is loaded by it; OMP_NUM_THREADS so that there is something to see.
archer=$(ls /usr/lib/llvm-*/lib/libarcher.so 2>/dev/null | tail -1 || true)
[ -n "$archer" ] || { echo "tsan.sh: no libarcher.so; apt-get install libomp-14-dev" >&2; exit 5; }
export OMP_TOOL_LIBRARIES=$archer OMP_NUM_THREADS=4 TSAN_OPTIONS="ignore_noninstrumented_modules=1 halt_on_error=1 ${TSAN_OPTIONS:-}"
tests=("$@")
[ ${#tests[@]} -gt 0 ] || tests=(test_core test_render test_tv test_photometric test_resume test_train test_stereo test_tsdf test_mesh_metrics test_io)
failed=()
for test in "${tests[@]}"; do
    [ -x "$bin/$test" ] || { echo "$test: not built"; failed+=("$test"); continue; }
    if "$bin/$test" >"build/cpu-tsan/$test.log" 2>&1; then echo "$test: clean"; else
        failed+=("$test")
        echo "$test: see build/cpu-tsan/$test.log"
    fi
done
[ ${#failed[@]} -eq 0 ]
