#include "mvs/stereo/depth_completion.h"

#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "core/scene/scene.h"

namespace tvsgs {
namespace {

constexpr float kGreyScale = 0.04f;   // of an edge of the photograph
constexpr float kSmoothness = 0.05f;  // more moves measured pixels, less keeps their noise
constexpr int kSteps = 200;           // at most, per size
constexpr double kResidual = 1e-5;    // relative to the right-hand side; ends the iteration
constexpr int kCoarsest = 8;          // px

using Values = std::vector<double>;

/// Like parallel_for(), but serial for small loops, of which there are hundreds.
template <class Body>
void for_each_pixel(std::size_t count, const Body& body) {
    const auto run = [&](int begin, int end, int /*slot*/ = 0) {
        for (int i = begin; i < end; ++i) body(static_cast<std::size_t>(i));
    };
    if (const int all = static_cast<int>(count); all > 65536)
        run_ranges(all, 16384, run);
    else
        run(0, all);
}

/// The problem at one size, in inverse depth.
struct Level {
    std::size_t width, height;
    Values weight, value;  // of known depths; weight 0: unknown
    std::vector<float> grey;
    std::vector<char> inside;
};

/// Halves width and height. Weights add up, so known depths keep their weight relative to the
/// smoothness, whose sum over neighbours does not depend on the size.
Level halved(const Level& fine) {
    const std::size_t w = (fine.width + 1) / 2, h = (fine.height + 1) / 2;
    Level coarse{
        w, h, Values(w * h), Values(w * h), std::vector<float>(w * h), std::vector<char>(w * h)};
    std::vector<float> count(w * h);
    for (std::size_t y = 0; y < fine.height; ++y)
        for (std::size_t x = 0; x < fine.width; ++x) {
            const std::size_t from = y * fine.width + x, to = y / 2 * w + x / 2;
            if (!fine.inside[from]) continue;
            coarse.inside[to] = 1, coarse.grey[to] += fine.grey[from], ++count[to];
            coarse.weight[to] += fine.weight[from];
            coarse.value[to] += fine.weight[from] * fine.value[from];
        }
    for (std::size_t at = 0; at < w * h; ++at) {
        if (coarse.weight[at] > 0) coarse.value[at] /= coarse.weight[at];
        if (coarse.inside[at]) coarse.grey[at] /= count[at];
    }
    return coarse;
}

/// The matrix: its diagonal and the entries beside it.
struct System {
    std::size_t width;
    Values diagonal;     // 0: not a pixel of the system
    Values right, down;  // weights of the edges to these neighbours

    explicit System(const Level& level)
        : width(level.width),
          diagonal(level.weight),
          right(diagonal.size()),
          down(diagonal.size()) {
        const auto edge = [&](std::size_t p, std::size_t q) {
            if (!level.inside[p] || !level.inside[q]) return 0.0;
            const double step = static_cast<double>(std::abs(level.grey[p] - level.grey[q]));
            // The minimum keeps every region connected to its neighbours.
            const double e = static_cast<double>(kSmoothness) *
                             std::max(std::exp(-step / static_cast<double>(kGreyScale)), 1e-6);
            diagonal[p] += e, diagonal[q] += e;
            return e;
        };
        for (std::size_t at = 0; at < diagonal.size(); ++at) {
            if (at % width + 1 < width) right[at] = edge(at, at + 1);
            if (at + width < diagonal.size()) down[at] = edge(at, at + width);
        }
    }

    double times(const Values& v, std::size_t at) const {
        const std::size_t x = at % width;
        double sum = diagonal[at] * v[at];
        if (x > 0) sum -= right[at - 1] * v[at - 1];
        if (x + 1 < width) sum -= right[at] * v[at + 1];
        if (at >= width) sum -= down[at - width] * v[at - width];
        if (at + width < v.size()) sum -= down[at] * v[at + width];
        return sum;
    }
};

/// Solves system * x = b, starting from x, with the diagonal as the preconditioner.
void conjugate_gradients(const System& system, const Values& b, Values& x) {
    const std::size_t n = b.size();
    Values r(n), z(n), p(n), q(n), partial(kSumBlocks);
    const auto dot = [&](const Values& u, const Values& v) {
        double sum = 0;
        add_sum(
            Cpu{}, static_cast<int>(n), [&](int i) { return u[i] * v[i]; }, 1,
            {partial.data(), partial.size()}, &sum);
        return sum;
    };
    const auto precondition = [&](std::size_t at) {
        z[at] = system.diagonal[at] > 0 ? r[at] / system.diagonal[at] : 0;
    };
    const double enough = kResidual * kResidual * dot(b, b);
    for_each_pixel(n, [&](std::size_t at) {
        r[at] = b[at] - system.times(x, at);
        precondition(at);
    });
    p = z;
    double rz = dot(r, z);
    for (int step = 0; step < kSteps && dot(r, r) > enough; ++step) {
        for_each_pixel(n, [&](std::size_t at) { q[at] = system.times(p, at); });
        const double along = dot(p, q);
        if (!(along > 0)) break;  // converged
        const double alpha = rz / along;
        for_each_pixel(n, [&](std::size_t at) {
            x[at] += alpha * p[at];
            r[at] -= alpha * q[at];
            precondition(at);
        });
        const double next = dot(r, z), beta = next / rz;
        rz = next;
        for_each_pixel(n, [&](std::size_t at) { p[at] = z[at] + beta * p[at]; });
    }
}

/// Starts from the solution at half the size: an iteration propagates by one pixel, and holes are
/// wider than the number of iterations.
Values solve(const Level& level) {
    const System system(level);
    const std::size_t n = level.weight.size();
    Values b(n), x(n);
    double sum = 0, weights = 0;
    for (std::size_t at = 0; at < n; ++at) {
        b[at] = level.weight[at] * level.value[at];
        sum += b[at], weights += level.weight[at];
    }
    if (std::max(level.width, level.height) > kCoarsest) {
        const Level coarse = halved(level);
        const Values half = solve(coarse);
        for (std::size_t at = 0; at < n; ++at)
            x[at] = half[at / level.width / 2 * coarse.width + at % level.width / 2];
    } else {
        std::ranges::fill(x, sum / weights);
    }
    conjugate_gradients(system, b, x);
    return x;
}

}  // namespace

std::vector<float> complete_depth(const SparseDepth& known) {
    const std::size_t n = known.depth.size();
    Level level{static_cast<std::size_t>(known.width_px),
                static_cast<std::size_t>(known.height_px),
                Values(n),
                Values(n),
                known.grey,
                std::vector<char>(n)};
    double low = 1e300, high = 0, sum = 0, count = 0;
    for (std::size_t at = 0; at < n; ++at) {
        level.inside[at] = known.mask.empty() || known.mask[at] >= kObjectMask;
        if (!level.inside[at] || !(known.depth[at] > 0) || !(known.weight[at] > 0)) continue;
        level.weight[at] = static_cast<double>(known.weight[at]);
        level.value[at] = 1 / static_cast<double>(known.depth[at]);
        low = std::min(low, level.value[at]), high = std::max(high, level.value[at]);
        sum += level.value[at], ++count;
    }
    std::vector<float> depth(n);
    if (count == 0) return depth;

    const double unit = sum / count;  // scales values to about 1 for any scene
    for (double& v : level.value) v /= unit;
    const Values z = solve(level);
    for (std::size_t at = 0; at < n; ++at)
        if (level.inside[at])
            depth[at] = static_cast<float>(1 / std::clamp(z[at] * unit, low, high));
    return depth;
}

}  // namespace tvsgs
