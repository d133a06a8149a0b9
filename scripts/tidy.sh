#!/usr/bin/env bash
# Checks the lines of src and apps that changed since BASE with clang-tidy 14 (.clang-tidy); prints findings, exits 1.
# Usage: scripts/tidy.sh [BASE]      default: origin/main
set -euo pipefail
cd "$(dirname "$0")/.."
base=${1:-origin/main}

command -v clang-tidy-diff-14.py >/dev/null || scripts/install_packages.sh clang-tidy-14 python3
[[ -e build/cpu/compile_commands.json ]] || cmake --preset cpu >/dev/null
# -w: GCC reports compiler warnings in the build.
found=$(git diff --unified=0 --diff-filter=d "$base" -- 'src/*.cpp' 'apps/*.cpp' |
    clang-tidy-diff-14.py -p1 -path build/cpu -j "$(nproc)" -quiet -extra-arg=-w 2>&1 |
    grep -A3 -E '(warning|error): ' || true)
[[ -z $found ]] || { printf '%s\n' "$found" >&2; exit 1; }
