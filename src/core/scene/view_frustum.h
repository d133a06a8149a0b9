// Conservative view-frustum test for boxes and convex hulls.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/scene/camera.h"

namespace tvsgs {

/// Axis-aligned box, world units.
struct Box3f {
    Vec3f low{3e38f, 3e38f, 3e38f}, high{-3e38f, -3e38f, -3e38f};

    void add(Vec3f p) {
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
};

/// The five planes that bound the points accepted by is_in_view(). The planes have a margin larger
/// than the rounding errors of is_in_view(), so it rejects every point of a piece that misses().
class ViewFrustum {
public:
    explicit ViewFrustum(const Camera& c) {
        const Mat3f& R = c.camera_from_world.R;
        const Vec3d t = vec_cast<double>(c.camera_from_world.t);
        const auto set = [&](int k, Vec3d of, double size) {  // of . (R x + t) >= 0 in view
            for (int j = 0; j < 3; ++j)
                normal_[k][j] =
                    of.x * double(R[0][j]) + of.y * double(R[1][j]) + of.z * double(R[2][j]);
            offset_[k] = dot(of, t), slack_[k] = kSlack * size;
        };
        const double fx = c.fx_px, fy = c.fy_px, cx = c.cx_px, cy = c.cy_px, w = c.width_px,
                     h = c.height_px;
        const double size = fx + fy + std::abs(cx) + std::abs(cy) + w + h;
        set(0, {0, 0, 1}, 1);
        set(1, {fx, 0, cx}, size), set(2, {-fx, 0, w - cx}, size);
        set(3, {0, fy, cy}, size), set(4, {0, -fy, h - cy}, size);
        shift_ = std::abs(t.x) + std::abs(t.y) + std::abs(t.z);
    }

    /// True if no point of the convex hull of `corners`, extended by float rounding, is in view.
    template <class Points>
    bool misses(const Points& corners) const {
        double reach = 0;
        for (const Vec3f p : corners)
            reach = std::max(reach,
                             double(std::abs(p.x)) + double(std::abs(p.y)) + double(std::abs(p.z)));
        for (int k = 0; k < kPlanes; ++k) {
            double most = -INFINITY;
            for (const Vec3f p : corners)
                most = std::max(most, dot(normal_[k], vec_cast<double>(p)));
            if (most + offset_[k] + slack_[k] * (reach + shift_) < 0) return true;
        }
        return false;
    }

    TVSGS_HD bool misses(const Box3f& box) const {
        const Vec3d low = vec_cast<double>(box.low), high = vec_cast<double>(box.high);
        double reach = shift_;
        for (int j = 0; j < 3; ++j) {
            const double a = low[j] < 0 ? -low[j] : low[j], b = high[j] < 0 ? -high[j] : high[j];
            reach += a > b ? a : b;
        }
        for (int k = 0; k < kPlanes; ++k) {
            double most = offset_[k];
            for (int j = 0; j < 3; ++j) most += normal_[k][j] * (normal_[k][j] > 0 ? high : low)[j];
            if (most + slack_[k] * reach < 0) return true;
        }
        return false;
    }

private:
    static constexpr int kPlanes = 5;
    static constexpr double kSlack = 1e-5;  // a hundred times the rounding of a float
    Vec3d normal_[kPlanes];
    double offset_[kPlanes], slack_[kPlanes], shift_;
};

}  // namespace tvsgs
