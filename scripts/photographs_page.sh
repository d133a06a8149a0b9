#!/usr/bin/env bash
# Makes the pictures and seconds of docs/results/photographs.md: trains each set at 800 px, meshes it, draws the mesh.
# Usage: scripts/photographs_page.sh SCENES OUT [SET...]     SCENES: folder of the scenes; SET: all, or some of the list
# Keeps runs and meshes that are in OUT. Writes OUT/SET.jpg and OUT/seconds.txt. Programs: $BIN, build/*/bin.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)

fail() { printf 'photographs_page.sh: %s\n' "$1" >&2; exit 2; }
[[ $# -ge 2 ]] || fail "expected SCENES OUT [SET...]"
bin=${BIN:-}
for folder in "$root"/build/{cuda,cpu}/bin; do
    [[ -z $bin && -x $folder/draw_mesh ]] && bin=$folder
done
[[ -x $bin/draw_mesh ]] || fail "no draw_mesh: build it (cmake --build --preset cpu), or let BIN be its folder"

# set: scene, photograph, degrees, photographs and textures that may be shown (shown or hidden), flags of the training
sets="
sceaux: sceaux 100_7105.JPG 45 hidden
monstree: monstree IMG_1050.JPG 45 shown
banana: banana DSC_0430.JPG 45 shown
copr: copr IMG_0076.jpg 45 shown
ring_17_43_17_train_3: ring_17_43_17 01.png 45 hidden --split train_3
ring_17_43_17_train_6: ring_17_43_17 01.png 45 hidden --split train_6
ring_17_43_17: ring_17_43_17 01.png 45 hidden --split train_all
ring_18_26_00_train_3: ring_18_26_00 01.png 45 hidden --split train_3
ring_18_26_00_train_6: ring_18_26_00 01.png 45 hidden --split train_6
ring_18_26_00: ring_18_26_00 01.png 45 hidden --split train_all
ring_12_11_32_train_3: ring_12_11_32 01.png 45 hidden --split train_3
ring_12_11_32_train_6: ring_12_11_32 01.png 45 hidden --split train_6
ring_12_11_32: ring_12_11_32 01.png 45 hidden --split train_all
fountain-P11: fountain-P11 0005.jpg 45 hidden
dtu_scan24: dtu_scan24 000025.jpg 45 hidden --images image --split train_9
dtu_scan24_no_masks: dtu_scan24 000025.jpg 45 hidden --images image --split train_9 --mask-use none
stone_bust: stone_bust 0024.jpg 45 hidden --split train_9
ycb_table: ycb_table 0024.jpg 45 hidden --split train_9
"

scenes=$(cd "$1" && pwd) out=$2
shift 2
mkdir -p "$out"
while IFS=': ' read -r set scene photograph degrees shown flags; do
    [[ -n $set && (" $* " == *" $set "* || $# -eq 0) ]] || continue
    run=$out/$set
    begin=$(date +%s%N)
    # shellcheck disable=SC2086  # several flags
    [[ -e $run/report.json ]] ||
        "$bin/tvsgs-train" --scene "$scenes/$scene" -r "${WIDTH:-800}" $flags --out "$run" --overwrite </dev/null
    if [[ ! -e $run/mesh/mesh.obj ]]; then
        "$bin/tvsgs-extract-mesh" --model "$run" --out "$run/mesh/mesh.obj" </dev/null
        awk -v set="$set" -v ns=$(($(date +%s%N) - begin)) 'BEGIN { printf "%s %.1f s\n", set, ns / 1e9 }' \
            >>"$out/seconds.txt"
    fi
    [[ $set != *_train_* ]] || continue
    panels=(plain "plain:$degrees")
    [[ $shown == shown ]] && panels=(photo texture "texture:$degrees" plain "plain:$degrees")
    drawn=()
    for each in "${run}_train_3" "${run}_train_6" "$run"; do # a ring shows all three in one picture
        [[ ! -e $each/mesh/mesh.obj ]] || drawn+=("$each/mesh/mesh.obj" "${panels[@]}")
    done
    count=$((${#drawn[@]} * ${#panels[@]} / (${#panels[@]} + 1)))
    "$bin/draw_mesh" "$out/$set.jpg" $((count == 2 ? 300 : 1200 / count)) "$scenes/$scene" "$photograph" "${drawn[@]}"
done <<<"$sets"
