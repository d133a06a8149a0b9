#include "apps/prepare/rays.h"

#include <algorithm>

namespace tvsgs::prepare {

Ray ray_of(const Intrinsics& in, const Rigid3d& camera_from_world, Vec2<double> pixel) {
    const Vec2<double> uv = undistort(
        in.distortion, {(pixel.x - in.cx_px) / in.fx_px, (pixel.y - in.cy_px) / in.fy_px});
    const Rigid3d world_from_camera = inverse(camera_from_world);
    return {world_from_camera.t, normalize(world_from_camera.R * Vec3d{uv.x, uv.y, 1})};
}

std::optional<Vec2<double>> pixel_of(const Intrinsics& in,
                                     const Rigid3d& camera_from_world,
                                     Vec3d point) {
    const Vec3d p = camera_from_world * point;
    if (!(p.z > 0)) return std::nullopt;
    const Vec2<double> uv = distort(in.distortion, {p.x / p.z, p.y / p.z});
    return Vec2<double>{uv.x * in.fx_px + in.cx_px, uv.y * in.fy_px + in.cy_px};
}

std::optional<Vec3d> meeting_point(const std::vector<Ray>& rays) {
    constexpr double kLeastSine = 0.0349;  // 2 degrees
    double widest = 0;
    for (const Ray& a : rays)
        for (const Ray& b : rays) widest = std::max(widest, norm(cross(a.direction, b.direction)));
    if (!(widest >= kLeastSine)) return std::nullopt;
    Vec3d columns[3]{}, wanted{};  // sum of I - d d^T, and of the same times the origins
    for (const Ray& ray : rays) {
        const Vec3d d = ray.direction;
        for (int c = 0; c < 3; ++c) columns[c] += -d[c] * d, columns[c][c] += 1;
        wanted += ray.origin - dot(d, ray.origin) * d;
    }
    const double det = dot(columns[0], cross(columns[1], columns[2]));
    return Vec3d{dot(wanted, cross(columns[1], columns[2])) / det,
                 dot(columns[0], cross(wanted, columns[2])) / det,
                 dot(columns[0], cross(columns[1], wanted)) / det};
}

}  // namespace tvsgs::prepare
