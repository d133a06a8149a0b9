// Loss: consistency of the depth maps of two views.
#pragma once

#include "optim/losses/loss.h"

namespace tvsgs {

struct MultiViewGeometryBody {
    ViewPair<float> pair;
    Camera camera;  // of the reference
    Span<const float> depth, other_depth, pixel_weight;
    const double* count;  // number of comparable pixels
    float weight;
    Span<float> pixel_loss;
    Span<float> dL_ddepth;  // added to
    std::int64_t* dL_dother_log_depth;

    TVSGS_HD void operator()(int at) const {
        pixel_loss[at] = 0;
        const float w = pixel_weight[at];
        if (!(w > 0)) return;
        const Vec3f ray = pixel_ray(camera, at % camera.width_px, at / camera.width_px);
        const auto r = reproject(pair, ray, depth[at], [&](int i) { return other_depth[i]; });
        const float scale = weight / float(*count);
        pixel_loss[at] = scale * w * r.distance;
        const auto g = reproject_vjp(pair, ray, r, w);
        dL_ddepth[at] += scale * g.dL_ddepth;
        for (int i = 0; i < 4; ++i) {
            const double px = double(r.share[i] * g.dL_dother_depth * other_depth[r.at[i]]);
            if (std::abs(px) < 1e6)  // the depth of this pixel is too sensitive
                add_atomically(&dL_dother_log_depth[r.at[i]],
                               std::int64_t(px * NeighbourView<Cpu>::kFixedUnit));
        }
    }
};

/// mean over comparable pixels of w phi. phi is the reprojection distance of a pixel through the
/// other view; w = exp(-phi) is a constant.  [PGSR, Eq. 12]
template <class Device>
class MultiViewGeometryLoss final : public Loss<Device> {
public:
    explicit MultiViewGeometryLoss(const ScheduledOptions& options, const LossContext& = {})
        : options_(options) {}

    LossNeeds needs() const override {
        return {.maps = kGeometryMaps,
                .neighbour_views = 1,
                .rendered_views = 1,
                .splat_gradients = true};
    }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        if (in.others == nullptr) return;
        NeighbourView<Device>& other = (*in.others)[0];
        const auto& images = in.images;
        const int pixels = int(images.depth.size());
        pixel_loss_.resize(images.depth.size());
        parallel_for(
            Device{}, pixels,
            MultiViewGeometryBody{other.pair(), images.camera, images.depth.span(),
                                  other.images().depth.span(), other.weight(), other.valid_count(),
                                  options_.weight, pixel_loss_.span(),
                                  objective.dL_dimages.depth.span(), other.depth_gradients().data});
        other.resolve_depth_gradients(options_.weight, other.valid_count());
        objective.add(pixel_loss_);
    }

private:
    ScheduledOptions options_;
    Buffer<float, Device> pixel_loss_;
};

}  // namespace tvsgs
