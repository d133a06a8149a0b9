#include "mesh/simplify/simplify.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/scene/view_frustum.h"
#include "mesh/mend/mend.h"
#include "mesh/mend/triangle_tree.h"
#include "mesh/simplify/simplify_steps.h"

namespace tvsgs {
namespace {

constexpr std::size_t kGroup = 1 << 14;  // faces of a group; its data fit into a cache
// With it the measured error is usually within the bound at once.
constexpr double kLargestCost = 0.4;
constexpr int kMaxRepeats = 4;
// Factor of the next tolerance, below the ratio of bound and error.
constexpr double kTighter = 0.9;

/// The centre of the bounding box.
Vec3d middle_of(const std::vector<Vec3f>& middles) {
    Box3f box;
    for (const Vec3f& p : middles) box.add(p);
    return 0.5 * (vec_cast<double>(box.low) + vec_cast<double>(box.high));
}

/// Centroids of faces. position(v): of a vertex.
template <class Position>
std::vector<Vec3f> face_middles(const std::vector<Vec3i>& faces, const Position& position) {
    std::vector<Vec3f> middles(faces.size());
    parallel_for(Cpu{}, static_cast<int>(middles.size()), [&](int f) {
        Vec3f sum;
        for (int k = 0; k < 3; ++k) sum += 1.0f / 3 * position(std::size_t(faces[f][k]));
        middles[f] = sum;
    });
    return middles;
}

/// Positions and faces, without unused vertices.
TriangleMesh compact(const CollapsibleMesh& from, Vec3d origin) {
    TriangleMesh out{std::vector<Vec3f>(from.positions.size()), {}, from.faces};
    parallel_for(Cpu{}, static_cast<int>(out.vertices.size()),
                 [&](int v) { out.vertices[v] = vec_cast<float>(from.positions[v] + origin); });
    filter_faces(out, std::vector<char>(out.faces.size(), 1));
    return out;
}

/// A mesh and the data that all attempts share.
struct Original {
    const TriangleMesh& mesh;
    const std::vector<Camera>& cameras;
    const SurfaceEdges edges;
    std::vector<Vec3f> middles =
        face_middles(mesh.faces, [this](std::size_t v) { return mesh.vertices[v]; });
    Vec3d origin = middle_of(middles);
    SpatialOrder order = spatial_order(middles);
    std::vector<std::vector<int>> groups = runs_of(order.places, kGroup, kGroup);
    std::vector<float> least_lengths = least_pixel_lengths(mesh.vertices, cameras);
    SurfacePlaces places = places_on(mesh);
    TriangleTree tree = TriangleTree(mesh, order);
};

/// Increases tolerances where no view sees the surface.
void increase_tolerances(CollapsibleMesh& mesh, const Original& original, double tolerance_px) {
    std::vector<Vec3f> points(mesh.positions.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()),
                 [&](int v) { points[v] = vec_cast<float>(mesh.positions[v] + original.origin); });
    std::vector<float> lengths = pixel_lengths({points, {}, mesh.faces}, points, original.cameras);
    // A coarse face near a depth edge may hide more than the fine faces did, so vertices within two
    // edges of a visible one count as visible.
    for (int round = 0; round < 2; ++round) {
        const std::vector<float> before = lengths;
        for (const Vec3i& face : mesh.faces) {
            const float least = std::min({before[face.x], before[face.y], before[face.z]});
            for (int k = 0; k < 3; ++k) {
                float& length = lengths[face[k]];
                length = std::min(length, least);
            }
        }
    }
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int v) {
        const double tolerance = tolerance_px * double(lengths[v]);
        if (!(tolerance > mesh.tolerances[v])) return;
        const double ratio = mesh.tolerances[v] / tolerance;
        mesh.surface[v].count_in(1 / ratio);
        if (mesh.boundary[v] >= 0) mesh.boundaries[mesh.boundary[v]].count_in(1 / ratio);
        mesh.tolerances[v] = tolerance;
    });
}

