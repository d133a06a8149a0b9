// PatchMatch over image pyramids of all views, for both devices.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/progress.h"
#include "mvs/stereo/depth_fusion_bodies.h"
#include "mvs/stereo/patch_match.h"
#include "mvs/stereo/stereo_images.h"
#include "mvs/stereo/view_selection.h"

namespace tvsgs {

/// One reconstruction: constructor, then run().
template <class Device>
class PatchMatch {
public:
    PatchMatch(const std::vector<View>& views,
               const std::vector<Vec3f>& points,
               const StereoOptions& options)
        : views_(views), options_(options) {
        require_views(views);
        pyramids_ = make_pyramids(views);
        std::vector<Camera> cameras;
        for (const StereoPyramid& pyramid : pyramids_) cameras.push_back(pyramid.levels[0].camera);
        plans_ = plan_views(cameras, points, options.depth_near, options.depth_far);
        for (const StereoPyramid& pyramid : pyramids_)
            levels_ = std::max(levels_, static_cast<int>(pyramid.levels.size()));
    }

    StereoResult run() {
        progress_.emplace(str("stereo of ", view_count(), " views"), all_work());
        for (int level = levels_ - 1; level >= 0; --level) {
            enter_level(level);
            int iteration = 0;
            const bool coarsest = level == levels_ - 1;
            for (int k = 0; k < iterations_at(level); ++k)
                iterate(iteration++, coarsest && k == 0, false);
            // Coarse levels get one round, which removes depths that the views do not agree on
            // before the next level starts from them.
            for (int round = 0; round < rounds_at(level); ++round) {
                take_depths();
                for (int k = 0; k < 2; ++k) iterate(iteration++, false, true);
            }
        }
        StereoResult result = fuse();
        progress_.reset();
        return result;
    }

private:
    static constexpr float kMinAngleDeg = 1;  // below, depth is too uncertain

    /// Rounds of two iterations with the geometric cost.
    static int rounds_at(int level) { return level == 0 ? 2 : 1; }
    /// Iterations with images only. Finer levels start from the level before.
    int iterations_at(int level) const { return level == levels_ - 1 ? 4 : 2; }

    /// Pixels times iterations, over all levels. The filter takes about as long as two iterations.
    double all_work() const {
        double work = 0;
        for (int level = 0; level < levels_; ++level)
            for (int v = 0; v < view_count(); ++v) {
                const Camera& c = level_of(v, level).camera;
                work += double(c.width_px) * c.height_px *
                        (iterations_at(level) + 2 * rounds_at(level) + (level == 0 ? 2 : 0));
            }
        return work;
    }

    int view_count() const { return static_cast<int>(views_.size()); }
    bool few_views() const { return view_count() <= 5; }
    /// Pyramids of small views have fewer levels; their last level serves all coarser ones.
    const StereoLevel& level_of(int view, int level) const {
        const auto& levels = pyramids_[view].levels;
        return levels[std::min(static_cast<std::size_t>(level), levels.size() - 1)];
    }

    int pixel_count(int v) const {
        return first_pixel_[static_cast<std::size_t>(v) + 1] - first_pixel_[v];
    }
    /// One view's part of an array over all views.
    template <class T>
    Span<T> of_view(Span<T> all, int v) const {
        return {all.data + first_pixel_[v], static_cast<std::size_t>(pixel_count(v))};
    }

    /// Loads images and cameras of the next level and initialises its planes.
    void enter_level(int level) {
        const bool first = level == levels_ - 1;
        images_.swap(coarse_images_), planes_.swap(coarse_planes_);
        costs_.swap(coarse_costs_), selected_.swap(coarse_selected_);
        const std::vector<StereoPass> coarse = passes_;

        std::size_t pixels = 0;
        first_pixel_.clear();
        for (int v = 0; v < view_count(); ++v) {
            first_pixel_.push_back(static_cast<int>(pixels));
            const Camera& camera = level_of(v, level).camera;
            pixels += static_cast<std::size_t>(camera.width_px) * camera.height_px;
        }
        first_pixel_.push_back(static_cast<int>(pixels));
        if (pixels > 2000000000)
            throw Error(
                ExitCode::memory, view_count(), " views with ", grouped(pixels),
                " pixels: too many for stereo (limit 2,000,000,000); use smaller images (-r)");
        std::vector<float> grey;
        grey.reserve(pixels);
        for (int v = 0; v < view_count(); ++v) {
            const auto& image = level_of(v, level).grey;
            grey.insert(grey.end(), image.begin(), image.end());
        }
        copy(grey, images_);
        planes_.resize(pixels), costs_.resize(pixels), selected_.resize(pixels);
        depths_.resize(pixels);
        upload_sources(level);
        make_passes(level);

        for (const StereoPass& pass : passes_) {
            const auto for_pixels = [&](const auto& body) {
                parallel_for(Device{}, pixel_count(pass.view), body);
            };
            if (pass.sources.empty()) {
                for_pixels(ClearBody{pass});
            } else if (first) {
                for_pixels(SweepBody{pass});
            } else {
                const StereoPass& from = coarse[pass.view];
                if (pass.camera.width_px == from.camera.width_px)
                    for_pixels(CopyBody{from, pass});
                else
                    for_pixels(UpsampleBody{pass, from.camera, from.image, from.planes, from.costs,
                                            from.selected});
            }
        }
    }

