// Fewer triangles for the same surface, to a bound in pixels of the views.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/log.h"
#include "core/scene/camera.h"
#include "core/scene/mesh.h"

namespace tvsgs {

struct SimplifyOptions {
    float error = 0.5f;
    int faces = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        field(
            "error", error, {0, 100},
            "pixels of the nearest view by which simplification may move 99.9 % of the surface; 0: "
            "nothing is simplified");
        field("faces", faces, {0, 2e9},
              "the mesh is simplified down to that many, whatever the error; 0: not");
    }
};

/// Distances between a mesh and what it was simplified to, in both directions, in pixels of the
/// nearest view (kUnseenPixels of them where none sees it).
struct SimplifyProof {
    double mean_px = 0, p999_px = 0, max_px = 0;
    std::size_t points = 0, all_points = 0;  // measured; of those at vertices and four per face
};

struct SimplifyReport {
    std::size_t vertices_before = 0, faces_before = 0;
    std::size_t no_triangles = 0;  // corners that repeat or are not finite, or the same face again
    int repeats = 0;               // with a smaller tolerance, as the proof had not held
    SimplifyProof proof;
    bool holds = true;  // 99.9 % are within the bound
};

/// Collapses edges until any more would move 1 in 1000 places of the surface by more than `error`
/// pixels, by exact distances in both directions; then down to `faces`, whatever the error.
/// [docs/method/simplify.md] Topology stays as it is, and what belongs to an edge of more than two
/// faces stays where it is. Colours are those of the nearest places of the original. Faces without
/// three different finite corners, faces that are there before, and vertices without faces are
/// dropped. Does nothing where both options are 0. The same bits for any number of threads.
/// `cameras`: one at least. Throws Error(ExitCode::input) for an index out of range.
SimplifyReport simplify(TriangleMesh& mesh,
                        const std::vector<Camera>& cameras,
                        const SimplifyOptions& options);

/// Does that and says in a line at `level` what became of it. Returns why nothing is left; empty if
/// something is, or there was nothing before.
std::string simplify_and_say(TriangleMesh& mesh,
                             const std::vector<Camera>& cameras,
                             const SimplifyOptions& options,
                             spdlog::level::level_enum level);

}  // namespace tvsgs