/// Collapses edges in three steps: with tolerances that ignore occlusion, so that later depth maps
/// show a small mesh; with tolerances of the visible surface; and along the remaining seams.
CollapsibleMesh collapsed(const Original& original, double tolerance_px, double largest_cost) {
    std::vector<double> tolerances(original.least_lengths.size());
    parallel_for(Cpu{}, static_cast<int>(tolerances.size()),
                 [&](int v) { tolerances[v] = tolerance_px * double(original.least_lengths[v]); });
    CollapsibleMesh left = collapse_in_groups(original.mesh, original.origin, tolerances,
                                              original.edges, original.groups, largest_cost);
    increase_tolerances(left, original, tolerance_px);
    const std::vector<Vec3f> middles =
        face_middles(left.faces, [&](std::size_t v) { return vec_cast<float>(left.positions[v]); });
    std::vector<char> seams;
    // Different groups, with seams in other places.
    left = collapse_in_groups(left, runs_of(spatial_order(middles).places, kGroup, kGroup / 2),
                              largest_cost, seams);
    collapse_edges(left, largest_cost, 0, seams);
    return left;
}

SimplifyProof measured(const Original& original, const TriangleMesh& found) {
    const SurfacePlaces places = places_on(found);
    const std::vector<Vec3f>& others = original.places.points;
    std::vector<Vec3f> points = others;
    points.insert(points.end(), places.points.begin(), places.points.end());
    const std::vector<float> lengths = pixel_lengths(found, points, original.cameras);
    const auto cut = lengths.begin() + others.size();
    return measure({original.places, original.tree, {lengths.begin(), cut}},
                   {places, TriangleTree(found), {cut, lengths.end()}});
}

}  // namespace

SimplifyReport simplify(TriangleMesh& mesh,
                        const std::vector<Camera>& cameras,
                        const SimplifyOptions& options) {
    SimplifyReport report;
    report.vertices_before = mesh.vertices.size(), report.faces_before = mesh.faces.size();
    if (!(options.error > 0) && options.faces == 0) return report;
    drop_flawed_faces(mesh);
    const Corners corners = drop_repeated_faces(mesh);
    report.no_triangles = report.faces_before - mesh.faces.size();
    if (mesh.faces.empty()) {
        mesh = {};
        return report;
    }
    const Original original{mesh, cameras, find_edges(mesh, corners)};
    const bool bounded = options.error > 0;
    const double bound_px = bounded ? double(options.error) : 1.0;
    const double largest_cost = bounded ? kLargestCost : -1;  // no cost is below 0
    for (double tolerance_px = bound_px;; ++report.repeats) {
        CollapsibleMesh left = collapsed(original, tolerance_px, largest_cost);
        // A rejected collapse may be possible after its surroundings have changed.
        const auto most = static_cast<std::size_t>(options.faces);
        for (std::size_t before = 0;
             most > 0 && left.faces.size() > most && left.faces.size() != before;) {
            before = left.faces.size();
            collapse_edges(left, std::numeric_limits<double>::infinity(), most);
        }
        TriangleMesh found = compact(left, original.origin);
        report.proof = measured(original, found);
        report.holds = report.proof.p999_px <= bound_px;
        if (!report.holds && std::isfinite(report.proof.p999_px) && options.faces == 0 &&
            report.repeats < kMaxRepeats) {
            tolerance_px *= kTighter * bound_px / report.proof.p999_px;
            continue;
        }
        if (!mesh.colors.empty()) carry_colors(mesh, original.tree, found);
        mesh = std::move(found);
        return report;
    }
}

std::string simplify_and_log(TriangleMesh& mesh,
                             const std::vector<Camera>& cameras,
                             const SimplifyOptions& options) {
    const SimplifyReport r = simplify(mesh, cameras, options);
    if (r.proof.points == 0)
        return r.no_triangles > 0 ? str("all of its ", r.faces_before, " faces are degenerate")
                                  : std::string();
    std::string notes;
    if (r.proof.points < r.proof.all_points)
        notes += str("; measured ", grouped(r.proof.points), " of ", grouped(r.proof.all_points),
                     " points");
    if (r.repeats > 0) notes += str("; attempt ", r.repeats + 1);
    if (!r.holds && options.faces == 0) notes += str("; above the bound of ", options.error, " px");
    if (r.no_triangles > 0) notes += str("; dropped ", r.no_triangles, " degenerate faces");
    if (options.faces > 0 && mesh.faces.size() > static_cast<std::size_t>(options.faces))
        notes += "; fewer faces would tear or fold it";
    spdlog::debug(
        "Simplified {} faces to {} (error: mean {:.2f} px, 99.9 % below {:.2f} px, max {:.2f} "
        "px){}",
        grouped(r.faces_before), grouped(mesh.faces.size()), r.proof.mean_px, r.proof.p999_px,
        r.proof.max_px, notes);
    return {};
}

}  // namespace tvsgs
