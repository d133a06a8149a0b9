#!/usr/bin/env bash
# Makes the picture of README.md: a photograph, and the mesh from the same place, textured and plain.
# Usage: scripts/readme_picture.sh SCENE PHOTOGRAPH [WORK]     WORK: runs/picture; keeps a mesh that is already there
# README shows DSC_0430.JPG of https://github.com/pierotofy/dataset_banana (MIT), 800 px wide.
set -euo pipefail
cd "$(dirname "$0")/.."

[[ $# -ge 2 ]] || { echo "readme_picture: expected SCENE PHOTOGRAPH [WORK]" >&2; exit 2; }
scene=$1 photograph=$2 work=${3:-runs/picture}
bin=${BIN:-build/cpu/bin}

if [[ ! -e $work/mesh/mesh.obj ]]; then
    [[ -e $work/report.json ]] || "$bin/tvsgs-train" --scene "$scene" --out "$work"
    "$bin/tvsgs-extract-mesh" --model "$work" --out "$work/mesh/mesh.obj"
fi
"$bin/draw_mesh" docs/images/overview.jpg 400 "$scene" "$photograph" "$work/mesh/mesh.obj" photo texture plain
ls -l docs/images/overview.jpg
