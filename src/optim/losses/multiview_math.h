// Geometry of two views of one surface: depth maps projected into another view and back, patches
// warped by the surface's plane.  [PGSR, Section 3.3]
#pragma once

#include "core/math/rng.h"
#include "core/scene/camera.h"

namespace tvsgs {

/// A pinhole camera without its pose. Image points are in corner coordinates: the centre of pixel
/// (i, j) is (i + 0.5, j + 0.5).
template <class Real>
struct Lens {
    Real fx, fy, cx, cy;  // px
    int width, height;
};

template <class Real>
Lens<Real> lens(const Camera& c) {
    return {Real(c.fx_px), Real(c.fy_px), Real(c.cx_px), Real(c.cy_px), c.width_px, c.height_px};
}

/// Ray with z = 1.
template <class Real>
TVSGS_HD Vec3<Real> ray_through(const Lens<Real>& l, Vec2<Real> point) {
    return {(point.x - l.cx) / l.fx, (point.y - l.cy) / l.fy, 1};
}
template <class Real>
TVSGS_HD Vec2<Real> project(const Lens<Real>& l, Vec3<Real> p) {
    return {l.fx * p.x / p.z + l.cx, l.fy * p.y / p.z + l.cy};
}
template <class Real>
TVSGS_HD Vec3<Real> project_vjp(const Lens<Real>& l, Vec3<Real> p, Vec2<Real> dL_dpoint) {
    const Real x = l.fx * dL_dpoint.x / p.z, y = l.fy * dL_dpoint.y / p.z;
    return {x, y, -(x * p.x + y * p.y) / p.z};
}

/// A reference view and another view of the same surface.
template <class Real>
struct ViewPair {
    Lens<Real> reference, other;
    Rigid3<Real> other_from_reference;
    // Points nearer to the other view are not compared, world units.
    Real min_depth;
};

template <class Real>
ViewPair<Real> view_pair(const Camera& reference, const Camera& other, Real min_depth) {
    const auto pose = [](const Camera& c) {
        return Rigid3d{mat_cast<double>(c.camera_from_world.R),
                       vec_cast<double>(c.camera_from_world.t)};
    };
    const Rigid3d relative = pose(other) * inverse(pose(reference));
    return {lens<Real>(reference),
            lens<Real>(other),
            {mat_cast<Real>(relative.R), vec_cast<Real>(relative.t)},
            min_depth};
}

/// Projection of a pixel to the other view by its own depth, and back by the other view's depth.
template <class Real>
struct Reprojection {
    bool valid = false;     // both depths exist, inside the other image, distance < 1 px
    Real distance = 0;      // from the pixel to its reprojection, px
    Real depth = 0;         // the other view's, bilinear between pixels `at`
    int at[4] = {};         // four pixels of the other view
    Real share[4] = {};     // their bilinear weights
    Vec2<Real> error{};     // px
    Vec2<Real> slope{};     // d depth / d point of the other view's image
    Vec3<Real> there{};     // the surface point of the pixel in the other view's frame
    Vec3<Real> returned{};  // the other view's surface point in the reference's frame
};

/// `other_depth(i)` reads pixel i; 0 means no depth. Samples bilinearly between pixel centres,
/// clamped at the border.
template <class Real, class ReadDepth>
TVSGS_HD Reprojection<Real> reproject(const ViewPair<Real>& pair,
                                      Vec3<Real> ray,
                                      Real depth,
                                      const ReadDepth& other_depth) {
    Reprojection<Real> r;
    if (!(depth > 0)) return r;
    r.there = pair.other_from_reference * (depth * ray);
    if (!(r.there.z > pair.min_depth)) return r;
    const Vec2<Real> q = project(pair.other, r.there) - Vec2<Real>{Real(0.5), Real(0.5)};
    const int w = pair.other.width, h = pair.other.height;
    if (!(q.x > 0) || !(q.x < Real(w)) || !(q.y > 0) || !(q.y < Real(h))) return r;

    const int x0 = int(q.x), y0 = int(q.y);
    const int x1 = x0 + 1 < w ? x0 + 1 : x0, y1 = y0 + 1 < h ? y0 + 1 : y0;
    const Real u = q.x - Real(x0), v = q.y - Real(y0);
    r.at[0] = y0 * w + x0, r.at[1] = y0 * w + x1, r.at[2] = y1 * w + x0, r.at[3] = y1 * w + x1;
    r.share[0] = (1 - u) * (1 - v), r.share[1] = u * (1 - v), r.share[2] = (1 - u) * v,
    r.share[3] = u * v;
    Real d[4];
    for (int i = 0; i < 4; ++i) {
        d[i] = other_depth(r.at[i]);
        if (!(d[i] > 0)) return r;
        r.depth += r.share[i] * d[i];
    }
    r.slope = {(1 - v) * (d[1] - d[0]) + v * (d[3] - d[2]),
               (1 - u) * (d[2] - d[0]) + u * (d[3] - d[1])};

    const Vec3<Real> point = (r.depth / r.there.z) * r.there;
    r.returned = transpose_times(pair.other_from_reference.R, point - pair.other_from_reference.t);
    if (!(r.returned.z > 0)) return r;
    r.error = {pair.reference.fx * (r.returned.x / r.returned.z - ray.x),
               pair.reference.fy * (r.returned.y / r.returned.z - ray.y)};
    r.distance = std::sqrt(dot(r.error, r.error));
    r.valid = r.distance < 1;
    return r;
}

template <class Real>
struct ReprojectionGradients {
    Real dL_ddepth;        // of the reference's pixel
    Real dL_dother_depth;  // of the bilinear sample; pixel at[i] gets share[i] of it
};

/// Call only where the reprojection is valid. The sample's position depends on the depth.
template <class Real>
TVSGS_HD ReprojectionGradients<Real> reproject_vjp(const ViewPair<Real>& pair,
                                                   Vec3<Real> ray,
                                                   const Reprojection<Real>& r,
                                                   Real dL_ddistance) {
    if (!(r.distance > 0)) return {0, 0};  // not differentiable at 0
    const Vec2<Real> dL_derror = (dL_ddistance / r.distance) * r.error;
    const Mat3<Real>& R = pair.other_from_reference.R;
    const Vec3<Real> dL_dpoint = R * project_vjp(pair.reference, r.returned, dL_derror);
    // point = depth / z * there
    const Real dL_dsample = dot(dL_dpoint, r.there) / r.there.z;
    Vec3<Real> dL_dthere = (r.depth / r.there.z) * dL_dpoint;
    dL_dthere.z -= r.depth * dL_dsample / r.there.z;
    dL_dthere += project_vjp(pair.other, r.there, dL_dsample * r.slope);
    return {dot(transpose_times(R, dL_dthere), ray), dL_dsample};
}

/// An image value and its derivative by the position.
template <class Real>
struct ImageSample {
    Real value;
    Vec2<Real> slope;
};

/// Bilinear between pixel centres, here at integer coordinates; `image(x, y)` is 0 outside.
template <class Real, class Image>
TVSGS_HD ImageSample<Real> bilinear(const Image& image, Vec2<Real> q) {
    // Converting NaN or a point far outside to int would be undefined.
    if (!(q.x > -2) || !(q.x < Real(1e6)) || !(q.y > -2) || !(q.y < Real(1e6))) return {0, {0, 0}};
    const Real fx = std::floor(q.x), fy = std::floor(q.y);
    const int x = int(fx), y = int(fy);
    const Real u = q.x - fx, v = q.y - fy;
    const Real a = image(x, y), b = image(x + 1, y), c = image(x, y + 1), d = image(x + 1, y + 1);
    const Real top = a + u * (b - a), bottom = c + u * (d - c);
    return {top + v * (bottom - top), {(1 - v) * (b - a) + v * (d - c), bottom - top}};
}

/// An 8-bit grey image, read as numbers from 0 to 1; 0 outside.
struct GreyBytes {
    const std::uint8_t* pixels;
    int width, height;

