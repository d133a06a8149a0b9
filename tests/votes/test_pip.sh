#!/usr/bin/env bash
# `pip install ./python` in a bare virtual environment, without a network. Skips without venv and pip.
# Usage: test_pip.sh PYTHON, with TVSGS_VOTES_LIBRARY set
set -euo pipefail
source_python=$(cd "$(dirname "$0")/../../python" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "test_pip: $*" >&2; exit 1; }
"$1" -m venv --without-pip "$work/venv" >"$work/log" 2>&1 && "$1" -m pip --python "$work/venv" --version >"$work/log" 2>&1 ||
    { echo "test_pip: skipped: $1 has no venv, or no pip of version 22.3 or later" >&2; exit 77; }
pip=("$1" -m pip --python "$work/venv")
cd "$work"
export PIP_NO_INDEX=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PYTHONDONTWRITEBYTECODE=1
cp -r "$source_python" python && chmod -R a-w python  # an installed copy cannot be written
"${pip[@]}" install ./python >log 2>&1 || fail "$(cat log)"
chmod -R u+w python
venv/bin/python - <<'END' || fail "the package does not work"
import tvsgs
assert 'site-packages' in tvsgs.__file__
found = tvsgs.Votes(k=5)._library.tvsgs_votes_version().decode()
assert found == 'tvsgs ' + tvsgs.__version__, found
END
TVSGS_VOTES_LIBRARY=$work/none venv/bin/python -c 'import tvsgs; tvsgs.Votes()' 2>log && fail "a missing library is found"
grep -q '^OSError: .*none.*correct TVSGS_VOTES_LIBRARY$' log || fail "$(cat log)"
"${pip[@]}" uninstall -y tvsgs >log 2>&1 || fail "$(cat log)"
! venv/bin/python -c 'import tvsgs' 2>log || fail "pip leaves files"
