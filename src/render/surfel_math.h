// Flat splats in the image: where a pixel's ray meets the plane of one, what it adds there, and the
// way back, one element at a time.  [2DGS, Sections 4 and 5]
#pragma once

#include "render/projection_math.h"

namespace tvsgs {

/// The matrix that takes points of a surfel's plane, (u, v, 1) in standard deviations, to
/// homogeneous pixels counted from the projected centre. The third entries of `row_x` and `row_y`
/// are 0 there. Counted from the image's corner, rays far from it would leave a small splat no
/// digits.
template <class Real>
struct SurfelRows {
    Vec2<Real> row_x, row_y;  // px x world units
    Vec2<Real> row_z;         // world units
    Real depth;               // of the centre, the third entry of the last row
};

/// A surfel as it appears in a view: the inverse of its SurfelRows. What it takes a pixel to is
/// (u, v, 1) over the depth there, which makes hits a few multiplications.
template <class Real>
struct alignas(16) SurfelShape {
    Vec2<Real> mean;          // px, the projected centre
    Vec2<Real> row_u, row_v;  // per px and world unit; their third entries are 0
    Vec2<Real> slope;         // of the inverse depth, per px and world unit
    Real inverse_depth;       // of the centre
    Real opacity;
    Vec2<Real> low_pass;   // px from `mean`: where the splat is at least a blurred dot
    Vec2<Real> low, high;  // px from `mean`: outside it draws nothing
};

/// Bounds of alpha.
inline constexpr float kLeastSurfelAlpha = 1.0f / 255, kMostSurfelAlpha = 0.99f;

/// A pixel's ray may meet a surfel at a depth that differs by this factor from the centre's, no
/// more: beyond, the disc is seen on edge and there is but the dot. (The official code takes from
/// 0.2 world units on, in scenes a few units deep.)
inline constexpr float kSurfelDepthRatio = 20;

/// Axes of a surfel in the camera's frame, in standard deviations, and its centre.
template <class Real>
struct SurfelAxes {
    Vec3<Real> a, b, centre;
};

/// Box of the ellipse `reach` standard deviations away, px from the projected centre.
template <class Real>
struct SurfelBox {
    Vec2<Real> centre, extent;
    bool bounded;  // else the disc reaches the camera's plane, and the rest means nothing
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

/// The official low-pass dot sits at the centre of the box of three standard deviations.
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

/// False: the surfel is seen on edge, or so near to the camera's plane that its box is unbounded.
/// `least_alpha`: what is fainter does not draw.
template <class Real>
TVSGS_HD bool surfel_shape(const Pinhole<Real>& camera,
                           const SurfelAxes<Real>& axes,
                           Real opacity,
                           Real least_alpha,
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
    const Real reach = std::sqrt(2 * std::log(opacity / least_alpha));
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

/// As tiles.h asks for it: the boxes meet.
template <class Real>
TVSGS_HD bool may_draw(const SurfelShape<Real>& s, Vec2<Real> low, Vec2<Real> high) {
    const Real slack = Real(0.01);  // px: what rounding of the box may cost
    return low.x <= s.mean.x + s.high.x + slack && high.x >= s.mean.x + s.low.x - slack &&
           low.y <= s.mean.y + s.high.y + slack && high.y >= s.mean.y + s.low.y - slack;
}

/// A surfel at a pixel.
template <class Real>
struct SurfelHit {
    Real alpha = 0;  // 0: it does not draw there, and the rest means nothing
    Real gauss = 0;
    Real z = 1;             // depth of where the ray meets the plane, world units
    Vec2<Real> uv{};        // the same place on the plane, standard deviations
    Vec2<Real> offset{};    // px, of the pixel centre from the mean
    bool low_pass = false;  // it is drawn as the dot
};

template <class Real>
TVSGS_HD SurfelHit<Real> surfel_hit(const SurfelShape<Real>& s, Vec2<Real> d) {
    SurfelHit<Real> hit;
    const Real inverse = s.inverse_depth + dot(s.slope, d), ratio = Real(kSurfelDepthRatio);
    if (!(inverse * ratio > s.inverse_depth) || !(inverse < s.inverse_depth * ratio)) return hit;
    const Real z = 1 / inverse;
    const Vec2<Real> uv{z * dot(s.row_u, d), z * dot(s.row_v, d)};
    const Vec2<Real> from_dot = d - s.low_pass;
    const Real by_plane = dot(uv, uv), by_dot = 2 * dot(from_dot, from_dot);
    hit.low_pass = !(by_plane <= by_dot);
    const Real gauss = std::exp(Real(-0.5) * (hit.low_pass ? by_dot : by_plane));
    const Real alpha = s.opacity * gauss;
    if (!(alpha >= Real(kLeastSurfelAlpha))) return hit;
    hit.alpha = alpha < Real(kMostSurfelAlpha) ? alpha : Real(kMostSurfelAlpha);
    hit.gauss = gauss, hit.z = z, hit.uv = uv, hit.offset = d;
    return hit;
}

/// dL/d of the inverse of SurfelRows with all its entries, and of the dot.
template <class Real>
struct SurfelInverseGradient {
    Vec3<Real> row_u, row_v, row_w;
    Vec2<Real> low_pass;
};

/// Adds. A dot's depth tells of the centre's depth alone: on edge, where dots win, what it would
/// tell of the tilt grows beyond all bounds. (The official code takes uv for a constant there.)
/// `dL_ddepth`: of the centre.
template <class Real>
TVSGS_HD void surfel_hit_vjp(const SurfelShape<Real>& s,
                             const SurfelHit<Real>& hit,
                             Real dL_dgauss,
                             Real dL_dz,
                             SurfelInverseGradient<Real>& g,
                             Real& dL_ddepth) {
    const Vec2<Real> d = hit.offset, uv = hit.uv;
    const Real slope = -hit.gauss * dL_dgauss;
    if (hit.low_pass) {
        g.low_pass += -2 * slope * (d - s.low_pass);
        dL_ddepth += dL_dz;
        return;
    }
    const Real by_u = slope * uv.x, by_v = slope * uv.y,
               by_inverse = -hit.z * (hit.z * dL_dz + by_u * uv.x + by_v * uv.y);
    const Vec3<Real> at{d.x, d.y, 1};
    g.row_u += hit.z * by_u * at, g.row_v += hit.z * by_v * at;
    g.row_w += by_inverse * at;
}

/// dL/d of SurfelRows with all their entries.
template <class Real>
struct SurfelMatrixGradient {
    Vec3<Real> row_x, row_y, row_z;
};

/// Of the inverse of a matrix, P = T^-1: dL/dT = -P^T dL/dP P^T.
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

/// Of surfel_shape(): adds what the dot's place passes on to the matrix.
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

/// From the matrix to the axes, `centre` that of the axes.
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

/// Depths as the distortion measures them: equal steps are equal steps in disparity. The official
/// far / (far - near) (1 - near / z) but for its constant: only differences count, and near 1 they
/// would have no digits left.
inline constexpr double kDistortionNear = 0.2, kDistortionFar = 100;
template <class Real>
TVSGS_HD Real distortion_depth(Real z) {
    const Real near = Real(kDistortionNear), far = Real(kDistortionFar);
    return -far * near / ((far - near) * z);
}
template <class Real>
TVSGS_HD Real distortion_depth_slope(Real z) {
    const Real near = Real(kDistortionNear), far = Real(kDistortionFar);
    return far * near / ((far - near) * z * z);
}

/// What a surfel adds to pixels.
template <class Real>
struct SurfelFeatures {
    Vec3<Real> color;
    Vec3<Real> normal;  // camera frame, towards the camera
};

/// A pixel on the way to the back.
template <class Real>
struct SurfelPixel {
    Real T = 1;
    Vec3<Real> color{}, normal{};
    Real z = 0;       // blended, not divided by the coverage
    Real median = 0;  // z of the last splat blended in front of which more than half gets through
    Real first = 0, second = 0;  // moments: sums of w m and w m^2, m = distortion_depth(z)
    Real distortion = 0;         // sum over pairs of w_i w_j (m_i - m_j)^2
};

/// False: the pixel is full, and the splat was not blended. Without `kMaps` the colour alone is.
template <bool kMaps, class Real>
TVSGS_HD bool blend(SurfelPixel<Real>& pixel,
                    const SurfelHit<Real>& hit,
                    const SurfelFeatures<Real>& f) {
    const Real next = pixel.T * (1 - hit.alpha);
    if (next < Real(1e-4)) return false;
    if (!(hit.alpha > 0)) return true;
    const Real w = hit.alpha * pixel.T;
    pixel.color += w * f.color;
    if constexpr (kMaps) {
        const Real m = distortion_depth(hit.z);
        pixel.distortion += w * (m * m * (1 - pixel.T) + pixel.second - 2 * m * pixel.first);
        pixel.first += w * m, pixel.second += w * m * m;
        pixel.normal += w * f.normal;
        pixel.z += w * hit.z;
        if (pixel.T > Real(0.5)) pixel.median = hit.z;
    }
    pixel.T = next;
    return true;
}

/// dL/d of a finished pixel, and what of it the way back needs.
template <class Real>
struct SurfelPixelGradient {
    Vec3<Real> color{}, normal{};
    Real coverage = 0, z = 0, median = 0, distortion = 0;
    Real all = 0, first = 0, second = 0;  // 1 - T and the moments of the finished pixel
};

/// A pixel on the way back to the front.
template <class Real>
struct SurfelPixelBackward {
    Real T;  // behind the next splat to visit
    SurfelPixelGradient<Real> by;
    Real behind = 0;  // as in blend_math.h
    bool had_median = false;
};

/// Sums of one surfel over pixels.
template <class Real>
struct alignas(16) SurfelGradients {
    SurfelInverseGradient<Real> inverse;
    Real opacity;
    Vec3<Real> color;
    Real front_pixels;  // as in blend_math.h
    Vec3<Real> normal;
    Real depth;  // of the centre, by dots

    static constexpr int kCount = 20, kOfColor = 16;  // the first ones are all that colour needs
};

/// One surfel at one pixel, visited back to front; adds. A hit of alpha 0 adds nothing.
template <bool kMaps, class Real>
TVSGS_HD void blend_vjp(SurfelPixelBackward<Real>& pixel,
                        const SurfelShape<Real>& s,
                        const SurfelFeatures<Real>& f,
                        const SurfelHit<Real>& hit,
                        SurfelGradients<Real>& g) {
    if (!(hit.alpha > 0)) return;
    const SurfelPixelGradient<Real>& by = pixel.by;
    const Real T = pixel.T / (1 - hit.alpha), w = hit.alpha * T;
    const bool in_front = T > Real(0.5);
    Real dL_dw = dot(by.color, f.color), dL_dz = 0;
    if constexpr (kMaps) {
        const Real m = distortion_depth(hit.z);
        dL_dw += dot(by.normal, f.normal) + by.coverage + by.z * hit.z +
                 by.distortion * (by.second + m * m * by.all - 2 * m * by.first);
        dL_dz = w * by.z +
                2 * by.distortion * w * (m * by.all - by.first) * distortion_depth_slope(hit.z);
        if (in_front && !pixel.had_median) dL_dz += by.median;
        pixel.had_median = pixel.had_median || in_front;
        g.normal += w * by.normal;
    }
    const Real step = dL_dw - pixel.behind;
    pixel.behind += hit.alpha * step;
    pixel.T = T;

    // The upper clamp of alpha is passed straight through, as in the official code.
    const Real dL_dalpha = T * step;
    g.opacity += hit.gauss * dL_dalpha;
    g.color += w * by.color;
    if (in_front) g.front_pixels += 1;
    surfel_hit_vjp(s, hit, s.opacity * dL_dalpha, dL_dz, g.inverse, g.depth);
}

}  // namespace tvsgs
