#!/usr/bin/env bash
# Formats the C++, CUDA and JavaScript sources with clang-format 14 (.clang-format).
# Usage: scripts/format.sh [--check]      --check changes nothing, names the files that differ and exits with 1
set -euo pipefail
cd "$(dirname "$0")/.."

check=false
case "${1:-}" in
    "") ;;
    --check) check=true ;;
    *)
        echo "format: usage: scripts/format.sh [--check]" >&2
        exit 2
        ;;
esac

# Other versions format some lines differently; Debian 12's decides.
formatter=clang-format-14
command -v "$formatter" >/dev/null || scripts/install_packages.sh "$formatter"

mapfile -d '' files < <(find src apps tests examples -type f \( -name '*.h' -o -name '*.cpp' -o -name '*.cu' -o -name '*.js' \) -print0)
mapfile -t differing < <(printf '%s\0' "${files[@]}" | xargs -0 -n 50 -P "$(nproc)" "$formatter" --dry-run 2>&1 |
    sed -n 's/^\([^:]*\):[0-9]*:[0-9]*: .*\[-Wclang-format-violations\].*/\1/p' | sort --unique)

if ((${#differing[@]} == 0)); then
    exit 0
fi
if $check; then
    echo "format: scripts/format.sh would change these files:" >&2
    printf '%s\n' "${differing[@]}" >&2
    exit 1
fi
"$formatter" -i "${differing[@]}"
printf 'formatted %s\n' "${differing[@]}"
