#!/bin/bash
# Fuzzes every reader of files under ASan and UBSan: scripts/fuzz.sh [SECONDS each] [READER...]
#
# Needs clang++ with libFuzzer (Debian 12: apt-get install clang libclang-rt-14-dev).
# Starts from the seeds of tests/fuzz/make_corpus.py, in build/fuzz-seeds, and from its earlier finds, in
# build/fuzz-corpus. Saves a file that breaks a reader as build/fuzz-corpus/READER.crash-*; with a name found_* in
# tests/fuzz/corpus/READER it becomes a seed of test_fuzz.
set -euo pipefail
cd "$(dirname "$0")/.."
seconds=${1:-60}
shift || true
command -v clang++ >/dev/null || {
    echo "fuzz.sh: no clang++; apt-get install clang libclang-rt-14-dev" >&2
    exit 5
}
cmake --preset cpu-fuzz >/dev/null
cmake --build --preset cpu-fuzz
python3 tests/fuzz/make_corpus.py build/fuzz-seeds
readers=("$@")
[ ${#readers[@]} -gt 0 ] || readers=($(ls build/fuzz-seeds))
failed=()
for reader in "${readers[@]}"; do
    kept=build/fuzz-corpus/$reader
    mkdir -p "$kept"
    # -malloc_limit_mb: a small file may not make a reader allocate much at once.
    if ! TVSGS_FUZZ_TARGET=$reader build/cpu-fuzz/bin/fuzz_readers "$kept" "build/fuzz-seeds/$reader" \
        -max_total_time="$seconds" -max_len=8192 -timeout=10 -rss_limit_mb=4096 -malloc_limit_mb=1024 \
        -artifact_prefix="build/fuzz-corpus/$reader." >"$kept.log" 2>&1; then
        failed+=("$reader")
        grep -m1 -E "ERROR|runtime error|what\(\)" "$kept.log" || true
    fi
    echo "$reader: $(grep -E '^(Done|#[0-9]+)' "$kept.log" | tail -1)"
done
[ ${#failed[@]} -eq 0 ] || { echo "broken: ${failed[*]} (logs in build/fuzz-corpus)" >&2; exit 1; }
