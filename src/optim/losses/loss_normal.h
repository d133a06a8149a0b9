// Loss: normals of the depth map against blended normals.
#pragma once

#include "optim/losses/depth_normals.h"
#include "optim/losses/loss.h"
#include "render/photometric/photometric.h"

namespace tvsgs {

struct NormalLossBody {
    Camera camera;
    Span<const Vec3f> normal;
    Span<const float> depth, transmittance;
    const std::uint8_t* photo;
    float edge_min, edge_max, weight_per_pixel;
    Span<float> pixel_loss;
    Span<DepthNormalGradients<float>> neighbours;  // overwritten
    Span<Vec3f> dL_dnormal;                        // added to

    TVSGS_HD void operator()(int at) const {
        pixel_loss[at] = 0;
        neighbours[at] = {};
        DepthNormal<float> n;
        if (!depth_normal_at(camera, depth, at, n)) return;
        const int w = camera.width_px;
        // Depth may jump at edges: (1 - e)^2 reduces the term there. Without edges e = 0.
        const float range = edge_max - edge_min;
        const float e =
            range > 0 ? (edge_strength(photo, w, at % w, at / w) - edge_min) / range : 0;
        const float weight = weight_per_pixel * (1 - e) * (1 - e);
        const float coverage = 1 - transmittance[at];  // a constant of the loss
        const Vec3f difference = coverage * n.normal - normal[at];
        Vec3f dL_ddifference;
        for (int c = 0; c < 3; ++c)
            dL_ddifference[c] = difference[c] > 0 ? weight : difference[c] < 0 ? -weight : 0;
        pixel_loss[at] = dot(difference, dL_ddifference);
        dL_dnormal[at] -= dL_ddifference;
        neighbours[at] = depth_normal_vjp(n, coverage * dL_ddifference);
    }
};

/// mean over pixels of (1 - e)^2 |N_depth - M_n|_1.  [PGSR, Eq. 9]
template <class Device>
class NormalLoss final : public Loss<Device> {
public:
    explicit NormalLoss(const ScheduledOptions& options, const LossContext& = {})
        : options_(options) {}

    LossNeeds needs() const override { return {.maps = kGeometryMaps, .edges = true}; }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const auto& images = in.images;
        const int pixels = images.width * images.height;
        pixel_loss_.resize(images.depth.size());
        neighbours_.resize(images.depth.size());
        parallel_for(
            Device{}, pixels,
            NormalLossBody{images.camera, images.normal.span(), images.depth.span(),
                           images.transmittance.span(), in.view.photo.data(), in.view.edge_min,
                           in.view.edge_max, options_.weight / float(pixels), pixel_loss_.span(),
                           neighbours_.span(), objective.dL_dimages.normal.span()});
        objective.add(pixel_loss_);
        parallel_for(Device{}, pixels,
                     NormalDepthBody{images.camera, neighbours_.span(), images.depth.span(),
                                     objective.dL_dimages.depth.span()});
    }

private:
    ScheduledOptions options_;
    Buffer<float, Device> pixel_loss_;
    Buffer<DepthNormalGradients<float>, Device> neighbours_;
};

}  // namespace tvsgs
