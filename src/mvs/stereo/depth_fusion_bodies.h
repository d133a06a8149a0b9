// Filtering of depth maps by consistency between views, and their fusion to points, pixel by pixel.
#pragma once

#include "core/scene/scene.h"
#include "mvs/stereo/patch_match_bodies.h"

namespace tvsgs {

/// Limits within which the surfaces of two views are the same.
struct Agreement {
    float reprojection_px, relative_depth, normal_cosine;
    int sources;  // that must agree; 0: one if few can see the point, else two
};

/// Number of sources that must agree. A source can see a point if the point lies in its photograph,
/// shows its front, and nothing nearer is in its direction. Among many sources one may confirm a
/// wrong match by chance; among few, only one may be able to confirm it.
TVSGS_HD inline int agreement_needed(const Agreement& limits,
                                     const StereoPass& pass,
                                     Vec3f point,
                                     Vec3f normal,
                                     Span<const float> depths) {
    constexpr int kFew = 4;
    constexpr float kNearer = 0.95f;
    if (limits.sources > 0) return limits.sources;
    int can_see = 0;
    for (const SourceView& source : pass.sources) {
        const Vec3f there = source.source_from_reference * point;
        const Vec2<int> q = source_pixel(source, there);
        if (q.x < 0 || !(dot(source.source_from_reference.R * normal, there) < 0)) continue;
        const float depth = depths[static_cast<std::size_t>(source.first_pixel +
                                                            q.y * source.camera.width_px + q.x)];
        can_see += !(depth > 0 && depth < kNearer * there.z);
    }
    return can_see > kFew ? 2 : 1;
}

/// The source's pixel that shows the same surface, or -1. `planes` and `depths`: of all views.
TVSGS_HD inline Crosscheck agreeing_pixel(const SourceView& source,
                                          const Camera& reference,
                                          Vec3f point,
                                          Vec3f normal,
                                          Span<const float> depths,
                                          Span<const SurfacePlane> planes,
                                          const Agreement& limits) {
    Crosscheck check = crosscheck(source, reference, point, depths);
    if (check.pixel < 0) return check;
    const Vec3f other = planes[source.first_pixel + check.pixel].normal;
    const float cosine = dot(source.source_from_reference.R * normal, other);
    if (!(check.reprojection_px < limits.reprojection_px &&
          std::abs(check.point_reference.z - point.z) < limits.relative_depth * point.z &&
          cosine > limits.normal_cosine))
        check.pixel = -1;
    return check;
}

enum Uniqueness : std::uint8_t { kNoDepth, kNotTested, kUnique, kRepeated };
inline constexpr int kUniquenessStep = 2;  // px: pixels on a grid of this step are tested

/// Keeps a depth if enough sources see the same surface, at a sufficient angle, with similar
/// patches. confidence = share of agreeing sources, by weight, x clamp(1.2 - cost).
struct FilterBody {
    static constexpr float kMaxCost = 1;         // 1 - correlation; that of unrelated patches
    static constexpr int kRepetitionRange = 64;  // px searched for second matches
    StereoPass pass;
    Agreement limits;
    float max_angle_cosine;
    Span<const float> depths;              // of all views
    Span<const SurfacePlane> planes;       // of all views
    Span<const std::uint8_t> mask;         // of this view; empty: everything
    Span<float> kept_depths, confidences;  // of this view; overwritten
    Span<std::uint8_t> uniqueness;         // of this view; overwritten

