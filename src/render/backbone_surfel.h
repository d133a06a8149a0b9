// Surfels: flat splats whose plane each pixel's ray meets. The backbone `surfel`.  [2DGS]
#pragma once

#include "core/parallel.h"
#include "render/blend_math.h"
#include "render/blend_surfel.h"
#include "render/blend_work.h"
#include "render/sh_math.h"

namespace tvsgs {

/// The third scale says nothing here; whoever takes the smallest axis for the normal, as voting
/// does, finds it thinner than the others.
inline constexpr float kSurfelThickness = -6.9077554f;  // ln 0.001, of the smaller scale

struct ThinBody {
    Span<Vec3f> log_scales;
    TVSGS_HD void operator()(int i) const {
        Vec3f& l = log_scales[i];
        l.z = (l.x < l.y ? l.x : l.y) + kSurfelThickness;
    }
};

struct SurfelView {
    Pinhole<float> camera;
    Vec3f centre;  // of the camera, world
    TileGrid grid;
    int sh_degree;
    float near, cull_alpha;
};

/// Of a splat, in the camera's frame. `sign`: of the normal, which looks at the camera; 0: edge on.
struct SurfelPose {
    SurfelAxes<float> axes;
    Mat3f R;  // of the splat in the world
    Vec3f normal;
    float sign;
};
TVSGS_HD inline SurfelPose surfel_pose(const SurfelView& view,
                                       Vec3f mean,
                                       Vec3f log_scale,
                                       Quatf quat) {
    SurfelPose pose;
    const Mat3f& to_camera = view.camera.camera_from_world.R;
    pose.R = rotation(normalize(quat));
    pose.axes.centre = view.camera.camera_from_world * mean;
    pose.axes.a = std::exp(log_scale.x) * (to_camera * column(pose.R, 0));
    pose.axes.b = std::exp(log_scale.y) * (to_camera * column(pose.R, 1));
    const Vec3f normal = to_camera * column(pose.R, 2);
    const float facing = dot(normal, pose.axes.centre);
    pose.sign = facing < 0 ? 1.0f : facing > 0 ? -1.0f : 0.0f;
    pose.normal = pose.sign * normal;
    return pose;
}

struct ProjectSurfelsBody {
    SurfelView view;
    bool color;
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;
    Span<const float> opacity_logits;
    Span<const Vec3f> sh;
    Span<SurfelShape<float>> shapes;
    Span<SurfelRecord> features;
    Span<float> depths;
    Span<TileRect> rects;
    Span<float> radii;

    TVSGS_HD void operator()(int i) const {
        rects[i] = {};
        radii[i] = 0;
        const SurfelPose pose = surfel_pose(view, means[i], log_scales[i], quats[i]);
        const Vec3f p = pose.axes.centre;
        if (!(p.z > view.near) || !is_finite(p) || pose.sign == 0) return;
        const float opacity = sigmoid(opacity_logits[i]);
        if (!(opacity > view.cull_alpha)) return;
        SurfelShape<float> s;
        if (!surfel_shape(view.camera, pose.axes, opacity, view.cull_alpha, s)) return;
        const Vec2f half{0.5f * (s.high.x - s.low.x), 0.5f * (s.high.y - s.low.y)};
        if (!(half.x < 1e6f) || !(half.y < 1e6f)) return;
        const TileRect rect =
            tile_rect({s.mean.x + s.low.x + half.x, s.mean.y + s.low.y + half.y}, half, view.grid);
        if (rect.count() == 0) return;

        shapes[i] = s;
        depths[i] = p.z;
        rects[i] = rect;
        const SurfelBox<float> box = surfel_box(surfel_rows(view.camera, pose.axes), kLowPassReach);
        const float longer = box.extent.x > box.extent.y ? box.extent.x : box.extent.y;
        const float least = kLowPassReach * 0.70710678f;
        radii[i] = std::ceil(longer > least ? longer : least);
        SurfelFeatures<float>& f = features[i].f;
        f.normal = pose.normal;
        f.color = color ? sh_color<float>(view.sh_degree, normalize(means[i] - view.centre),
                                          sh.data, means.count, i)
                        : Vec3f{};
    }
};

/// Statistics and gradients of the splats, from those of their pixels.
template <bool kMaps>
struct SurfelBackwardBody {
    SurfelView view;
    bool color;
    Span<const SurfelShape<float>> shapes;
    Span<const SurfelRecord> features;
    Span<const std::uint32_t> fragment_counts, first_fragment;
    Span<const SurfelGradients<kMaps, float>> fragments;
    Span<const std::uint8_t> drawn;
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;
    Span<const float> opacity_logits;
    Span<const Vec3f> sh;
    Span<Vec2f> stat_grad, stat_abs;  // overwritten
    Span<int> stat_front;
    Span<Vec3f> dL_dmeans, dL_dlog_scales;  // added to; empty: the statistics alone are asked for
    Span<Quatf> dL_dquats;
    Span<float> dL_dopacity_logits;
    Span<Vec3f> dL_dsh;

