// Loss: the splats' normals against the normals of the rendered surface.
#pragma once

#include "optim/losses/depth_normals.h"
#include "optim/losses/loss.h"

namespace tvsgs {

struct NormalConsistencyOptions : ScheduledOptions {
    float expected = 0;
    bool by_coverage = true;

    template <class Visitor>
    void fields(Visitor& field) {
        ScheduledOptions::fields(field);
        field("expected", expected, {0, 1},
              "share of normals from the mean depth, the rest from render.depth");
        field("by_coverage", by_coverage,
              "weight the normals of the depth map by coverage (2DGS); false: full weight");
    }
};

/// weight * (1 - M_n . N) of a pixel; N is 0 where the depth map has no normal.
struct NormalConsistencyBody {
    Camera camera;
    Span<const Vec3f> normal;
    Span<const float> depth, transmittance;
    bool by_coverage;
    float weight_per_pixel;
    Span<float> pixel_loss;                        // added to
    Span<DepthNormalGradients<float>> neighbours;  // overwritten
    Span<Vec3f> dL_dnormal;                        // added to

    TVSGS_HD void operator()(int at) const {
        pixel_loss[at] += weight_per_pixel;
        neighbours[at] = {};
        DepthNormal<float> n;
        if (!depth_normal_at(camera, depth, at, n)) return;
        // A constant of the loss.
        const float length = weight_per_pixel * (by_coverage ? 1 - transmittance[at] : 1);
        pixel_loss[at] -= length * dot(normal[at], n.normal);
        dL_dnormal[at] -= length * n.normal;
        neighbours[at] = depth_normal_vjp(n, -length * normal[at]);
    }
};

/// mean over pixels of 1 - M_n . N, N the normals of the depth map; also of the expected depth map,
/// where `expected` is above 0.  [2DGS, Eq. 14; RaDe-GS, Eq. 20]
template <class Device>
class NormalConsistencyLoss final : public Loss<Device> {
public:
    explicit NormalConsistencyLoss(const NormalConsistencyOptions& options, const LossContext& = {})
        : options_(options) {}

    LossNeeds needs() const override {
        LossNeeds needs{.maps = Maps::normal};
        if (options_.expected < 1) needs.maps |= Maps::depth;
        if (options_.expected > 0) needs.maps |= Maps::expected_depth;
        return needs;
    }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const auto& images = in.images;
        auto& dL = objective.dL_dimages;
        pixel_loss_.resize(images.normal.size());
        pixel_loss_.fill_zero();
        neighbours_.resize(images.normal.size());
        compare(images, images.depth, 1 - options_.expected, dL.normal, dL.depth);
        compare(images, images.expected_depth, options_.expected, dL.normal, dL.expected_depth);
        objective.add(pixel_loss_);
    }

private:
    void compare(const RenderedImages<Device>& images,
                 const Buffer<float, Device>& depth,
                 float share,
                 Buffer<Vec3f, Device>& dL_dnormal,
                 Buffer<float, Device>& dL_ddepth) {
        if (!(share > 0)) return;
        const int pixels = images.width * images.height;
        parallel_for(
            Device{}, pixels,
            NormalConsistencyBody{images.camera, images.normal.span(), depth.span(),
                                  images.transmittance.span(), options_.by_coverage,
                                  share * options_.weight / float(pixels), pixel_loss_.span(),
                                  neighbours_.span(), dL_dnormal.span()});
        parallel_for(
            Device{}, pixels,
            NormalDepthBody{images.camera, neighbours_.span(), depth.span(), dL_ddepth.span()});
    }

    NormalConsistencyOptions options_;
    Buffer<float, Device> pixel_loss_;
    Buffer<DepthNormalGradients<float>, Device> neighbours_;
};

}  // namespace tvsgs
