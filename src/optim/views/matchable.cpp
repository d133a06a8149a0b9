#include "optim/views/matchable.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/parallel.h"
#include "core/log.h"
#include "core/math/quantile.h"
#include "core/progress.h"
#include "core/scene/photo_light.h"
#include "core/scene/view_frustum.h"

namespace tvsgs {

double lower_median(std::vector<double>& values) {
    if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
    const auto middle = values.begin() + std::ptrdiff_t((values.size() - 1) / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

std::vector<Sighting> sightings(const Camera& camera,
                                const std::vector<Vec3f>& points,
                                std::size_t stride) {
    std::vector<Sighting> seen;
    for (std::size_t i = 0; i < points.size(); i += stride) {
        if (!is_in_view(camera, points[i])) continue;
        const Vec3f p = camera.camera_from_world * points[i];
        const int x = int(camera.fx_px * p.x / p.z + camera.cx_px),
                  y = int(camera.fy_px * p.y / p.z + camera.cy_px);
        seen.push_back(
            {std::min(x, camera.width_px - 1), std::min(y, camera.height_px - 1), double(p.z), i});
    }
    return seen;
}

double median_depth(const std::vector<Sighting>& seen) {
    std::vector<double> depths;
    for (const Sighting& s : seen) depths.push_back(s.depth);
    return lower_median(depths);
}

double depth_of_view(const Camera& camera, const std::vector<Vec3f>& points, std::size_t stride) {
    std::vector<double> seen, before;
    for (std::size_t i = 0; i < points.size(); i += stride) {
        const float z = (camera.camera_from_world * points[i]).z;
        if (z > 0) before.push_back(z);
        if (is_in_view(camera, points[i])) seen.push_back(z);
    }
    std::vector<double>& depths = seen.empty() ? before : seen;
    return depths.empty() ? 0 : middle_of(depths);
}

Matchable::Matchable(const View& view,
                     const std::vector<View>& views,
                     bool masks,
                     double depth,
                     const FarPixels* sky)
    : view_(view),
      flat_(kFlat * measure_light(view.photo).factor(kFlat, 0.5)),
      masks_(masks && !view.mask.empty()),
      depth_(depth),
      sky_(sky) {
    if (!(depth > 0)) return;
    // Of thousands of views only a few overlap this one.
    const Camera& own = view.camera;
    const Rigid3f world = inverse(own.camera_from_world);
    std::vector<Vec3f> corners;
    for (const int x : {-1, own.width_px})
        for (const int y : {-1, own.height_px})
            corners.push_back(world * (float(depth) * pixel_ray(own, x, y)));
    for (const View& other : views)
        if (&other != &view && !ViewFrustum(other.camera).misses(corners))
            others_.push_back(&other.camera);
}

double Matchable::share() const {
    constexpr double kSample = 20000;  // pixels
    const int step = std::max(1, int(std::sqrt(pixels() / kSample)));
    int all = 0, good = 0;
    for (int y = step / 2; y < view_.photo.height; y += step)
        for (int x = step / 2; x < view_.photo.width; x += step) ++all, good += at(x, y);
    return all > 0 ? double(good) / all : 0;
}

bool Matchable::is_textured(int x, int y) const {
    constexpr int kBlocks = 5;
    const int left = std::clamp(x - kBlocks, 0, view_.photo.width - 2 * kBlocks),
              top = std::clamp(y - kBlocks, 0, view_.photo.height - 2 * kBlocks);
    if (left < 0 || top < 0) return true;     // the image is too small to decide
    const auto block = [&](int bx, int by) {  // sum over 2 x 2 pixels and 3 channels
        int sum = 0;
        for (int i = 0; i < 4; ++i)
            for (int c = 0; c < 3; ++c)
                sum += view_.photo.at(left + 2 * bx + i % 2, top + 2 * by + i / 2, c);
        return sum;
    };
    double sum = 0, squares = 0;
    for (int by = 0; by < kBlocks; ++by)
        for (int bx = 0; bx < kBlocks; ++bx) {
            const double level = block(bx, by) / 12.0;
            sum += level, squares += level * level;
        }
    constexpr double n = kBlocks * kBlocks;
    return squares / n - (sum / n) * (sum / n) > flat_ * flat_;
}

bool Matchable::is_in_other_view(int x, int y) const {
    if (!(depth_ > 0)) return true;
    const Rigid3f world = inverse(view_.camera.camera_from_world);
    const Vec3f point = world * (float(depth_) * pixel_ray(view_.camera, x, y));
    return std::ranges::any_of(others_,
                               [&](const Camera* other) { return is_in_view(*other, point); });
}

namespace {

/// Open shares of a view, per block of pixels.
class Blocks {
public:
    static constexpr int kSide = 8, kSamples = 2;  // pixels; samples along a side

    Blocks(const View& view, const std::vector<Sighting>& seen, const Matchable& could_match)
        : width_((view.camera.width_px + kSide - 1) / kSide),
          height_((view.camera.height_px + kSide - 1) / kSide) {
        std::vector<double> matchable(std::size_t(width_ * height_)), points(matchable.size()),
            covered(matchable.size());
        parallel_for_heavy(Cpu{}, width_ * height_, [&](int block) {
            constexpr int kStep = kSide / kSamples;
            int good = 0;
            for (int i = 0; i < kSamples * kSamples; ++i) {
                const int x = block % width_ * kSide + i % kSamples * kStep + kStep / 2,
                          y = block / width_ * kSide + i / kSamples * kStep + kStep / 2;
                good +=
                    x < view.camera.width_px && y < view.camera.height_px && could_match.at(x, y);
            }
            matchable[block] = 1.0 * good / (kSamples * kSamples);
        });
        for (const Sighting& s : seen) points[index(s)] += 1;
        for (std::size_t i = 0; i < points.size(); ++i)
            covered[i] = covered_share(points[i] / (kSide * kSide * std::max(matchable[i], 0.25)));
        // Next to covered blocks may lie the edge of a silhouette.
        const std::vector<double> beside = largest_around(covered, 1);
        for (std::size_t i = 0; i < matchable.size(); ++i) matchable[i] *= 1 - beside[i];
        // Points beside a gap grow into it, across its edge.
        open_ = largest_around(matchable, 2);
    }

    double open(const Sighting& s) const { return open_[index(s)]; }

private:
    std::size_t index(const Sighting& s) const {
        return std::size_t(s.y / kSide * width_ + s.x / kSide);
    }

    /// Largest value among the blocks at most `reach` away, per block.
    std::vector<double> largest_around(const std::vector<double>& values, int reach) const {
        std::vector<double> out(values.size());
        for (int y = 0; y < height_; ++y)
            for (int x = 0; x < width_; ++x) {
                double& most = out[y * width_ + x];
                for (int v = std::max(0, y - reach); v <= std::min(height_ - 1, y + reach); ++v)
                    for (int u = std::max(0, x - reach); u <= std::min(width_ - 1, x + reach); ++u)
                        most = std::max(most, values[v * width_ + u]);
            }
        return out;
    }

    int width_, height_;
    std::vector<double> open_;
};

}  // namespace

std::vector<float> open_shares(const std::vector<View>& views,
                               const std::vector<Vec3f>& points,
                               bool masks) {
    std::vector<float> open(points.size(), 0);
    Progress progress("gaps of the start cloud", double(views.size()));
    for (const View& view : views) {
        progress.advance();
        const std::vector<Sighting> seen = sightings(view.camera, points, 1);
        const Blocks blocks(view, seen, Matchable(view, views, masks, median_depth(seen)));
        for (const Sighting& s : seen)
            open[s.point] = std::max(open[s.point], float(blocks.open(s)));
    }
    const auto beside = std::ranges::count_if(open, [](float o) { return o > 0; });
    if (!open.empty())
        spdlog::info("Growth: {:.1f} % of the first splats lie beside gaps of the start cloud",
                     100.0 * double(beside) / double(open.size()));
    return open;
}

}  // namespace tvsgs
