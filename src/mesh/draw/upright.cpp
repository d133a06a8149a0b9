#include "core/math/eigen.h"
#include "mesh/draw/mesh_render.h"

namespace tvsgs {

Mat3<double> upright_from_scene(const std::vector<Camera>& cameras) {
    // Greater than the effect of a camera roll of 3 degrees on the rows.
    constexpr double kTrustInMean = 0.003;
    constexpr double kSteep = 0.3;  // weight for the sign: decides beyond 73 degrees
    if (cameras.empty()) return {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    const auto axis_of = [](const Camera& camera, int row) {
        const float* const r = camera.camera_from_world.R[row];
        return Vec3d{r[0], r[1], r[2]};
    };
    // 1. Up minimises the component along the pixel rows. It maximises the one along the mean
    // upward axis and, as far as these axes cancel, against the mean viewing direction.
    const double share = 1 / static_cast<double>(cameras.size());
    Sym3<double> spread;
    Vec3d mean_up, mean_back;
    for (const Camera& camera : cameras) {
        add_outer(spread, share, axis_of(camera, 0));
        mean_up -= share * axis_of(camera, 1), mean_back -= share * axis_of(camera, 2);
    }
    add_outer(spread, -kTrustInMean, mean_up);
    add_outer(spread, -kTrustInMean * (1 - dot(mean_up, mean_up)), mean_back);
    const Vec3d least = column(sym_eigen(spread).vectors, 2);
    const Vec3d up = dot(least, mean_up + kSteep * mean_back) < 0 ? -least : least;

    // 2. The front faces the middle camera or, where that looks along `up`, the lower edge of its
    // image.
    const Camera& middle = cameras[cameras.size() / 2];
    const auto level = [&](Vec3d v) { return v - dot(v, up) * up; };
    Vec3d front = level(-axis_of(middle, 2));
    if (!(norm(front) > 1e-3)) front = level(axis_of(middle, 1));
    front = normalize(front);
    const Vec3d right = cross(up, front);
    return {{{right.x, right.y, right.z}, {up.x, up.y, up.z}, {front.x, front.y, front.z}}};
}

}  // namespace tvsgs
