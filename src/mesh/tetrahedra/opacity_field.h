// Opacity field: which points in space the views see through the splats. Its zeros are the surface.
// docs/method/tetrahedra.md
#pragma once

#include <vector>

#include "core/scene/gaussians.h"
#include "core/scene/scene.h"
#include "mesh/fuse/depth_view.h"
#include "mesh/tetrahedra/opacity_math.h"
#include "render/tiles/tiles.h"

namespace tvsgs {

/// Image region in which a splat may reach kMinAlpha: an ellipse, as in SplatShape, from a depth
/// on. Slightly too large.
struct alignas(16) FieldShape {
    Vec2f mean;
    EllipseRoot<float> root;
    float reach, front;
};

/// Points lie anywhere in a pixel, but tiles are given by their pixels' centres.
TVSGS_HD inline bool may_draw(const FieldShape& s, Vec2f low, Vec2f high) {
    return may_draw(SplatShape<float>{s.mean, s.root, 1, s.reach},
                    Vec2f{low.x - 0.5f, low.y - 0.5f}, Vec2f{high.x + 0.5f, high.y + 0.5f});
}

/// The splats for the field, all [N]: activated, with the 3D filter if there is one. Made on the
/// host for both devices.
template <class Device>
struct FieldSplats {
    Buffer<Vec3f, Device> means, scales;
    Buffer<Quatf, Device> quats;  // unit
    Buffer<float, Device> opacities;

    int size() const { return static_cast<int>(means.size()); }
};
FieldSplats<Cpu> field_splats(const Gaussians<Cpu>& gaussians);

template <class From, class To>
void copy(const FieldSplats<From>& from, FieldSplats<To>& to) {
    copy(from.means, to.means), copy(from.scales, to.scales);
    copy(from.quats, to.quats), copy(from.opacities, to.opacities);
}

/// Device memory per splat: FieldSplats, and a view's records and lists of about ten tiles.
inline constexpr int kFieldBytesPerSplat = 500;

/// The views that see the points.
struct FieldViews {
    const std::vector<View>& views;
    bool masks;  // a point outside of a view's mask is not in its image
    float near;  // nor are splats and points nearer to a camera's plane
};

/// Counts the views that see each point; `sights` is resized and overwritten. Transmittance is prod
/// (1 - alpha) over all splats, with the largest alpha up to the point.
template <class Device>
void see_points(const FieldSplats<Device>& splats,
                const FieldViews& views,
                const Buffer<Vec3f, Device>& points,
                Buffer<Sight, Device>& sights);

/// Bisects segments between a free and an inside end, `steps` times, and sets both ends to the
/// middle of the remaining segment.
template <class Device>
void find_crossings(const FieldSplats<Device>& splats,
                    const FieldViews& views,
                    int steps,
                    Buffer<Vec3f, Device>& free_ends,
                    Buffer<Vec3f, Device>& inside_ends);

/// Colour of a vertex from renders of the views that see it.
struct ColorSum {
    Vec3f color{};
    float weight = 0;
};

/// Adds the view's pixel at each vertex, weighted by its resolution and by the distance between
/// vertex and depth, in pixels. At eight pixels and more it shows another surface.
template <class Device>
void add_colors(const DepthView<Device>& view,
                const Buffer<Vec3f, Device>& vertices,
                Buffer<ColorSum, Device>& sums);

}  // namespace tvsgs
