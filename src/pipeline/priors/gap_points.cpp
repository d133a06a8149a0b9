// Fills the gaps of a stereo cloud.  [docs/method/support.md#gaps]
#include <algorithm>
#include <cmath>

#include "optim/losses/depth_normals.h"
#include "pipeline/priors/stereo_priors.h"

namespace tvsgs {
namespace {

constexpr float kBehind = 1.05f;       // a point covers depths up to this multiple of its own
constexpr float kLeastFacing = 0.15f;  // cosine between ray and normal; depth edges have less
// A gap is filled where this share of the pixels at most kReach away is measured. At the straight
// border of a measured surface the share is a half.
constexpr int kReach = 6;
constexpr float kEnclosed = 0.6f;

/// Depth of the farthest point at each pixel or beside it; 0: none.
std::vector<float> covered_depths(const Camera& camera, const std::vector<Vec3f>& points) {
    const int w = camera.width_px, h = camera.height_px;
    std::vector<float> farthest(std::size_t(w) * std::size_t(h));
    for (const Vec3f& point : points) {
        const Vec3f p = camera.camera_from_world * point;
        if (!(p.z > 0)) continue;
        const float u = std::floor(camera.fx_px * p.x / p.z + camera.cx_px),
                    v = std::floor(camera.fy_px * p.y / p.z + camera.cy_px);
        if (!(u >= -1 && u <= float(w) && v >= -1 && v <= float(h))) continue;
        const int x = int(u), y = int(v);
        for (int b = std::max(y - 1, 0); b <= std::min(y + 1, h - 1); ++b)
            for (int a = std::max(x - 1, 0); a <= std::min(x + 1, w - 1); ++a) {
                float& depth = farthest[b * w + a];
                depth = std::max(depth, p.z);
            }
    }
    return farthest;
}

/// Share of measured pixels among those that are at most kReach columns and rows away.
std::vector<float> measured_shares(const StereoMaps& maps) {
    const int w = maps.camera.width_px, h = maps.camera.height_px;
    std::vector<int> sums(std::size_t((w + 1) * (h + 1)));  // above and left of a pixel
    const auto sum = [&](int x, int y) -> int& { return sums[y * (w + 1) + x]; };
    std::vector<float> shares(maps.depth.size());
    for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x)
            sum(x + 1, y + 1) =
                sum(x, y + 1) + sum(x + 1, y) - sum(x, y) + is_measured(maps.confidence[y * w + x]);
    for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x) {
            const int left = std::max(x - kReach, 0), right = std::min(x + kReach + 1, w),
                      top = std::max(y - kReach, 0), bottom = std::min(y + kReach + 1, h);
            shares[y * w + x] =
                float(sum(right, bottom) - sum(left, bottom) - sum(right, top) + sum(left, top)) /
                float((right - left) * (bottom - top));
        }
    return shares;
}

}  // namespace

std::size_t add_gap_points(const std::vector<StereoMaps>& completed,
                           const std::vector<View>& views,
                           const SkyDetection& sky,
                           int spacing_px,
                           PointCloud& cloud) {
    const std::size_t before = cloud.positions.size();
    for (std::size_t v = 0; v < views.size(); ++v) {
        const StereoMaps& maps = completed[v];
        if (measured_pixels(maps) == 0) continue;
        const Camera& camera = maps.camera;
        const Rigid3f& pose = camera.camera_from_world;
        const int w = camera.width_px, h = camera.height_px;
        const Span<const float> depth{maps.depth.data(), maps.depth.size()};
        const std::vector<float> covered = covered_depths(camera, cloud.positions);
        const std::vector<float> measured = measured_shares(maps);
        const ImageU8& photo = views[v].photo;
        for (int y = spacing_px / 2; y < h; y += spacing_px)
            for (int x = spacing_px / 2; x < w; x += spacing_px) {
                const auto i = std::size_t(y * w + x);
                const float z = depth[i];
                if (!(z > 0) || z < kBehind * covered[i] || measured[i] < kEnclosed) continue;
                // Pixel of the photograph, which may be finer than the maps.
                const int px = (2 * x + 1) * photo.width / (2 * w),
                          py = (2 * y + 1) * photo.height / (2 * h);
                if (!sky.views.empty() && sky.views[v].is_far(px, py)) continue;
                Vec3f normal = maps.normals[i];
                if (DepthNormal<float> n;
                    norm(normal) < 0.5f && depth_normal_at(camera, depth, int(i), n))
                    normal = n.normal;
                if (!(-dot(normal, normalize(pixel_ray(camera, x, y))) > kLeastFacing)) continue;
                const auto at = std::size_t(3 * (py * photo.width + px));
                const auto level = [&](std::size_t c) { return float(photo.pixels[at + c]) / 255; };
                cloud.positions.push_back(
                    transpose_times(pose.R, z * pixel_ray(camera, x, y) - pose.t));
                cloud.normals.push_back(transpose_times(pose.R, normal));
                cloud.colors.push_back({level(0), level(1), level(2)});
                cloud.confidences.push_back(0);
            }
    }
    return cloud.positions.size() - before;
}

}  // namespace tvsgs
