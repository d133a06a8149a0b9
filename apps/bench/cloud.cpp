#include "apps/bench/cloud.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "tv/vote_math.h"

namespace tvsgs {
namespace {

struct SurfacePoint {
    Vec3d position, normal;
    double spacing;
};

SurfacePoint on_sphere(int count, Draws& draw) {
    // Heights by an exponential map of even draws: the density falls by this factor from z = -1 to
    // 1.
    const double a = std::log(16.0), u = draw.uniform();
    const double z = 2 * std::expm1(a * u) / std::expm1(a) - 1;
    const double stretch = a * std::exp(a * u) / std::expm1(a);  // 1: even
    const double angle = draw.uniform(0, 2 * kPi), r = std::sqrt(std::max(0.0, 1 - z * z));
    const Vec3d n{r * std::cos(angle), r * std::sin(angle), z};
    return {n, n, std::sqrt(4 * kPi * stretch / count)};
}

SurfacePoint on_planes(int count, Draws& draw) {
    const bool first = draw.uniform() < 0.5;
    const double a = draw.uniform(-1, 1), b = draw.uniform(-1, 1), h = std::sqrt(8.0 / count);
    return first ? SurfacePoint{{a, b, 0}, {0, 0, 1}, h} : SurfacePoint{{0, a, b}, {1, 0, 0}, h};
}

SurfacePoint in_cluster(int count, Draws& draw) {
    const int which = std::min(static_cast<int>(draw.uniform(0, 5)), 4);
    const double size = 1e-3 * std::pow(10.0, 0.5 * which);
    const Vec3d centre{0.8 * std::cos(2 * kPi * which / 5), 0.8 * std::sin(2 * kPi * which / 5), 0};
    const Vec3d p = draw.normal3();
    return {centre + size * Vec3d{p.x, p.y, 0}, {0, 0, 1}, size * std::sqrt(4 * kPi * 5 / count)};
}

/// Scales, rotation and place of a splat at `point`.
void put(Gaussians<Cpu>& g, std::size_t i, const SurfacePoint& point, bool stray, Draws& draw) {
    const double h = point.spacing;
    const Vec3d tilt = draw.normal3(), deviates = draw.normal3();
    const Vec3d n = stray ? draw.direction() : normalize(point.normal + 0.1 * tilt);
    const double base = stray ? 3 * h : 0.7 * h;
    const double a = base * std::exp(0.5 * deviates.x), b = base * std::exp(0.5 * deviates.y);
    const double thin = 0.03 * std::min(a, b) * std::exp(0.5 * deviates.z);
    const double off = stray ? 0 : 0.1 * h * draw.normal3().x;
    g.means[i] = vec_cast<float>(point.position + off * point.normal);
    g.log_scales[i] = {static_cast<float>(std::log(a)), static_cast<float>(std::log(b)),
                       static_cast<float>(std::log(thin))};
    g.quats[i] = quat_cast<float>(turned_to(n, draw.uniform(0, kPi)));
}

}  // namespace

Quat<double> turned_to(Vec3d to, double turn) {
    const Vec3d half = to + Vec3d{0, 0, 1};
    const Quat<double> q = norm(half) < 1e-6 ? Quat<double>{0, 1, 0, 0}
                                             : normalize(Quat<double>{half.z, -half.y, half.x, 0});
    const double c = std::cos(turn), s = std::sin(turn);
    return {q.w * c - q.z * s, q.x * c + q.y * s, q.y * c - q.x * s, q.z * c + q.w * s};
}

const std::vector<std::string>& bench_shapes() {
    static const std::vector<std::string> shapes = {"sphere", "planes",     "cluster",
                                                    "line",   "coincident", "outliers"};
    return shapes;
}

Gaussians<Cpu> make_bench_cloud(const std::string& shape, int count, std::uint64_t seed) {
    const auto& shapes = bench_shapes();
    if (std::ranges::find(shapes, shape) == shapes.end())
        throw Error(ExitCode::usage, "--shape ", shape, ": unknown shape");
    Gaussians<Cpu> g;
    resize(g, count, 0);
    fill_zero(g);
    const bool strays = shape != "line" && shape != "coincident";
    for (int i = 0; i < count; ++i) {
        Draws draw(seed, i);
        const double kind = draw.uniform();
        SurfacePoint point = shape == "planes"    ? on_planes(count, draw)
                             : shape == "cluster" ? in_cluster(count, draw)
                                                  : on_sphere(count, draw);
        if (shape == "line") point = {{draw.uniform(-1, 1), 0, 0}, {0, 0, 1}, 2.0 / count};
        const bool stray = strays && kind < 0.02;
        if (stray) point.position = 1.5 * std::cbrt(draw.uniform()) * draw.direction();
        if (shape == "outliers" && !stray && kind < 0.22)
            point.position = 2 * std::pow(5e5, draw.uniform()) * draw.direction();
        if (shape == "outliers" && i == count / 2) point.position = {1e12, 0, 0};
        put(g, std::size_t(i), point, stray, draw);
        if (shape == "coincident" && kind < 0.5) g.means[i] = {0.5f, 0.5f, 0.5f};
        if (shape == "line") g.means[i] = vec_cast<float>(point.position);
        if (shape == "cluster" && kind > 0.99 && i > 0) g.means[i] = g.means[std::size_t(i) - 1];
    }
    return g;
}

}  // namespace tvsgs
