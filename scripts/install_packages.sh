#!/usr/bin/env bash
# Installs the missing Debian packages of the build; changes nothing if all are installed.
# Usage: scripts/install_packages.sh [PACKAGE...]     further packages to install as well
set -euo pipefail

packages=(
    cmake ninja-build g++ pkg-config
    libeigen3-dev nlohmann-json3-dev libcli11-dev libstb-dev libspdlog-dev libfmt-dev libnanoflann-dev libzip-dev zlib1g-dev libmatio-dev
    libwebp-dev  # WebP photographs and textures, SOG
    libzstd-dev  # SPZ version 4
    libjemalloc-dev  # for tvsgs-extract-mesh to take less time
    libcpp-httplib-dev  # for tvsgs-view to serve pages
    libgtest-dev libgmock-dev libbenchmark-dev
    "$@"
)

if ! command -v dpkg-query >/dev/null; then
    echo "install_packages: this is not a Debian system; install the counterparts of: ${packages[*]}" >&2
    exit 1
fi

missing=()
for package in "${packages[@]}"; do
    status=$(dpkg-query --show --showformat='${Status}' "$package" 2>/dev/null || true)
    [[ $status == "install ok installed" ]] || missing+=("$package")
done
if ((${#missing[@]} == 0)); then
    exit 0
fi

as_root=()
if ((EUID != 0)); then
    if ! command -v sudo >/dev/null; then
        echo "install_packages: missing: ${missing[*]}" >&2
        echo "install_packages: neither root nor sudo; as root: apt-get install ${missing[*]}" >&2
        exit 1
    fi
    as_root=(sudo)
fi
echo "install_packages: installing ${missing[*]}" >&2
export DEBIAN_FRONTEND=noninteractive
# Tries the present package lists first: an update needs the network and is often not needed.
"${as_root[@]}" apt-get install -y --no-install-recommends "${missing[@]}" >&2 || {
    "${as_root[@]}" apt-get update >&2
    "${as_root[@]}" apt-get install -y --no-install-recommends "${missing[@]}" >&2
}
