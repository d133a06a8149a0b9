// Kernels of PatchMatch for one pixel, for both devices.  [ACMM]
#pragma once

#include <cstdint>

#include "core/math/rng.h"
#include "mvs/stereo/mvs_math.h"

namespace tvsgs {

/// One reference view at one image size.
struct StereoPass {
    Camera camera;
    int view = 0, level = 0;
    GreyImage image;
    Span<const float> images;  // of all views
    Span<const SourceView> sources;
    Span<SurfacePlane> planes;
    Span<float> costs;
    Span<std::uint8_t> selected;              // sources in use, one bit each
    float far_inverse = 0, near_inverse = 0;  // 1 / depth: the range
    int side = 6;                             // of a patch, in samples
    std::uint64_t seed = 0;

    TVSGS_HD int source_count() const { return sources.size(); }
    TVSGS_HD GreyImage source_image(const SourceView& source) const {
        return {images.data + source.first_pixel, source.camera.width_px, source.camera.height_px,
                source.min_variance};
    }
    TVSGS_HD std::size_t index(int x, int y) const {
        return static_cast<std::size_t>(y) * camera.width_px + x;
    }
    TVSGS_HD bool contains(int x, int y) const {
        return x >= 0 && x < camera.width_px && y >= 0 && y < camera.height_px;
    }
    TVSGS_HD bool in_range(float depth) const {
        return depth > 0 && depth * far_inverse <= 1 && depth * near_inverse >= 1;
    }
    TVSGS_HD Random4 random(int x, int y, int iteration, int draw) const {
        return random4(seed, RandomStream::stereo,
                       (static_cast<std::uint64_t>(view) << 32) + index(x, y),
                       static_cast<std::uint32_t>((level << 20) + (iteration << 4) + draw));
    }
    /// Depth at a share of the range, uniform in inverse depth.
    TVSGS_HD float depth_at(float share) const {
        return 1 / (far_inverse + share * (near_inverse - far_inverse));
    }
    TVSGS_HD float source_cost(
        int source, int x, int y, const ReferencePatch& patch, const SurfacePlane& plane) const {
        const SourceView& s = sources[source];
        return patch_cost(patch, source_image(s), plane_warp(s, camera, x, y, plane));
    }
};

/// Half of the pixels, as on a checkerboard, in tiles of 32 x 16: neighbours in space are processed
/// at almost the same time.
struct Checkerboard {
    int width, height, color;

    TVSGS_HD static int count(int width, int height) {
        return (width + 31) / 32 * ((height + 15) / 16) * 256;
    }
    TVSGS_HD Vec2<int> pixel(int i) const {
        const int tiles = (width + 31) / 32, tile = i / 256, row = i % 256 / 16, column = i % 16;
        return {tile % tiles * 32 + 2 * column + ((row + color) & 1), tile / tiles * 16 + row};
    }
};

/// Inserts a value into `count` ascending ones.
TVSGS_HD inline void insert_sorted(float* sorted, int count, float value) {
    for (; count > 0 && sorted[count - 1] > value; --count) sorted[count] = sorted[count - 1];
    sorted[count] = value;
}

/// Mean of the `best` smallest of `count` costs.
TVSGS_HD inline float mean_of_best(const float* costs, int count, int best) {
    float sorted[kMaxSources];
    for (int i = 0; i < count; ++i) insert_sorted(sorted, i, costs[i]);
    float sum = 0;
    for (int i = 0; i < best; ++i) sum += sorted[i];
    return sum / static_cast<float>(best);
}

/// A unit vector within `angle` of facing the camera.
TVSGS_HD inline Vec3f random_normal(Vec3f ray, float angle, Random4 random) {
    const Vec3f towards = normalize(-ray);
    const Vec3f axis = normal3(random);
    return facing(normalize(towards + std::tan(angle) * uniform(random.v[3]) *
                                          normalize(axis - dot(axis, towards) * towards)),
                  ray);
}

/// Initialises the plane of each pixel. Pixels of one colour get the best of 128 parallel planes.
/// The other colour gets a random plane; it reads its neighbours first. Normals are random around
/// the viewing ray.
struct SweepBody {
    static constexpr int kPlanes = 128;
    static constexpr float kNormalSpread = 0.35f;  // 20 degrees
    StereoPass pass;

