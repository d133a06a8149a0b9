#include "pipeline/priors/stereo_priors.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/parallel.h"
#include "core/math/quantile.h"
#include "core/scene/prior_maps.h"
#include "mvs/stereo/depth_completion.h"
#include "mvs/stereo/mvs_math.h"
#include "pipeline/scene/stereo_cloud.h"

namespace tvsgs {
namespace {

constexpr std::string_view kMade[] = {prior_map::kDepth, prior_map::kDepthOrder,
                                      prior_map::kConfidence, prior_map::kNormal};

/// Cosine of the angle to the ray: planes at grazing angles mostly bridge a depth step.
constexpr float kLeastFacing = 0.3f;

/// Order and confidence belong to the depth.
bool lacks(const View& view, std::string_view name) {
    return std::ranges::none_of(view.maps, [&](const ViewMap& map) {
        return name == prior_map::kNormal
                   ? map.name == name
                   : map.name == prior_map::kDepth || map.name == prior_map::kDepthOrder;
    });
}

MapNames to_make(const View& view, const MapNames& wanted) {
    MapNames made;
    for (const std::string_view name : wanted)
        if (std::find(std::begin(kMade), std::end(kMade), name) != std::end(kMade) &&
            lacks(view, name))
            made.insert(name);
    return made;
}

/// Resamples an image to the size of `camera`, at pixel centres.
std::vector<std::uint8_t> levels_at(const ImageU8& image, const Camera& camera) {
    std::vector<std::uint8_t> out;
    for (int y = 0; !image.empty() && y < camera.height_px; ++y)
        for (int x = 0; x < camera.width_px; ++x)
            out.push_back(image.at((2 * x + 1) * image.width / (2 * camera.width_px),
                                   (2 * y + 1) * image.height / (2 * camera.height_px)));
    return out;
}

/// Smooths the noisy stereo normals: mean over 5 x 5 pixels of similar depth and colour.
std::vector<Vec3f> smoothed_normals(const StereoMaps& maps, const std::vector<float>& grey) {
    const int w = maps.camera.width_px, h = maps.camera.height_px;
    std::vector<Vec3f> out(maps.normals.size());
    parallel_for(Cpu{}, w * h, [&](int i) {
        const int x = i % w, y = i / w;
        if (!(maps.depth[i] > 0)) return;
        Vec3f sum{};
        for (int v = std::max(y - 2, 0); v <= std::min(y + 2, h - 1); ++v)
            for (int u = std::max(x - 2, 0); u <= std::min(x + 2, w - 1); ++u) {
                const int j = v * w + u;
                if (!(std::abs(maps.depth[j] - maps.depth[i]) < 0.02f * maps.depth[i])) continue;
                const float alike = std::exp(-std::abs(grey[j] - grey[i]) / 0.1f);
                sum += maps.confidence[j] * alike * maps.normals[j];
            }
        const float length = norm(sum);
        out[i] = length > 1e-6f ? sum / length : maps.normals[i];
    });
    return out;
}

/// Resamples to the photograph's size: each depth lies on the plane of the nearest stereo pixel, so
/// surfaces have no steps.
StereoMaps resized(const StereoMaps& maps, const Camera& camera) {
    const int w = camera.width_px, h = camera.height_px;
    if (w == maps.camera.width_px && h == maps.camera.height_px) return maps;
    StereoMaps out{camera, {}, {}, {}};
    for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x) {
            const int u = (2 * x + 1) * maps.camera.width_px / (2 * w),
                      v = (2 * y + 1) * maps.camera.height_px / (2 * h);
            const auto from = std::size_t(v * maps.camera.width_px + u);
            const SurfacePlane plane{maps.normals[from], maps.depth[from]};
            const float depth =
                depth_on_ray(plane, pixel_ray(maps.camera, u, v), pixel_ray(camera, x, y));
            out.depth.push_back(depth > 0 ? depth : plane.depth);  // filled pixels have no normal
            out.normals.push_back(plane.normal);
            out.confidence.push_back(maps.confidence[from]);
        }
    return out;
}

/// Maps the 2nd and 98th percentiles of the measured depths to 0 and 1; NaN: no depth.
std::vector<float> order_of(const StereoMaps& maps) {
    std::vector<float> measured;
    for (std::size_t i = 0; i < maps.depth.size(); ++i)
        if (is_measured(maps.confidence[i])) measured.push_back(maps.depth[i]);
    const float low = percentile(measured, 2), high = percentile(measured, 98);
    // A wall seen frontally has no depth range.
    const float range = std::max(high - low, 1e-4f * low);
    std::vector<float> order;
    for (const float depth : maps.depth)
        order.push_back(depth > 0 ? (depth - low) / range
                                  : std::numeric_limits<float>::quiet_NaN());
    return order;
}

StereoMaps completed(const StereoMaps& maps, const View& view) {
    std::vector<float> grey;
    for (const std::uint8_t level : levels_at(grey_of(view.photo), maps.camera))
        grey.push_back(float(level) / 255);
    const std::vector<std::uint8_t> mask = levels_at(view.mask, maps.camera);
    StereoMaps out = maps;
    out.normals = smoothed_normals(maps, grey);
    std::vector<float> costs(maps.depth.size(), kWorstCost);
    for (std::size_t i = 0; i < maps.depth.size(); ++i) {
        out.confidence[i] = 0;
        if (!(maps.depth[i] > 0)) continue;
        costs[i] = 0.09f * (1 - maps.confidence[i]);  // all below the limit of planar_prior()
        out.confidence[i] =
            kPlanarConfidence + (1 - kPlanarConfidence) * std::max(maps.confidence[i], 0.01f);
    }

    std::vector<SurfacePlane> planes;
    for (std::size_t i = 0; i < maps.depth.size(); ++i)
        planes.push_back({maps.normals[i], maps.depth[i]});
    const auto prior = planar_prior(maps.camera, {planes.data(), planes.size()},
                                    {costs.data(), costs.size()}, mask);
    for (std::size_t i = 0; i < prior.size(); ++i) {
        if (maps.depth[i] > 0 || !(prior[i].depth > 0) || !(mask.empty() || mask[i] >= kObjectMask))
            continue;
        const int at = int(i), w = maps.camera.width_px;
        if (!(-dot(prior[i].normal, normalize(pixel_ray(maps.camera, at % w, at / w))) >
              kLeastFacing))
            continue;
        out.depth[i] = prior[i].depth, out.normals[i] = prior[i].normal;
        out.confidence[i] = kPlanarConfidence;
    }
    const std::vector<float> filled = complete_depth(
        {maps.camera.width_px, maps.camera.height_px, out.depth, out.confidence, grey, mask});
    for (std::size_t i = 0; i < filled.size(); ++i) {
        if (maps.depth[i] > 0) continue;  // keep measured depths
        out.depth[i] = filled[i];
        if (!(out.confidence[i] > 0) && filled[i] > 0) out.confidence[i] = kFillConfidence;
    }
    return out;
}

}  // namespace

