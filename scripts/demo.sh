#!/usr/bin/env bash
# From nothing to splats, a mesh and numbers: installs what is missing, builds, makes a scene with exact
# ground truth, trains on it, extracts the mesh and measures it.
# Usage: scripts/demo.sh [OUT]        default: runs/demo
set -euo pipefail
cd "$(dirname "$0")/.."

views=24
width=160
height=120
config=configs/pgsr_sparse.json
split=train_all
train_flags=(--iterations 1000 --set densify.until=600) # a growth near the end would show as noise
mesh_flags=()
taus=0.01,0.02,0.05 # the object is 2 units high

out=${1:-runs/demo}
scene=$out/scene
run=$out/run

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
cmake --build "build/demo-$preset" --parallel "$(nproc)"
bin=build/demo-$preset/bin

step() { printf '\n== %s\n' "$1" >&2; }
SECONDS=0

step "scene with exact ground truth: $scene"
"$bin/tvsgs-synth" --out "$scene" --views "$views" --width "$width" --height "$height" --overwrite

step "training: $run"
"$bin/tvsgs-train" --scene "$scene" --split "$split" --config "$config" --out "$run" --overwrite "${train_flags[@]}"

step "mesh"
"$bin/tvsgs-extract-mesh" --model "$run" "${mesh_flags[@]}"

step "mesh against the true surface (thresholds $taus)"
mkdir -p "$run/eval"
"$bin/tvsgs-eval" geometry --pred "$run/mesh/mesh.glb" --gt "$scene/gt/mesh.ply" --visible-gt "$scene/gt/points.ply" \
    --crop "$scene/gt/info.json" --tau "$taus" --out "$run/eval/geometry.json"

step "renders of the test views against the photographs"
"$bin/tvsgs-eval" nvs --model "$run"

step "a page to look at"
"$bin/tvsgs-view" "$run" --out "$run/view.html"

cat <<END

Done in $SECONDS s after the build.
  photographs             $scene/images/*.png
  renders of test views   $run/test/*.png
  splats                  $run/point_cloud/iteration_*/point_cloud.ply
  mesh                    $run/mesh/mesh.glb      (the true one: $scene/gt/mesh.ply)
  picture of the mesh     $run/mesh/mesh.png
  all of it in 3D         $run/view.html
  numbers                 $run/eval/*.json, $run/log.jsonl
END
