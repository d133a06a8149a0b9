// Differences between two sets of splats, by attribute.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "core/math/quantile.h"
#include "core/scene/gaussians.h"
#include "io/splats/splat_checks.h"

namespace tvsgs {

/// Angle between the rotations of two quaternions of any length and sign.
inline double angle_deg(Quatf a, Quatf b) {
    const auto p = normalize(quat_cast<double>(a)), q = normalize(quat_cast<double>(b));
    const double c = p.w * q.w + p.x * q.x + p.y * q.y + p.z * q.z;
    return 2 * std::acos(std::min(1.0, std::abs(c))) * 180 / std::numbers::pi;
}

/// Largest differences (one is a median) of splats with the same order and SH degree.
struct SplatErrors {
    double mean = 0, mean_log = 0;  // world units; the same / (1 + |coordinate|)
    double median_mean = 0;         // median over the splats of the first
    double log_scale = 0, degrees = 0, opacity = 0;
    double color = 0, sh_1 = 0, sh_rest = 0;  // SH coefficients of degree 0, 1, and above
};

/// Compares `b` with `a`.
inline SplatErrors errors_of(const Gaussians<Cpu>& a, const Gaussians<Cpu>& b) {
    SplatErrors out;
    const auto widen = [](double& most, double by) { most = std::max(most, std::abs(by)); };
    const std::size_t count = a.means.size();
    std::vector<double> means(count, 0);
    for (std::size_t i = 0; i < count; ++i) {
        for (int c = 0; c < 3; ++c) {
            const double off = double{a.means[i][c]} - double{b.means[i][c]};
            widen(means[i], off);
            widen(out.mean_log, off / (1 + std::abs(double{a.means[i][c]})));
            widen(out.log_scale, double{a.log_scales[i][c]} - double{b.log_scales[i][c]});
            for (std::size_t k = 0; k < std::size_t(sh_count(a.sh_degree)); ++k)
                widen(k == 0  ? out.color
                      : k < 4 ? out.sh_1
                              : out.sh_rest,
                      a.sh[k * count + i][c] - b.sh[k * count + i][c]);
        }
        widen(out.degrees, angle_deg(a.quats[i], b.quats[i]));
        widen(out.opacity, sigmoid(a.opacity_logits[i]) - sigmoid(b.opacity_logits[i]));
    }
    if (count == 0) return out;
    out.median_mean = middle_of(means), out.mean = *std::ranges::max_element(means);
    return out;
}

}  // namespace tvsgs