    TVSGS_HD float operator()(int x, int y) const {
        return x >= 0 && x < width && y >= 0 && y < height
                   ? float(pixels[y * width + x]) * (1.0f / 255)
                   : 0.0f;
    }
};

inline constexpr int kPatchRadius = 3;         // 7 x 7
inline constexpr double kMaxPatchError = 0.9;  // patches with a larger error are not compared

/// Error of a patch against its warp into the other view, and its derivatives.
template <class Real>
struct PatchScore {
    bool valid = false;         // error below kMaxPatchError
    Real error = 0;             // 1 - NCC^2: 0 also for an inverted patch
    Vec3<Real> derror_dnormal;  // by the normal of the pixel's plane
    Real derror_ddistance = 0;
};

/// Warps the patch around `centre` (corner coordinates of the reference image) by the homography R
/// - t n^T / d of the plane n . X = -d. Only n / d counts. `pair` has the lenses of the images;
/// `shift`: from corner to sample coordinates. The derivative of NCC^2 by a warped intensity is
/// linear in the patch's intensities, so three weighted sums suffice for it.
template <class Real, class Image>
TVSGS_HD PatchScore<Real> patch_score(const ViewPair<Real>& pair,
                                      Vec2<Real> centre,
                                      Vec3<Real> normal,
                                      Real distance,
                                      const Image& reference,
                                      const Image& other,
                                      Vec2<Real> shift) {
    PatchScore<Real> score{};
    if (!(distance > 0)) return score;
    const Mat3<Real>& R = pair.other_from_reference.R;
    const Vec3<Real> t = pair.other_from_reference.t, plane = normal / distance;
    // The warped ray is linear in the patch coordinates.
    const auto warped = [&](Vec3<Real> ray) { return R * ray - dot(plane, ray) * t; };
    const Vec3<Real> ray0 = ray_through(pair.reference, centre), p0 = warped(ray0);
    const Real step_x = 1 / pair.reference.fx, step_y = 1 / pair.reference.fy;
    const Vec3<Real> px = warped({step_x, 0, 0}), py = warped({0, step_y, 0});
    if (!(p0.z > Real(1e-6))) return score;

    // Intensities relative to the centre's: the covariances stay, with little cancellation.
    const Real a0 = bilinear(reference, centre - shift).value,
               b0 = bilinear(other, project(pair.other, p0) - shift).value;
    constexpr Real kTaps = (2 * kPatchRadius + 1) * (2 * kPatchRadius + 1);
    Real sum_a = 0, sum_b = 0, sum_aa = 0, sum_bb = 0, sum_ab = 0;
    Vec3<Real> slope{}, slope_a{}, slope_b{};  // sums of db/d(plane . ray) x ray, times 1, a, b
    for (int j = -kPatchRadius; j <= kPatchRadius; ++j)
        for (int i = -kPatchRadius; i <= kPatchRadius; ++i) {
            const Real dx = Real(i), dy = Real(j);
            const Vec3<Real> p = p0 + dx * px + dy * py;
            if (!(p.z > Real(1e-6))) return score;
            const Real a = bilinear(reference, centre + Vec2<Real>{dx, dy} - shift).value - a0;
            const auto sample = bilinear(other, project(pair.other, p) - shift);
            const Real b = sample.value - b0;
            sum_a += a, sum_b += b, sum_aa += a * a, sum_bb += b * b, sum_ab += a * b;
            const Real s = -dot(project_vjp(pair.other, p, sample.slope), t);
            const Vec3<Real> g = s * Vec3<Real>{ray0.x + dx * step_x, ray0.y + dy * step_y, 1};
            slope += g, slope_a += a * g, slope_b += b * g;
        }
    const Real mean_a = sum_a / kTaps, mean_b = sum_b / kTaps;
    const Real cross = sum_ab - sum_a * mean_b, var_a = sum_aa - sum_a * mean_a,
               var_b = sum_bb - sum_b * mean_b;
    const Real under = var_a * var_b + Real(1e-8);
    const Real error = 1 - cross * cross / under;
    if (!(error < Real(kMaxPatchError))) return score;
    score.valid = true;
    if (!(error > 0)) return score;  // perfect within rounding
    score.error = error;
    const Real by_cross = -2 * cross / under, by_var = cross * cross * var_a / (under * under);
    const Vec3<Real> dL_dplane =
        by_cross * (slope_a - mean_a * slope) + 2 * by_var * (slope_b - mean_b * slope);
    score.derror_dnormal = dL_dplane / distance;
    score.derror_ddistance = -dot(dL_dplane, plane) / distance;
    return score;
}

/// Image of `i` under a permutation of [0, count) chosen by `key`: one-to-one mixing of b-bit
/// numbers, repeated until the result is below `count` (less than twice on average).
TVSGS_HD inline std::uint32_t permuted(std::uint32_t i, std::uint32_t count, const Random4& key) {
    int bits = 1;
    while (bits < 32 && (std::uint64_t{1} << bits) < count) ++bits;
    const std::uint32_t mask = std::uint32_t((std::uint64_t{1} << bits) - 1);
    const int half = (bits + 1) / 2;
    do {
        for (int round = 0; round < 4; ++round) {
            i = (i * (key.v[round] | 1u) + (key.v[3 - round] >> 7)) & mask;
            i ^= i >> half;
        }
    } while (i >= count);
    return i;
}

}  // namespace tvsgs