    TVSGS_HD void operator()(int i) const {
        stat_grad[i] = stat_abs[i] = {};
        stat_front[i] = 0;
        if (fragment_counts[i] == 0 || !drawn[first_fragment[i]]) return;
        const SurfelGradients<kMaps, float> g = fragments[first_fragment[i]];
        const SurfelShape<float> s = shapes[i];
        SurfelMatrixGradient<float> matrix = surfel_inverse_vjp(s, g.inverse);
        // A surrogate for the derivative by the centre's place, of what the dot did not draw.
        const float half_w = 0.5f * static_cast<float>(view.grid.width),
                    half_h = 0.5f * static_cast<float>(view.grid.height);
        stat_grad[i] = {half_w * matrix.row_x.z / s.inverse_depth,
                        half_h * matrix.row_y.z / s.inverse_depth};
        stat_abs[i] = {std::abs(stat_grad[i].x), std::abs(stat_grad[i].y)};
        stat_front[i] = static_cast<int>(g.front_pixels);
        if (dL_dmeans.empty()) return;

        if constexpr (kMaps) matrix.row_z.z += g.depth;
        const SurfelPose pose = surfel_pose(view, means[i], log_scales[i], quats[i]);
        low_pass_vjp(surfel_rows(view.camera, pose.axes), s.low_pass, g.inverse.low_pass, matrix);
        const SurfelAxes<float> axes = surfel_axes_vjp(view.camera, pose.axes.centre, matrix);
        const Mat3f& to_camera = view.camera.camera_from_world.R;
        dL_dlog_scales[i].x += dot(axes.a, pose.axes.a);
        dL_dlog_scales[i].y += dot(axes.b, pose.axes.b);
        const float scale_x = std::exp(log_scales[i].x), scale_y = std::exp(log_scales[i].y);
        Vec3f by_normal{};
        if constexpr (kMaps) by_normal = pose.sign * transpose_times(to_camera, g.normal);
        const Vec3f by_axis[3] = {scale_x * transpose_times(to_camera, axes.a),
                                  scale_y * transpose_times(to_camera, axes.b), by_normal};
        Mat3f dL_dR;
        for (int r = 0; r < 3; ++r)
            for (int c = 0; c < 3; ++c) dL_dR[r][c] = by_axis[c][r];
        const Quatf by_quat = rotation_vjp(quats[i], dL_dR);
        Quatf& quat = dL_dquats[i];
        quat.w += by_quat.w, quat.x += by_quat.x, quat.y += by_quat.y, quat.z += by_quat.z;
        dL_dopacity_logits[i] += sigmoid_slope(opacity_logits[i]) * g.opacity;
        Vec3f by_mean = transpose_times(to_camera, axes.centre);
        if (color) {
            AddShGradient<float> visit{sh.data, dL_dsh.data, means.count,
                                       static_cast<std::size_t>(i)};
            by_mean += sh_color_vjp<float>(view.sh_degree, means[i] - view.centre,
                                           features[i].f.color, g.color, visit);
        }
        dL_dmeans[i] += by_mean;
    }
};

template <class Device>
class SurfelBackbone final : public Backbone<Device> {
public:
    explicit SurfelBackbone(const BackboneOptions& options) : options_(options) {}

    Maps maps() const override { return Maps::color | kGeometryMaps | Maps::distortion; }

    bool flat() const override { return true; }

    void prepare(int, bool, const std::vector<Camera>&, Gaussians<Device>& g) override {
        parallel_for(Device{}, g.size(), ThinBody{g.log_scales.span()});
    }

    const RenderedImages<Device>& forward(const Gaussians<Device>& g,
                                          const Camera& camera,
                                          int sh_degree,
                                          Maps maps) override {
        color_ = has(maps, Maps::color);
        maps_ = has(maps, kGeometryMaps | Maps::distortion);
        view_ = {pinhole<float>(camera),
                 camera_centre(camera),
                 tile_grid(camera.width_px, camera.height_px),
                 sh_degree < g.sh_degree ? sh_degree : g.sh_degree,
                 options_.near,
                 options_.cull_alpha};
        resize_images(camera);
        splats_.resize(g.means.size());
        statistics_.radii_px.resize(g.means.size());
        auto& clock = this->clock();
        clock("project", [&] {
            parallel_for(Device{}, g.size(),
                         ProjectSurfelsBody{view_, color_, g.means.span(), g.log_scales.span(),
                                            g.quats.span(), g.opacity_logits.span(), g.sh.span(),
                                            splats_.shapes.span(), splats_.features.span(),
                                            splats_.depths.span(), splats_.rects.span(),
                                            statistics_.radii_px.span()});
        });
        clock("tile lists", [&] { build_tile_lists(splats_, view_.grid, lists_); });
        clock("blend", [&] { maps_ ? blend_as<true>() : blend_as<false>(); });
        return images_;
    }

