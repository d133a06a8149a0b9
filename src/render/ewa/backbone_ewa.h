// The backbone `ewa`: EWA splatting of 3D Gaussians, with PGSR's plane channels. It renders plane
// channels only for requests of depth or normals. Depth is that of the blended plane, or a depth
// along rays.
#pragma once

#include "render/tiles/blend_work.h"
#include "render/tiles/tiled_backbone.h"

namespace tvsgs {

/// Converts derivatives by depth to derivatives by the blended plane.
struct PlaneOfDepthBody {
    Camera camera;
    Span<const Vec3f> normal;
    Span<const float> distance, depth;
    Span<const Vec3f> dL_dnormal;  // or empty
    Span<const float> dL_ddepth;
    Span<Vec3f> dL_dplane_normal;  // overwritten
    Span<float> dL_dplane_distance;

    TVSGS_HD void operator()(int at) const {
        Vec3f by_normal = dL_dnormal.empty() ? Vec3f{} : dL_dnormal[at];
        float by_distance = 0;
        if (depth[at] > 0) {
            const Vec3f ray = pixel_ray(camera, at % camera.width_px, at / camera.width_px);
            const auto g = plane_depth_vjp(normal[at], distance[at], ray, dL_ddepth[at]);
            by_normal += g.dL_dnormal;
            by_distance = g.dL_ddistance;
        }
        dL_dplane_normal[at] = by_normal;
        dL_dplane_distance[at] = by_distance;
    }
};

template <class Device>
class EwaBackbone final : public TiledBackbone<Device> {
public:
    static constexpr BackboneTraits kTraits{.maps = Maps::color | kGeometryMaps | Maps::coverage,
                                            .low_pass_px2 = kLowPassPx2,
                                            .parts_colors = true};

    explicit EwaBackbone(const BackboneOptions& options)
        : TiledBackbone<Device>(kTraits), options_(options) {}

    const RenderedImages<Device>& forward(const Gaussians<Device>& gaussians,
                                          const Camera& camera,
                                          int sh_degree,
                                          Maps maps) override {
        camera_ = ray_camera(camera, options_.pixel_center);
        channels_ = is_along_rays() ? along_rays(channels_of(maps)) : channels_of(maps);
        grid_ = tile_grid(camera.width_px, camera.height_px);
        view_ = {pinhole<float>(camera),
                 camera_centre(camera),
                 grid_,
                 sh_degree < gaussians.sh_degree ? sh_degree : gaussians.sh_degree,
                 options_.near,
                 kLowPassPx2};
        resize_images();
        with_channels(channels_, [&]<Channels kChannels>() { forward_as<kChannels>(gaussians); });
        return images_;
    }

    const FusedGradients* blend_backward(const Gaussians<Device>&,
                                         const ImageGradients<Device>& dL_dimages) override {
        const bool by_depth = has_plane(channels_) && !dL_dimages.depth.empty();
        this->clock()("blend backward", [&] {
            Span<const Vec3f> normal = dL_dimages.normal.span();
            Span<const float> distance{};
            if (by_depth && !has_ray(channels_)) {
                resolve_depth(dL_dimages);
                normal = std::as_const(plane_normal_).span();
                distance = std::as_const(plane_distance_).span();
            }
            const auto blend_back = [&]<class Model>(const Model&) {
                blend_tiles_vjp<Model>(
                    splats_, lists_, grid_,
                    {dL_dimages.color.span(), normal, distance, dL_dimages.transmittance.span()},
                    images_.transmittance, stops_, fragments_);
            };
            with_channels(channels_, [&]<Channels kChannels>() {
                constexpr Channels kBlended = blended(kChannels);
                if constexpr (has_color(kChannels))
                    if (parted_) return blend_back(PartedEwaModel<kBlended>{});
                blend_back(EwaModel<kBlended>{});
            });
        });
        ray_depth_.fragments.resize(0);
        if (by_depth && has_ray(channels_))
            this->clock()("depth backward", [&] { ray_depth_back(dL_dimages.depth); });
        const RayDepthFragments<Device>& ray = ray_depth_.fragments;
        with_channels(channels_, [&]<Channels kChannels>() {
            gradients_.vjp = EwaVjp<kChannels>{view_,
                                               splats_.shapes.span(),
                                               splats_.features.span(),
                                               this->sums(fragments_),
                                               ray.gradients.span(),
                                               ray.drawn.span()};
        });
        return &gradients_;
    }

    BlendWork blend_work() const override {
        return count_blend_work<EwaModel<Channels::color>>(splats_, lists_, grid_);
    }

    void use_atomic_sums() override { fragments_.atomic = ray_depth_.fragments.atomic = true; }

private:
    using TiledBackbone<Device>::images_, TiledBackbone<Device>::lists_,
        TiledBackbone<Device>::statistics_, TiledBackbone<Device>::stops_,
        TiledBackbone<Device>::gradients_;

    bool is_along_rays() const {
        return options_.depth == SurfaceDepth::expected || options_.depth == SurfaceDepth::median;
    }
    bool is_median() const { return options_.depth == SurfaceDepth::median; }

