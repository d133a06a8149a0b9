// The backbone `ewa`: EWA splatting of 3D Gaussians, with PGSR's plane channels. It renders plane
// channels only for requests of depth or normals. Depth is that of the blended plane.
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
    using Base = TiledBackbone<Device>;
    using Base::channels_, Base::images_, Base::lists_, Base::stops_, Base::view_;

public:
    static constexpr BackboneTraits kTraits{.maps = Maps::color | kGeometryMaps | Maps::coverage,
                                            .low_pass_px2 = kLowPassPx2,
                                            .parts_colors = true};

    explicit EwaBackbone(const BackboneOptions& options) : Base(kTraits, options) {}

    const RenderedImages<Device>& forward(const Gaussians<Device>& g,
                                          const Camera& camera,
                                          int sh_degree,
                                          Maps maps) override {
        this->begin(g, camera, sh_degree, channels_of(maps), kLowPassPx2);
        distance_.resize(this->plane_pixels());
        with_channels(channels_, [&]<Channels kChannels>() {
            const auto project = [&](auto& to) {
                return ProjectBody<kChannels>{parameters_of(g), view_, to.records(), this->share_};
            };
            this->list_splats(g, project, splats_);
            this->clock()("blend", [&] {
                blend_tiles<EwaModel<kChannels>>(splats_, lists_, view_.grid, {images_, distance_},
                                                 stops_);
            });
        });
        return images_;
    }

    const FusedGradients* blend_backward(const Gaussians<Device>&,
                                         const ImageGradients<Device>& dL_dimages) override {
        this->clock()("blend backward", [&] {
            Span<const Vec3f> normal = dL_dimages.normal.span();
            Span<const float> distance{};
            if (has_plane(channels_) && !dL_dimages.depth.empty()) {
                resolve_depth(dL_dimages);
                normal = plane_normal_.span();
                distance = plane_distance_.span();
            }
            const auto blend_back = [&]<class Model>(const Model&) {
                blend_tiles_vjp<Model>(
                    splats_, lists_, view_.grid,
                    {dL_dimages.color.span(), normal, distance, dL_dimages.transmittance.span()},
                    images_.transmittance, stops_, fragments_);
            };
            with_channels(channels_, [&]<Channels kChannels>() {
                if constexpr (has_color(kChannels))
                    if (this->parts_colors()) return blend_back(PartedEwaModel<kChannels>{});
                blend_back(EwaModel<kChannels>{});
            });
        });
        with_channels(channels_, [&]<Channels kChannels>() {
            this->gradients_.vjp = EwaVjp<kChannels>{
                view_, splats_.shapes.span(), splats_.features.span(), this->sums(fragments_)};
        });
        return &this->gradients_;
    }

    BlendWork blend_work() const override {
        return count_blend_work<EwaModel<Channels::color>>(splats_, lists_, view_.grid);
    }

private:
    void resolve_depth(const ImageGradients<Device>& dL_dimages) {
        const std::size_t pixels = images_.depth.size();
        plane_normal_.resize(pixels), plane_distance_.resize(pixels);
        const RenderedImages<Device>& images = images_;
        parallel_for(
            Device{}, int(pixels),
            PlaneOfDepthBody{images.camera, images.normal.span(), distance_.span(),
                             images.depth.span(), dL_dimages.normal.span(), dL_dimages.depth.span(),
                             plane_normal_.span(), plane_distance_.span()});
    }

    EwaSplats<Device> splats_;
    Buffer<float, Device> distance_;  // [H W] blended plane distances, world units
    EwaFragmentGradients<Device> fragments_;
    Buffer<Vec3f, Device> plane_normal_;  // dL/d of the plane, if depth has derivatives
    Buffer<float, Device> plane_distance_;
};

}  // namespace tvsgs
