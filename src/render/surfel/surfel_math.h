// One flat splat in the image: the point where a pixel's ray meets its plane, its contribution to
// the pixel, and the derivatives.  [2DGS, Sections 4 and 5]
#pragma once

#include <type_traits>

#include "core/math/fast_math.h"
#include "render/ewa/projection_math.h"

namespace tvsgs {

/// Matrix that maps points of a surfel's plane, (u, v, 1) in standard deviations, to homogeneous
/// pixels relative to the projected centre. So the third entries of `row_x` and `row_y` are 0. With
/// pixels relative to the image's corner, a small splat far from it would lose all digits.
template <class Real>
struct SurfelRows {
    Vec2<Real> row_x, row_y;  // px x world units
    Vec2<Real> row_z;         // world units
    Real depth;               // of the centre: the third entry of the last row
};

/// A surfel in a view: the inverse of its SurfelRows. It maps a pixel to (u, v, 1) / depth, so a
/// hit costs a few multiplications.
template <class Real>
struct alignas(16) SurfelShape {
    Vec2<Real> mean;          // px, the projected centre
    Vec2<Real> row_u, row_v;  // per px and world unit; the third entries are 0
    Vec2<Real> slope;         // of the inverse depth, per px and world unit
    Real inverse_depth;       // of the centre
    Real opacity;
    Vec2<Real> low_pass;   // px from `mean`: centre of the low-pass dot
    Vec2<Real> low, high;  // px from `mean`: box outside which the surfel draws nothing
};

/// Range of alpha.
inline constexpr float kLeastSurfelAlpha = 1.0f / 255, kMostSurfelAlpha = 0.99f;

/// Largest ratio of depths between the hit of a ray and the centre. Beyond it the disc is seen edge
/// on, and the surfel draws nothing at the pixel. (The official code accepts depths from 0.2 world
/// units on, in scenes a few units deep.)
inline constexpr double kSurfelDepthRatio = 20;

/// Axes of a surfel in the camera's frame, in standard deviations, and its centre.
template <class Real>
struct SurfelAxes {
    Vec3<Real> a, b, centre;
};

/// Bounding box of the ellipse at `reach` standard deviations, px from the projected centre.
template <class Real>
struct SurfelBox {
    Vec2<Real> centre, extent;
    bool bounded;  // else the disc reaches the camera's plane, and the box is not valid
};
template <class Real>
TVSGS_HD SurfelBox<Real> surfel_box(const SurfelRows<Real>& s, Real reach) {
    const Real r2 = reach * reach, d0 = r2 * dot(s.row_z, s.row_z) - s.depth * s.depth;
    if (!(d0 < 0)) return {{0, 0}, {0, 0}, false};
    const Real f = r2 / d0;
    const auto side = [&](Vec2<Real> row, Real& centre) {
        centre = f * dot(row, s.row_z);
        const Real squared = centre * centre - f * dot(row, row);
        return std::sqrt(squared > Real(1e-4) ? squared : Real(1e-4));
    };
    SurfelBox<Real> box;
    box.bounded = true;
    box.extent.x = side(s.row_x, box.centre.x);
    box.extent.y = side(s.row_y, box.centre.y);
    return box;
}

/// As in the official code, the low-pass dot is centred in the box of three standard deviations.
inline constexpr float kLowPassReach = 3;

template <class Real>
TVSGS_HD SurfelRows<Real> surfel_rows(const Pinhole<Real>& camera, const SurfelAxes<Real>& axes) {
    const Vec3<Real>&a = axes.a, &b = axes.b, &p = axes.centre;
    const Real x = camera.fx * p.x / p.z, y = camera.fy * p.y / p.z;
    return {{camera.fx * a.x - x * a.z, camera.fx * b.x - x * b.z},
            {camera.fy * a.y - y * a.z, camera.fy * b.y - y * b.z},
            {a.z, b.z},
            p.z};
}

/// Returns false if the surfel is seen edge on, or reaches the camera's plane so that its box is
/// unbounded.
template <class Real>
TVSGS_HD bool surfel_shape(const Pinhole<Real>& camera,
                           const SurfelAxes<Real>& axes,
                           Real opacity,
                           SurfelShape<Real>& s) {
    const SurfelRows<Real> rows = surfel_rows(camera, axes);
    const Vec2<Real>&x = rows.row_x, &y = rows.row_y;
    const Real det = x.x * y.y - x.y * y.x;
    if (!(det * det > Real(1e-12) * dot(x, x) * dot(y, y))) return false;
    s.mean = project_point(camera, axes.centre);
    s.row_u = {y.y / det, -x.y / det}, s.row_v = {-y.x / det, x.x / det};
    s.inverse_depth = 1 / rows.depth;
    s.slope = -s.inverse_depth * (rows.row_z.x * s.row_u + rows.row_z.y * s.row_v);
    s.opacity = opacity;
    const SurfelBox<Real> dot_at = surfel_box(rows, Real(kLowPassReach));
    if (!dot_at.bounded) return false;
    s.low_pass = dot_at.centre;
    const Real reach = std::sqrt(2 * std::log(opacity / Real(kLeastSurfelAlpha)));
    const SurfelBox<Real> box = surfel_box(rows, reach);
    if (!box.bounded) return false;
    const Real blur = reach * Real(0.70710678);  // of the dot
    const auto bounds = [&](Real at, Real half, Real dot_centre, Real& low, Real& high) {
        const Real dot_low = dot_centre - blur, dot_high = dot_centre + blur;
        low = at - half < dot_low ? at - half : dot_low;
        high = at + half > dot_high ? at + half : dot_high;
    };
    bounds(box.centre.x, box.extent.x, s.low_pass.x, s.low.x, s.high.x);
    bounds(box.centre.y, box.extent.y, s.low_pass.y, s.low.y, s.high.y);
    return true;
}

/// Implements may_draw() of tiles.h by intersecting boxes.
template <class Real>
TVSGS_HD bool may_draw(const SurfelShape<Real>& s, Vec2<Real> low, Vec2<Real> high) {
    const Real slack = Real(0.01);  // px, for rounding of the box
    return low.x <= s.mean.x + s.high.x + slack && high.x >= s.mean.x + s.low.x - slack &&
           low.y <= s.mean.y + s.high.y + slack && high.y >= s.mean.y + s.low.y - slack;
}

template <class Real>
struct SurfelHit {
    Real alpha = 0;  // 0: the surfel draws nothing at the pixel and adds zeros
    Real gauss = 0;
    Real inverse = 1, z = 1;  // depth of the intersection with the plane, world units
    Vec2<Real> uv{};          // the intersection on the plane, standard deviations
    Vec2<Real> offset{};      // px, pixel centre minus mean
    bool low_pass = false;    // drawn as the dot
};

/// Forward and backward call this function, so that they decide alike.
template <class Real>
TVSGS_HD SurfelHit<Real> surfel_hit(const SurfelShape<Real>& s, Vec2<Real> d) {
    using std::abs;
    const Real inverse =
        multiply_add(s.slope.x, d.x, multiply_add(s.slope.y, d.y, s.inverse_depth));
    constexpr double kMiddle = (kSurfelDepthRatio + 1 / kSurfelDepthRatio) / 2,
                     kHalf = (kSurfelDepthRatio - 1 / kSurfelDepthRatio) / 2;
    const bool meets =
        abs(inverse - Real(kMiddle) * s.inverse_depth) < Real(kHalf) * s.inverse_depth;
    SurfelHit<Real> hit;
    hit.offset = d;
    hit.inverse = meets ? inverse : s.inverse_depth;
    hit.z = FastMath::inverse(hit.inverse);
    const Vec2<Real> uv{hit.z * multiply_add(s.row_u.x, d.x, s.row_u.y * d.y),
                        hit.z * multiply_add(s.row_v.x, d.x, s.row_v.y * d.y)};
    const Vec2<Real> from_dot = d - s.low_pass;
    const Real by_plane = multiply_add(uv.x, uv.x, uv.y * uv.y),
               by_dot = 2 * multiply_add(from_dot.x, from_dot.x, from_dot.y * from_dot.y);
    hit.low_pass = !(by_plane <= by_dot);
    const Real gauss = FastMath::decay(Real(0.5) * (hit.low_pass ? by_dot : by_plane)),
               alpha = s.opacity * gauss;
    const bool draws = meets && alpha >= Real(kLeastSurfelAlpha);
    if (draws) hit.uv = uv;  // else uv may be infinite, and uv times 0 is NaN
    hit.gauss = draws ? gauss : 0;
    hit.alpha = !draws ? 0 : alpha < Real(kMostSurfelAlpha) ? alpha : Real(kMostSurfelAlpha);
    return hit;
}

/// dL/d of the inverse of SurfelRows with all entries, and of the dot.
template <class Real>
struct SurfelInverseGradient {
    Vec3<Real> row_u, row_v, row_w;
    Vec2<Real> low_pass;
};

/// Adds the derivatives of a hit. `dL_ddepth`: by the depth of the centre. The depth of a dot
/// counts as a function of the centre's depth alone: for discs seen edge on, drawn as dots, the
/// derivative by tilt would be unbounded. (The official code treats uv as a constant there.)
template <class Real>
TVSGS_HD void surfel_hit_vjp(const SurfelShape<Real>& s,
                             const SurfelHit<Real>& hit,
                             Real dL_dgauss,
                             Real dL_dz,
                             SurfelInverseGradient<Real>& g,
                             Real& dL_ddepth) {
    // No branches, because neighbouring pixels differ.
    const Vec2<Real> d = hit.offset, uv = hit.uv;
    const Real slope = -hit.gauss * dL_dgauss, zero = 0, of_dot = hit.low_pass ? slope : zero,
               of_plane = hit.low_pass ? zero : slope, by_z = hit.low_pass ? zero : dL_dz;
    g.low_pass += -2 * of_dot * (d - s.low_pass);
    dL_ddepth += hit.low_pass ? dL_dz : zero;
    const Real u = hit.z * (of_plane * uv.x), v = hit.z * (of_plane * uv.y),
               w = -hit.z * (hit.z * by_z + of_plane * dot(uv, uv));
    g.row_u += {u * d.x, u * d.y, u};
    g.row_v += {v * d.x, v * d.y, v};
    g.row_w += {w * d.x, w * d.y, w};
}

/// dL/d of SurfelRows with all entries.
template <class Real>
struct SurfelMatrixGradient {
    Vec3<Real> row_x, row_y, row_z;
};

/// Derivative through the matrix inverse, P = T^-1: dL/dT = -P^T dL/dP P^T.
template <class Real>
TVSGS_HD SurfelMatrixGradient<Real> surfel_inverse_vjp(const SurfelShape<Real>& s,
                                                       const SurfelInverseGradient<Real>& g) {
    const auto times_inverse = [&](Vec3<Real> by) -> Vec3<Real> {  // by P^T, a row
        return {by.x * s.row_u.x + by.y * s.row_u.y, by.x * s.row_v.x + by.y * s.row_v.y,
                by.x * s.slope.x + by.y * s.slope.y + by.z * s.inverse_depth};
    };
    const Vec3<Real> u = times_inverse(g.row_u), v = times_inverse(g.row_v),
                     w = times_inverse(g.row_w);
    return {-(s.row_u.x * u + s.row_v.x * v + s.slope.x * w),
            -(s.row_u.y * u + s.row_v.y * v + s.slope.y * w), -s.inverse_depth * w};
}

/// Derivative through surfel_shape(): adds the dot's position to the gradient of the matrix.
template <class Real>
TVSGS_HD void low_pass_vjp(const SurfelRows<Real>& s,
                           Vec2<Real> low_pass,
                           Vec2<Real> dL_dlow_pass,
                           SurfelMatrixGradient<Real>& g) {
    const Real r2 = Real(kLowPassReach * kLowPassReach);
    const Vec3<Real> t{r2, r2, -1}, x{s.row_x.x, s.row_x.y, 0}, y{s.row_y.x, s.row_y.y, 0},
        z{s.row_z.x, s.row_z.y, s.depth};
    const Real d0 = r2 * dot(s.row_z, s.row_z) - s.depth * s.depth;
    const Real e = dot(dL_dlow_pass, low_pass);
    for (int j = 0; j < 3; ++j) {
        const Real f = t[j] / d0;
        g.row_x[j] += dL_dlow_pass.x * f * z[j];
        g.row_y[j] += dL_dlow_pass.y * f * z[j];
        g.row_z[j] += f * (dL_dlow_pass.x * x[j] + dL_dlow_pass.y * y[j]) - 2 * e * f * z[j];
    }
}

/// Gradients of the axes from the gradient of the matrix. `centre`: SurfelAxes::centre.
template <class Real>
TVSGS_HD SurfelAxes<Real> surfel_axes_vjp(const Pinhole<Real>& camera,
                                          Vec3<Real> centre,
                                          const SurfelMatrixGradient<Real>& g) {
    const Real x = camera.fx * centre.x / centre.z, y = camera.fy * centre.y / centre.z;
    const auto column = [&](int j) -> Vec3<Real> {
        return {camera.fx * g.row_x[j], camera.fy * g.row_y[j],
                g.row_z[j] - x * g.row_x[j] - y * g.row_y[j]};
    };
    return {column(0), column(1), column(2)};
}

/// Depth measure of the distortion, proportional to the inverse depth. It equals the official far /
/// (far - near) (1 - near / z) less its constant, which differences do not need: with it, values
/// would be near 1 and lose all digits.
inline constexpr double kDistortionScale = -100 * 0.2 / (100 - 0.2);  // near 0.2, far 100
template <class Real>
TVSGS_HD Real distortion_depth(Real inverse) {
    return Real(kDistortionScale) * inverse;
}
/// Derivative by z.
template <class Real>
TVSGS_HD Real distortion_depth_slope(Real inverse) {
    return -Real(kDistortionScale) * inverse * inverse;
}

template <class Real>
struct SurfelFeatures {
    Vec3<Real> color;
    Vec3<Real> normal;  // camera frame, towards the camera
};

/// State of a pixel in the forward pass, front to back.
template <class Real>
struct SurfelPixel {
    Real T = 1;
    Vec3<Real> color{}, normal{};
    Real z = 0;       // blended, not divided by the coverage
    Real median = 0;  // z of the last blended splat that more than half of the light reaches
    Real first = 0, second = 0;  // moments: sums of w m and w m^2, m = distortion_depth(1 / z)
    Real distortion = 0;         // sum over pairs of w_i w_j (m_i - m_j)^2
};

/// Blends a surfel. Returns false if the pixel is full and the splat was not blended. Without
/// `kMaps` it blends only the colour.
template <bool kMaps, class Real>
TVSGS_HD bool blend(SurfelPixel<Real>& pixel,
                    const SurfelHit<Real>& hit,
                    const SurfelFeatures<Real>& f) {
    const Real next = pixel.T * (1 - hit.alpha);
    const bool fits = !(next < Real(1e-4));  // no branch: neighbouring pixels differ
    const Real w = fits ? hit.alpha * pixel.T : Real(0);
    pixel.color += w * f.color;
    if constexpr (kMaps) {
        const Real m = distortion_depth(hit.inverse);
        pixel.distortion += w * (m * m * (1 - pixel.T) + pixel.second - 2 * m * pixel.first);
        pixel.first += w * m, pixel.second += w * m * m;
        pixel.normal += w * f.normal;
        pixel.z += w * hit.z;
        pixel.median = w > 0 && pixel.T > Real(0.5) ? hit.z : pixel.median;
    }
    pixel.T = fits ? next : pixel.T;
    return fits;
}

/// dL/d of a finished pixel, and values of this pixel that the backward pass needs.
template <class Real>
struct SurfelPixelGradient {
    Vec3<Real> color{}, normal{};
    Real coverage = 0, z = 0, median = 0, distortion = 0;
    Real all = 0, first = 0, second = 0;  // 1 - T and the moments of the finished pixel
};

/// State of a pixel in the backward pass, back to front.
template <class Real>
struct SurfelPixelBackward {
    Real T;  // behind the next splat to visit
    SurfelPixelGradient<Real> by;
    Real behind = 0;  // as in blend_math.h
    bool had_median = false;
    Real maps_behind = 0;  // with kParted `behind` of the maps; `behind` is of the colours
};

/// Gradients of one surfel, summed over pixels.
template <class Real>
struct alignas(16) SurfelColorGradients {
    SurfelInverseGradient<Real> inverse;
    Real opacity;
    Vec3<Real> color;
    Real front_pixels;  // as in blend_math.h

