// Flat splats in the image: where a pixel's ray meets the plane of one, what it adds there, and the
// way back, one element at a time.  [2DGS, Sections 4 and 5]
#pragma once

#include "render/projection_math.h"

namespace tvsgs {

/// A surfel as it appears in a view. Rows of the matrix that takes points of its plane, (u, v, 1)
/// in standard deviations, to homogeneous pixels counted from `mean`; the third entries of `row_x`
/// and `row_y` are 0 there. Counted from the image's corner, rays far from it would leave a small
/// splat no digits.
template <class Real>
struct alignas(16) SurfelShape {
    Vec2<Real> mean;          // px, the projected centre
    Vec2<Real> row_x, row_y;  // px x world units
    Vec2<Real> row_z;         // world units
    Real depth;               // of the centre, the third entry of the last row
    Real opacity;
    Vec2<Real> low_pass;   // px from `mean`: where the splat is at least a blurred dot
    Vec2<Real> low, high;  // px from `mean`: outside it draws nothing
};

/// Bounds of alpha, and of the depth at which a pixel's ray may meet a surfel, world units.
inline constexpr float kLeastSurfelAlpha = 1.0f / 255, kMostSurfelAlpha = 0.99f,
                       kLeastSurfelDepth = 0.2f;

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
TVSGS_HD SurfelBox<Real> surfel_box(const SurfelShape<Real>& s, Real reach) {
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

/// False: the surfel is not in view, or so near to the camera's plane that its box is unbounded.
/// `least_alpha`: what is fainter does not draw.
template <class Real>
TVSGS_HD bool surfel_shape(const Pinhole<Real>& camera,
                           const SurfelAxes<Real>& axes,
                           Real opacity,
                           Real least_alpha,
                           SurfelShape<Real>& s) {
    const Vec3<Real> p = axes.centre;
    s.mean = project_point(camera, p);
    const Real x = s.mean.x - camera.cx, y = s.mean.y - camera.cy;
    s.row_x = {camera.fx * axes.a.x - x * axes.a.z, camera.fx * axes.b.x - x * axes.b.z};
    s.row_y = {camera.fy * axes.a.y - y * axes.a.z, camera.fy * axes.b.y - y * axes.b.z};
    s.row_z = {axes.a.z, axes.b.z};
    s.depth = p.z, s.opacity = opacity;
    const SurfelBox<Real> dot_at = surfel_box(s, Real(kLowPassReach));
    if (!dot_at.bounded) return false;
    s.low_pass = dot_at.centre;
    const Real reach = std::sqrt(2 * std::log(opacity / least_alpha));
    const SurfelBox<Real> box = surfel_box(s, reach);
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
struct SurfelRay {
    Vec3<Real> k, l, m;  // homogeneous lines through the pixel, on the plane; m = k x l
};
template <class Real>
TVSGS_HD SurfelRay<Real> surfel_ray(const SurfelShape<Real>& s, Vec2<Real> d) {
    SurfelRay<Real> r;
    r.k = {d.x * s.row_z.x - s.row_x.x, d.x * s.row_z.y - s.row_x.y, d.x * s.depth};
    r.l = {d.y * s.row_z.x - s.row_y.x, d.y * s.row_z.y - s.row_y.y, d.y * s.depth};
    r.m = cross(r.k, r.l);
    return r;
}

/// `near`: what is nearer to the camera's plane does not draw.
template <class Real>
TVSGS_HD SurfelHit<Real> surfel_hit(const SurfelShape<Real>& s, Vec2<Real> d, Real near) {
    const Vec3<Real> m = surfel_ray(s, d).m;
    SurfelHit<Real> hit;
    if (m.z == 0) return hit;
    const Vec2<Real> uv{m.x / m.z, m.y / m.z};
    const Real z = dot(uv, s.row_z) + s.depth;
    if (!(z >= near)) return hit;
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

/// dL/d of the matrix of a SurfelShape, its pixels counted from where they are, and of the dot.
template <class Real>
struct SurfelMatrixGradient {
    Vec3<Real> row_x, row_y, row_z;
    Vec2<Real> low_pass;
};

/// Adds. Where the dot is drawn, uv counts as a constant, as in the official code.
template <class Real>
TVSGS_HD void surfel_hit_vjp(const SurfelShape<Real>& s,
                             const SurfelHit<Real>& hit,
                             Real dL_dgauss,
                             Real dL_dz,
                             SurfelMatrixGradient<Real>& g) {
    const Vec2<Real> d = hit.offset, uv = hit.uv;
    g.row_z += Vec3<Real>{dL_dz * uv.x, dL_dz * uv.y, dL_dz};
    const Real slope = -hit.gauss * dL_dgauss;
    if (hit.low_pass) {
        g.low_pass += -2 * slope * (d - s.low_pass);
        return;
    }
    const SurfelRay<Real> r = surfel_ray(s, d);
    const Real by_u = slope * uv.x + dL_dz * s.row_z.x, by_v = slope * uv.y + dL_dz * s.row_z.y;
    const Vec3<Real> by_m = Vec3<Real>{by_u, by_v, -(uv.x * by_u + uv.y * by_v)} / r.m.z;
    const Vec3<Real> by_k = cross(r.l, by_m), by_l = cross(by_m, r.k);
    g.row_x -= by_k, g.row_y -= by_l;
    g.row_z += d.x * by_k + d.y * by_l;
}

/// Of surfel_shape(): adds what the dot's place passes on to the matrix.
template <class Real>
TVSGS_HD void low_pass_vjp(const SurfelShape<Real>& s, SurfelMatrixGradient<Real>& g) {
    const Real r2 = Real(kLowPassReach * kLowPassReach);
    const Vec3<Real> t{r2, r2, -1}, last{s.row_z.x, s.row_z.y, s.depth};
    const Real d0 = r2 * dot(s.row_z, s.row_z) - s.depth * s.depth;
    const Real e = dot(g.low_pass, s.low_pass);
    for (int j = 0; j < 3; ++j) {
        const Real f = t[j] / d0;
        const Real x = j == 0   ? s.row_x.x
                       : j == 1 ? s.row_x.y
                                : 0,
                   y = j == 0   ? s.row_y.x
                       : j == 1 ? s.row_y.y
                                : 0;
        g.row_x[j] += g.low_pass.x * f * last[j];
        g.row_y[j] += g.low_pass.y * f * last[j];
        g.row_z[j] += f * (g.low_pass.x * x + g.low_pass.y * y) - 2 * e / d0 * t[j] * last[j];
    }
}

/// From the matrix to the axes in the camera's frame.
template <class Real>
TVSGS_HD SurfelAxes<Real> surfel_axes_vjp(const Pinhole<Real>& camera,
                                          const SurfelShape<Real>& s,
                                          const SurfelMatrixGradient<Real>& g) {
    const Real x = s.mean.x - camera.cx, y = s.mean.y - camera.cy;
    const auto column = [&](int j) -> Vec3<Real> {
        return {camera.fx * g.row_x[j], camera.fy * g.row_y[j],
                g.row_z[j] - x * g.row_x[j] - y * g.row_y[j]};
    };
    return {column(0), column(1), column(2)};
}

/// Depths as the distortion measures them: equal steps are equal steps in disparity.
inline constexpr double kDistortionNear = 0.2, kDistortionFar = 100;
template <class Real>
TVSGS_HD Real distortion_depth(Real z) {
    const Real near = Real(kDistortionNear), far = Real(kDistortionFar);
    return far / (far - near) * (1 - near / z);
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

/// False: the pixel is full, and the splat was not blended.
template <class Real>
TVSGS_HD bool blend(SurfelPixel<Real>& pixel,
                    const SurfelHit<Real>& hit,
                    const SurfelFeatures<Real>& f) {
    const Real next = pixel.T * (1 - hit.alpha);
    if (next < Real(1e-4)) return false;
    if (!(hit.alpha > 0)) return true;
    const Real w = hit.alpha * pixel.T, m = distortion_depth(hit.z);
    pixel.distortion += w * (m * m * (1 - pixel.T) + pixel.second - 2 * m * pixel.first);
    pixel.first += w * m, pixel.second += w * m * m;
    pixel.color += w * f.color, pixel.normal += w * f.normal;
    pixel.z += w * hit.z;
    if (pixel.T > Real(0.5)) pixel.median = hit.z;
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
    SurfelMatrixGradient<Real> matrix;
    Real opacity;
    Vec3<Real> color, normal;
    Real front_pixels;  // as in blend_math.h
    Real unused;        // for whole 16-byte words

    static constexpr int kCount = 20;
};

/// One surfel at one pixel, visited back to front; adds. A hit of alpha 0 adds nothing.
template <class Real>
TVSGS_HD void blend_vjp(SurfelPixelBackward<Real>& pixel,
                        const SurfelShape<Real>& s,
                        const SurfelFeatures<Real>& f,
                        const SurfelHit<Real>& hit,
                        SurfelGradients<Real>& g) {
    if (!(hit.alpha > 0)) return;
    const SurfelPixelGradient<Real>& by = pixel.by;
    const Real T = pixel.T / (1 - hit.alpha), w = hit.alpha * T, m = distortion_depth(hit.z);
    const Real dL_dw = dot(by.color, f.color) + dot(by.normal, f.normal) + by.coverage +
                       by.z * hit.z +
                       by.distortion * (by.second + m * m * by.all - 2 * m * by.first);
    const Real step = dL_dw - pixel.behind;
    pixel.behind += hit.alpha * step;
    pixel.T = T;

    Real dL_dz =
        w * by.z + 2 * by.distortion * w * (m * by.all - by.first) * distortion_depth_slope(hit.z);
    const bool in_front = T > Real(0.5);
    if (in_front && !pixel.had_median) dL_dz += by.median;
    pixel.had_median = pixel.had_median || in_front;

    // The upper clamp of alpha is passed straight through, as in the official code.
    const Real dL_dalpha = T * step;
    g.opacity += hit.gauss * dL_dalpha;
    g.color += w * by.color, g.normal += w * by.normal;
    if (in_front) g.front_pixels += 1;
    surfel_hit_vjp(s, hit, s.opacity * dL_dalpha, dL_dz, g.matrix);
}

}  // namespace tvsgs
