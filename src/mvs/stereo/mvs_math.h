// Formulas of PatchMatch stereo for one pixel: planes, their homographies, the weighted correlation
// of patches, and the cross-check with another view's depth.
#pragma once

#include <cmath>

#include "core/device/buffer.h"
#include "core/math/pack.h"
#include "core/scene/camera.h"

namespace tvsgs {

inline constexpr int kMaxSources = 8;    // per reference view; also the bits of a mask of views
inline constexpr int kMaxPatchSide = 8;  // samples per side of a patch, two pixels apart
inline constexpr float kWorstCost = 2;   // 1 - correlation of inverted patches
// Smallest deviation of a textured patch in full light, of 255 grey levels, and its variance of
// grey values in [0, 1].
inline constexpr double kMinDeviation = 0.8;
inline constexpr float kMinVariance = 1e-5f;
inline constexpr float kMinFacing = 0.05f;  // planes seen at a flatter angle project to no area

/// A surface element in the frame of its camera: unit normal towards the camera, and depth (z) at
/// its pixel; 0: none.
struct alignas(16) SurfacePlane {
    Vec3f normal;
    float depth = 0;
};

/// Depth along `ray` of the plane through the pixel with ray `own_ray`; 0 if they do not meet.
TVSGS_HD inline float depth_on_ray(const SurfacePlane& plane, Vec3f own_ray, Vec3f ray) {
    const float slope = dot(plane.normal, ray);
    return slope < -kMinFacing ? plane.depth * dot(plane.normal, own_ray) / slope : 0;
}

/// A source view relative to the reference view.
struct SourceView {
    Camera camera;
    int view = 0, first_pixel = 0;  // its images start there
    Rigid3f source_from_reference;
    Mat3f pixels_at_infinity;  // K_source R K_reference^-1
    Vec3f epipole;             // K_source t
    float min_variance = kMinVariance;
    float weight = 1;  // ViewPlan::weights
};

/// Homogeneous source pixels of a patch around a reference pixel: at_centre + dx per_x + dy per_y.
struct PatchWarp {
    Vec3f at_centre, per_x, per_y;
};

/// Homography of a plane, H = K_s (R + t n^T / d) K_r^-1 with n . X = d, around the centre of pixel
/// (x, y).  [Zheng14, Eq. 2]
TVSGS_HD inline PatchWarp plane_warp(
    const SourceView& source, const Camera& reference, int x, int y, const SurfacePlane& plane) {
    const Mat3f& M = source.pixels_at_infinity;
    const Vec3f ray = pixel_ray(reference, x, y);
    const float inverse_distance = 1 / (plane.depth * dot(plane.normal, ray));
    const Vec3f pixel{static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f, 1};
    return {M * pixel + (1 / plane.depth) * source.epipole,
            column(M, 0) + (plane.normal.x / reference.fx_px * inverse_distance) * source.epipole,
            column(M, 1) + (plane.normal.y / reference.fy_px * inverse_distance) * source.epipole};
}

/// The warp after moving the patch along the viewing rays by `step` in inverse depth. Its image
/// moves along the epipolar line and keeps its shape.
TVSGS_HD inline PatchWarp moved(const PatchWarp& warp, const SourceView& source, float step) {
    return {warp.at_centre + step * source.epipole, warp.per_x, warp.per_y};
}

/// Pixels by which the image of a warp's centre moves per unit of inverse depth.
TVSGS_HD inline float pixels_per_step(const PatchWarp& warp, const SourceView& source) {
    const float u = warp.at_centre.x / warp.at_centre.z, v = warp.at_centre.y / warp.at_centre.z;
    const float du = (source.epipole.x - u * source.epipole.z) / warp.at_centre.z;
    const float dv = (source.epipole.y - v * source.epipole.z) / warp.at_centre.z;
    return std::sqrt(du * du + dv * dv);
}

TVSGS_HD inline Pack<float> four(float a, float b, float c, float d) {
    const Pack<float> all = {a, b, c, d};
    return all;
}
TVSGS_HD inline Pack<float> four_at(const float* p) {
    return four(p[0], p[1], p[2], p[3]);
}

/// A grey image in [0, 1], row by row.
struct GreyImage {
    const float* pixels = nullptr;
    int width = 0, height = 0;
    float min_variance = kMinVariance;  // of a textured patch

