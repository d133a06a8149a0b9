#include "mesh/simplify.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/error.h"
#include "mesh/simplify_pieces.h"
#include "mesh/simplify_proof.h"
#include "mesh/simplify_tolerance.h"

namespace tvsgs {
namespace {

constexpr std::size_t kGroup = 1 << 16;  // faces of a group; what it needs fits into a cache
constexpr double kLargestCost = 0.4;     // with it the proof holds at once, as a rule
constexpr int kMostRepeats = 4;
constexpr double kTighter = 0.9;  // than the proof asks for, when all is done again

/// The middle of the box around the vertices that faces have.
Vec3d middle_of(const TriangleMesh& mesh) {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    Vec3d low{kFar, kFar, kFar}, high = -low;
    for (const Vec3i& face : mesh.faces)
        for (int k = 0; k < 3; ++k) {
            const Vec3d p = vec_cast<double>(mesh.vertices[std::size_t(face[k])]);
            for (int axis = 0; axis < 3; ++axis) {
                low[axis] = std::min(low[axis], p[axis]);
                high[axis] = std::max(high[axis], p[axis]);
            }
        }
    return 0.5 * (low + high);
}

/// Positions and faces of what is used, and the length of a pixel at its vertices.
TriangleMesh compact(const CollapsibleMesh& from,
                     Vec3d origin,
                     double tolerance_px,
                     std::vector<float>& pixel_lengths) {
    TriangleMesh out;
    std::vector<int> place(from.positions.size(), -1);
    for (const Vec3i& face : from.faces)
        for (int k = 0; k < 3; ++k) place[std::size_t(face[k])] = 0;
    for (std::size_t v = 0; v < place.size(); ++v) {
        if (place[v] < 0) continue;
        place[v] = static_cast<int>(out.vertices.size());
        out.vertices.push_back(vec_cast<float>(from.positions[v] + origin));
        pixel_lengths.push_back(static_cast<float>(from.tolerances[v] / tolerance_px));
    }
    for (const Vec3i& face : from.faces)
        out.faces.push_back(
            {place[std::size_t(face.x)], place[std::size_t(face.y)], place[std::size_t(face.z)]});
    return out;
}

}  // namespace

SimplifyReport simplify(TriangleMesh& mesh,
                        const std::vector<Camera>& cameras,
                        const SimplifyOptions& options) {
    SimplifyReport report;
    report.vertices_before = mesh.vertices.size(), report.faces_before = mesh.faces.size();
    if (!(options.error > 0) && options.faces == 0) return report;
    report.no_triangles = drop_what_is_no_triangle(mesh);
    if (mesh.faces.empty()) {
        mesh = {};
        return report;
    }
    std::vector<float> lengths = pixel_lengths(mesh, cameras);
    for (float& length : lengths) length = std::clamp(length, 1e-30f, 1e30f);
    const SurfaceEdges edges = find_edges(mesh);
    const std::vector<std::vector<int>> groups = group_faces(mesh, kGroup);
    const Vec3d origin = middle_of(mesh);
    const MeasuredMesh original{mesh, TriangleTree(mesh), lengths};
    const bool bounded = options.error > 0;
    const double bound_px = bounded ? double(options.error) : 1.0;
    const double largest_cost = bounded ? kLargestCost : -1;  // none is below 0
    for (double tolerance_px = bound_px;; ++report.repeats) {
        std::vector<double> tolerances;
        for (const float length : lengths) tolerances.push_back(tolerance_px * double(length));
        CollapsibleMesh left =
            collapse_in_groups(mesh, origin, tolerances, edges, groups, largest_cost);
        collapse_edges(left, largest_cost, 0);
        // What was refused may be possible once its surroundings have changed.
        const auto most = static_cast<std::size_t>(options.faces);
        for (std::size_t before = 0;
             most > 0 && left.faces.size() > most && left.faces.size() != before;) {
            before = left.faces.size();
            collapse_edges(left, std::numeric_limits<double>::infinity(), most);
        }
        std::vector<float> lengths_left;
        TriangleMesh found = compact(left, origin, tolerance_px, lengths_left);
        report.proof = measure(original, {found, TriangleTree(found), lengths_left});
        report.holds = report.proof.p999_px <= bound_px;
        if (!report.holds && std::isfinite(report.proof.p999_px) && options.faces == 0 &&
            report.repeats < kMostRepeats) {
            tolerance_px *= kTighter * bound_px / report.proof.p999_px;
            continue;
        }
        if (!mesh.colors.empty()) carry_colors(mesh, original.tree, found);
        mesh = std::move(found);
        return report;
    }
}

std::string simplify_and_say(TriangleMesh& mesh,
                             const std::vector<Camera>& cameras,
                             const SimplifyOptions& options,
                             spdlog::level::level_enum level) {
    const SimplifyReport r = simplify(mesh, cameras, options);
    if (r.proof.points == 0)
        return r.no_triangles > 0
                   ? str("none of its ", r.faces_before, " faces has three corners apart")
                   : std::string();
    std::string notes;
    if (r.proof.points < r.proof.all_points)
        notes += str(" (", r.proof.points, " of ", r.proof.all_points, " places measured)");
    if (r.repeats > 0) notes += str(", at attempt ", r.repeats + 1);
    if (!r.holds && options.faces == 0) notes += str(", which is not within ", options.error);
    if (r.no_triangles > 0) notes += str("; ", r.no_triangles, " faces were no triangles");
    if (options.faces > 0 && mesh.faces.size() > static_cast<std::size_t>(options.faces))
        notes += "; fewer would tear it or turn faces over";
    spdlog::log(level,
                "simplified: {} faces of {}, {} vertices of {}; off by {:.2f} pixels in the mean, "
                "{:.2f} at 99.9 %, {:.2f} at most{}",
                mesh.faces.size(), r.faces_before, mesh.vertices.size(), r.vertices_before,
                r.proof.mean_px, r.proof.p999_px, r.proof.max_px, notes);
    return {};
}

}  // namespace tvsgs
