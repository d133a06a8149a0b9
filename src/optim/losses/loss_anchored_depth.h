// Loss: depth against a prior that is fitted to pixels whose depth is consistent in two views.
#pragma once

#include <algorithm>
#include <string>
#include <vector>

#include "optim/losses/depth_anchors.h"
#include "optim/losses/loss.h"
#include "optim/losses/patch_pair.h"

namespace tvsgs {

struct AnchoredDepthOptions : ScheduledOptions {
    float anchor_confidence = 0, min_confidence = 0;
    int refresh_every = 500;

    template <class Visitor>
    void fields(Visitor& field) {
        ScheduledOptions::fields(field);
        field("refresh_every", refresh_every, {1, 1e9},
              "iterations between updates of the target of a view");
        field("anchor_confidence", anchor_confidence, {0, 1},
              "pixels at or below this confidence of the prior are not anchors");
        field("min_confidence", min_confidence, {0, 1},
              "pixels at or below this confidence of the prior are not compared");
    }
};

/// exp(-e) (1 + NCC^2) / 2: agreement of both views on a pixel's depth; e is the pixel's
/// reprojection distance in px. 0 where the views cannot be compared, where the patches differ or
/// leave a photograph, and where the prior must not be fitted.
struct AnchorConfidenceBody {
    PatchPair patches;
    Span<const Vec3f> normal;
    Span<const float> depth, agreement;  // exp(-e)
    Span<const float> prior, prior_confidence;
    float least_prior_confidence;
    Span<float> confidence;  // overwritten

    TVSGS_HD void operator()(int at) const {
        confidence[at] = 0;
        if (!(agreement[at] > 0) || !is_number(prior[at]) ||
            !(confidence_at(prior_confidence, at) > least_prior_confidence))
            return;
        const Camera& camera = patches.camera;
        const Vec3f point =
            depth[at] * pixel_ray(camera, at % camera.width_px, at / camera.width_px);
        if (!patches.inside(at, point)) return;
        const auto score = patches.score(at, normal[at], point);
        if (score.valid) confidence[at] = agreement[at] * (1 - score.error / 2);
    }
};

struct CalibrateBody {
    DepthAlignment<float> alignment;
    Span<const float> prior, depth;
    Span<float> target;  // overwritten

    TVSGS_HD void operator()(int at) const {
        target[at] = calibrated_depth(alignment, prior[at], depth[at]);
    }
};

/// Pixels that the loss compares.
struct HasTarget {
    Span<const float> target, depth, confidence;
    float min_confidence;
    TVSGS_HD int operator()(int at) const {
        return target[at] > 0 && depth[at] > 0 && confidence_at(confidence, at) > min_confidence;
    }
};

struct AnchoredDepthBody {
    HasTarget compared;
    const double* count;     // number of HasTarget pixels
    float weight;            // per unit of length
    Span<float> pixel_loss;  // overwritten
    Span<float> dL_ddepth;   // added to

    TVSGS_HD void operator()(int at) const {
        pixel_loss[at] = 0;
        if (!compared(at)) return;
        const float difference = compared.depth[at] - compared.target[at];
        const float share = weight / float(*count);
        pixel_loss[at] = share * std::abs(difference);
        dL_ddepth[at] += difference > 0 ? share : difference < 0 ? -share : 0;
    }
};

/// mean of |D - target| over the pixels whose prior has enough confidence. The target of a view is
/// the render where it agrees with the fitted prior, else that prior. It is renewed when the view
/// first comes up in each period of `refresh_every` iterations.
/// [docs/method/vggs.md#anchored-depth]
template <class Device>
class AnchoredDepthLoss final : public Loss<Device> {
public:
    explicit AnchoredDepthLoss(const AnchoredDepthOptions& options, const LossContext& context = {})
        : options_(options),
          length_unit_(context.length_unit),
          pixel_center_(context.pixel_center),
          made_(std::size_t(context.views)),
          targets_(std::size_t(context.views)) {}

    bool active(int step) const override { return step >= options_.start; }
    /// Of the iterations that make a target.
    LossNeeds needs() const override {
        return {.maps = kGeometryMaps,
                .neighbour_views = 1,
                .rendered_views = 1,
                .grey = true,
                .view_maps = {prior_map::kDepthOrder, prior_map::kConfidence},
                .kept_per_pixel = 1};
    }
    LossNeeds needs_at(int step, int view) const override {
        if (due(step, view)) return needs();
        return {.maps = Maps::depth, .view_maps = {prior_map::kDepthOrder, prior_map::kConfidence}};
    }