    void backward(const Gaussians<Device>& g,
                  const ImageGradients<Device>& dL_dimages,
                  Gaussians<Device>& dL) override {
        go_back(g, dL_dimages, &dL);
    }
    void observe(const Gaussians<Device>& g) override { go_back(g, {}, nullptr); }

    const ScreenStatistics<Device>& statistics() const override { return statistics_; }
    RenderCounts counts() const override { return {lists_.visible_count, lists_.fragment_count}; }
    BlendWork blend_work() const override {
        return count_blend_work<SurfelModel<false>>(splats_, lists_, view_.grid);
    }
    void use_atomic_sums() override { color_fragments_.atomic = map_fragments_.atomic = true; }

private:
    void resize_images(const Camera& camera) {
        const std::size_t pixels = std::size_t(camera.width_px) * std::size_t(camera.height_px),
                          maps = maps_ ? pixels : 0;
        images_.width = camera.width_px, images_.height = camera.height_px;
        images_.camera = camera;
        images_.color.resize(color_ ? pixels : 0);
        images_.transmittance.resize(pixels);
        images_.normal.resize(maps), images_.depth.resize(maps), images_.distortion.resize(maps);
        z_.resize(maps), first_.resize(maps), second_.resize(maps);
        stops_.resize(pixels);
    }

    template <bool kMaps>
    void blend_as() {
        blend_tiles<SurfelModel<kMaps>>(
            splats_, lists_, view_.grid,
            {images_.color.span(), images_.normal.span(), images_.transmittance.span(),
             images_.depth.span(), images_.distortion.span(), z_.span(), first_.span(),
             second_.span(), images_.width, median()},
            stops_);
    }
    /// `dL`: null where only the statistics are asked for.
    void go_back(const Gaussians<Device>& g,
                 const ImageGradients<Device>& dL_dimages,
                 Gaussians<Device>* dL) {
        maps_ ? go_back_as<true>(g, dL_dimages, dL, map_fragments_)
              : go_back_as<false>(g, dL_dimages, dL, color_fragments_);
    }
    template <bool kMaps>
    void go_back_as(const Gaussians<Device>& g,
                    const ImageGradients<Device>& dL_dimages,
                    Gaussians<Device>* dL,
                    FragmentGradients<Device, SurfelGradients<kMaps, float>>& fragments) {
        const RenderedImages<Device>& images = images_;
        this->clock()("blend backward", [&] {
            blend_tiles_vjp<SurfelModel<kMaps>>(
                splats_, lists_, view_.grid,
                {dL_dimages.color.span(), dL_dimages.normal.span(), dL_dimages.depth.span(),
                 dL_dimages.distortion.span(), images.transmittance.span(), images.depth.span(),
                 std::as_const(z_).span(), std::as_const(first_).span(),
                 std::as_const(second_).span(), median()},
                images.transmittance, stops_, fragments);
        });
        const std::size_t n = g.means.size();
        statistics_.dL_dmeans2d.resize(n);
        statistics_.abs_dL_dmeans2d.resize(n);
        statistics_.front_pixels.resize(n);
        SurfelBackwardBody<kMaps> body{view_,
                                       color_,
                                       std::as_const(splats_.shapes).span(),
                                       std::as_const(splats_.features).span(),
                                       std::as_const(lists_.fragment_counts).span(),
                                       std::as_const(lists_.first_fragment).span(),
                                       std::as_const(fragments.gradients).span(),
                                       std::as_const(fragments.drawn).span(),
                                       g.means.span(),
                                       g.log_scales.span(),
                                       g.quats.span(),
                                       g.opacity_logits.span(),
                                       g.sh.span(),
                                       statistics_.dL_dmeans2d.span(),
                                       statistics_.abs_dL_dmeans2d.span(),
                                       statistics_.front_pixels.span(),
                                       {},
                                       {},
                                       {},
                                       {},
                                       {}};
        if (dL != nullptr) {
            body.dL_dmeans = dL->means.span(), body.dL_dlog_scales = dL->log_scales.span();
            body.dL_dquats = dL->quats.span(), body.dL_dsh = dL->sh.span();
            body.dL_dopacity_logits = dL->opacity_logits.span();
        }
        this->clock()("project backward", [&] { parallel_for(Device{}, g.size(), body); });
    }

    bool median() const { return options_.depth != SurfaceDepth::expected; }

    BackboneOptions options_;
    bool color_ = true, maps_ = false;  // of the last forward()
    SurfelView view_{};
    Surfels<Device> splats_;
    TileLists<Device> lists_;
    RenderedImages<Device> images_;
    Buffer<float, Device> z_, first_, second_;  // [H W] as in SurfelPixel
    Buffer<std::uint32_t, Device> stops_;       // [H W] see blend_tiles()
    ScreenStatistics<Device> statistics_;
    FragmentGradients<Device, SurfelGradients<false, float>> color_fragments_;
    FragmentGradients<Device, SurfelGradients<true, float>> map_fragments_;
};

}  // namespace tvsgs
