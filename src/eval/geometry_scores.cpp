#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "eval/mesh_metrics.h"
#include "io/files/read_file.h"
#include "io/mesh/mesh_files.h"

namespace tvsgs {

namespace {

std::string box_text(const std::vector<Vec3f>& points, Vec3d origin) {
    const Points finite = all_points(points).points;
    if (finite.empty()) return {};
    const PointBounds box = bounds_of(finite);
    return str(point_text(box.lower + origin), " to ", point_text(box.upper + origin));
}

/// Throws an error with the reason why no point is left to measure from.
[[noreturn]] void refuse_empty(const std::string& kind,
                               const std::vector<Vec3f>& points,
                               const MeasureOptions& options) {
    const std::string box = box_text(points, options.origin);
    if (points.empty()) throw Error(ExitCode::input, "no points; nothing to compare");
    if (box.empty())
        throw input_error("none of its ", grouped(points.size()), " ", kind, " is finite");
    if (options.crop_path.empty())
        throw input_error("its ", kind, " have no area; they span ", box);
    throw input_error("none of its ", kind, " is inside ", options.crop_path, "; they span ", box,
                      "; has the crop the same frame and units?");
}

std::vector<Vec3f> inside_of(const Crop& crop, const std::vector<Vec3f>& points, Vec3d origin) {
    std::vector<Vec3f> inside;
    for (const Vec3f p : points)
        if (is_finite(p) && contains(crop, vec_cast<double>(p) + origin)) inside.push_back(p);
    return inside;
}

}  // namespace

MeasureOptions of_truth(MeasureOptions options) {
    if (options.point_samples == 0) options.seed += 0x9E3779B97F4A7C15ull;
    options.truth = true;
    return options;
}

MeasuredSurface measured_mesh(const TriangleMesh& mesh,
                              const MeasureOptions& options,
                              const Crop& crop) {
    if (options.point_samples > 0) {
        const std::vector<Vec3f> samples = inside_of(
            crop,
            sample_surface(mesh, static_cast<std::size_t>(options.point_samples), options.seed),
            options.origin);
        if (samples.empty()) refuse_empty("samples", mesh.vertices, options);
        return {all_points(samples), Surface(samples)};
    }
    MeasuredSurface result{{}, Surface(mesh)};
    result.from =
        sample_by_lines(result.to.triangles(), crop, options.origin, kStandardError, options.seed);
    if (result.from.points.empty()) refuse_empty("faces", mesh.vertices, options);
    if (const double error = worst_standard_error(result.from); error > kStandardError)
        spdlog::warn(
            "Little of the surface is inside the crop: {} samples, so the shares have standard "
            "errors up to {:.2g} (aim {:g})",
            grouped(result.from.points.size()), error, kStandardError);
    return result;
}

MeasuredSurface measured_points(const std::vector<Vec3f>& points,
                                const MeasureOptions& options,
                                const Crop& crop) {
    const std::vector<Vec3f> inside = inside_of(crop, points, options.origin);
    if (inside.empty()) refuse_empty("points", points, options);
    // Compare with the same samples as measured from: cropped.
    return {all_points(inside), Surface(options.point_samples > 0 ? inside : points)};
}

MeasuredSurface read_measured(const std::string& path,
                              const MeasureOptions& options,
                              const Crop& crop) {
    PlyContents ply = read_mesh(path, options.origin, false);
    const bool is_mesh = !ply.faces.empty();
    const std::vector<Vec3f>& read = ply.points.positions;
    const auto dropped = static_cast<std::size_t>(
        std::ranges::count_if(read, [](Vec3f p) { return !is_finite(p); }));
    MeasuredSurface result;
    try {
        result = is_mesh
                     ? measured_mesh({std::move(ply.points.positions), {}, std::move(ply.faces)},
                                     options, crop)
                     : measured_points(ply.points.positions, options, crop);
    } catch (const Error& error) {
        throw Error(error.code(), str(path, ": ", error.what()));
    }
    result.dropped = dropped;
    if (dropped > 0)
        spdlog::warn("{}: dropped {} {} that are not finite{}", path, grouped(dropped),
                     is_mesh ? "vertices" : "points", is_mesh ? ", and their faces" : "");
    const std::size_t left_out = is_mesh ? 0 : read.size() - dropped - result.from.points.size();
    if (options.truth && ply.is_splats)
        spdlog::warn("{}: splats as the truth; were --pred and --gt swapped?", path);
    spdlog::info("{}: {} {}{}{}", path, grouped(result.from.points.size()),
                 is_mesh         ? "samples of the mesh"
                 : ply.is_splats ? "splat centres"
                                 : "points",
                 result.to.triangles().empty()
                     ? ""
                     : str(" of ", grouped(result.to.triangles().size()), " triangles"),
                 left_out > 0 ? str(" inside the crop, ", grouped(left_out), " outside") : "");
    return result;
}

JsonValue geometry_json(const GeometryMetrics& m) {
    JsonValue json;
    json.add("accuracy", m.accuracy).add("completeness", m.completeness).add("chamfer", m.chamfer);
    json.add("median_accuracy", m.median_accuracy)
        .add("median_completeness", m.median_completeness);
    const auto add_error = [](JsonValue& line, const char* key, double error) {
        if (error > 0) line.add(key, error);
    };
    add_error(json, "accuracy_se", m.accuracy_se);
    add_error(json, "completeness_se", m.completeness_se);
    std::vector<JsonValue> thresholds;
    for (const auto& t : m.thresholds) {
        JsonValue line;
        line.add("tau", t.tau)
            .add("precision", t.precision)
            .add("recall", t.recall)
            .add("f1", t.f1);
        add_error(line, "precision_se", t.precision_se);
        add_error(line, "recall_se", t.recall_se);
        add_error(line, "f1_se", t.f1_se);
        thresholds.push_back(line);
    }
    return json.add("thresholds", thresholds);
}

JsonValue counts_json(const MeasuredSurface& prediction,
                      const MeasuredSurface& truth,
                      const SamplePoints* visible) {
    JsonValue json;
    json.add("pred", prediction.from.points.size()).add("gt", truth.from.points.size());
    if (visible) json.add("visible_gt", visible->points.size());
    return json;
}

}  // namespace tvsgs
