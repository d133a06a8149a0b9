#include "pipeline/mesh_extraction.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "core/error.h"
#include "core/log.h"
#include "core/parse_numbers.h"

namespace tvsgs {
namespace {

constexpr int kMeshResolution = 2048;       // twice that of 2DGS and FatesGS
constexpr double kShareOfFreeMemory = 0.8;  // the rest is for images and the mesh itself

void parse_box(const std::string& text, Vec3d origin, DepthRules& rules) {
    double numbers[6];
    const char* at = text.data();
    const char* const end = at + text.size();
    bool good = true;
    for (int i = 0; i < 6 && good; ++i) {
        const auto [rest, code] = std::from_chars(at, end, numbers[i]);
        good = code == std::errc{} && std::isfinite(numbers[i]) &&
               (i < 5 ? rest != end && *rest == ',' : rest == end);
        at = rest + 1;
    }
    if (!good || !(numbers[0] < numbers[3] && numbers[1] < numbers[4] && numbers[2] < numbers[5]))
        throw Error(
            ExitCode::usage,
            str("--bbox ", text, ": expected x0,y0,z0,x1,y1,z1 with x0 < x1, y0 < y1, z0 < z1"));
    rules.has_box = true;
    rules.box_min = vec_cast<float>(Vec3d{numbers[0], numbers[1], numbers[2]} - origin);
    rules.box_max = vec_cast<float>(Vec3d{numbers[3], numbers[4], numbers[5]} - origin);
}

/// Voxels along the depth limit, but none smaller than a pixel at half that depth, where the object
/// is: such voxels average nothing and hold only noise.
int automatic_resolution(const std::vector<View>& views) {
    float focal_px = kMeshResolution / 2.0f;
    for (const View& view : views) focal_px = std::min(focal_px, view.camera.fx_px);
    return std::max(8, static_cast<int>(2 * focal_px));
}

/// "any" where an unbounded scene has no limit.
std::string limit_text(const DepthRules& rules) {
    return rules.depth_max < std::numeric_limits<float>::max()
               ? fmt::format("{:.4g}", rules.depth_max)
               : "any";
}

}  // namespace

DepthRules depth_rules(const MeshOptions& options, Vec3d origin) {
    DepthRules rules;
    rules.depth_max = options.depth_max, rules.alpha_min = options.alpha_min;
    rules.depth_step = options.depth_step, rules.weighting = options.weight;
    if (options.min_weight > 1 && options.weight != DepthWeighting::unit)
        throw Error(ExitCode::usage,
                    str("mesh.min_weight=", options.min_weight,
                        " counts views, which --weight does not: give --weight unit, or "
                        "--min-weight 1"));
    if (options.max_angle < 90)
        rules.min_cosine = std::cos(options.max_angle * static_cast<float>(M_PI / 180));
    if (!options.box.empty()) parse_box(options.box, origin, rules);
    return rules;
}

void check_mesh_options(const MeshOptions& options) {
    depth_rules(options);
    if (!options.memory.empty()) parse_bytes("--memory", options.memory);
}

namespace detail {

double median_depth(std::vector<float> depths) {
    std::erase_if(depths, [](float d) { return !(d > 0 && std::isfinite(d)); });
    if (depths.empty()) return 0;
    const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
    std::nth_element(depths.begin(), middle, depths.end());
    return static_cast<double>(*middle);
}

std::vector<Camera> cameras_of(const std::vector<View>& views) {
    std::vector<Camera> cameras;
    for (const View& view : views) cameras.push_back(view.camera);
    return cameras;
}

TsdfOptions volume_options(const MeshOptions& options,
                           const std::vector<View>& views,
                           const Focus& focus,
                           std::int64_t free_bytes,
                           spdlog::level::level_enum level,
                           DepthRules& rules) {
    const float radius =
        options.unbounded && options.radius > 0 ? options.radius : static_cast<float>(focus.radius);
    if ((options.unbounded || rules.depth_max == 0) && !(radius > 0))
        throw Error(ExitCode::input,
                    str("the size of the scene cannot be found: a camera lies in the point that "
                        "all look at; give ",
                        options.unbounded ? "--set mesh.radius=R" : "--depth-max"));
    if (rules.depth_max == 0)
        rules.depth_max = options.unbounded ? std::numeric_limits<float>::max() : 2 * radius;
    TsdfOptions volume;
    volume.carve = options.carve;
    const float extent = options.unbounded ? 2 * radius : rules.depth_max;
    const int resolution =
        options.resolution > 0 ? options.resolution : automatic_resolution(views);
    volume.voxel_size =
        options.voxel_size > 0 ? options.voxel_size : extent / static_cast<float>(resolution);
    volume.truncation =
        options.truncation > 0 ? options.truncation : options.truncation_voxels * volume.voxel_size;
    volume.max_bytes =
        !options.memory.empty()
            ? parse_bytes("--memory", options.memory)
            : static_cast<std::int64_t>(kShareOfFreeMemory * static_cast<double>(free_bytes));
    spdlog::log(level, "voxels of {:.4g}, truncation {:.4g}, depths below {}", volume.voxel_size,
                volume.truncation, limit_text(rules));
    if (options.unbounded) {
        volume.contraction = {vec_cast<float>(focus.point), radius};
        rules.centre = volume.contraction.centre;
        rules.reach = volume.contraction.reach(volume.truncation);
        spdlog::log(level,
                    "unbounded: voxels grow from {:.4g} around what the cameras look at, and end "
                    "{:.4g} away",
                    radius, rules.reach);
    }
    return volume;
}

/// A pixel marks what lies within the truncation of its depth. Where the marks of neighbouring
/// pixels do not touch, the surface falls apart into specks.
void check_truncation(const Camera& camera, std::vector<float> depths, const TsdfOptions& volume) {
    if (volume.contraction.is_on())  // which brings far pixels closer together
        for (int i = 0; i < static_cast<int>(depths.size()); ++i) {
            float& d = depths[static_cast<std::size_t>(i)];
            d /= volume.contraction.growth(
                unproject(camera, i % camera.width_px, i / camera.width_px, d));
        }
    const double pixel =
        median_depth(std::move(depths)) / static_cast<double>(std::max(camera.fx_px, camera.fy_px));
    if (2 * static_cast<double>(volume.truncation) >= pixel) return;
    throw Error(ExitCode::usage, str("voxels of ", volume.voxel_size, " with a truncation of ",
                                     volume.truncation, ": the pixels lie ", pixel,
                                     " apart on the surface, so it would have gaps; give "
                                     "a --voxel-size of about ",
                                     pixel, ", or a --truncation of at least ", pixel));
}

void report_fusion(const DepthCounts& counts,
                   const DepthRules& rules,
                   const FusionReport& fusion,
                   spdlog::level::level_enum level) {
    const auto line = [&](const char* what, std::int64_t count) {
        if (count > 0) spdlog::log(level, "  {:>12} pixels dropped: {}", count, what);
    };
    spdlog::log(level, "  {:>12} pixels fused", counts.kept);
    line("depth not finite", counts.not_finite);
    line("no surface", counts.no_surface);
    line(str("depth at or beyond ", rules.depth_max).c_str(), counts.too_far);
    line(str("coverage below ", rules.alpha_min).c_str(), counts.transparent);
    line("outside of the mask", counts.masked);
    line("seen at too flat an angle", counts.grazing);
    line("outside of --bbox", counts.outside);
    line(str("at or beyond ", rules.reach, " from the middle").c_str(), counts.out_of_reach);
    spdlog::log(level, "{} blocks of {}^3 voxels, {:.1f} MiB", fusion.blocks, kBlockEdge,
                static_cast<double>(fusion.bytes) / (1 << 20));
    if (fusion.parts > 1)
        spdlog::log(level,
                    "fused in {} parts to keep within --memory; {:.1f} MiB were kept on disk",
                    fusion.parts, static_cast<double>(fusion.spilled_bytes) / (1 << 20));
}

std::string why_nothing_fused(const DepthCounts& counts,
                              const DepthRules& rules,
                              double median_depth) {
    if (counts.kept > 0) return {};
    std::string dropped;
    const auto count = [&](const char* what, std::int64_t pixels) {
        if (pixels > 0) dropped += str(dropped.empty() ? "" : ", ", pixels, " ", what);
    };
    count("not finite", counts.not_finite);
    count("without a surface", counts.no_surface);
    count("too far", counts.too_far);
    count("of too little coverage", counts.transparent);
    count("outside of the masks", counts.masked);
    count("seen at too flat an angle", counts.grazing);
    count("outside of --bbox", counts.outside);
    count("too far from the middle", counts.out_of_reach);
    return fmt::format(
        "none of the depth pixels passed: {} (depths below {} pass; the median depth of the last "
        "view is {:.4g}); raise --depth-max, lower --alpha-min, or look at the masks (--no-masks) "
        "and --bbox",
        dropped, limit_text(rules), median_depth);
}

std::string clean_mesh(TriangleMesh& mesh, int clusters, spdlog::level::level_enum level) {
    const CleanReport cleaned = keep_largest_components(mesh, clusters);
    spdlog::log(level, "{} components, {} kept; {} faces and {} vertices removed",
                cleaned.components, cleaned.kept_components, cleaned.removed_faces,
                cleaned.removed_vertices);
    if (!mesh.faces.empty() || cleaned.components == 0) return {};
    return str("all ", cleaned.components,
               " components have fewer than 50 faces; lower --voxel-size, or pass --clusters 0");
}

}  // namespace detail
}  // namespace tvsgs