    void upload_sources(int level) {
        std::vector<SourceView> sources;
        source_begin_.assign(1, 0);
        for (int v = 0; v < view_count(); ++v) {
            const Camera& own = level_of(v, level).camera;
            const ViewPlan& plan = plans_[v];
            for (std::size_t k = 0; k < plan.sources.size(); ++k) {
                const int j = plan.sources[k];
                sources.push_back(make_source(own, level_of(j, level).camera, j, first_pixel_[j]));
                sources.back().min_variance = level_of(j, level).min_variance;
                sources.back().weight = plan.weights[k];
            }
            source_begin_.push_back(sources.size());
        }
        copy(sources, sources_);
    }

    void make_passes(int level) {
        passes_.clear();
        for (int v = 0; v < view_count(); ++v) {
            const std::size_t i = static_cast<std::size_t>(v);
            StereoPass pass;
            pass.camera = level_of(v, level).camera;
            pass.view = v;
            pass.level = level;
            pass.image = {images_.data() + first_pixel_[i], pass.camera.width_px,
                          pass.camera.height_px, level_of(v, level).min_variance};
            pass.images = images_.span();
            pass.sources = {sources_.data() + source_begin_[i],
                            source_begin_[i + 1] - source_begin_[i]};
            pass.planes = of_view(planes_.span(), v);
            pass.costs = of_view(costs_.span(), v);
            pass.selected = of_view(selected_.span(), v);
            pass.far_inverse = 1 / plans_[i].far_depth;
            pass.near_inverse = 1 / plans_[i].near_depth;
            // A coarse image of few views offers little texture, so patches are larger.
            pass.side = level == levels_ - 1 && levels_ > 1 && few_views() ? 8 : 6;
            pass.seed = static_cast<std::uint64_t>(options_.seed);
            passes_.push_back(pass);
        }
    }

    void take_depths() {
        parallel_for(Device{}, static_cast<int>(planes_.size()),
                     TakeDepthsBody{planes_.span(), depths_.span()});
    }

    void iterate(int iteration, bool by_best_sources, bool geometric) {
        for (const StereoPass& pass : passes_) {
            const int n = pass.sources.size(), width = pass.camera.width_px,
                      height = pass.camera.height_px;
            if (n == 0) continue;
            const int best_sources = by_best_sources ? (n <= 2 ? 1 : std::min(4, n)) : 0;
            const Span<const float> depths = geometric ? depths_.span() : Span<float>{};
            for (int color = 0; color < 2; ++color)
                parallel_for(
                    Device{}, Checkerboard::count(width, height),
                    PropagateBody{pass, {width, height, color}, iteration, best_sources, depths});
            synchronize(Device{});  // so that the progress counts finished work
            progress_->advance(double(width) * height);
        }
    }

