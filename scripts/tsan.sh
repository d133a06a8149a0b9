#!/bin/bash
# Runs the tests of the threaded parts under the thread sanitizer: scripts/tsan.sh [TEST...]
# Needs the build of the preset cpu-tsan (or BUILD=folder).
set -euo pipefail
cd "$(dirname "$0")/.."
build=${BUILD:-build/cpu-tsan}
export OMP_NUM_THREADS=${OMP_NUM_THREADS:-4} TSAN_OPTIONS="halt_on_error=1 ${TSAN_OPTIONS:-}"
tests=("$@")
[ ${#tests[@]} -gt 0 ] || tests=(test_core test_render test_tiles_and_blend test_photometric test_neighbours test_lists test_voting test_voting_events test_resume test_train test_stereo test_tsdf test_mesh_metrics test_io)
failed=()
for test in "${tests[@]}"; do
    [ -x "$build/bin/$test" ] || { echo "$test: not built"; failed+=("$test"); continue; }
    if "$build/bin/$test" >"$build/$test.log" 2>&1; then echo "$test: clean"; else
        failed+=("$test")
        echo "$test: see $build/$test.log"
    fi
done
[ ${#failed[@]} -eq 0 ]
