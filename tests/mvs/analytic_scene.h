// A textured ball in front of a slanted wall, seen by cameras on an arc. Every pixel's depth and
// normal are known.
#pragma once

#include <cmath>
#include <functional>

#include "core/scene/scene.h"

namespace tvsgs::test {

struct Surface {
    double depth = 0;  // z; 0: nothing there
    Vec3d point, normal;
    bool is_ball = false;
};

constexpr double kBallRadius = 0.9;
inline const Vec3d kWallNormal = normalize(Vec3d{0.2, -0.3, -1});
constexpr double kWallOffset = -1.3;  // normal . x

/// The surface that the ray through image point (u, v) meets. The ball is at the origin.
inline Surface trace(const Camera& camera, double u, double v) {
    const Rigid3d world_from_camera =
        inverse(Rigid3d{mat_cast<double>(camera.camera_from_world.R),
                        vec_cast<double>(camera.camera_from_world.t)});
    const Vec3d ray_camera{(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, 1};
    const Vec3d ray = world_from_camera.R * ray_camera, from = world_from_camera.t;
    Surface out;
    const double wall = (kWallOffset - dot(kWallNormal, from)) / dot(kWallNormal, ray);
    if (wall > 0) out = {wall, from + wall * ray, kWallNormal, false};
    const double a = dot(ray, ray), b = dot(ray, from);
    const double c = dot(from, from) - kBallRadius * kBallRadius, root = b * b - a * c;
    if (root > 0) {
        const double near = (-b - std::sqrt(root)) / a;
        const Vec3d point = from + near * ray;
        if (near > 0 && (out.depth == 0 || near < out.depth))
            out = {near, point, normalize(point), true};
    }
    return out;
}

/// Smooth noise in [0, 1] with features of about 1 unit.
inline double noise(Vec3d p) {
    const auto lattice = [](int x, int y, int z) {
        auto h = static_cast<unsigned>(x) * 73856093u ^ static_cast<unsigned>(y) * 19349663u ^
                 static_cast<unsigned>(z) * 83492791u;
        h = (h ^ h >> 13) * 1274126177u;
        return static_cast<double>((h ^ h >> 16) & 0xffff) / 65535;
    };
    const auto floor_of = [](double v) { return static_cast<int>(std::floor(v)); };
    const int x = floor_of(p.x), y = floor_of(p.y), z = floor_of(p.z);
    double sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
        const int i = corner & 1, j = corner >> 1 & 1, k = corner >> 2;
        const auto weight = [](double t, int side) {
            const double s = t * t * (3 - 2 * t);
            return side != 0 ? s : 1 - s;
        };
        sum += weight(p.x - x, i) * weight(p.y - y, j) * weight(p.z - z, k) *
               lattice(x + i, y + j, z + k);
    }
    return sum;
}
inline double texture(Vec3d p) {
    return 0.15 + 0.45 * noise(17.0 * p) + 0.3 * noise(36.0 * p + Vec3d{7, 3, 5});
}

/// Looks at the origin from 4 units away, `angle` radians around the vertical.
inline Camera arc_camera(int width, int height, double angle) {
    Camera c;
    c.width_px = width, c.height_px = height;
    c.fx_px = 1.5f * float(width), c.fy_px = 1.48f * float(width);
    c.cx_px = 0.51f * float(width), c.cy_px = 0.48f * float(height);
    const double half = angle / 2;
    c.camera_from_world.R = rotation(Quatf{float(std::cos(half)), 0, float(std::sin(half)), 0});
    c.camera_from_world.t = {0.02f, -0.03f, 4};
    return c;
}

/// Grey value of a surface point in [0, 1].
using Shade = std::function<double(const Surface&)>;

inline View photograph(const Camera& camera, const Shade& shade) {
    View view;
    view.name = "view.png";
    view.camera = camera;
    view.photo = ImageU8(camera.width_px, camera.height_px, 3);
    for (int y = 0; y < camera.height_px; ++y)
        for (int x = 0; x < camera.width_px; ++x) {
            double sum = 0;
            for (int s = 0; s < 9; ++s) {
                const Surface surface = trace(camera, x + (s % 3 + 0.5) / 3, y + (s / 3 + 0.5) / 3);
                sum += surface.depth > 0 ? shade(surface) : 0.5;
            }
            const auto value = static_cast<std::uint8_t>(std::lround(255 * sum / 9));
            view.photo.at(x, y, 0) = value;
            view.photo.at(x, y, 1) = static_cast<std::uint8_t>(value / 2 + 60);
            view.photo.at(x, y, 2) = value;
        }
    return view;
}

inline std::vector<View> arc_views(
    int count, const Shade& shade, int width = 128, int height = 96, double step = 0.2) {
    std::vector<View> views;
    for (int i = 0; i < count; ++i) {
        views.push_back(
            photograph(arc_camera(width, height, step * (i - 0.5 * (count - 1))), shade));
        views.back().name = "view" + std::to_string(i) + ".png";
    }
    return views;
}

}  // namespace tvsgs::test