    TVSGS_HD void operator()(int i) const {
        const std::size_t at = static_cast<std::size_t>(i);
        kept_depths[at] = confidences[at] = 0;
        uniqueness[at] = kNoDepth;
        if (!mask.empty() && mask[at] < kObjectMask) return;
        const SurfacePlane plane = pass.planes[at];
        const int x = i % pass.camera.width_px, y = i / pass.camera.width_px;
        if (!(plane.depth > 0)) return;
        // Surfaces near the ends of the depth range may lie beyond it.
        const float share =
            (1 / plane.depth - pass.far_inverse) / (pass.near_inverse - pass.far_inverse);
        if (!(share > 0.02f && share < 0.98f)) return;
        ReferencePatch patch;
        make_patch(pass.image, x, y, pass.side, patch);
        if (!patch.textured) return;
        const Vec3f point = plane.depth * pixel_ray(pass.camera, x, y);
        int agreeing = 0, which[kMaxSources];
        bool wide = false;
        float cost_sum = 0, weight_sum = 0;
        for (int j = 0; j < pass.source_count(); ++j) {
            const SourceView& source = pass.sources[j];
            if (agreeing_pixel(source, pass.camera, point, plane.normal, depths, planes, limits)
                    .pixel < 0)
                continue;
            const float cost = pass.source_cost(j, x, y, patch, plane);
            if (!(cost < kMaxCost)) continue;
            which[agreeing++] = j;
            cost_sum += cost;
            weight_sum += source.weight;
            wide |= triangulation_cosine(source, point) < max_angle_cosine;
        }
        if (!wide || agreeing < agreement_needed(limits, pass, point, plane.normal, depths)) return;
        const float cost = cost_sum / static_cast<float>(agreeing);
        const float similarity = 1.2f - cost > 1 ? 1 : 1.2f - cost;
        if (!(similarity > 0)) return;
        uniqueness[at] = x % kUniquenessStep != 0 || y % kUniquenessStep != 0     ? kNotTested
                         : is_repeated(x, y, patch, plane, which, agreeing, cost) ? kRepeated
                                                                                  : kUnique;
        kept_depths[at] = plane.depth;
        confidences[at] = weight_sum / static_cast<float>(pass.source_count()) * similarity;
    }

private:
    /// True if the patch matches equally well elsewhere on its viewing ray: a repeated texture, for
    /// which the cost cannot tell the right match. Searches kRepetitionRange pixels in the source
    /// where the patch moves fastest, in steps of a pixel, for a separate minimum of the cost
    /// behind a rise. A parabola gives the minimum between the steps.
    TVSGS_HD bool is_repeated(int x,
                              int y,
                              const ReferencePatch& patch,
                              const SurfacePlane& plane,
                              const int* which,
                              int count,
                              float best) const {
        constexpr float kRise = 0.15f, kAlike = 0.15f, kGood = 0.3f;
        PatchWarp warps[kMaxSources];
        float fastest = 0;
        for (int k = 0; k < count; ++k) {
            const SourceView& source = pass.sources[which[k]];
            warps[k] = plane_warp(source, pass.camera, x, y, plane);
            const float speed = pixels_per_step(warps[k], source);
            fastest = speed > fastest ? speed : fastest;
        }
        for (int sign = -1; sign <= 1; sign += 2) {
            bool risen = false;
            float before = best, last = best;  // costs of the two preceding steps
            for (int step = 1; step <= kRepetitionRange; ++step) {
                const float move = static_cast<float>(sign * step) / fastest;
                if (!pass.in_range(1 / (1 / plane.depth + move))) break;
                float cost = 0;  // sums only until a minimum is impossible
                for (int k = 0; k < count && cost < (best + 4 * kRise) * static_cast<float>(count);
                     ++k) {
                    const SourceView& source = pass.sources[which[k]];
                    cost +=
                        patch_cost(patch, pass.source_image(source), moved(warps[k], source, move));
                }
                cost /= static_cast<float>(count);
                if (risen && last <= before && last <= cost) {
                    const float bend = before - 2 * last + cost;
                    const float half = 0.5f * (before - cost);
                    const float bottom = bend > 0 ? last - half * half / (2 * bend) : last;
                    if (bottom < best + kAlike && bottom < kGood) return true;
                }
                risen |= cost > best + kRise;
                before = last;
                last = cost;
            }
        }
        return false;
    }
};

/// Drops a depth if most of the tested depths around it have a repeated texture: the others match
/// by chance.
struct DropRepeatedBody {
    int width, height;
    Span<const std::uint8_t> uniqueness;   // of this view
    Span<float> kept_depths, confidences;  // of this view

