#!/usr/bin/env bash
# Checks an installation: the commands run, manuals are complete, and the example program builds against it.
# Usage: test_install.sh BUILD_DIR CXX
set -euo pipefail
build=$1 cxx=$2
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "test_install: $*" >&2; exit 1; }

cmake --install "$build" --prefix "$work/usr" >"$work/log"
cd "$work"
prefix=$work/usr
commands=0
for program in "$prefix"/bin/*; do
    name=${program##*/}
    commands=$((commands + 1))
    env -i "$program" --version >version || fail "$name --version: exit code $?"
    grep -q '^tvsgs [0-9.]*$' version && grep -q '^device code: CPU' version && grep -q '^libraries: .*zlib [0-9]' version ||
        fail "$name --version does not name its build: $(cat version)"
    cmp -s <("$program" -V) version || fail "$name: -V is not --version"
    page=$prefix/share/man/man1/$name.1.gz
    zcat "$page" | grep "^\.SH NAME" >/dev/null || fail "$page is no manual"
    if command -v man >/dev/null; then
        warnings=$(zcat "$page" | LC_ALL=C.UTF-8 MANROFFSEQ='' man --warnings -E UTF-8 -l -Tutf8 -Z - 2>&1 >/dev/null)
        [[ -z $warnings ]] || fail "$page: $warnings"
    fi
    [[ -e $prefix/share/bash-completion/completions/$name ]] || fail "no completion for $name"
done
((commands >= 6)) || fail "only $commands commands are installed"

# Each flag of --help-all is in the manual.
"$prefix/bin/tvsgs-train" --help-all | grep -o -- '--[a-z][a-z-]*' | sort -u >flags
zcat "$prefix/share/man/man1/tvsgs-train.1.gz" | sed 's/\\-/-/g' >manual
(($(wc -l <flags) > 40)) || fail "--help-all lists $(wc -l <flags) flags"
while read -r flag; do grep -q -e "$flag" manual || fail "$flag is not in the manual"; done <flags
"$prefix/bin/tvsgs-train" --help | grep -- '--help-all' >/dev/null || fail "--help does not say that there is --help-all"
"$prefix/bin/tvsgs-train" --help | grep -- '--profile' && fail "--help has what --help-all is for"

# tvsgs COMMAND runs the other commands.
"$prefix/bin/tvsgs" help | grep 'extract-mesh' >/dev/null || fail "tvsgs help does not list the commands"
cmp -s <("$prefix/bin/tvsgs" help train) <("$prefix/bin/tvsgs-train" --help) || fail "tvsgs help train is another page"
code=0
"$prefix/bin/tvsgs" trian 2>message || code=$?
[[ $code == 2 ]] && grep -q 'did you mean train?' message || fail "tvsgs trian: exit code $code, $(cat message)"
code=0
"$prefix/bin/tvsgs" train --iteratoins 3 2>message || code=$?
[[ $code == 2 ]] && grep -q -- '--iterations' message || fail "tvsgs train does not pass on arguments and exit code"
mv "$prefix/bin/tvsgs-eval" elsewhere
code=0
"$prefix/bin/tvsgs" eval 2>message || code=$?
[[ $code == 2 ]] && grep -q 'package tvsgs-eval' message || fail "a missing command: $(cat message)"

# Only tvsgs-eval links MATLAB files, and with them LDAP, Kerberos and TLS; tvsgs-prepare may link them through OpenCV.
for program in "$prefix"/bin/tvsgs*; do
    [[ $program != */tvsgs-prepare ]] || continue
    ! ldd "$program" | grep -E 'libmatio|libhdf5|libcurl|libldap|libkrb5' || fail "$program links them"
done

# The example program finds, links and uses the installed libraries.
cmake -S "$here/../../examples/program" -B program -DCMAKE_BUILD_TYPE=Debug -DCMAKE_CXX_COMPILER="$cxx" \
    -Dtvsgs_ROOT="$prefix" >"$work/log" || fail "find_package: $(cat log)"
grep -q "tvsgs_DIR:PATH=$prefix" program/CMakeCache.txt || fail "another tvsgs was found"
cmake --build program >"$work/log" || fail "the example program does not build: $(cat log)"
"$prefix/bin/tvsgs-synth" --out scene --views 2 --width 16 --height 16 --points 50 --quiet
program/train_darker scene splats.ply 20 || fail "the example program does not train"
"$prefix/bin/tvsgs-export" splats.ply splats.spz --quiet || fail "splats.ply is not readable"

# A C program and the Python package find the votes.
library=$(find "$prefix" -name libtvsgs_votes.so)
cat >votes.c <<'END'
#include <tvsgs_votes.h>
int main(void) {
    tvsgs_votes* votes;
    return tvsgs_votes_create("cpu", "k=5", &votes);
}
END
"$cxx" -x c votes.c "-I$prefix/include" "-L${library%/*}" "-Wl,-rpath,${library%/*}" -ltvsgs_votes -o votes ||
    fail "libtvsgs_votes cannot be linked"
./votes || fail "libtvsgs_votes does not run"
if command -v python3 >/dev/null; then
    PYTHONPATH=$prefix/share/tvsgs/python TVSGS_VOTES_LIBRARY=$library python3 -B -c 'import tvsgs; tvsgs.Votes()' ||
        fail "the Python package does not load"
fi
