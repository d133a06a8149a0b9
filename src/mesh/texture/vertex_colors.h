// Vertex colours of a mesh from renders of the views that see them.
#pragma once

#include "core/device/parallel.h"
#include "mesh/fuse/depth_view.h"

namespace tvsgs {

struct ColorSum {
    Vec3f color{};
    float weight = 0;
};

/// Adds the view's pixel at the vertex, weighted by its resolution and by the distance between
/// vertex and depth, in pixels. At eight pixels and more it shows another surface.
struct AddColorBody {
    Camera camera;
    Span<const float> depth;  // [H W] 0: none
    Span<const Vec3f> color;  // [H W]
    Span<const Vec3f> vertices;
    Span<ColorSum> sums;

    TVSGS_HD void operator()(int i) const {
        const Vec3f p = camera.camera_from_world * vertices[i];
        if (!(p.z > 0)) return;
        const float u = camera.fx_px * p.x / p.z + camera.cx_px,
                    v = camera.fy_px * p.y / p.z + camera.cy_px;
        if (!(u >= 0 && u < static_cast<float>(camera.width_px) && v >= 0 &&
              v < static_cast<float>(camera.height_px)))
            return;
        const int at = static_cast<int>(v) * camera.width_px + static_cast<int>(u);
        const float resolution = camera.fx_px / p.z, d = resolution * (p.z - depth[at]);
        if (!(depth[at] > 0) || !(d * d < 64) || !is_finite(color[at])) return;
        const float falloff = 1 / (1 + d * d), weight = resolution * resolution * falloff * falloff;
        sums[i].color += weight * color[at];
        sums[i].weight += weight;
    }
};

/// Adds the colours of one view to the vertices.
void add_colors(const DepthView<Cpu>& view,
                const Buffer<Vec3f, Cpu>& vertices,
                Buffer<ColorSum, Cpu>& sums);
void add_colors(const DepthView<Cuda>& view,
                const Buffer<Vec3f, Cuda>& vertices,
                Buffer<ColorSum, Cuda>& sums);

}  // namespace tvsgs
