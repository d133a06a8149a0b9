// A program of others: links the installed libraries and counts the points of a file.
#include <cstdio>

#include "io/ply.h"
#include "pipeline/built_in_configs.h"

int main(int argc, char** argv) {
    if (argc != 2) return 2;
    const auto points = tvsgs::read_ply_geometry(argv[1]).positions.size();
    std::printf("%zu points; the built-in configuration begins with %c\n", points,
                *tvsgs::kAutoConfig);
    return points > 0 ? 0 : 1;
}
