#!/usr/bin/env bash
# Installs missing packages, builds, makes a scene with exact truth, trains by the plan, extracts the mesh, measures it
# and writes a 3D page.
# Usage: scripts/demo.sh [OUT]        default: runs/demo
set -euo pipefail
cd "$(dirname "$0")/.."

views=5 # around the front, one of them for testing
width=320
height=240
split=train_all
iterations=100
taus=0.01,0.02,0.05 # the object is 2 units high

out=${1:-runs/demo}
scene=$out/scene
run=$out/run
truth=(--crop "$scene/gt/info.json" --tau "$taus")

step() { printf '\n== %s\n' "$1" >&2; }

step "packages and build: the first time it takes minutes"
scripts/install_packages.sh
export PATH=$PATH:/usr/local/cuda/bin
preset=cpu
configure_flags=()
if command -v nvcc >/dev/null && command -v nvidia-smi >/dev/null && nvidia-smi -L >/dev/null 2>&1; then
    preset=cuda
    configure_flags+=(-DCMAKE_CUDA_ARCHITECTURES=native)
fi
if command -v ccache >/dev/null; then
    configure_flags+=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache -DCMAKE_CUDA_COMPILER_LAUNCHER=ccache)
fi
cmake --preset "$preset" -DTVSGS_TESTS=OFF -B "build/demo-$preset" "${configure_flags[@]}" >/dev/null
NINJA_STATUS='[%f of %t, %e s] ' cmake --build "build/demo-$preset" --parallel "$(nproc)"
bin=build/demo-$preset/bin
SECONDS=0

step "scene with exact ground truth: $scene"
"$bin/tvsgs-synth" --out "$scene" --views "$views" --arc 75 --test-views 1 --points 300 --width "$width" \
    --height "$height" --overwrite

step "training: $run"
"$bin/tvsgs-train" --scene "$scene" --split "$split" --iterations "$iterations" --out "$run" --overwrite \
    --gt "$scene/gt/points.ply" "${truth[@]}" --eval-mesh --eval-every $((iterations / 5))

step "mesh"
"$bin/tvsgs-extract-mesh" --model "$run"

step "mesh, splats and pictures against the truth (thresholds $taus)"
"$bin/tvsgs-eval" run --model "$run" --gt "$scene/gt/mesh.ply" --visible-gt "$scene/gt/points.ply" "${truth[@]}" \
    >/dev/null # the same is in eval/*.json

step "a page to look at"
"$bin/tvsgs-view" "$run" --out "$run/view.html"

cat <<END

Done in $SECONDS s after the build. Open in a browser:
  $run/report.html        how good it is, its error against time, what limits it
  $run/view.html          splats, mesh, cameras and errors in 3D

  photographs             $scene/images/*.png
  renders of test views   $run/test/*.png
  splats                  $run/point_cloud/iteration_*/point_cloud.ply
  mesh                    $run/mesh/mesh.glb      (the true one: $scene/gt/mesh.ply)
  picture of the mesh     $run/mesh/mesh.png
  numbers                 $run/eval/*.json, $run/log.jsonl
END
