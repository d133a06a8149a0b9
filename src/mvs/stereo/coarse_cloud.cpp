#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>

#include "core/device/parallel.h"
#include "mvs/stereo/patch_match.h"
#include "mvs/stereo/view_selection.h"

namespace tvsgs {
namespace {

constexpr int kCells = 64;   // along the longer side of a photograph
constexpr int kDepths = 64;  // per ray
// A point is ambiguous if more than one in so many depths of its ray agree as well.
constexpr std::ptrdiff_t kMostAlike = 4;

/// A view reduced to the mean colours of square cells.
struct Cells {
    int side_px = 1, width = 0, height = 0;
    std::vector<Vec3f> colors;  // [0, 1]

    explicit Cells(const ImageU8& photo)
        : side_px((std::max(photo.width, photo.height) + kCells - 1) / kCells),
          width((photo.width + side_px - 1) / side_px),
          height((photo.height + side_px - 1) / side_px),
          colors(static_cast<std::size_t>(width) * height) {
        std::vector<float> counts(colors.size());
        for (int y = 0; y < photo.height; ++y)
            for (int x = 0; x < photo.width; ++x) {
                const std::size_t at = index(x, y);
                const std::uint8_t* p = &photo.at(x, y);
                colors[at] += Vec3f{static_cast<float>(p[0]), static_cast<float>(p[1]),
                                    static_cast<float>(p[2])} /
                              255.0f;
                counts[at] += 1;
            }
        for (std::size_t i = 0; i < colors.size(); ++i) colors[i] = colors[i] / counts[i];
    }

    /// Of the cell with this pixel of the photograph.
    std::size_t index(int x, int y) const {
        return static_cast<std::size_t>(y / side_px) * width + x / side_px;
    }
};

class CoarseSweep {
public:
    CoarseSweep(const std::vector<View>& views, std::vector<ViewPlan> ranges, bool masks)
        : views_(views), ranges_(std::move(ranges)), masks_(masks) {
        for (const View& view : views) cells_.emplace_back(view.photo);
    }

    /// Adds the points of a view's rays.
    void add_points(std::size_t v, PointCloud& cloud) const {
        const Cells& cells = cells_[v];
        std::vector<std::optional<Vec3f>> found(cells.colors.size());
        parallel_for_heavy(Cpu{}, cells.width * cells.height, [&](int cell) {
            found[cell] = point_on_ray(v, cell % cells.width, cell / cells.width);
        });
        for (std::size_t i = 0; i < found.size(); ++i) {
            if (!found[i]) continue;
            cloud.positions.push_back(*found[i]);
            cloud.colors.push_back(cells.colors[i]);
        }
    }

private:
    std::optional<Vec3f> point_on_ray(std::size_t v, int cell_x, int cell_y) const {
        const View& view = views_[v];
        const int side = cells_[v].side_px;
        const int x = std::min(cell_x * side + side / 2, view.camera.width_px - 1),
                  y = std::min(cell_y * side + side / 2, view.camera.height_px - 1);
        if (is_outside(view, x, y)) return std::nullopt;
        const Rigid3f world = inverse(view.camera.camera_from_world);
        const Vec3f ray = pixel_ray(view.camera, x, y);
        const float nearest = 1 / ranges_[v].near_depth, farthest = 1 / ranges_[v].far_depth;
        std::array<Look, kDepths> looks;  // from near to far
        std::array<Vec3f, kDepths> points;
        int most = 0;
        for (std::size_t k = 0; k < kDepths; ++k) {
            const float share = 1 - (static_cast<float>(k) + 0.5f) / kDepths;
            points[k] = world * (1 / (farthest + share * (nearest - farthest)) * ray);
            looks[k] = look_at(v, cells_[v].index(x, y), points[k]);
            most = std::max(most, looks[k].views);
        }
        std::vector<std::size_t> common;  // depths at which enough views see the ray
        float mean = 0;
        for (std::size_t k = 0; k < kDepths && most > 0; ++k) {
            // Space near a camera is inside of all masks, because few views see it.
            if (2 * looks[k].views < most || !std::isfinite(looks[k].difference)) continue;
            if (masks_) return points[k];
            common.push_back(k), mean += looks[k].difference;
        }
        mean /= static_cast<float>(common.size());
        const auto differs_less = [&](std::size_t a, std::size_t b) {
            return looks[a].difference < looks[b].difference;
        };
        const auto alike = std::ranges::count_if(
            common, [&](std::size_t k) { return looks[k].difference < 0.5f * mean; });
        if (alike == 0 || kMostAlike * alike > std::ssize(common)) return std::nullopt;
        return points[*std::ranges::min_element(common, differs_less)];
    }

    bool is_outside(const View& view, int x, int y) const {
        return masks_ && !view.mask.empty() && view.mask.at(x, y) < kObjectMask;
    }

    /// Other views that see a point, and the mean difference from the colours of the half of them
    /// that agree best, because surface hides the point from others. Infinite if no other view sees
    /// the point, or a mask excludes it.
    struct Look {
        int views = 0;
        float difference = INFINITY;
    };
    Look look_at(std::size_t v, std::size_t cell, Vec3f point) const {
        std::vector<float> differences;
        bool outside = false;
        for (std::size_t other = 0; other < views_.size(); ++other) {
            const Camera& c = views_[other].camera;
            if (other == v || !is_in_view(c, point)) continue;
            const Vec3f p = c.camera_from_world * point;
            const int x = static_cast<int>(c.fx_px * p.x / p.z + c.cx_px),
                      y = static_cast<int>(c.fy_px * p.y / p.z + c.cy_px);
            outside |= is_outside(views_[other], x, y);
            differences.push_back(
                norm(cells_[v].colors[cell] - cells_[other].colors[cells_[other].index(x, y)]));
        }
        Look look{static_cast<int>(differences.size()), INFINITY};
        if (differences.empty() || outside) return look;
        std::ranges::sort(differences);
        const std::size_t count = (differences.size() + 1) / 2;
        look.difference =
            std::accumulate(differences.begin(),
                            differences.begin() + static_cast<std::ptrdiff_t>(count), 0.0f) /
            static_cast<float>(count);
        return look;
    }

    const std::vector<View>& views_;
    std::vector<ViewPlan> ranges_;
    bool masks_;
    std::vector<Cells> cells_;
};

}  // namespace

PointCloud coarse_cloud(const std::vector<View>& views,
                        const std::vector<Vec3f>& points,
                        const StereoOptions& options) {
    std::vector<Camera> cameras;
    bool masks = false;
    for (const View& view : views) {
        cameras.push_back(view.camera);
        masks |= options.use_masks && !view.mask.empty();
    }
    const CoarseSweep sweep(
        views, plan_ranges(cameras, points, options.depth_near, options.depth_far), masks);
    PointCloud cloud;
    for (std::size_t v = 0; v < views.size(); ++v) sweep.add_points(v, cloud);
    return cloud;
}

}  // namespace tvsgs
