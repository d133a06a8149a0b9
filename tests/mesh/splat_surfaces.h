// Flat, opaque splats on known surfaces, and views of them.
#pragma once

#include <cmath>
#include <vector>

#include "core/scene/gaussians.h"
#include "core/scene/scene.h"
#include "mesh/sphere_views.h"

namespace tvsgs::test {

/// Sets splat `i`; its third axis is the unit vector n.
inline void set_flat_splat(
    Gaussians<Cpu>& g, int i, Vec3d mean, Vec3d n, double size, double thickness) {
    const auto at = static_cast<std::size_t>(i);
    g.means[at] = vec_cast<float>(mean);
    const auto broad = static_cast<float>(std::log(size));
    g.log_scales[at] = {broad, broad, static_cast<float>(std::log(thickness))};
    // Rotates the z axis to n.
    g.quats[at] =
        n.z > -0.999 ? quat_cast<float>(Quat<double>{1 + n.z, -n.y, n.x, 0}) : Quatf{0, 1, 0, 0};
    g.opacity_logits[at] = 6;
    g.sh[at] = {1, 0, -1};
}

/// Splats on a Fibonacci sphere about the origin; neighbours overlap.
inline Gaussians<Cpu> sphere_splats(int count, double radius, double flatness) {
    Gaussians<Cpu> g;
    resize(g, count, 0);
    const double size = 2 * radius / std::sqrt(count);
    for (int i = 0; i < count; ++i) {
        const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
        const double angle = M_PI * (1 + std::sqrt(5.0)) * i;
        const Vec3d n{r * std::cos(angle), r * std::sin(angle), z};
        set_flat_splat(g, i, radius * n, n, size, flatness * size);
    }
    return g;
}

/// n x n splats on the square [-1, 1]^2 of the plane z = 0.
inline Gaussians<Cpu> plane_splats(int n, double flatness) {
    Gaussians<Cpu> g;
    resize(g, n * n, 0);
    const double size = 1.2 / n;
    for (int i = 0; i < n * n; ++i) {
        const auto to = [&](int k) { return (2 * k + 1.0) / n - 1; };
        set_flat_splat(g, i, {to(i % n), to(i / n), 0}, {0, 0, 1}, size, flatness * size);
    }
    return g;
}

inline View view_from(Vec3d centre, int size_px) {
    View view;
    view.name = "a view";
    view.camera = look_at_origin(centre, size_px);
    return view;
}

/// Cameras at distance 3 from the origin, all around.
inline std::vector<View> views_around(int count, int size_px) {
    std::vector<View> views;
    for (int i = 0; i < count; ++i) {
        const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
        const double angle = M_PI * (1 + std::sqrt(5.0)) * (i + 0.5);
        views.push_back(
            view_from(3.0 * Vec3d{r * std::cos(angle), r * std::sin(angle), z}, size_px));
    }
    return views;
}

}  // namespace tvsgs::test
