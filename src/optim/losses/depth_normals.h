// Normals of a depth map, and their derivatives by depth; shared by the terms that compare normals.
#pragma once

#include "core/device/parallel.h"
#include "core/scene/camera.h"
#include "render/depth/normal_math.h"

namespace tvsgs {

/// Normal of an inner pixel whose four neighbours have depth; returns false for other pixels.
TVSGS_HD inline bool depth_normal_at(const Camera& camera,
                                     Span<const float> depth,
                                     int at,
                                     DepthNormal<float>& n) {
    const int w = camera.width_px, x = at % w, y = at / w;
    if (x == 0 || y == 0 || x == w - 1 || y == camera.height_px - 1) return false;
    if (!(depth[at - 1] > 0) || !(depth[at + 1] > 0) || !(depth[at - w] > 0) ||
        !(depth[at + w] > 0))
        return false;
    n = depth_normal(
        depth[at - 1] * pixel_ray(camera, x - 1, y), depth[at + 1] * pixel_ray(camera, x + 1, y),
        depth[at - w] * pixel_ray(camera, x, y - 1), depth[at + w] * pixel_ray(camera, x, y + 1));
    return true;
}

/// Sums dL/ddepth of a pixel over the neighbours whose normals depend on it.
struct NormalDepthBody {
    Camera camera;
    Span<const DepthNormalGradients<float>> neighbours;
    Span<const float> depth;
    Span<float> dL_ddepth;  // added to

    TVSGS_HD void operator()(int at) const {
        if (!(depth[at] > 0)) return;
        const int w = camera.width_px, x = at % w, y = at / w;
        Vec3f dL_dpoint{};
        if (x > 0) dL_dpoint += neighbours[at - 1].dL_da;
        if (x < w - 1) dL_dpoint -= neighbours[at + 1].dL_da;
        if (y < camera.height_px - 1) dL_dpoint += neighbours[at + w].dL_db;
        if (y > 0) dL_dpoint -= neighbours[at - w].dL_db;
        dL_ddepth[at] += dot(dL_dpoint, pixel_ray(camera, x, y));
    }
};

}  // namespace tvsgs
