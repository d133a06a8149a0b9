#!/usr/bin/env bash
# Makes the picture of README.md: photographs of a made scene, normals of a test view, and the mesh. Needs
# GraphicsMagick.
# Usage: scripts/readme_picture.sh [WORK]     default: runs/picture; keeps a training that is already there
set -euo pipefail
cd "$(dirname "$0")/.."

work=${1:-runs/picture}
picture=docs/images/overview.jpg
command -v gm >/dev/null || { echo "readme_picture: no gm: apt-get install graphicsmagick" >&2; exit 2; }
bin=${BIN:-build/cpu/bin}

if [[ ! -e $work/run/mesh/mesh.png ]]; then
    "$bin/tvsgs-synth" --out "$work/scene" --shape bust --views 8 --test-views 3 --arc 70 --width 400 --height 300 \
        --noise 1 --overwrite
    "$bin/tvsgs-train" --scene "$work/scene" --split train_all --iterations 800 --out "$work/run" --overwrite
    "$bin/tvsgs-extract-mesh" --model "$work/run"
fi

# White background; no margins around normals and mesh.
photographs=()
for name in $(grep -o '"train_all": \[[^]]*' "$work/scene/splits.json" | grep -o '[0-9]*\.png'); do
    photographs+=("$work/scene/images/$name")
done
panel=(-resize 640x480 -background white -gravity center -extent 500x500)
gm convert "${photographs[@]}" -resize 133x100 -append "$work/photographs.png"
gm convert "$work/run/test/0004_normal.png" -trim +repage -fill white -opaque black "${panel[@]}" "$work/normals.png"
gm convert "$work/run/mesh/mesh.png" -trim +repage "${panel[@]}" "$work/mesh.png"
mkdir -p "$(dirname "$picture")"
gm convert "$work"/{photographs,normals,mesh}.png +append -quality 88 "$picture"
ls -l "$picture"
