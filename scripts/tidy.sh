#!/usr/bin/env bash
# Checks changed lines of .cpp files in src and apps with clang-tidy 14 (.clang-tidy); prints findings, exits 1.
# Usage: scripts/tidy.sh [BASE]      changes since BASE, default: origin/main
set -euo pipefail
cd "$(dirname "$0")/.."
base=${1:-origin/main}

changes=$(git diff --unified=0 --diff-filter=d "$base" -- 'src/*.cpp' 'apps/*.cpp')
[[ -n $changes ]] || exit 0
command -v clang-tidy-diff-14.py >/dev/null || scripts/install_packages.sh clang-tidy-14 python3
[[ -e build/cpu/compile_commands.json ]] || cmake --preset cpu >/dev/null
# Debian's package has only clang-tidy-14. -w: GCC reports compiler warnings in the build.
said=$(clang-tidy-diff-14.py -clang-tidy-binary clang-tidy-14 -p1 -path build/cpu -j "$(nproc)" -quiet -extra-arg=-w \
    <<<"$changes" 2>&1) || { printf '%s\n' "$said" >&2; exit 1; }
found=$(grep -A3 -E '(warning|error): |^Failed: |^Skipping ' <<<"$said" || true)
[[ -z $found ]] || { printf '%s\n' "$found" >&2; exit 1; }