    static constexpr int kCount = 16;
};
template <class Real>
struct alignas(16) SurfelMapGradients : SurfelColorGradients<Real> {
    Vec3<Real> normal;
    Real depth;  // by the depth of the centre, from pixels that drew the dot

    static constexpr int kCount = 20;
};
template <bool kMaps, class Real>
using SurfelGradients =
    std::conditional_t<kMaps, SurfelMapGradients<Real>, SurfelColorGradients<Real>>;

/// Adds one surfel at one pixel, back to front. A hit with alpha 0 adds nothing. With `kParted`
/// only `color_share` of the derivatives by colour and by the transmittance behind all splats
/// reaches the shape; opacity and colour get them in full.
template <bool kMaps, bool kParted = false, class Real>
TVSGS_HD void blend_vjp(SurfelPixelBackward<Real>& pixel,
                        const SurfelShape<Real>& s,
                        const SurfelFeatures<Real>& f,
                        const SurfelHit<Real>& hit,
                        SurfelGradients<kMaps, Real>& g,
                        Real color_share = 1) {
    const SurfelPixelGradient<Real>& by = pixel.by;
    const Real T = pixel.T * FastMath::inverse(1 - hit.alpha), w = hit.alpha * T;
    const bool in_front = hit.alpha > 0 && T > Real(0.5);
    const Real by_color = dot(by.color, f.color);
    Real dL_dw = kParted ? Real(0) : by_color, dL_dz = 0;
    if constexpr (kMaps) {
        const Real m = distortion_depth(hit.inverse);
        dL_dw += dot(by.normal, f.normal) + by.coverage + by.z * hit.z +
                 by.distortion * (by.second + m * m * by.all - 2 * m * by.first);
        dL_dz = w * by.z + 2 * by.distortion * w * (m * by.all - by.first) *
                               distortion_depth_slope(hit.inverse);
        dL_dz += in_front && !pixel.had_median ? by.median : Real(0);
        pixel.had_median = pixel.had_median || in_front;
        g.normal += w * by.normal;
    }
    Real step, shape_step;
    if constexpr (kParted) {
        const Real color_step = by_color - pixel.behind, maps_step = dL_dw - pixel.maps_behind;
        pixel.behind += hit.alpha * color_step;
        pixel.maps_behind += hit.alpha * maps_step;
        step = color_step + maps_step;
        shape_step = color_share * color_step + maps_step;
    } else {
        step = shape_step = dL_dw - pixel.behind;
        pixel.behind += hit.alpha * step;
    }
    pixel.T = T;

    // The gradient passes the upper clamp of alpha unchanged, as in the official code.
    g.opacity += hit.gauss * (T * step);  // gauss is 0 if the surfel draws nothing
    g.color += w * by.color;
    g.front_pixels += in_front ? Real(1) : Real(0);
    Real by_depth = 0;
    surfel_hit_vjp(s, hit, s.opacity * (T * shape_step), dL_dz, g.inverse, by_depth);
    if constexpr (kMaps) g.depth += by_depth;
}

}  // namespace tvsgs