std::size_t measured_pixels(const StereoMaps& completed) {
    return std::size_t(std::ranges::count_if(completed.confidence, is_measured));
}

std::vector<StereoMaps> completed_maps(const std::vector<StereoMaps>& maps,
                                       const std::vector<View>& views) {
    std::vector<StereoMaps> out(views.size());
    parallel_for_heavy(Cpu{}, int(views.size()),
                       [&](int v) { out[v] = completed(maps[v], views[v]); });
    return out;
}

void add_stereo_priors(const std::vector<StereoMaps>& completed,
                       const MapNames& wanted,
                       std::vector<View>& views) {
    for (std::size_t v = 0; v < views.size(); ++v) {
        View& view = views[v];
        const MapNames names = to_make(view, wanted);
        if (names.empty() || measured_pixels(completed[v]) == 0) continue;
        StereoMaps maps = resized(completed[v], view.camera);
        // A confidence without its depth belongs to other data.
        if (lacks(view, prior_map::kDepth))
            std::erase_if(view.maps,
                          [](const ViewMap& map) { return map.name == prior_map::kConfidence; });
        const auto add = [&](std::string_view name, int channels, std::vector<float> values) {
            if (std::ranges::find(names, name) != names.end())
                view.maps.push_back({std::string(name), view.camera.width_px, view.camera.height_px,
                                     channels, std::move(values)});
        };
        std::vector<float> normals;
        for (const Vec3f& n : maps.normals) normals.insert(normals.end(), {n.x, n.y, n.z});
        add(prior_map::kDepthOrder, 1, order_of(maps));
        add(prior_map::kDepth, 1, std::move(maps.depth));
        add(prior_map::kConfidence, 1, std::move(maps.confidence));
        add(prior_map::kNormal, 3, std::move(normals));
    }
}

void make_stereo_priors(const DeviceChoice& device,
                        const StereoOptions& stereo,
                        const MapNames& wanted,
                        StereoStart start,
                        std::vector<View>& views) {
    if (std::ranges::all_of(views, [&](const View& view) { return to_make(view, wanted).empty(); }))
        return;
    if (start.maps.empty()) {
        spdlog::info("Losses need priors that the scene lacks: stereo makes them");
        start.maps =
            with_context(
                "making priors (set the weights of the losses that use them to 0 to avoid it)",
                [&] { return run_stereo(device, views, start.points, stereo); })
                .maps;
    }
    start.complete(views);
    std::size_t known = 0, pixels = 0;
    for (const StereoMaps& maps : start.maps) {
        pixels += maps.depth.size();
        known += measured_pixels(maps);
    }
    if (known == 0)
        throw Error(ExitCode::input, "losses need priors, but stereo found no depth in ",
                    views.size(),
                    " views; give priors with --priors, or set the weights of these losses to 0");
    add_stereo_priors(start.maps, wanted, views);
    spdlog::debug("priors by stereo: {:.0f} % of the pixels are measured, the others filled in",
                  100.0 * double(known) / double(pixels));
}

}  // namespace tvsgs
