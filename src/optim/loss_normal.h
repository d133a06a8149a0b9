// Normals of the depth map against those that are blended.
#pragma once

#include "optim/edge_strength.h"
#include "optim/loss.h"
#include "render/normal_math.h"
#include "render/photometric.h"

namespace tvsgs {

/// What a pixel passes on to the depths of its four neighbours.
struct NormalPixelGradient {
    Vec3f dL_da, dL_db;
};

struct NormalLossBody {
    Camera camera;
    Span<const Vec3f> normal;
    Span<const float> depth, transmittance;
    const std::uint8_t* photo;
    float edge_min, edge_max, weight_per_pixel;
    Span<float> pixel_loss;
    Span<NormalPixelGradient> neighbours;  // overwritten
    Span<Vec3f> dL_dnormal;                // added to

    TVSGS_HD void operator()(int at) const {
        pixel_loss[at] = 0;
        neighbours[at] = {};
        const int w = camera.width_px, x = at % w, y = at / w;
        if (x == 0 || y == 0 || x == w - 1 || y == camera.height_px - 1) return;
        if (!(depth[at - 1] > 0) || !(depth[at + 1] > 0) || !(depth[at - w] > 0) ||
            !(depth[at + w] > 0))
            return;
        // Edges are where depth may jump: (1 - e)^2 fades the term out there. An image without
        // edges has e = 0.
        const float range = edge_max - edge_min;
        const float e = range > 0 ? (edge_strength(photo, w, x, y) - edge_min) / range : 0;
        const float weight = weight_per_pixel * (1 - e) * (1 - e);
        const auto n = depth_normal(depth[at - 1] * pixel_ray(camera, x - 1, y),
                                    depth[at + 1] * pixel_ray(camera, x + 1, y),
                                    depth[at - w] * pixel_ray(camera, x, y - 1),
                                    depth[at + w] * pixel_ray(camera, x, y + 1));
        const float coverage = 1 - transmittance[at];  // a constant of the loss
        const Vec3f difference = coverage * n.normal - normal[at];
        Vec3f dL_ddifference;
        for (int c = 0; c < 3; ++c)
            dL_ddifference[c] = difference[c] > 0 ? weight : difference[c] < 0 ? -weight : 0;
        pixel_loss[at] = dot(difference, dL_ddifference);
        dL_dnormal[at] -= dL_ddifference;
        const auto g = depth_normal_vjp(n, coverage * dL_ddifference);
        neighbours[at] = {g.dL_da, g.dL_db};
    }
};

/// Gathers dL/ddepth of a pixel from the pixels whose normal it takes part in.
struct NormalDepthBody {
    Camera camera;
    Span<const NormalPixelGradient> neighbours;
    Span<const float> depth;
    Span<float> dL_ddepth;  // added to

    TVSGS_HD void operator()(int at) const {
        if (!(depth[at] > 0)) return;
        const int w = camera.width_px, x = at % w, y = at / w;
        Vec3f dL_dpoint{};
        if (x > 0) dL_dpoint += neighbours[at - 1].dL_da;
        if (x < w - 1) dL_dpoint -= neighbours[at + 1].dL_da;
        if (y < camera.height_px - 1) dL_dpoint += neighbours[at + w].dL_db;
        if (y > 0) dL_dpoint -= neighbours[at - w].dL_db;
        dL_ddepth[at] += dot(dL_dpoint, pixel_ray(camera, x, y));
    }
};

/// mean over pixels of (1 - e)^2 |N_depth - M_n|_1.  [PGSR, Eq. 9]
template <class Device>
class NormalLoss final : public Loss<Device> {
public:
    static constexpr LossNeeds kNeeds{.maps = kGeometryMaps, .edges = true};

    explicit NormalLoss(const ScheduledOptions& options) : options_(options) {}

    const char* name() const override { return "normal"; }
    bool active(int step) const override { return step >= options_.start; }
    LossNeeds needs() const override { return kNeeds; }

    void add_to(Objective<Device>& objective,
                double* value,
                const LossInputs<Device>& in) override {
        const auto& images = in.images;
        const int pixels = images.width * images.height;
        pixel_loss_.resize(images.depth.size());
        neighbours_.resize(images.depth.size());
        parallel_for(
            Device{}, pixels,
            NormalLossBody{images.camera, images.normal.span(), images.depth.span(),
                           images.transmittance.span(), in.view.photo.data(), in.view.edge_min,
                           in.view.edge_max, options_.weight / static_cast<float>(pixels),
                           pixel_loss_.span(), neighbours_.span(),
                           objective.dL_dimages.normal.span()});
        add_sum(Device{}, pixels, ReadValue{pixel_loss_.span()}, 1, objective.partial.span(),
                value);
        parallel_for(Device{}, pixels,
                     NormalDepthBody{images.camera, neighbours_.span(), images.depth.span(),
                                     objective.dL_dimages.depth.span()});
    }

private:
    ScheduledOptions options_;
    Buffer<float, Device> pixel_loss_;
    Buffer<NormalPixelGradient, Device> neighbours_;
};

}  // namespace tvsgs