    void resize_images() {
        const std::size_t pixels = std::size_t(grid_.width) * grid_.height;
        const std::size_t color = has_color(channels_) ? pixels : 0,
                          plane = has_plane(channels_) ? pixels : 0;
        images_.width = grid_.width, images_.height = grid_.height;
        images_.camera = camera_;
        images_.color.resize(color);
        images_.transmittance.resize(pixels);
        images_.normal.resize(plane), images_.depth.resize(plane);
        stops_.resize(pixels), distance_.resize(plane);
    }

    void resolve_depth(const ImageGradients<Device>& dL_dimages) {
        const std::size_t pixels = images_.depth.size();
        plane_normal_.resize(pixels), plane_distance_.resize(pixels);
        const RenderedImages<Device>& images = images_;
        parallel_for(
            Device{}, static_cast<int>(pixels),
            PlaneOfDepthBody{camera_, images.normal.span(), std::as_const(distance_).span(),
                             images.depth.span(), dL_dimages.normal.span(), dL_dimages.depth.span(),
                             plane_normal_.span(), plane_distance_.span()});
    }

    template <Channels kChannels>
    void forward_as(const Gaussians<Device>& g) {
        auto& clock = this->clock();
        const ColorShare share{g.uncertainty.span(), this->color_share_};
        parted_ = has_color(kChannels) && share.parts();
        const auto project = [&](auto& to) {
            return ProjectBody<blended(kChannels)>{view_,
                                                   g.means.span(),
                                                   g.log_scales.span(),
                                                   g.quats.span(),
                                                   g.opacity_logits.span(),
                                                   share,
                                                   to.shapes.span(),
                                                   to.features.span(),
                                                   to.depths.span(),
                                                   to.rects.span()};
        };
        std::optional<ViewColors> colors;
        if constexpr (has_color(kChannels)) colors = {view_.centre, view_.sh_degree};
        this->list_splats(g, grid_, project, colors, splats_);
        clock("blend", [&] {
            blend_tiles<EwaModel<blended(kChannels)>>(splats_, lists_, grid_,
                                                      {images_, distance_, camera_}, stops_);
        });
        if constexpr (has_ray(kChannels)) clock("depth", [&] { find_ray_depth(g); });
    }

    /// Overwrites the depth of the planes.
    void find_ray_depth(const Gaussians<Device>& g) {
        const std::size_t pixels = images_.depth.size();
        RayDepth& r = ray_depth_;
        r.profiles.resize(splats_.shapes.size());
        r.stops.resize(pixels), r.slope.resize(is_median() ? pixels : 0);
        parallel_for(
            Device{}, g.size(),
            RayProfileBody{view_.camera, g.means.span(), g.log_scales.span(), g.quats.span(),
                           this->places(), view_.camera.cx - camera_.cx_px, r.profiles.span()});
        const RenderedImages<Device>& images = images_;
        if (is_median())
            find_medians(Device{},
                         {std::as_const(splats_.shapes).span(), std::as_const(r.profiles).span(),
                          std::as_const(lists_.spans).span(), std::as_const(lists_.splats).span(),
                          grid_, images.transmittance.span(), std::as_const(stops_).span(),
                          images_.depth.span(), r.slope.span(), r.stops.span()},
                         r.crossings);
        else
            blend_tiles<MeanDepthModel>({splats_.shapes, r.profiles}, lists_, grid_,
                                        {images_.depth.span(), grid_.width}, r.stops);
    }

    void ray_depth_back(const Buffer<float, Device>& dL_ddepth) {
        const RenderedImages<Device>& images = images_;
        RayDepth& r = ray_depth_;
        if (is_median())
            blend_tiles_vjp<MedianDepthModel>(
                {splats_.shapes, r.profiles}, lists_, grid_,
                {images.depth.span(), std::as_const(r.slope).span(), dL_ddepth.span()},
                images.transmittance, r.stops, r.fragments);
        else
            blend_tiles_vjp<MeanDepthModel>(
                {splats_.shapes, r.profiles}, lists_, grid_,
                {images.depth.span(), images.transmittance.span(), dL_ddepth.span()},
                images.transmittance, r.stops, r.fragments);
    }

    BackboneOptions options_;
    Camera camera_;        // of the rays of depth
    bool parted_ = false;  // in the last forward()
    Channels channels_ = Channels::color;
    TileGrid grid_{};
    ViewParameters view_{};
    EwaSplats<Device> splats_;
    Buffer<float, Device> distance_;  // [H W] blended plane distances, world units
    EwaFragmentGradients<Device> fragments_;
    struct RayDepth {
        Buffer<RayProfile<float>, Device> profiles;  // as shapes
        Buffer<std::uint32_t, Device> stops;         // [H W] of the mean or of the median
        Buffer<float, Device> slope;                 // [H W] see MedianView
        Buffer<Crossing, Device> crossings;          // scratch
        RayDepthFragments<Device> fragments;         // empty if depth has no gradient
    } ray_depth_;
    Buffer<Vec3f, Device> plane_normal_;  // dL/d of the plane, if depth has derivatives
    Buffer<float, Device> plane_distance_;
};

}  // namespace tvsgs