    TVSGS_HD void operator()(int i) const {
        const int x = i % pass.camera.width_px, y = i / pass.camera.width_px;
        const std::size_t at = pass.index(x, y);
        const Vec3f ray = pixel_ray(pass.camera, x, y);
        ReferencePatch patch;
        make_patch(pass.image, x, y, 4, patch);  // 7 x 7
        const int count = pass.source_count();
        float best_cost = kWorstCost;
        SurfacePlane best{{0, 0, -1}, pass.depth_at(uniform(pass.random(x, y, 0, 0).v[0]))};
        if (((x + y) & 1) != 0 && patch.textured) {
            for (int k = 0; k < kPlanes; ++k) {
                const SurfacePlane plane{{0, 0, -1},
                                         pass.depth_at((static_cast<float>(k) + 0.5f) / kPlanes)};
                float costs[kMaxSources];
                for (int j = 0; j < count; ++j) costs[j] = pass.source_cost(j, x, y, patch, plane);
                const float cost = mean_of_best(costs, count, (count + 1) / 2);
                if (cost < best_cost) best_cost = cost, best = plane;
            }
        }
        best.normal = random_normal(ray, kNormalSpread, pass.random(x, y, 0, 1));
        pass.planes[at] = best;
        pass.costs[at] = best_cost;
        pass.selected[at] = 0xff;
    }
};

/// Initialises planes from the half-size level: extends to the pixel the one of the four
/// surrounding planes that is nearest in position and grey value.
struct UpsampleBody {
    StereoPass pass;
    Camera coarse_camera;
    GreyImage coarse_image;
    Span<const SurfacePlane> coarse_planes;
    Span<const float> coarse_costs;
    Span<const std::uint8_t> coarse_selected;

    TVSGS_HD void operator()(int i) const {
        const int x = i % pass.camera.width_px, y = i / pass.camera.width_px;
        const std::size_t at = pass.index(x, y);
        const float grey = pass.image.pixels[at];
        const int x0 = (x - 1) >> 1, y0 = (y - 1) >> 1;  // floor
        float best = -1;
        std::size_t from = 0;
        Vec2<int> place;
        for (int corner = 0; corner < 4; ++corner) {
            const int cx = clamped(x0 + (corner & 1), coarse_camera.width_px);
            const int cy = clamped(y0 + (corner >> 1), coarse_camera.height_px);
            const std::size_t there = static_cast<std::size_t>(cy) * coarse_camera.width_px + cx;
            const float dx = (static_cast<float>(x) + 0.5f) / 2 - (static_cast<float>(cx) + 0.5f);
            const float dy = (static_cast<float>(y) + 0.5f) / 2 - (static_cast<float>(cy) + 0.5f);
            const float weight = std::exp(-2 * (dx * dx + dy * dy) -
                                          10 * std::abs(grey - coarse_image.pixels[there]));
            if (weight > best) best = weight, from = there, place = {cx, cy};
        }
        const SurfacePlane plane = coarse_planes[from];
        const Vec3f ray = pixel_ray(pass.camera, x, y);
        float depth = depth_on_ray(plane, pixel_ray(coarse_camera, place.x, place.y), ray);
        if (!pass.in_range(depth)) depth = plane.depth;
        pass.planes[at] = {facing(plane.normal, ray), depth};
        pass.costs[at] = coarse_costs[from];
        pass.selected[at] = coarse_selected[from];
    }
    TVSGS_HD static int clamped(int v, int size) { return v < 0 ? 0 : v >= size ? size - 1 : v; }
};

/// Copies from a level of the same size.
struct CopyBody {
    StereoPass from, to;
    TVSGS_HD void operator()(int i) const {
        const std::size_t at = static_cast<std::size_t>(i);
        to.planes[at] = from.planes[at];
        to.costs[at] = from.costs[at];
        to.selected[at] = from.selected[at];
    }
};

/// Clears the planes of a view that overlaps with no other.
struct ClearBody {
    StereoPass pass;
    TVSGS_HD void operator()(int i) const {
        pass.planes[i] = {{0, 0, -1}, 0};
        pass.costs[i] = kWorstCost;
    }
};

/// One iteration for the pixels of one colour, which read only planes of the other colour: tries
/// the best surrounding planes, then variations of the best one.
struct PropagateBody {
    static constexpr float kGeometricWeight = 0.2f, kGeometricCap_px = 3, kNoLimit = 1e9f;
    StereoPass pass;
    Checkerboard board;
    int iteration = 0;
    int best_sources = 0;      // > 0: the cost is the mean over this number of best sources
    Span<const float> depths;  // of all views, for the geometric cost; empty: only images