    StereoResult fuse() {
        take_depths();
        for (const StereoPass& pass : passes_)
            if (!pass.sources.empty())
                parallel_for(Device{}, pixel_count(pass.view),
                             MedianBody{pass, of_view(depths_.span(), pass.view)});
        take_depths();
        const std::size_t pixels = planes_.size();
        const float degree = 3.14159265f / 180;
        // Few views stand far apart: their depths of slanted surfaces differ by more pixels.
        const Agreement filter{few_views() ? 2.0f : 1.5f, 0.01f,
                               std::cos((few_views() ? 30 : 15) * degree), options_.min_consistent};
        const Agreement fusion{2.0f, 0.01f, filter.normal_cosine, options_.min_consistent};

        // 1. Filters depths and removes small segments.
        Buffer<float, Device> kept(pixels), confidences(pixels);
        kept.fill_zero(), confidences.fill_zero();
        Buffer<std::uint8_t, Device> mask, uniqueness;
        for (const StereoPass& pass : passes_) {
            const int v = pass.view;
            if (pass.sources.empty()) continue;
            copy(options_.use_masks ? pyramids_[v].mask : std::vector<std::uint8_t>(), mask);
            uniqueness.resize(static_cast<std::size_t>(pixel_count(v)));
            parallel_for(Device{}, pixel_count(v),
                         FilterBody{pass, filter, std::cos(kMinAngleDeg * degree), depths_.span(),
                                    planes_.span(), mask.span(), of_view(kept.span(), v),
                                    of_view(confidences.span(), v), uniqueness.span()});
            parallel_for(
                Device{}, pixel_count(v),
                DropRepeatedBody{pass.camera.width_px, pass.camera.height_px, uniqueness.span(),
                                 of_view(kept.span(), v), of_view(confidences.span(), v)});
            synchronize(Device{});
            progress_->advance(2.0 * pixel_count(v));
        }
        std::vector<float> depths = to_host(kept);
        std::vector<float> confidence = to_host(confidences);
        std::vector<DepthMapSpan> maps;
        for (const StereoPass& pass : passes_) {
            const int first = first_pixel_[pass.view];
            maps.push_back({pass.camera.width_px, pass.camera.height_px, depths.data() + first,
                            confidence.data() + first});
        }
        remove_small_segments(maps);
        copy(depths, kept);
        copy(confidence, confidences);

        // 2. Fuses points.
        StereoResult result;
        Buffer<std::uint8_t, Device> confirmed(pixels);
        confirmed.fill_zero();
        Buffer<std::uint32_t, Device> colors;
        copy(packed_colors(pyramids_), colors);
        for (const StereoPass& pass : passes_)
            parallel_for(
                Device{}, pixel_count(pass.view),
                ConfirmBody{pass, fusion, kept.span(), planes_.span(),
                            of_view(confirmed.span(), pass.view), first_pixel_[pass.view]});
        Buffer<FusedPoint, Device> points;
        for (const StereoPass& pass : passes_) {
            const int v = pass.view;
            points.resize(static_cast<std::size_t>(pixel_count(v)));
            parallel_for(Device{}, pixel_count(v),
                         FuseBody{pass, fusion, kept.span(), confidences.span(), planes_.span(),
                                  confirmed.span(), colors.span(), points.span(), first_pixel_[v]});
            for (const FusedPoint& p : to_host(points)) {
                if (!(p.confidence > 0)) continue;
                result.cloud.positions.push_back(p.position);
                result.cloud.normals.push_back(p.normal);
                result.cloud.confidences.push_back(p.confidence);
                result.cloud.colors.push_back(FuseBody::unpacked(p.color) / 255.0f);
            }
        }

        // 3. Copies the maps.
        const std::vector<SurfacePlane> planes = to_host(planes_);
        for (const StereoPass& pass : passes_) {
            const int first = first_pixel_[pass.view], last = first + pixel_count(pass.view);
            StereoMaps map{pass.camera,
                           {depths.begin() + first, depths.begin() + last},
                           {},
                           {confidence.begin() + first, confidence.begin() + last}};
            map.normals.resize(map.depth.size());
            for (std::size_t i = 0; i < map.depth.size(); ++i)
                if (map.depth[i] > 0)
                    map.normals[i] = planes[static_cast<std::size_t>(first) + i].normal;
            result.maps.push_back(std::move(map));
        }
        return result;
    }

    const std::vector<View>& views_;
    StereoOptions options_;
    std::vector<StereoPyramid> pyramids_;
    std::vector<ViewPlan> plans_;
    int levels_ = 0;
    std::optional<Progress> progress_;  // of run()

    // Of all views at the present level, one after another; coarse: of the level before.
    Buffer<float, Device> images_, coarse_images_, costs_, coarse_costs_, depths_;
    Buffer<SurfacePlane, Device> planes_, coarse_planes_;
    Buffer<std::uint8_t, Device> selected_, coarse_selected_;
    Buffer<SourceView, Device> sources_;
    std::vector<std::size_t> source_begin_;
    std::vector<int> first_pixel_;  // of each view, and one past the last
    std::vector<StereoPass> passes_;
};

template <class Device>
StereoResult reconstruct_stereo(Device,
                                const std::vector<View>& views,
                                const std::vector<Vec3f>& points,
                                const StereoOptions& options) {
    return PatchMatch<Device>(views, points, options).run();
}

}  // namespace tvsgs
