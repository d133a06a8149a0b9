# tvsgs on Debian 12 for the CPU:
#   docker build -t tvsgs .
#   docker run --rm -u "$(id -u):$(id -g)" -v "$PWD:/data" tvsgs train --scene SCENE --out runs/mine
FROM debian:12 AS build
WORKDIR /tvsgs
COPY scripts/install_packages.sh scripts/
RUN scripts/install_packages.sh dpkg-dev file && rm -rf /var/lib/apt/lists/*
COPY . .
RUN cmake --preset package-cpu && cmake --build --preset package-cpu \
    && cd build/package-cpu && cpack -G DEB

FROM debian:12-slim
# tvsgs-prepare brings COLMAP: --build-arg PACKAGES="tvsgs tvsgs-eval" leaves it out.
ARG PACKAGES="tvsgs tvsgs-eval tvsgs-prepare"
COPY --from=build /tvsgs/build/package-cpu/packages /packages
RUN for package in $PACKAGES; do set -- "$@" "/packages/${package}_"*.deb; done \
    && apt-get update && apt-get install -y --no-install-recommends "$@" \
    && rm -rf /var/lib/apt/lists/* /packages \
    && useradd --create-home tvsgs
USER tvsgs
WORKDIR /data
ENTRYPOINT ["tvsgs"]
CMD ["help"]
