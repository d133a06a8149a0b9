#!/usr/bin/env bash
# Installs what is missing, builds for the CPU and runs all tests.
# Usage: scripts/test.sh [CTEST ARGUMENT...]      for example: scripts/test.sh -L formula
set -euo pipefail
cd "$(dirname "$0")/.."

scripts/install_packages.sh python3-numpy python3-scipy  # the oracles of the tests
launcher=()
if command -v ccache >/dev/null; then
    launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
fi
cmake --preset cpu -DTVSGS_WERROR=ON "${launcher[@]}"
cmake --build --preset cpu --parallel "$(nproc)"
ctest --test-dir build/cpu --output-on-failure --parallel "$(nproc)" "$@"