    /// Weights of the sources for a pixel.
    struct Weights {
        float of[kMaxSources], total = 0;
    };
    struct Candidates {
        SurfacePlane planes[8];
        float costs[8][kMaxSources];
        int count = 0;
    };

    TVSGS_HD void operator()(int i) const {
        const Vec2<int> pixel = board.pixel(i);
        const int x = pixel.x, y = pixel.y;
        if (!pass.contains(x, y)) return;
        const std::size_t at = pass.index(x, y);
        ReferencePatch patch;
        make_patch(pass.image, x, y, pass.side, patch);
        if (!patch.textured) {
            pass.costs[at] = kWorstCost;
            return;
        }

        // 1. Costs of the planes of eight surrounding regions in every source.
        const Vec3f ray = pixel_ray(pass.camera, x, y);
        Candidates candidates;
        for (int region = 0; region < 8; ++region) add_candidate(x, y, region, ray, candidates);
        for (int c = 0; c < candidates.count; ++c)
            for (int j = 0; j < pass.source_count(); ++j)
                candidates.costs[c][j] = pass.source_cost(j, x, y, patch, candidates.planes[c]);

        // 2. Weights of the sources, and the best plane with them.
        Weights weights;
        if (best_sources == 0) pass.selected[at] = choose_sources(x, y, candidates, weights);
        SurfacePlane best = pass.planes[at];
        float best_cost = plane_cost(x, y, patch, weights, best, kNoLimit);
        for (int c = 0; c < candidates.count; ++c) {
            const SurfacePlane& plane = candidates.planes[c];
            const float cost = combined_cost(x, y, plane, weights, kNoLimit,
                                             [&](int j) { return candidates.costs[c][j]; });
            if (cost < best_cost) best_cost = cost, best = plane;
        }

        // 3. Variations of the best plane.
        for (int k = 0; k < 6; ++k) {
            const SurfacePlane plane = variation(k, x, y, ray, best);
            if (!pass.in_range(plane.depth)) continue;
            const float cost = plane_cost(x, y, patch, weights, plane, best_cost);
            if (cost < best_cost) best_cost = cost, best = plane;
        }
        pass.planes[at] = best;
        pass.costs[at] = best_cost;
    }

private:
    /// Adds the plane of least cost of a region, extended to the pixel. Regions 0-3: V shapes next
    /// to the pixel; 4-7: strips farther away.
    TVSGS_HD void add_candidate(int x, int y, int region, Vec3f ray, Candidates& candidates) const {
        const int direction = region & 3;
        const int ax = direction == 0 ? 1 : direction == 1 ? -1 : 0;
        const int ay = direction == 2 ? 1 : direction == 3 ? -1 : 0;
        float least = 1e9f;
        int best_x = -1, best_y = 0;
        const auto look = [&](int px, int py) {
            if (!pass.contains(px, py)) return;
            const float cost = pass.costs[pass.index(px, py)];
            if (cost < least) least = cost, best_x = px, best_y = py;
        };
        if (region < 4) {
            look(x + ax, y + ay);
            for (int step = 1; step <= 3; ++step)
                for (int sign = -1; sign <= 1; sign += 2)
                    look(x + ax * (1 + step) + ay * sign * step,
                         y + ay * (1 + step) + ax * sign * step);
        } else {
            for (int step = 3; step <= 23; step += 2) look(x + ax * step, y + ay * step);
        }
        if (best_x < 0) return;
        const SurfacePlane plane = pass.planes[pass.index(best_x, best_y)];
        const float depth = depth_on_ray(plane, pixel_ray(pass.camera, best_x, best_y), ray);
        if (pass.in_range(depth)) candidates.planes[candidates.count++] = {plane.normal, depth};
    }

