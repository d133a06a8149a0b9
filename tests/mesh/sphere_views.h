// A unit sphere with exact depth maps of cameras all around: the input of the fusion oracles.
#pragma once

#include <cmath>
#include <vector>

#include "core/scene/camera.h"
#include "mesh/fuse/tsdf.h"

namespace tvsgs::test {

/// A host depth map with its camera.
struct DepthMap {
    Camera camera;
    std::vector<float> depth;
    std::vector<Vec3f> color;

    DepthView<Cpu> view() const {
        return {camera, {depth.data(), depth.size()}, {color.data(), color.size()}};
    }
};

/// Camera at `centre` looking at the origin; focal length equal to the width, principal point in
/// the middle.
inline Camera look_at_origin(Vec3d centre, int size_px) {
    const Vec3d z = normalize(-centre);
    const Vec3d up = std::abs(z.z) < 0.9 ? Vec3d{0, 0, 1} : Vec3d{0, 1, 0};
    const Vec3d x = normalize(cross(z, up)), y = cross(z, x);
    const Mat3<double> R{{{x.x, x.y, x.z}, {y.x, y.y, y.z}, {z.x, z.y, z.z}}};
    Camera camera;
    camera.width_px = camera.height_px = size_px;
    camera.fx_px = camera.fy_px = static_cast<float>(size_px);
    camera.cx_px = camera.cy_px = 0.5f * static_cast<float>(size_px);
    camera.camera_from_world = {mat_cast<float>(R), vec_cast<float>(-(R * centre))};
    return camera;
}

/// Camera `i` of `count` on a Fibonacci sphere of radius 3 around the unit sphere at the origin;
/// colours by position. The background is empty, or a white dome about the origin.
inline DepthMap sphere_view(int i, int count, int size_px, double dome_radius = 0) {
    const double theta = 3.14159265358979 * (1 + std::sqrt(5.0)) * (i + 0.5);
    const double cos_phi = 1 - 2 * (i + 0.5) / count, sin_phi = std::sqrt(1 - cos_phi * cos_phi);
    const Vec3d centre{3 * std::cos(theta) * sin_phi, 3 * std::sin(theta) * sin_phi, 3 * cos_phi};
    DepthMap map;
    map.camera = look_at_origin(centre, size_px);
    const Rigid3d world_from_camera =
        inverse(Rigid3d{mat_cast<double>(map.camera.camera_from_world.R),
                        vec_cast<double>(map.camera.camera_from_world.t)});
    for (int y = 0; y < size_px; ++y)
        for (int x = 0; x < size_px; ++x) {
            // |centre + s * ray|^2 = 1, with s the z-depth.
            const Vec3d ray = world_from_camera.R * vec_cast<double>(pixel_ray(map.camera, x, y));
            const double a = dot(ray, ray), b = dot(centre, ray);
            const auto root = [&](double radius) {
                return b * b - a * (dot(centre, centre) - radius * radius);
            };
            const bool hit = root(1) >= 0;
            const double s = hit               ? (-b - std::sqrt(root(1))) / a
                             : dome_radius > 0 ? (-b + std::sqrt(root(dome_radius))) / a
                                               : 0;
            const Vec3d p = centre + s * ray;
            map.depth.push_back(static_cast<float>(s));
            map.color.push_back(hit     ? vec_cast<float>(0.5 * (p + Vec3d{1, 1, 1}))
                                : s > 0 ? Vec3f{1, 1, 1}
                                        : Vec3f{});
        }
    return map;
}

}  // namespace tvsgs::test
