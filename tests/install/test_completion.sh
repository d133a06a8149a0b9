#!/usr/bin/env bash
# Checks completion in bash with the built commands.
# Usage: test_completion.sh BIN_DIR TVSGS_BASH
set -euo pipefail
export PATH=$1:$PATH
# shellcheck source=/dev/null
source "$2"
compopt() { :; } # there is no line to edit

# complete WORD...: prints completions of the last word.
complete_words() {
    COMP_WORDS=("$@")
    COMP_CWORD=$(($# - 1))
    COMPREPLY=()
    _tvsgs "$1" || true
    printf '%s\n' "${COMPREPLY[@]}"
}
failures=0
expect() { # EXPECTED WORD...: among them
    local expected=$1
    shift
    complete_words "$@" | grep -xF -e "$expected" >/dev/null || {
        echo "test_completion: '$*' does not offer '$expected', but: $(complete_words "$@" | head -5 | tr '\n' ' ')" >&2
        failures=$((failures + 1))
    }
}
expect_only() { # 'EXPECTED...' WORD...: these alone
    local expected=$1
    shift
    [[ $(complete_words "$@" | sort | tr '\n' ' ') == "$expected " ]] || {
        echo "test_completion: '$*' offers $(complete_words "$@" | tr '\n' ' '), not $expected" >&2
        failures=$((failures + 1))
    }
}
expect_only '--iterations' tvsgs-train --itera
expect_only '--iterations' tvsgs train --itera
expect_only 'train' tvsgs tra
expect_only 'train' tvsgs help tra
expect_only 'auto json plain' tvsgs-train --progress ''
expect_only 'tv.k=' tvsgs-train --set tv.k
expect geometry tvsgs-eval ge
expect --pred tvsgs-eval geometry --
expect --pred tvsgs eval geometry --pr
if complete_words tvsgs-eval '' | grep -e '^-'; then
    echo "test_completion: flags are offered before a '-' is typed" >&2
    failures=$((failures + 1))
fi
cd "$(dirname "$2")"
expect "${2##*/}" tvsgs-train --init-ply ''
exit $((failures > 0))
