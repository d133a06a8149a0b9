// Simplifies a mesh within an error bound in pixels of the views.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"

namespace tvsgs {

struct SimplifyOptions {
    float error = 0.5f;
    int faces = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        field("error", error, {0, 100},
              "error bound of simplification for 99.9 % of the surface, in pixels of the nearest "
              "view; 0: no simplification");
        field("faces", faces, {0, 2e9},
              "number of faces to simplify to, whatever the error; 0: no limit");
    }
};

/// Distances between a mesh and its simplification, in both directions, in pixels of the nearest
/// view (units of kUnseenPixels pixels where no view sees it).
struct SimplifyProof {
    double mean_px = 0, p999_px = 0, max_px = 0;
    // Measured points, of the points at vertices and four per face.
    std::size_t points = 0, all_points = 0;
};

struct SimplifyReport {
    std::size_t vertices_before = 0, faces_before = 0;
    std::size_t no_triangles = 0;  // faces with repeated or non-finite corners, and repeated faces
    int repeats = 0;  // attempts with a smaller tolerance because the error exceeded the bound
    SimplifyProof proof;
    bool holds = true;  // 99.9 % of the points are within the bound
};

/// Collapses edges until any more would move 1 in 1000 points of the surface by more than `error`
/// pixels, by exact distances in both directions; then down to `faces`, whatever the error.
/// [docs/method/simplify.md] The topology does not change, and vertices of non-manifold edges do
/// not move. Colours come from the nearest points of the original. Drops flawed and repeated faces,
/// and vertices without faces. Does nothing if both options are 0. `cameras`: at least one. Throws
/// Error(ExitCode::input) for an index out of range.
SimplifyReport simplify(TriangleMesh& mesh,
                        const std::vector<Camera>& cameras,
                        const SimplifyOptions& options);

/// Simplifies and logs the result in one line. Returns why nothing is left; empty if
/// something is left, or the mesh was empty before.
std::string simplify_and_log(TriangleMesh& mesh,
                             const std::vector<Camera>& cameras,
                             const SimplifyOptions& options);

}  // namespace tvsgs