    TVSGS_HD float at_clamped(int x, int y) const {
        x = x < 0 ? 0 : x >= width ? width - 1 : x;
        y = y < 0 ? 0 : y >= height ? height - 1 : y;
        return pixels[static_cast<std::size_t>(y) * width + x];
    }
    /// True if the pixel coordinates are at least `margin` away from the border.
    TVSGS_HD bool contains(float u, float v, float margin) const {
        return u >= margin && u < static_cast<float>(width) - margin && v >= margin &&
               v < static_cast<float>(height) - margin;
    }
    /// Values at (u, v), counted from the centre of the first pixel.
    template <bool kClamp>
    TVSGS_HD Pack<float> bilinear(Pack<float> u, Pack<float> v) const {
        if constexpr (kClamp) {
            u = clamped(u, 0, static_cast<float>(width) - 1.001f);
            v = clamped(v, 0, static_cast<float>(height) - 1.001f);
        }
        const Pack<float> x = truncated(u), y = truncated(v), fx = u - x, fy = v - y;
        const Pack<float> index = y * static_cast<float>(width) + x;  // exact below 2^24
        const float* p[4] = {
            pixels + static_cast<int>(index[0]), pixels + static_cast<int>(index[1]),
            pixels + static_cast<int>(index[2]), pixels + static_cast<int>(index[3])};
        const auto corner = [&](int offset) {
            return four(p[0][offset], p[1][offset], p[2][offset], p[3][offset]);
        };
        const Pack<float> left = corner(0), below_left = corner(width);
        const Pack<float> above = left + fx * (corner(1) - left);
        const Pack<float> below = below_left + fx * (corner(width + 1) - below_left);
        return above + fy * (below - above);
    }
};

/// The reference side of the correlation, shared by all hypotheses of a pixel: samples at offsets
/// -(side - 1), -(side - 3), ..., side - 1 in x and y, in groups of 2 x 2 for vector instructions.
struct ReferencePatch {
    int side = 0;  // even
    bool textured = false;
    float mean = 0, variance = 0;
    float weights[kMaxPatchSide * kMaxPatchSide];   // sum 1
    float weighted[kMaxPatchSide * kMaxPatchSide];  // weight x (value - mean): sum 0
};

/// Samples near the centre, in position and in grey value, get the largest weights.  [ACMM]
TVSGS_HD inline void make_patch(
    const GreyImage& image, int x, int y, int side, ReferencePatch& patch) {
    constexpr float kSpatial = 1 / (2 * 5.0f * 5.0f);  // per pixel
    constexpr float kColor = 255 / 18.0f;              // 18 grey levels
    patch.side = side;
    const float centre = image.at_clamped(x, y);
    float total = 0, mean = 0;
    for (int j = 0, k = 0; j < side; j += 2)
        for (int i = 0; i < side; i += 2)
            for (int lane = 0; lane < 4; ++lane, ++k) {
                const int dx = 2 * (i + (lane & 1)) - side + 1;
                const int dy = 2 * (j + (lane >> 1)) - side + 1;
                const float value = image.at_clamped(x + dx, y + dy) - centre;
                const float distance = std::sqrt(static_cast<float>(dx * dx + dy * dy));
                const float weight = std::exp(-distance * kSpatial - std::abs(value) * kColor);
                patch.weights[k] = weight;
                patch.weighted[k] = value;
                total += weight;
                mean += weight * value;
            }
    mean /= total;
    patch.variance = 0;
    for (int k = 0; k < side * side; ++k) {
        const float value = patch.weighted[k] - mean;
        patch.weights[k] /= total;
        patch.weighted[k] = patch.weights[k] * value;
        patch.variance += patch.weighted[k] * value;
    }
    patch.textured = patch.variance > image.min_variance;
    patch.mean = mean + centre;
}

/// Weighted sums over the patch's image in a source, of values minus the patch's mean.
struct SourceSums {
    float value = 0, square = 0, product = 0;
};
template <bool kClamp>  // false: the whole patch lies inside
TVSGS_HD inline SourceSums sum_source(const ReferencePatch& patch,
                                      const GreyImage& source,
                                      const PatchWarp& warp) {
    const float reach = static_cast<float>(patch.side - 1);
    const Vec3f step_x = 2 * warp.per_x, step_y = 2 * warp.per_y;
    const Pack<float> lane_x = four(0, step_x.x, step_y.x, step_x.x + step_y.x);
    const Pack<float> lane_y = four(0, step_x.y, step_y.y, step_x.y + step_y.y);
    const Pack<float> lane_z = four(0, step_x.z, step_y.z, step_x.z + step_y.z);
    Pack<float> value_sum{}, square_sum{}, product_sum{};
    Vec3f row = warp.at_centre - reach * (warp.per_x + warp.per_y);
    const float* weights = patch.weights;
    const float* weighted = patch.weighted;
    for (int j = 0; j < patch.side; j += 2) {
        Vec3f h = row;
        for (int i = 0; i < patch.side; i += 2, weights += 4, weighted += 4) {
            const Pack<float> inverse_z = 1.0f / (h.z + lane_z);
            const Pack<float> value = source.bilinear<kClamp>((h.x + lane_x) * inverse_z - 0.5f,
                                                              (h.y + lane_y) * inverse_z - 0.5f) -
                                      patch.mean;
            const Pack<float> weighted_value = four_at(weights) * value;
            value_sum += weighted_value;
            square_sum += weighted_value * value;
            product_sum += four_at(weighted) * value;
            h += 2 * step_x;
        }
        row += 2 * step_y;
    }
    const auto sum = [](const Pack<float>& a) { return (a[0] + a[1]) + (a[2] + a[3]); };
    return {sum(value_sum), sum(square_sum), sum(product_sum)};
}

/// 1 - weighted correlation of the patch with its image in a source, in [0, 2]; 2 if the centre
/// lies outside or either side has no texture.
TVSGS_HD inline float patch_cost(const ReferencePatch& patch,
                                 const GreyImage& source,
                                 const PatchWarp& warp) {
    const float reach = static_cast<float>(patch.side - 1);
    const float z_spread = reach * (std::abs(warp.per_x.z) + std::abs(warp.per_y.z));
    if (!patch.textured || !(warp.at_centre.z > z_spread)) return kWorstCost;
    const float inverse_z = 1 / warp.at_centre.z;
    const float u = warp.at_centre.x * inverse_z, v = warp.at_centre.y * inverse_z;
    if (!source.contains(u, v, 0)) return kWorstCost;

    bool inside = true;  // a homography keeps a square convex, so its corners suffice
    for (int corner = 0; corner < 4; ++corner) {
        const Vec3f h = warp.at_centre + ((corner & 1) != 0 ? reach : -reach) * warp.per_x +
                        ((corner & 2) != 0 ? reach : -reach) * warp.per_y;
        inside &= source.contains(h.x / h.z, h.y / h.z, 0.51f);
    }
    const SourceSums sums =
        inside ? sum_source<false>(patch, source, warp) : sum_source<true>(patch, source, warp);
    const float variance = sums.square - sums.value * sums.value;
    if (!(variance > source.min_variance)) return kWorstCost;
    const float cost = 1 - sums.product / std::sqrt(patch.variance * variance);
    return cost < 0 ? 0 : cost > kWorstCost ? kWorstCost : cost;
}

/// The source's pixel that contains a point of the source's frame, or {-1, -1}.
TVSGS_HD inline Vec2<int> source_pixel(const SourceView& source, Vec3f point_source) {
    if (!(point_source.z > 0)) return {-1, -1};
    const float u = source.camera.fx_px * point_source.x / point_source.z + source.camera.cx_px;
    const float v = source.camera.fy_px * point_source.y / point_source.z + source.camera.cy_px;
    if (!(u >= 0 && u < static_cast<float>(source.camera.width_px) && v >= 0 &&
          v < static_cast<float>(source.camera.height_px)))
        return {-1, -1};
    return {static_cast<int>(u), static_cast<int>(v)};
}

/// The surface in a source's depth map in the direction of a point.
struct Crosscheck {
    int pixel = -1;             // in the source; -1: nothing there
    Vec3f point_reference;      // its surface point, in the reference camera's frame
    float reprojection_px = 0;  // distance of its image from the reference pixel's centre
};
/// `depths`: of all views, 0 = none. Uses the depth of the pixel that contains the point.
TVSGS_HD inline Crosscheck crosscheck(const SourceView& source,
                                      const Camera& reference,
                                      Vec3f point_reference,
                                      Span<const float> depths) {
    const Rigid3f& T = source.source_from_reference;
    const Vec2<int> q = source_pixel(source, T * point_reference);
    if (q.x < 0) return {};
    const int pixel = q.y * source.camera.width_px + q.x;
    const float depth = depths[source.first_pixel + pixel];
    if (!(depth > 0)) return {};
    const Vec3f there = depth * pixel_ray(source.camera, q.x, q.y);
    const Vec3f back = transpose_times(T.R, there - T.t);
    if (!(back.z > 0)) return {};
    const float du = reference.fx_px * (back.x / back.z - point_reference.x / point_reference.z);
    const float dv = reference.fy_px * (back.y / back.z - point_reference.y / point_reference.z);
    return {pixel, back, std::sqrt(du * du + dv * dv)};
}

/// Cosine of the angle between the two cameras' rays to a point.
TVSGS_HD inline float triangulation_cosine(const SourceView& source, Vec3f point_reference) {
    const Vec3f centre =
        -transpose_times(source.source_from_reference.R, source.source_from_reference.t);
    return dot(normalize(point_reference), normalize(point_reference - centre));
}

/// The nearest unit vector that faces the camera along `ray` by at least kMinFacing; other normals
/// are invisible.
TVSGS_HD inline Vec3f facing(Vec3f normal, Vec3f ray) {
    if (dot(normal, ray) > 0) normal = -normal;
    const float lack = dot(normal, ray) + 2 * kMinFacing;
    return lack > 0 ? normalize(normal - (lack / dot(ray, ray)) * ray) : normal;
}

}  // namespace tvsgs
