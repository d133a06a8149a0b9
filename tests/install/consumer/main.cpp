// A program of others: links the installed libraries and counts the points of a file.
#include <cstdio>

#include "io/config/built_in_configs.h"
#include "io/splats/ply.h"

int main(int argc, char** argv) {
    if (argc != 2) return 2;
    const auto points = tvsgs::read_ply_geometry(argv[1]).positions.size();
    std::printf("%zu points; the built-in configuration begins with %c\n", points,
                *tvsgs::built_in_config(tvsgs::kAutoConfig));
    return points > 0 ? 0 : 1;
}
