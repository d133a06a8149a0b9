#!/usr/bin/env bash
# From photographs to a scene that tvsgs-train reads: COLMAP's features, matching, poses and
# undistortion, all on the CPU (Debian package colmap).
# Usage: scripts/prepare.sh [OPTION]... PHOTOS SCENE
#   --poses DIR       COLMAP model (cameras, images) with poses that you have: only points are made
#   --matcher NAME    exhaustive (default up to 150 photographs), sequential (video; default above)
#   --one-camera      all photographs come from one camera with one zoom
#   --max-size N      features are searched in photographs of at most N pixels [3200]
#   --min-share P     per cent of the photographs that must find a pose [80]
# SCENE must not exist. What COLMAP says goes to SCENE.log.
set -euo pipefail

poses=""
matcher=""
one_camera=0
max_size=3200
min_share=80
places=()
while (($#)); do
    case $1 in
        --poses) poses=$(realpath "$2"); shift ;;
        --matcher) matcher=$2; shift ;;
        --one-camera) one_camera=1 ;;
        --max-size) max_size=$2; shift ;;
        --min-share) min_share=$2; shift ;;
        -*) echo "prepare: unknown option $1; see the head of this script" >&2; exit 2 ;;
        *) places+=("$1") ;;
    esac
    shift
done
if ((${#places[@]} != 2)); then
    echo "usage: scripts/prepare.sh [OPTION]... PHOTOS SCENE" >&2
    exit 2
fi
photos=${places[0]%/}
scene=${places[1]%/}
if [[ ! -d $photos ]]; then
    echo "prepare: $photos: no such folder of photographs" >&2
    exit 3
fi
if [[ -e $scene ]]; then
    echo "prepare: $scene exists; name a new folder" >&2
    exit 2
fi
count=$(find -L "$photos" -type f \( -iname '*.jpg' -o -iname '*.jpeg' -o -iname '*.png' \) | wc -l)
if ((count < 2)); then
    echo "prepare: $photos: found $count photographs (.jpg, .jpeg, .png); expected at least 2" >&2
    exit 3
fi
if ! command -v colmap >/dev/null; then
    "$(dirname "$0")/install_packages.sh" colmap
fi
photos=$(realpath "$photos")
: "${matcher:=$( ((count <= 150)) && echo exhaustive || echo sequential )}"

# No display is needed or looked for.
export QT_QPA_PLATFORM=offscreen
mkdir -p "$(dirname "$scene")"
log=$(realpath "$(dirname "$scene")")/$(basename "$scene").log
work=$(mktemp -d "$(realpath "$(dirname "$scene")")/.$(basename "$scene").XXXXXX")
trap 'rm -rf "$work"' EXIT
: >"$log"
run() {
    echo "prepare: $1" >&2
    shift
    if ! colmap "$@" >>"$log" 2>&1; then
        echo "prepare: colmap $1 failed; the end of $log:" >&2
        tail -n 5 "$log" >&2
        exit 1
    fi
}

camera_flags=(--ImageReader.camera_model OPENCV --ImageReader.single_camera "$one_camera")
if [[ -n $poses ]]; then
    # Features must carry the calibration that you have: one of its cameras stands for all.
    colmap model_converter --input_path "$poses" --output_path "$work" --output_type TXT >>"$log" 2>&1 ||
        { echo "prepare: $poses: not a COLMAP model; see $log" >&2; exit 3; }
    read -r model params < <(awk '!/^#/ { m = $2; $1 = $2 = $3 = $4 = ""; gsub(/^ +/, ""); gsub(/ +/, ",")
        print m, $0; exit }' "$work/cameras.txt")
    if (($(grep -vc '^#' "$work/cameras.txt") > 1)); then
        echo "prepare: $poses holds several cameras; --poses works with one" >&2
        exit 3
    fi
    camera_flags=(--ImageReader.camera_model "$model" --ImageReader.camera_params "$params"
        --ImageReader.single_camera 1)
fi
run "features of $count photographs" feature_extractor --database_path "$work/db" --image_path "$photos" \
    --SiftExtraction.use_gpu 0 --SiftExtraction.max_image_size "$max_size" "${camera_flags[@]}"
run "$matcher matching" "${matcher}_matcher" --database_path "$work/db" --SiftMatching.use_gpu 0

if [[ -n $poses ]]; then
    # The database numbers the photographs by name; the poses must follow its numbers.
    mkdir "$work/given" "$work/sparse"
    sqlite=$(command -v sqlite3 || true)
    if [[ -z $sqlite ]]; then
        "$(dirname "$0")/install_packages.sh" sqlite3
    fi
    sqlite3 "$work/db" "select image_id, camera_id, name from images" >"$work/names"
    awk -F'|' 'NR == FNR { id[$3] = $1; camera[$3] = $2; next }
        /^#/ { next }
        !second { second = 1; n = split($0, w, " "); name = w[10]
            for (i = 11; i <= n; ++i) name = name " " w[i]
            if (name in id) { w[1] = id[name]; w[9] = camera[name]
                for (i = 1; i < 10; ++i) printf "%s ", w[i]; print name; print "" }
            next }
        { second = 0 }' "$work/names" "$work/images.txt" >"$work/given/images.txt"
    awk '!/^#/ { $1 = 1; print; exit }' "$work/cameras.txt" >"$work/given/cameras.txt"
    : >"$work/given/points3D.txt"
    if [[ ! -s $work/given/images.txt ]]; then
        echo "prepare: $poses names none of the photographs in $photos" >&2
        exit 3
    fi
    run "points for the given poses" point_triangulator --database_path "$work/db" --image_path "$photos" \
        --input_path "$work/given" --output_path "$work/sparse"
    best=$work/sparse
else
    mkdir "$work/sparse"
    run "poses" mapper --database_path "$work/db" --image_path "$photos" --output_path "$work/sparse"
    best=""
    most=0
    for model in "$work"/sparse/*/; do # COLMAP writes one model for every group that hangs together
        [[ -e $model/images.bin ]] || continue
        posed=$(od -An -t u8 -N 8 "$model/images.bin" | tr -d ' ')
        if ((posed > most)); then
            most=$posed
            best=$model
        fi
    done
    if ((most * 100 < count * min_share)); then
        echo "prepare: COLMAP found poses for $most of $count photographs, expected at least $min_share %." >&2
        echo "prepare: take more photographs with more overlap (60 % or more between neighbours), sharp, of a" >&2
        echo "prepare: scene with texture, from different places; --min-share takes what there is; see $log" >&2
        exit 3
    fi
fi
run "undistortion" image_undistorter --image_path "$photos" --input_path "$best" --output_path "$work/scene" \
    --output_type COLMAP
mkdir -p "$work/scene/sparse/0"
mv "$work"/scene/sparse/*.bin "$work/scene/sparse/0/"
rm -rf "$work/scene/stereo" "$work"/scene/run-colmap-*.sh
mv "$work/scene" "$scene"
posed=$(od -An -t u8 -N 8 "$scene/sparse/0/images.bin" | tr -d ' ')
points=$(od -An -t u8 -N 8 "$scene/sparse/0/points3D.bin" | tr -d ' ')
echo "prepare: $scene: $posed of $count photographs with poses, $points points; next: tvsgs-train --scene $scene" >&2