    /// Chooses sources that agree with several candidates and preferably are in use by neighbours.
    TVSGS_HD std::uint8_t choose_sources(int x,
                                         int y,
                                         const Candidates& candidates,
                                         Weights& weights) const {
        const float t = static_cast<float>(iteration);
        const float good_below = 0.8f * std::exp(-t * t / 90);
        const int n = pass.source_count();
        float largest = 0;
        for (int j = 0; j < n; ++j) {
            int good = 0, bad = 0;
            float sum = 0;
            for (int c = 0; c < candidates.count; ++c) {
                const float cost = candidates.costs[c][j];
                if (cost < good_below) ++good, sum += std::exp(-cost * cost / 0.18f);
                if (cost > 1.2f) ++bad;
            }
            float weight = 0;
            if (bad < 3)
                weight = good > 2 ? sum / static_cast<float>(good)
                                  : std::exp(-good_below * good_below / 0.32f);
            float nearby = 0;
            for (int side = 0; side < 4; ++side) {
                const int px = x + (side == 0) - (side == 1), py = y + (side == 2) - (side == 3);
                if (!pass.contains(px, py)) continue;
                nearby += (pass.selected[pass.index(px, py)] >> j & 1) != 0 ? 0.9f : 0.1f;
            }
            weights.of[j] = weight * nearby;
            weights.total += weights.of[j];
            largest = weights.of[j] > largest ? weights.of[j] : largest;
        }
        if (!(weights.total > 0)) {
            for (int j = 0; j < n; ++j) weights.of[j] = 1;
            weights.total = static_cast<float>(n);
            return 0xff;
        }
        int bits = 0;
        for (int j = 0; j < n; ++j) bits |= (weights.of[j] >= 0.5f * largest ? 1 : 0) << j;
        return static_cast<std::uint8_t>(bits);
    }

    /// Distance between the depths of the two views, in pixels of this view.
    TVSGS_HD float geometric_cost(int source, int x, int y, const SurfacePlane& plane) const {
        const Crosscheck check = crosscheck(pass.sources[source], pass.camera,
                                            plane.depth * pixel_ray(pass.camera, x, y), depths);
        return check.pixel >= 0 && check.reprojection_px < kGeometricCap_px ? check.reprojection_px
                                                                            : kGeometricCap_px;
    }

    /// photometric(j): cost in source j. Stops early if the result must exceed `limit`.
    template <class Photometric>
    TVSGS_HD float combined_cost(int x,
                                 int y,
                                 const SurfacePlane& plane,
                                 const Weights& weights,
                                 float limit,
                                 const Photometric& photometric) const {
        const int n = pass.source_count();
        if (best_sources > 0) {
            float costs[kMaxSources];
            for (int j = 0; j < n; ++j) costs[j] = photometric(j);
            return mean_of_best(costs, n, best_sources);
        }
        float sum = 0;
        const float enough = limit * weights.total;
        for (int j = 0; j < n && sum < enough; ++j) {
            if (!(weights.of[j] > 0)) continue;
            float cost = photometric(j);
            if (!depths.empty()) cost += kGeometricWeight * geometric_cost(j, x, y, plane);
            sum += weights.of[j] * cost;
        }
        return sum / weights.total;
    }
    TVSGS_HD float plane_cost(int x,
                              int y,
                              const ReferencePatch& patch,
                              const Weights& weights,
                              const SurfacePlane& plane,
                              float limit) const {
        return combined_cost(x, y, plane, weights, limit,
                             [&](int j) { return pass.source_cost(j, x, y, patch, plane); });
    }