    /// Whether the view's target should be made at this step.
    bool due(int step, int view) const {
        const int last = made_[view].step;
        return step >= options_.start && (last < options_.start || round_of(step) > round_of(last));
    }

    /// Number of anchors that define the prior's correction; decreases with time.
    int nearest_at(int step) const { return std::max(4 - round_of(step), 1); }

    /// [H W] target depth of a view; 0: unknown. Empty: no target yet.
    const Buffer<float, Device>& target(int view) const { return targets_[view]; }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        const Span<const float> prior = prior_values(in.view, prior_map::kDepthOrder);
        const bool now = due(in.step, in.view.index);
        if (now) made_[in.view.index].step = in.step;
        if (prior.empty() || (now && in.others == nullptr)) return;
        const Span<const float> confidence = prior_values(in.view, prior_map::kConfidence);
        if (now) make_target(in, prior, confidence);

        const auto& images = in.images;
        const Buffer<float, Device>& target = this->target(in.view.index);
        if (target.size() != images.depth.size()) return;  // no target could be made
        const int pixels = int(images.depth.size());
        const HasTarget compared{target.span(), images.depth.span(), confidence,
                                 options_.min_confidence};
        objective.count_of(pixels, compared);
        pixel_loss_.resize(images.depth.size());
        parallel_for(
            Device{}, pixels,
            AnchoredDepthBody{compared, objective.count.data(), options_.weight / length_unit_,
                              pixel_loss_.span(), objective.dL_dimages.depth.span()});
        objective.add(pixel_loss_);
    }

    void state(StateVisitor<Device>& visit) override {
        Buffer<Made, Device> made;
        if (!visit.loading()) copy(made_, made);
        visit.optional("anchored_depth.made", made);
        if (made.size() == made_.size()) made_ = to_host(made);
        for (std::size_t i = 0; i < targets_.size(); ++i)
            visit.optional("anchored_depth.target." + std::to_string(i), targets_[i]);
    }

private:
    /// Step of a view's last request for a target, and slope of its last fit.
    struct Made {
        int step = 0;
        float slope = 0;  // 0: no fit, or a rejected one
    };

    int round_of(int step) const { return (step - options_.start) / options_.refresh_every; }

    /// Keeps the old target where the fit fails.
    void make_target(const LossInputs<Device>& in,
                     Span<const float> prior,
                     Span<const float> prior_confidence) {
        Made& made = made_[in.view.index];
        const NeighbourView<Device>& other = (*in.others)[0];
        const auto& images = in.images;
        const int pixels = int(images.depth.size());
        confidence_.resize(images.depth.size());
        parallel_for(
            Device{}, pixels,
            AnchorConfidenceBody{patch_pair(images, in.view, other, pixel_center_),
                                 images.normal.span(), images.depth.span(), other.weight(), prior,
                                 prior_confidence, options_.anchor_confidence, confidence_.span()});

        // Refreshes are rare, so anchors are chosen on the host.
        const std::vector<int> anchors = choose_anchors(images.width, to_host(confidence_));
        const std::vector<float> depths = to_host(images.depth),
                                 priors = to_host(in.view.map(prior_map::kDepthOrder)->values);
        std::vector<double> depth, wanted;
        for (const int at : anchors) {
            depth.push_back(double(depths[at]));
            wanted.push_back(double(priors[at]));
        }
        const auto fit = fit_affine(wanted, depth);
        if (!fit) return;
        // Rejects a slope far from the last one, unless the next fit confirms it.
        const double ratio = fit->slope / double(made.slope);
        const bool jumps = made.slope > 0 && !(ratio >= 0.1 && ratio <= 10);
        made.slope = jumps ? 0 : float(fit->slope);
        if (jumps) return;

        const DepthAlignment<double> a = align(*fit, wanted, depth, nearest_at(in.step));
        const DepthAlignment<float> alignment{float(a.slope), float(a.offset), float(a.max_gap),
                                              float(a.correction)};
        Buffer<float, Device>& target = targets_[in.view.index];
        target.resize(images.depth.size());
        parallel_for(Device{}, pixels,
                     CalibrateBody{alignment, prior, images.depth.span(), target.span()});
    }

    AnchoredDepthOptions options_;
    float length_unit_;
    PixelCenter pixel_center_;
    std::vector<Made> made_;                      // per view
    std::vector<Buffer<float, Device>> targets_;  // per view
    Buffer<float, Device> confidence_, pixel_loss_;
};

}  // namespace tvsgs
