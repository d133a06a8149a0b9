// Detects when the surface of a training stands still, without test views.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "core/math/quantile.h"
#include "mesh/fuse/large_splats.h"
#include "optim/loop/train.h"
#include "render/backbone.h"

namespace tvsgs {

/// How far a surface has moved in the pictures of some views.
struct SurfaceMotion {
    double median_px = 0, p90_px = 0;
    std::size_t pixels = 0;  // with a depth before and after
};

/// Depths a before and b after: a pixel has moved by |a - b| f / a pixels. `before`, `after`:
/// [views][H W], 0: no depth. `focal_px`: f of each view.
inline SurfaceMotion surface_motion(const std::vector<std::vector<float>>& before,
                                    const std::vector<std::vector<float>>& after,
                                    const std::vector<float>& focal_px) {
    std::vector<float> moved;
    for (std::size_t v = 0; v < before.size(); ++v)
        for (std::size_t i = 0; i < before[v].size(); ++i) {
            const float a = before[v][i], b = after[v][i];
            if (a > 0 && b > 0) moved.push_back(std::abs(a - b) * focal_px[v] / a);
        }
    const auto median = double(quantile(moved, 0.5));
    return {median, double(quantile(moved, 0.9)), moved.size()};
}

/// Compares the depths of a few training views with those of kEvery iterations earlier. If splats
/// have an uncertainty, only the supported ones count: splats that fill gaps never rest.
template <class Device>
class SurfaceWatch {
public:
    static constexpr int kEvery = 100, kMostViews = 4;
    static constexpr double kMedianPx = 0.02, kP90Px = 0.1;  // largest motion of a surface at rest

    SurfaceWatch(const std::vector<View>& views, const TrainOptions& options)
        : backbone_(make_backbone<Device>(options.backbone, options.render)) {
        const std::size_t all = views.size(), count = std::min(all, std::size_t(kMostViews));
        for (std::size_t i = 0; i < count; ++i) {
            cameras_.push_back(views[i * all / count].camera);
            focal_px_.push_back(cameras_.back().fx_px);
        }
    }

    bool due(int step) const { return step % kEvery == 0; }

    /// Call after each step that is due.
    void look(const Gaussians<Device>& splats) {
        if (!splats.uncertainty.empty()) {
            copy(splats, supported_);
            fade_unsupported(supported_);
        }
        const Gaussians<Device>& seen = splats.uncertainty.empty() ? splats : supported_;
        std::vector<std::vector<float>> depths;
        for (const Camera& camera : cameras_)
            depths.push_back(to_host(backbone_->forward(seen, camera, 0, Maps::depth).depth));
        motion_ = surface_motion(depths_, depths, focal_px_);
        depths_ = std::move(depths);
    }

    bool still() const {
        return motion_.pixels > 0 && motion_.median_px < kMedianPx && motion_.p90_px < kP90Px;
    }
    const SurfaceMotion& motion() const { return motion_; }  // at the last look

private:
    std::unique_ptr<Backbone<Device>> backbone_;
    std::vector<Camera> cameras_;
    std::vector<float> focal_px_;
    std::vector<std::vector<float>> depths_;  // at the last look
    Gaussians<Device> supported_;
    SurfaceMotion motion_;
};

}  // namespace tvsgs
