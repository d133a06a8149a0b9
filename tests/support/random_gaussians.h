// Seeded Gaussians and cameras for rendering tests.
#pragma once

#include "core/scene/camera.h"
#include "core/scene/gaussians.h"
#include "support/numeric.h"

namespace tvsgs::test {

/// `count` Gaussians in a cube of half-width 1 around the origin, of all shapes and opacities; SH
/// degree 3.
inline Gaussians<Cpu> random_gaussians(int count,
                                       unsigned seed,
                                       double size = 0.05,
                                       int sh_degree = 3) {
    Random random(seed);
    Gaussians<Cpu> g;
    resize(g, count, sh_degree);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const double log_size = std::log(size) + 0.4 * random.normal();
        g.means[i] = {float(random.uniform(-1, 1)), float(random.uniform(-1, 1)),
                      float(random.uniform(-1, 1))};
        g.log_scales[i] = {float(log_size + 0.5 * random.normal()),
                           float(log_size + 0.5 * random.normal()), float(log_size - 1.5)};
        g.quats[i] = quat_cast<float>(random.quat());
        g.opacity_logits[i] = float(random.uniform(-3, 3));
        for (std::size_t k = 0; k < std::size_t(sh_count(sh_degree)); ++k)
            g.sh[k * g.means.size() + i] = vec_cast<float>((k == 0 ? 0.6 : 0.1) * random.normal3());
    }
    return g;
}

/// Looks at the origin from 4 units away; the principal point is off-centre on purpose.
inline Camera test_camera(int width, int height, float angle = 0.3f) {
    Camera c;
    c.width_px = width, c.height_px = height;
    c.fx_px = 1.3f * float(width), c.fy_px = 1.25f * float(width);
    c.cx_px = 0.52f * float(width), c.cy_px = 0.47f * float(height);
    c.camera_from_world.R = rotation(Quatf{std::cos(angle / 2), 0, std::sin(angle / 2), 0});
    c.camera_from_world.t = {0.05f, -0.1f, 4};
    return c;
}

}  // namespace tvsgs::test
