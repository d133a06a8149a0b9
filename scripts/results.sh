#!/usr/bin/env bash
# Makes the tables of docs/results.md from run folders, or the runs too.
# Usage: scripts/results.sh RUNS [PAGE]        every finished run below RUNS, into PAGE (docs/results.md)
#        scripts/results.sh --train DATA OUT [--matrix FILE] [--scenes A,B]
#                                          trains, meshes and measures the runs of matrices/results.json (FILE) below
#                                          OUT, with the scenes of DATA; then writes OUT/results.md
# Keeps finished runs, so a stopped --train continues. Programs: $BIN, build/*/bin, or PATH.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)

fail() { printf 'results.sh: %s\n' "$1" >&2; exit 2; }

bin=${BIN:-}
for folder in "$root"/build/{cuda,demo-cuda,cpu,demo-cpu}/bin; do
    [[ -z $bin && -x $folder/tvsgs-eval ]] && bin=$folder
done
eval_command=${bin:+$bin/}tvsgs-eval
command -v "$eval_command" >/dev/null ||
    fail "no $eval_command: build it (cmake --build --preset cpu), or let BIN be its folder"

# One row per scene (and configuration, if there are several): means over the seeds, and half their range.
tables() {
    awk '
        # scene,configuration,seed,metric,value,version; quoted if it has a comma
        function fields(line, into,    n, part) {
            n = 0
            while (line != "") {
                if (line ~ /^"/) { match(line, /^"([^"]|"")*"/); part = substr(line, 2, RLENGTH - 2)
                                   line = substr(line, RLENGTH + 2) }
                else { match(line, /^[^,]*/); part = substr(line, 1, RLENGTH); line = substr(line, RLENGTH + 2) }
                into[++n] = part
            }
        }
        function cell(row, metric, form,    n, half) {
            n = count[row, metric]
            if (!n) return ""
            half = (high[row, metric] - low[row, metric]) / 2
            return sprintf(form, sum[row, metric] / n) (n > 1 && half >= 0 ? " ± " sprintf(form, half) : "")
        }
        function pair(row, key, source,    i, t, text) {  # at the two finest distances
            for (i = 1; i <= 2; i++) {
                t = cell(row, key "@" taus[row, i] " (" source ")", "%.3f")
                text = text (text != "" && t != "" ? ", " : "") t
            }
            return text
        }
        NR > 1 {
            fields($0, f); row = f[1] SUBSEP f[2]; metric = f[4]; value = f[5] + 0
            if (!(row in seen)) { seen[row] = 1; rows[++n_rows] = row }
            if (!(f[2] in named)) { named[f[2]] = 1; n_names++ }
            if (!((row, f[3]) in of_seed)) { of_seed[row, f[3]] = 1; seeds[row]++ }
            if (match(metric, /^f1@[^ ]+/)) {
                tau = substr(metric, 4, RLENGTH - 3)
                if (!((row, "tau", tau) in seen)) {
                    seen[row, "tau", tau] = 1
                    for (i = ++n_taus[row]; i > 1 && taus[row, i - 1] + 0 > tau + 0; i--)
                        taus[row, i] = taus[row, i - 1]
                    taus[row, i] = tau
                }
            }
            k = row SUBSEP metric
            if (!(k in count) || value < low[k]) low[k] = value
            if (!(k in count) || value > high[k]) high[k] = value
            sum[k] += value; count[k]++
        }
        END {
            many = n_names > 1
            print "| scene, split" (many ? ", configuration" : "") " | seeds | mesh F1 | mesh recall | accuracy |" \
                  " completeness | PSNR | SSIM | splats | peak MiB |"
            print "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
            for (i = 1; i <= n_rows; i++) {
                r = rows[i]; split(r, name, SUBSEP)
                print "| " name[1] (many ? ", " name[2] : "") " | " seeds[r] " | " pair(r, "f1", "geometry") " | " \
                      pair(r, "recall", "geometry") " | " cell(r, "accuracy (geometry)", "%.4f") " | " \
                      cell(r, "completeness (geometry)", "%.4f") " | " cell(r, "psnr", "%.2f") " | " \
                      cell(r, "ssim", "%.3f") " | " cell(r, "splats", "%.0f") " | " \
                      cell(r, "peak MiB", "%.0f") " |"
            }
        }' "$1"
}

# Writes `tables FILE.csv` between the two marks of a page.
fill() {
    local csv=$1 page=$2 new
    grep -q '^<!-- tables -->$' "$page" && grep -q '^<!-- end of tables -->$' "$page" ||
        fail "$page: no lines '<!-- tables -->' and '<!-- end of tables -->' to write between"
    new=$(mktemp "$page.XXXXXX")
    {
        sed '/^<!-- tables -->$/q' "$page"
        printf '\nBy %s, `scripts/results.sh`:\n\n' "$(sed -n '2s/.*,//p' "$csv")"
        tables "$csv"
        printf '\n'
        sed -n '/^<!-- end of tables -->$/,$p' "$page"
    } >"$new"
    chmod --reference="$page" "$new"
    mv "$new" "$page"
    printf 'results.sh: %s: the tables are new\n' "$page" >&2
}

if [[ ${1:-} == --train ]]; then
    [[ $# -ge 3 ]] || fail "expected --train DATA OUT"
    data=$(cd "$2" && pwd) || fail "$2: no folder of scenes"
    mkdir -p "$3" && cd "$3"
    shift 3
    matrix=$root/matrices/results.json
    rest=()
    while [[ $# -gt 0 ]]; do
        case $1 in
            --matrix) matrix=$(realpath -e "$OLDPWD/$2" 2>/dev/null || realpath -e "$2") || fail "$2: no matrix" ;;
            --scenes) rest+=(--scenes "$2") ;;
            *) fail "$1: expected --matrix FILE or --scenes A,B" ;;
        esac
        shift 2
    done
    "$eval_command" table --matrix "$matrix" --data "$data" "${rest[@]}" --out runs.md
    [[ -e results.md ]] || printf '# Results\n\n<!-- tables -->\n<!-- end of tables -->\n' >results.md
    fill runs.csv results.md
    exit 0
fi

[[ $# -ge 1 && $# -le 2 && $1 != -* ]] || fail "expected RUNS [PAGE], or --train DATA OUT"
page=${2:-$root/docs/results.md}
runs=()
while IFS= read -r report; do
    run=$(dirname "$report")
    label=plan # as SCENE/CONFIGURATION/seed_N, or a plain run
    [[ $(basename "$run") == seed_* ]] && label=$(basename "$(dirname "$run")")
    runs+=(--runs "$label=$run")
done < <(find "$1" -name report.json | sort)
[[ ${#runs[@]} -gt 0 ]] || fail "$1: no run below it (a finished one has a report.json)"
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
"$eval_command" table "${runs[@]}" --out "$scratch/runs.md" 2> >(grep -v "^info: $scratch" >&2)
fill "$scratch/runs.csv" "$page"
