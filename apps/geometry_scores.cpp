#include "geometry_scores.h"

#include <cmath>

#include "core/error.h"
#include "core/log.h"
#include "io/ply.h"

namespace tvsgs {

std::vector<Vec3f> read_points(const std::string& path,
                               const PointsOptions& options,
                               const Crop& crop) {
    PlyContents ply = read_ply(path, options.origin);
    const char* kind = ply.is_splats       ? "splat centres"
                       : ply.faces.empty() ? "points"
                                           : "samples of the mesh";
    std::vector<Vec3f> points;
    if (ply.faces.empty()) {
        points = std::move(ply.points.positions);
    } else {
        const TriangleMesh mesh{std::move(ply.points.positions), {}, std::move(ply.faces)};
        points = with_context("reading " + path, [&] {
            return sample_surface(mesh, static_cast<std::size_t>(options.samples), options.seed);
        });
    }
    const std::size_t before = points.size();
    Vec3d lower{INFINITY, INFINITY, INFINITY}, upper = -lower;
    std::erase_if(points, [&](Vec3f local) {
        if (!is_finite(local)) return true;
        const Vec3d p = vec_cast<double>(local) + options.origin;
        for (int axis = 0; axis < 3; ++axis) {
            lower[axis] = std::min(lower[axis], p[axis]);
            upper[axis] = std::max(upper[axis], p[axis]);
        }
        return !contains(crop, p);
    });
    spdlog::info("{}: {} {}, {} of them used", path, before, kind, points.size());
    if (points.empty())
        throw Error(ExitCode::input,
                    before == 0 ? str(path, ": holds no points; nothing to compare")
                    : !(lower.x <= upper.x)
                        ? str(path, ": none of its ", before, " ", kind, " is finite")
                        : str(path, ": none of its ", before, " ", kind, " is inside of ",
                              options.crop_path, "; they span (", lower.x, ", ", lower.y, ", ",
                              lower.z, ") to (", upper.x, ", ", upper.y, ", ", upper.z,
                              "); are frame and units those of the crop?"));
    return points;
}

std::string json_list(const std::vector<JsonLine>& items) {
    std::string text;
    for (const JsonLine& item : items) text += (text.empty() ? "" : ", ") + item.text();
    return "[" + text + "]";
}

JsonLine geometry_json(const GeometryMetrics& m) {
    JsonLine json;
    json.add("accuracy", m.accuracy).add("completeness", m.completeness).add("chamfer", m.chamfer);
    json.add("median_accuracy", m.median_accuracy)
        .add("median_completeness", m.median_completeness);
    std::vector<JsonLine> thresholds;
    for (const auto& t : m.thresholds)
        thresholds.push_back(JsonLine()
                                 .add("tau", t.tau)
                                 .add("precision", t.precision)
                                 .add("recall", t.recall)
                                 .add("f1", t.f1));
    return json.add_json("thresholds", json_list(thresholds));
}

}  // namespace tvsgs