    TVSGS_HD void operator()(int i) const {
        constexpr int kReach = 10;  // px
        const std::size_t at = static_cast<std::size_t>(i);
        if (uniqueness[at] == kNoDepth) return;
        const int x = i % width, y = i / width;
        int found = 0, repeated = 0;
        for (int py = first_tested(y - kReach); py <= y + kReach && py < height;
             py += kUniquenessStep)
            for (int px = first_tested(x - kReach); px <= x + kReach && px < width;
                 px += kUniquenessStep) {
                const std::uint8_t kind = uniqueness[static_cast<std::size_t>(py) * width + px];
                found += kind >= kUnique;
                repeated += kind == kRepeated;
            }
        if (2 * repeated > found) kept_depths[at] = confidences[at] = 0;
    }
    TVSGS_HD static int first_tested(int place) {
        return place < 0 ? 0 : (place + kUniquenessStep - 1) / kUniquenessStep * kUniquenessStep;
    }
};

/// One point of the fused cloud.
struct FusedPoint {
    Vec3f position, normal;   // world frame
    float confidence = 0;     // 0: no point
    std::uint32_t color = 0;  // 0xBBGGRR
};

/// Marks pixels whose filtered depth agrees with enough sources, within the limits of the fusion.
struct ConfirmBody {
    StereoPass pass;
    Agreement limits;
    Span<const float> depths;  // of all views, filtered
    Span<const SurfacePlane> planes;
    Span<std::uint8_t> confirmed;  // of this view; overwritten
    int first_pixel;

    TVSGS_HD void operator()(int i) const {
        const std::size_t at = static_cast<std::size_t>(i);
        const float depth = depths[at + static_cast<std::size_t>(first_pixel)];
        confirmed[at] = 0;
        if (!(depth > 0)) return;
        const Vec3f point =
            depth * pixel_ray(pass.camera, i % pass.camera.width_px, i / pass.camera.width_px);
        const Vec3f normal = pass.planes[at].normal;
        int agreeing = 0;
        for (const SourceView& source : pass.sources)
            agreeing +=
                agreeing_pixel(source, pass.camera, point, normal, depths, planes, limits).pixel >=
                0;
        confirmed[at] = agreeing >= agreement_needed(limits, pass, point, normal, depths);
    }
};

/// Mean of the surfaces of all agreeing views. The first view that sees a surface fuses it, so its
/// points appear once, independent of the order of execution.
struct FuseBody {
    StereoPass pass;
    Agreement limits;
    Span<const float> depths, confidences;  // of all views, filtered
    Span<const SurfacePlane> planes;
    Span<const std::uint8_t> confirmed;  // of all views
    Span<const std::uint32_t> colors;    // of all views
    Span<FusedPoint> points;             // of this view; overwritten
    int first_pixel;

    TVSGS_HD void operator()(int i) const {
        const std::size_t own = static_cast<std::size_t>(first_pixel + i);
        points[i] = {};
        if (confirmed[own] == 0) return;
        const Vec3f normal_own = planes[own].normal;
        const Vec3f point = depths[own] * pixel_ray(pass.camera, i % pass.camera.width_px,
                                                    i / pass.camera.width_px);
        Vec3f position = point, normal = normal_own, color = unpacked(colors[own]);
        int count = 1;
        for (int j = 0; j < pass.source_count(); ++j) {
            const SourceView& source = pass.sources[j];
            const Crosscheck check =
                agreeing_pixel(source, pass.camera, point, normal_own, depths, planes, limits);
            if (check.pixel < 0) continue;
            const std::size_t there = static_cast<std::size_t>(source.first_pixel + check.pixel);
            if (source.view < pass.view && confirmed[there] != 0) return;
            position += check.point_reference;
            normal += transpose_times(source.source_from_reference.R, planes[there].normal);
            color += unpacked(colors[there]);
            ++count;
        }
        const Rigid3f& T = pass.camera.camera_from_world;
        const float share = 1 / static_cast<float>(count);
        points[i] = {transpose_times(T.R, share * position - T.t),
                     transpose_times(T.R, normalize(normal)), confidences[own],
                     packed(share * color)};
    }

    TVSGS_HD static Vec3f unpacked(std::uint32_t c) {
        return {static_cast<float>(c & 255), static_cast<float>(c >> 8 & 255),
                static_cast<float>(c >> 16 & 255)};
    }
    TVSGS_HD static std::uint32_t packed(Vec3f c) {
        const Vec3f r = c + Vec3f{0.5f, 0.5f, 0.5f};
        return static_cast<std::uint32_t>(r.x) | static_cast<std::uint32_t>(r.y) << 8 |
               static_cast<std::uint32_t>(r.z) << 16;
    }
};

}  // namespace tvsgs
