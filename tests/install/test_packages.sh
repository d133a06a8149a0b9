#!/usr/bin/env bash
# Checks the packages: size, dependencies, and that the tarball runs by itself. Skips without Debian's tools.
# Usage: test_packages.sh BUILD_DIR LARGEST_MB COMPRESSION
set -euo pipefail
build=$1 largest=$2 compression=$3
for tool in dpkg-deb dpkg-shlibdeps cpack; do
    command -v "$tool" >/dev/null || { echo "test_packages: skipped, there is no $tool" >&2; exit 77; }
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
fail() { echo "test_packages: $*" >&2; exit 1; }
(cd "$build" && cpack -G "DEB;TGZ" -D CPACK_DEBIAN_COMPRESSION_TYPE="$compression" -B "$work/packages") >"$work/log" 2>&1 || fail "$(tail -20 "$work/log")"
cd "$work/packages"

main=$(ls tvsgs_*.deb tvsgs-cuda_*.deb 2>/dev/null) || true
[[ $(wc -w <<<"$main") == 1 ]] || fail "no package of the commands among: $(ls)"
size=$(($(stat -c %s "$main") / 1000000))
echo "$main: $size MB"
((size < largest)) || fail "$main has $size MB, more than $largest"
depends=$(dpkg-deb --field "$main" Depends)
for library in libc6 libspdlog libzip4; do
    grep -q "$library" <<<"$depends" || fail "$main does not depend on $library: $depends"
done
! grep -E 'matio|hdf5|curl|opencv|gomp' <<<"$depends" || fail "$main depends on a library that its commands do not use: $depends"
dpkg-deb --contents "$main" >contents
for file in bin/tvsgs-train bin/tvsgs share/man/man1/tvsgs-train.1.gz share/bash-completion/completions/tvsgs-train \
    share/doc/tvsgs/copyright share/tvsgs/configs/auto.json share/tvsgs/python/pyproject.toml \
    'lib/.*libtvsgs_votes.so.1'; do
    grep -q " ./usr/$file\( \|$\)" contents || fail "$main lacks $file"
done
dpkg-deb --field "$(ls tvsgs-eval*.deb)" Depends | grep libmatio >/dev/null || fail "tvsgs-eval does not depend on libmatio"

# The tarball needs only the libraries of C and C++ from the system.
tar -xzf tvsgs-*.tar.gz
root=$(echo "$PWD"/tvsgs-*-linux-*/)
for program in "$root"bin/* "$root"lib/libtvsgs_votes.so.1; do
    outside=$(env -i /usr/bin/ldd "$program" | awk '$2 == "=>" {print $1, $3}' |
        grep -vE '^(lib(c|m|mvec|dl|rt|pthread|resolv|util|anl|stdc\+\+|gcc_s)\.so|ld-linux)' | grep -vE "/lib[^ ]*/tvsgs/" || true)
    [[ -z $outside ]] || fail "${program##*/} of the tarball takes from outside: $outside"
    [[ $program == *.so.1 ]] || env -i "$program" --version >/dev/null || fail "${program##*/} of the tarball does not run"
done
[[ -e $root/share/doc/tvsgs/licences/zlib1g ]] || fail "the tarball has no licences of its libraries"
