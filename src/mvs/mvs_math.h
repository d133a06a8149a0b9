// Formulas of PatchMatch stereo for one pixel: planes, their homographies, the bilaterally weighted
// correlation of patches, and what one view's depth says about another's.
#pragma once

#include <cmath>

#include "core/buffer.h"
#include "core/camera.h"

namespace tvsgs {

inline constexpr int kMaxSources = 8;     // per reference view; also the bits of a mask of views
inline constexpr int kMaxPatchSide = 8;   // samples per side of a patch, two pixels apart
inline constexpr float kWorstCost = 2;    // 1 - correlation of patches that oppose each other
inline constexpr float kMinFacing = 0.05f;  // planes seen flatter than that project to no area

/// A piece of surface in the frame of the camera that sees it: unit normal towards the camera, and
/// the depth (z) at the pixel that holds it; 0: none.
struct alignas(16) SurfacePlane {
    Vec3f normal;
    float depth = 0;
};

/// Depth along `ray` of the plane that a pixel with ray `own_ray` holds; 0 where they do not meet.
TVSGS_HD inline float depth_on_ray(const SurfacePlane& plane, Vec3f own_ray, Vec3f ray) {
    const float slope = dot(plane.normal, ray);
    return slope < -kMinFacing ? plane.depth * dot(plane.normal, own_ray) / slope : 0;
}

/// One source view as the reference view needs it.
struct SourceView {
    Camera camera;
    int view = 0, first_pixel = 0;  // its images start there
    Rigid3f source_from_reference;
    Mat3f pixels_at_infinity;  // K_source R K_reference^-1
    Vec3f epipole;             // K_source t
};

/// Source pixels (homogeneous) of a patch around a reference pixel: at_centre + dx per_x + dy
/// per_y.
struct PatchWarp {
    Vec3f at_centre, per_x, per_y;
};

/// The homography of a plane, H = K_s (R + t n^T / d) K_r^-1 with n . X = d, around the centre of
/// pixel (x, y).  [Zheng14, Eq. 2]
TVSGS_HD inline PatchWarp plane_warp(const SourceView& source,
                                     const Camera& reference,
                                     int x,
                                     int y,
                                     const SurfacePlane& plane) {
    const Mat3f& M = source.pixels_at_infinity;
    const Vec3f ray = pixel_ray(reference, x, y);
    const float inverse_distance = 1 / (plane.depth * dot(plane.normal, ray));
    const Vec3f pixel{static_cast<float>(x) + 0.5f, static_cast<float>(y) + 0.5f, 1};
    return {M * pixel + (1 / plane.depth) * source.epipole,
            column(M, 0) +
                (plane.normal.x / reference.fx_px * inverse_distance) * source.epipole,
            column(M, 1) +
                (plane.normal.y / reference.fy_px * inverse_distance) * source.epipole};
}

/// A grey image in [0, 1], row by row.
struct GreyImage {
    const float* pixels = nullptr;
    int width = 0, height = 0;

