// Loss: order of depth of two pixels, compared with a prior.
#pragma once

#include "optim/losses/depth_prior_math.h"
#include "optim/losses/loss.h"

namespace tvsgs {

struct RelativeDepthOptions : ScheduledOptions {
    float dead_zone = 0, min_confidence = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        ScheduledOptions::fields(field);
        field("dead_zone", dead_zone, {0, 1},
              "smallest difference of priors that gives an order, as a share of their range");
        field("min_confidence", min_confidence, {0, 1},
              "pixels at or below this confidence of the prior are in no pair");
    }
};

/// Pixel p is in two pairs: (p, p + shift) and (p - shift, p). Adds the cost of the first pair, and
/// the derivatives of both by the depth of p.
struct RelativeDepthBody {
    int width, height;
    PixelShift shift;
    Span<const float> depth, order, confidence;
    float dead_zone, min_confidence;
    float per_length;  // length units of the losses per world unit
    float weight_per_pixel;
    Span<float> pixel_loss;  // overwritten
    Span<float> dL_ddepth;   // added to

    TVSGS_HD bool known(int at) const {
        return depth[at] > 0 && is_number(order[at]) &&
               confidence_at(confidence, at) > min_confidence;
    }
    TVSGS_HD Penalty<float> pair(int p, int q) const {
        if (!known(p) || !known(q)) return {};
        return order_hinge(order_sign(order[p], order[q], dead_zone),
                           per_length * (depth[q] - depth[p]), kOrderMargin);
    }
    TVSGS_HD bool inside(int x, int y) const { return x >= 0 && x < width && y >= 0 && y < height; }

    TVSGS_HD void operator()(int at) const {
        const int x = at % width, y = at / width, step = shift.y * width + shift.x;
        float slope = 0;
        pixel_loss[at] = 0;
        if (inside(x + shift.x, y + shift.y)) {
            const Penalty<float> first = pair(at, at + step);
            pixel_loss[at] = weight_per_pixel * first.value;
            slope -= first.slope;
        }
        if (inside(x - shift.x, y - shift.y)) slope += pair(at - step, at).slope;
        dL_ddepth[at] += weight_per_pixel * per_length * slope;
    }
};

/// mean over pixels p of [sgn(M(p) - M(q)) (D(q) - D(p)) + margin]+, q = p + a shift drawn at each
/// step. Only the order of the prior M counts. Pairs cost nothing if q is outside the image or if a
/// pixel has no depth or no prior.  [docs/method/vggs.md#relative-depth]
template <class Device>
class RelativeDepthLoss final : public Loss<Device> {
public:
    explicit RelativeDepthLoss(const RelativeDepthOptions& options, const LossContext& context = {})
        : options_(options), length_unit_(context.length_unit), seed_(context.seed) {}

    LossNeeds needs() const override {
        return {.maps = Maps::depth, .view_maps = {prior_map::kDepthOrder, prior_map::kConfidence}};
    }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const Span<const float> order = prior_values(in.view, prior_map::kDepthOrder);
        if (order.empty()) return;
        const auto& images = in.images;
        const int pixels = int(images.depth.size());
        pixel_loss_.resize(images.depth.size());
        parallel_for(
            Device{}, pixels,
            RelativeDepthBody{
                images.width, images.height,
                pixel_shift(random4(seed_, RandomStream::depth_pairs, std::uint64_t(in.step)),
                            kReach),
                images.depth.span(), order, prior_values(in.view, prior_map::kConfidence),
                options_.dead_zone, options_.min_confidence, 1 / length_unit_,
                options_.weight / float(pixels), pixel_loss_.span(),
                objective.dL_dimages.depth.span()});
        objective.add(pixel_loss_);
    }

    static constexpr int kReach = 16;  // largest distance of a pair along each axis, px  [VGGS]

private:
    RelativeDepthOptions options_;
    float length_unit_;
    std::uint64_t seed_;
    Buffer<float, Device> pixel_loss_;
};

}  // namespace tvsgs
