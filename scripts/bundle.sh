#!/usr/bin/env bash
# Collects the tools with the shared libraries they need into a folder that runs on any x86-64 Linux
# whose C library is at least as new: OUT/{bin,lib,configs,LICENSE,README.md}.
# Usage: scripts/bundle.sh [--with-tests] [--tar] [BUILD_DIR [OUT]]     default: build/cpu build/bundle
#   --with-tests   adds the test programs and their data (to try a CUDA build on a machine with a GPU:
#                  TVSGS_TEST_DATA=OUT/tests/data OUT/bin/test_voting; tests of commands need the sources)
#   --tar          writes OUT.tar.gz as well
# BUILD_DIR must have been configured; it is re-linked so that its programs look into ../lib first.
set -euo pipefail
cd "$(dirname "$0")/.."

with_tests=false
tar=false
places=()
for argument in "$@"; do
    case $argument in
        --with-tests) with_tests=true ;;
        --tar) tar=true ;;
        -*) echo "bundle: unknown option $argument" >&2; exit 2 ;;
        *) places+=("$argument") ;;
    esac
done
build=${places[0]:-build/cpu}
out=${places[1]:-build/bundle}
if [[ ! -f $build/CMakeCache.txt ]]; then
    echo "bundle: $build is not a configured build folder; for example: cmake --preset cpu" >&2
    exit 2
fi
if [[ -e $out && ! -d $out/bin ]]; then
    echo "bundle: $out exists and is not a bundle" >&2
    exit 2
fi

# The old kind of run path (DT_RPATH) holds for the libraries of the libraries too. OpenCV's videos and pictures, for
# tvsgs-prepare alone, would bring 240 MB along.
cmake "$build" -DTVSGS_PREPARE_OPENCV=OFF '-DCMAKE_BUILD_RPATH=$ORIGIN/../lib' -DCMAKE_EXE_LINKER_FLAGS=-Wl,--disable-new-dtags >/dev/null
cmake --build "$build" --parallel "$(nproc)"

rm -rf "$out"
mkdir -p "$out/bin" "$out/lib"
cp "$build"/bin/tvsgs-* "$out/bin/"
if $with_tests; then
    compgen -G "$build/bin/test_*" >/dev/null || { echo "bundle: $build was configured without tests" >&2; exit 2; }
    cp "$build"/bin/test_* "$out/bin/"
    mkdir -p "$out/tests"
    cp -r tests/data "$out/tests/"
fi
cp -r configs LICENSE README.md "$out/"

# The C library must be the machine's own, and the driver's library belongs to its kernel.
is_system() {
    case $1 in
        linux-vdso.so.* | ld-linux*.so.* | */ld-linux*.so.*) return 0 ;;
        libc.so.* | libm.so.* | libmvec.so.* | libdl.so.* | librt.so.* | libpthread.so.*) return 0 ;;
        libresolv.so.* | libutil.so.* | libanl.so.* | libcuda.so.*) return 0 ;;
    esac
    return 1
}

# ldd lists the libraries of the libraries as well.
for program in "$out"/bin/*; do
    while read -r name arrow path _; do
        if is_system "$name" || [[ $arrow != "=>" ]]; then continue; fi
        if [[ $path == not ]]; then
            echo "bundle: $program needs $name, which is not installed here" >&2
            exit 1
        fi
        [[ -e $out/lib/$name ]] || cp -L "$path" "$out/lib/$name"
    done < <(ldd "$program")
done
chmod u+w "$out"/lib/*
strip --strip-unneeded "$out"/bin/* "$out"/lib/*

# Nothing but the C library may come from outside, and the tools must start without an environment.
root=$(cd "$out" && pwd)
for program in "$root"/bin/*; do
    while read -r name arrow path _; do
        if is_system "$name" || [[ $arrow != "=>" ]]; then continue; fi
        if [[ $path != "$root"/* ]]; then
            echo "bundle: $program takes $name from $path" >&2
            exit 1
        fi
    done < <(env -i ldd "$program" | sed "s#$root/bin/\.\./#$root/#")
done
for program in "$root"/bin/tvsgs-*; do
    env -i "$program" --help >/dev/null
done

if $tar; then
    tar -C "$(dirname "$root")" -czf "$root.tar.gz" "$(basename "$root")"
    du -h "$root.tar.gz" >&2
fi
du -sh "$root" >&2