    /// Variation `k` of the best plane, of six. Steps have random sizes over several octaves: large
    /// ones find surfaces, small ones refine them. From the second iteration on, a small step of
    /// both depth and normal replaces the plane of random depth and normal, which would no longer
    /// win.
    TVSGS_HD SurfacePlane variation(int k, int x, int y, Vec3f ray, SurfacePlane plane) const {
        const Random4 r = pass.random(x, y, iteration, 2 + k);
        const float octaves = std::exp2(-6 * uniform(r.v[0]));
        const float step = (r.v[1] & 1) != 0 ? octaves : -octaves;
        const float near_depth = plane.depth * (1 + 0.02f * step);
        const auto tilted = [&](float angle) {
            return facing(normalize(plane.normal + angle * normalize(normal3(pass.random(
                                                               x, y, iteration, 8 + k)))),
                          ray);
        };
        switch (k) {
            case 0:
                return {plane.normal, pass.depth_at(uniform(r.v[0]))};
            case 1:
                return {random_normal(ray, 1.3f, r), plane.depth};
            case 2:
                if (iteration == 0)
                    return {random_normal(ray, 1.3f, r), pass.depth_at(uniform(r.v[1]))};
                return {tilted(0.2f * octaves), near_depth};
            case 3:
                return {tilted(0.2f * octaves), plane.depth};
            case 4:
                return {plane.normal, near_depth};
            default:
                return {surface_normal(x, y, ray, plane.normal), plane.depth};
        }
    }

    /// Normal of the depth map from the four neighbours; `otherwise` if they do not form a surface.
    TVSGS_HD Vec3f surface_normal(int x, int y, Vec3f ray, Vec3f otherwise) const {
        if (!pass.contains(x - 1, y - 1) || !pass.contains(x + 1, y + 1)) return otherwise;
        const auto point = [&](int px, int py) {
            return pass.planes[pass.index(px, py)].depth * pixel_ray(pass.camera, px, py);
        };
        const Vec3f left = point(x - 1, y), right = point(x + 1, y);
        const Vec3f up = point(x, y - 1), down = point(x, y + 1);
        const Vec3f n = cross(down - up, right - left);
        const float length = norm(n);
        if (!(length > 1e-12f * left.z * left.z) ||
            !(std::abs(right.z - left.z) < 0.05f * left.z) ||
            !(std::abs(down.z - up.z) < 0.05f * up.z))
            return otherwise;
        return facing(n / length, ray);
    }
};

/// Copies the depths, for readers of other pixels or views while planes change.
struct TakeDepthsBody {
    Span<const SurfacePlane> planes;
    Span<float> depths;
    TVSGS_HD void operator()(int i) const { depths[i] = planes[i].depth; }
};

/// Median of 21 depths in a checkerboard around the pixel; removes single wrong depths.
struct MedianBody {
    StereoPass pass;
    Span<const float> depths;  // of this view

    TVSGS_HD void operator()(int i) const {
        if (!(pass.costs[i] > 1e-3f)) return;
        const int x = i % pass.camera.width_px, y = i / pass.camera.width_px;
        constexpr int kOffsets[21][2] = {{0, 0},  {0, -1},  {0, 1},  {0, -3}, {0, 3}, {0, -5},
                                         {0, 5},  {-1, 0},  {1, 0},  {-3, 0}, {3, 0}, {-5, 0},
                                         {5, 0},  {-1, -2}, {-1, 2}, {1, -2}, {1, 2}, {-2, -1},
                                         {-2, 1}, {2, -1},  {2, 1}};
        float sorted[21];
        int count = 0;
        for (const auto& offset : kOffsets) {
            const int px = x + offset[0], py = y + offset[1];
            if (pass.contains(px, py)) insert_sorted(sorted, count++, depths[pass.index(px, py)]);
        }
        pass.planes[i].depth = sorted[count / 2];
    }
};

}  // namespace tvsgs