    TVSGS_HD float at_clamped(int x, int y) const {
        x = x < 0 ? 0 : x >= width ? width - 1 : x;
        y = y < 0 ? 0 : y >= height ? height - 1 : y;
        return pixels[static_cast<std::size_t>(y) * width + x];
    }
};

/// The reference side of the correlation, shared by all hypotheses of a pixel: samples at offsets
/// -(side - 1), -(side - 3), ..., side - 1 in x and y.
struct ReferencePatch {
    int side = 0;
    float mean = 0, variance = 0;
    float weights[kMaxPatchSide * kMaxPatchSide];   // sum 1
    float weighted[kMaxPatchSide * kMaxPatchSide];  // weight x (value - mean): sum 0
};

/// Samples near the centre, in the image and in grey value, count most.  [ACMM]
TVSGS_HD inline void make_patch(
    const GreyImage& image, int x, int y, int side, ReferencePatch& patch) {
    constexpr float kSpatial = 1 / (2 * 5.0f * 5.0f);  // per pixel
    constexpr float kColor = 255 / 18.0f;              // 18 grey levels
    patch.side = side;
    const float centre = image.at_clamped(x, y);
    float total = 0, mean = 0;
    for (int j = 0, k = 0; j < side; ++j)
        for (int i = 0; i < side; ++i, ++k) {
            const int dx = 2 * i - side + 1, dy = 2 * j - side + 1;
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
    patch.mean = mean + centre;
}

/// 1 - weighted correlation of the patch with its image in a source, in [0, 2]; 2 where the centre
/// is not seen or either side has no texture.
TVSGS_HD inline float patch_cost(const ReferencePatch& patch,
                                 const GreyImage& source,
                                 const PatchWarp& warp,
                                 float min_variance) {
    const float reach = static_cast<float>(patch.side - 1);
    const float z_spread = reach * (std::abs(warp.per_x.z) + std::abs(warp.per_y.z));
    if (!(patch.variance > min_variance) || !(warp.at_centre.z > z_spread)) return kWorstCost;
    const float width = static_cast<float>(source.width), height = static_cast<float>(source.height);
    const float u_centre = warp.at_centre.x / warp.at_centre.z;
    const float v_centre = warp.at_centre.y / warp.at_centre.z;
    if (!(u_centre >= 0 && u_centre < width && v_centre >= 0 && v_centre < height))
        return kWorstCost;

    const float u_max = width - 1, v_max = height - 1;
    float sum = 0, squares = 0, covariance = 0;
    Vec3f row = warp.at_centre - reach * (warp.per_x + warp.per_y);
    for (int j = 0, k = 0; j < patch.side; ++j) {
        Vec3f h = row;
        for (int i = 0; i < patch.side; ++i, ++k) {
            const float inverse_z = 1 / h.z;
            float u = h.x * inverse_z - 0.5f, v = h.y * inverse_z - 0.5f;
            u = u < 0 ? 0 : u > u_max ? u_max : u;
            v = v < 0 ? 0 : v > v_max ? v_max : v;
            int x = static_cast<int>(u), y = static_cast<int>(v);
            x = x > source.width - 2 ? source.width - 2 : x;
            y = y > source.height - 2 ? source.height - 2 : y;
            const float fx = u - static_cast<float>(x), fy = v - static_cast<float>(y);
            const float* p = source.pixels + static_cast<std::ptrdiff_t>(y) * source.width + x;
            const float above = p[0] + fx * (p[1] - p[0]);
            const float below = p[source.width] + fx * (p[source.width + 1] - p[source.width]);
            const float value = above + fy * (below - above) - patch.mean;
            const float weighted_value = patch.weights[k] * value;
            sum += weighted_value;
            squares += weighted_value * value;
            covariance += patch.weighted[k] * value;
            h += 2 * warp.per_x;
        }
        row += 2 * warp.per_y;
    }
    const float variance = squares - sum * sum;
    if (!(variance > min_variance)) return kWorstCost;
    const float cost = 1 - covariance / std::sqrt(patch.variance * variance);
    return cost < 0 ? 0 : cost > kWorstCost ? kWorstCost : cost;
}

/// Where a point of the reference camera's frame falls in a source: the pixel, or {-1, -1}.
TVSGS_HD inline Vec2<int> source_pixel(const SourceView& source, Vec3f point_source) {
    if (!(point_source.z > 0)) return {-1, -1};
    const float u = source.camera.fx_px * point_source.x / point_source.z + source.camera.cx_px;
    const float v = source.camera.fy_px * point_source.y / point_source.z + source.camera.cy_px;
    if (!(u >= 0 && u < static_cast<float>(source.camera.width_px) && v >= 0 &&
          v < static_cast<float>(source.camera.height_px)))
        return {-1, -1};
    return {static_cast<int>(u), static_cast<int>(v)};
}

/// What a source's depth map says about a point: the surface it saw in that direction.
struct Crosscheck {
    int pixel = -1;             // in the source; -1: it sees nothing there
    Vec3f point_reference;      // its surface point, in the reference camera's frame
    float reprojection_px = 0;  // distance of its image from the reference pixel's centre
};
/// `depths`: of all views, 0 = none. The depth is that of the nearest pixel.
TVSGS_HD inline Crosscheck crosscheck(const SourceView& source,
                                      const Camera& reference,
                                      Vec3f point_reference,
                                      Span<const float> depths) {
    const Rigid3f& T = source.source_from_reference;
    const Vec2<int> q = source_pixel(source, T * point_reference);
    if (q.x < 0) return {};
    const int pixel = q.y * source.camera.width_px + q.x;
    const float depth = depths[static_cast<std::size_t>(source.first_pixel + pixel)];
    if (!(depth > 0)) return {};
    const Vec3f there = depth * pixel_ray(source.camera, q.x, q.y);
    const Vec3f back = transpose_times(T.R, there - T.t);
    if (!(back.z > 0)) return {};
    const float du = reference.fx_px * (back.x / back.z - point_reference.x / point_reference.z);
    const float dv = reference.fy_px * (back.y / back.z - point_reference.y / point_reference.z);
    return {pixel, back, std::sqrt(du * du + dv * dv)};
}

/// Cosine of the angle at which the two cameras see a point.
TVSGS_HD inline float triangulation_cosine(const SourceView& source, Vec3f point_reference) {
    const Vec3f centre = -transpose_times(source.source_from_reference.R,
                                          source.source_from_reference.t);
    return dot(normalize(point_reference), normalize(point_reference - centre));
}

/// Turns a unit vector into the nearest one that faces the camera along `ray` by at least
/// kMinFacing; other normals cannot be seen.
TVSGS_HD inline Vec3f facing(Vec3f normal, Vec3f ray) {
    if (dot(normal, ray) > 0) normal = -normal;
    const float lack = dot(normal, ray) + 2 * kMinFacing;
    return lack > 0 ? normalize(normal - (lack / dot(ray, ray)) * ray) : normal;
}

}  // namespace tvsgs
