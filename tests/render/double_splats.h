// Splats in double, for reference renderers in tests.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/scene/gaussians.h"
#include "support/numeric.h"

namespace tvsgs::test {

/// Parameters in double, for finite differences.
struct DoubleSplats {
    std::vector<Vec3d> means, log_scales, sh;
    std::vector<Quat<double>> quats;
    std::vector<double> logits, filters;  // filters: 0 if there are none

    explicit DoubleSplats(const Gaussians<Cpu>& g) {
        for (std::size_t i = 0; i < g.means.size(); ++i) {
            means.push_back(vec_cast<double>(g.means[i]));
            log_scales.push_back(vec_cast<double>(g.log_scales[i]));
            quats.push_back(quat_cast<double>(g.quats[i]));
            logits.push_back(static_cast<double>(g.opacity_logits[i]));
            filters.push_back(g.filter.empty() ? 0 : static_cast<double>(g.filter[i]));
        }
        for (std::size_t k = 0; k < g.sh.size(); ++k) sh.push_back(vec_cast<double>(g.sh[k]));
    }
};

/// Counts derivatives of loss() that central differences contradict.
template <class Loss>
class Differences {
public:
    Differences(Loss loss, double relative) : loss_(std::move(loss)), relative_(relative) {}

    void check(float analytic, double& parameter, double scale) {
        const double kept = parameter, h = 1e-6;
        parameter = kept + h;
        const double high = loss_();
        parameter = kept - h;
        const double low = loss_();
        parameter = kept;
        ++checked;
        outliers += !close(static_cast<double>(analytic), (high - low) / (2 * h), relative_, scale);
    }

    int checked = 0, outliers = 0;

private:
    Loss loss_;
    double relative_;
};

/// Makes splat i a flat one on a surface: at `at`, with the third axis along `normal`, rotated at
/// random.
inline void lay_flat(
    Gaussians<Cpu>& g, std::size_t i, Vec3f at, Vec3f normal, Vec3f log_scale, Random& random) {
    const Vec3f a = normalize(
                    cross(normal, std::abs(normal.y) < 0.9f ? Vec3f{0, 1, 0} : Vec3f{1, 0, 0})),
                b = cross(normal, a);
    const float turn = float(random.uniform(0, 6.28));
    const Vec3f t1 = std::cos(turn) * a + std::sin(turn) * b, t2 = cross(normal, t1);
    const double w = 0.5 * std::sqrt(std::max(1e-9, double(1 + t1.x + t2.y + normal.z)));
    g.means[i] = at;
    g.quats[i] = quat_cast<float>(Quat<double>{w, double(t2.z - normal.y) / (4 * w),
                                               double(normal.x - t1.z) / (4 * w),
                                               double(t1.y - t2.x) / (4 * w)});
    g.log_scales[i] = log_scale;
}

}  // namespace tvsgs::test
