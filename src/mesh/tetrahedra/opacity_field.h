// Opacity field: which points in space the views see through the splats, by the exact opacity of a
// Gaussian along a ray up to a point. Its zeros are the surface. docs/method/tetrahedra.md
#pragma once

#include <vector>

#include "core/device/parallel.h"
#include "core/math/fast_math.h"
#include "core/scene/camera.h"
#include "core/scene/gaussians.h"
#include "core/scene/scene.h"
#include "mesh/fuse/depth_view.h"
#include "render/tiles/blend_math.h"
#include "render/tiles/tiles.h"

namespace tvsgs {

/// A Gaussian relative to a camera's centre, in its own axes, each in units of its standard
/// deviation over the smallest one's: flat splats give no large numbers. Its size is a multiple of
/// 16 bytes.
template <class Real>
struct alignas(16) RayGaussian {
    Mat3<Real> W;      // from the camera frame
    Vec3<Real> start;  // the camera's centre
    Real variance;     // of the thinnest axis, world units
    Real opacity;
    Real reach2;  // squared standard deviations up to which alpha is at least kMinAlpha
    Real unused = 0;
};

/// Scales limited to at least a millionth of the largest; thinner splats are no thinner in float.
template <class Real>
TVSGS_HD Vec3<Real> kept_scales(Vec3<Real> s) {
    const Real largest = s.x > s.y ? (s.x > s.z ? s.x : s.z) : (s.y > s.z ? s.y : s.z);
    const Real least = Real(1e-6) * largest;
    return {s.x > least ? s.x : least, s.y > least ? s.y : least, s.z > least ? s.z : least};
}

/// `axes`: of the splat as columns, in the camera frame; `scales`: kept_scales().
template <class Real>
TVSGS_HD RayGaussian<Real> ray_gaussian(const Mat3<Real>& axes,
                                        Vec3<Real> scales,
                                        Vec3<Real> mean_camera,
                                        Real opacity) {
    RayGaussian<Real> g;
    Real smallest = scales.x < scales.y ? scales.x : scales.y;
    smallest = scales.z < smallest ? scales.z : smallest;
    for (int k = 0; k < 3; ++k) {
        const Real weight = smallest / scales[k];
        for (int c = 0; c < 3; ++c) g.W[k][c] = weight * axes[c][k];
    }
    g.start = -(g.W * mean_camera);
    g.variance = smallest * smallest;
    g.opacity = opacity;
    g.reach2 = 2 * splat_reach(opacity);
    return g;
}

/// The largest alpha between the camera and depth z > 0 along `ray` (z = 1, camera frame); 0 below
/// kMinAlpha. The squared distance from the mean, in standard deviations, is a parabola over depth
/// with its minimum where the ray is nearest to the mean.
template <class Real>
TVSGS_HD Real alpha_up_to(const RayGaussian<Real>& g, Vec3<Real> ray, Real z) {
    const Vec3<Real> b = g.W * ray, moment = cross(g.start, b);
    const Real bb = dot(b, b), unit = bb * g.variance;
    // In units of `unit`: most splats are out of reach, and this test needs no division.
    Real distance2 = dot(moment, moment);
    const Real limit = (g.reach2 + Real(1e-3)) * unit;
    if (!(distance2 < limit)) return 0;
    const Real along = dot(g.start, b);  // -bb times the depth nearest to the mean
    const Real y = along > 0 ? along : z * bb + along < 0 ? z * bb + along : Real(0);
    distance2 += y * y;
    if (!(distance2 < limit)) return 0;
    const Real alpha = g.opacity * ExactMath::decay(Real(0.5) * distance2 / unit);
    if (!(alpha >= Real(kMinAlpha))) return 0;
    return alpha < Real(kMaxAlpha) ? alpha : Real(kMaxAlpha);
}

/// Image of the ellipsoid in which a Gaussian reaches kMinAlpha: an ellipse.
template <class Real>
struct EllipsoidImage {
    Vec2<Real> mean;   // px
    Sym2<Real> shape;  // px^2: squared half-widths on the diagonal
    Real half_depth;   // world units
    bool bounded;      // else it reaches to the camera's plane and may be anywhere in the image
};

/// The dual conic of the ellipsoid (x - mean)^T Sigma^-1 (x - mean) <= reach2, without the terms
/// that cancel. `axes`: of the splat as columns, in the camera frame.
template <class Real>
TVSGS_HD EllipsoidImage<Real> ellipsoid_image(
    const Camera& camera, const Mat3<Real>& axes, Vec3<Real> scales, Vec3<Real> mean, Real reach2) {
    Sym3<Real> N{};  // reach2 Sigma
    for (int k = 0; k < 3; ++k) add_outer(N, reach2 * scales[k] * scales[k], column(axes, k));
    const Real D = mean.z * mean.z - N.zz;
    EllipsoidImage<Real> image{};
    image.half_depth = std::sqrt(N.zz);
    image.bounded = D > Real(1e-3) * mean.z * mean.z;
    if (!image.bounded) return image;
    const Real fx = static_cast<Real>(camera.fx_px), fy = static_cast<Real>(camera.fy_px);
    image.mean = {fx * (mean.x * mean.z - N.xz) / D + static_cast<Real>(camera.cx_px),
                  fy * (mean.y * mean.z - N.yz) / D + static_cast<Real>(camera.cy_px)};
    const Real x = mean.x, y = mean.y, z = mean.z, over = 1 / (D * D);
    image.shape = {
        fx * fx * over *
            (N.xx * z * z - 2 * N.xz * x * z + N.zz * x * x - (N.xx * N.zz - N.xz * N.xz)),
        fx * fy * over *
            (N.xy * z * z - N.xz * y * z - N.yz * x * z + N.zz * x * y -
             (N.xy * N.zz - N.xz * N.yz)),
        fy * fy * over *
            (N.yy * z * z - 2 * N.yz * y * z + N.zz * y * y - (N.yy * N.zz - N.yz * N.yz))};
    return image;
}

/// A point is clear in a view if half of its light reaches the camera.
inline constexpr float kClear = 0.5f;

/// Number of views whose image contains a point, and number in which it is clear. Stops counting
/// when is_free() is decided.
struct Sight {
    int views = 0, clear = 0;
};

/// Views in which a point of free space is clear, if more have it in their image; with one, a wrong
/// view would dig a pit.
inline constexpr int kClearViews = 2;

/// Whether a point lies in free space. One clear view is enough if up to two have it in their
/// image.
TVSGS_HD inline bool is_free(Sight sight) {
    return sight.clear >= (sight.views > kClearViews ? kClearViews : 1);
}

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
