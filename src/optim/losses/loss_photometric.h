// Loss: the render against its photograph.
#pragma once

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/scene/prior_maps.h"
#include "optim/losses/loss.h"
#include "optim/photo/exposure.h"
#include "render/photometric/photometric.h"

namespace tvsgs {

struct PhotometricOptions {
    float weight = 1, ssim = 0.2f, geometry = 1, dropout = 0;
    bool exposure = false;
    int exposure_start = 1001, geometry_full = 0;
    MaskUse masks = MaskUse::automatic;
    float coverage = 0.1f;
    std::string background = "none", exposure_from, sky_from;
    std::shared_ptr<const HeldExposures> held{};  // contents of exposure_from, once read
    std::shared_ptr<const ImageU8> sky{};         // map of a sky background, once made

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "weight of (1 - ssim) L1 + ssim (1 - SSIM); 0: off");
        field("ssim", ssim, {0, 1}, "share of the SSIM term, 0 to 1");
        field("geometry", geometry, {0, 1},
              "share of the gradient that moves, turns and scales splats with init.support");
        field("geometry_full", geometry_full, {0, 1e9},
              "iteration at which that share has risen to 1, in a straight line; 0: it stays");
        field("dropout", dropout, {0, 0.9},
              "share of the splats that an iteration leaves out, in groups of neighbours");
        field("exposure", exposure,
              "fit brightness and offset of each photograph, in the L1 term (PGSR)");
        field("exposure_start", exposure_start, {1, 1e9}, "first iteration of that fit");
        field("exposure_from", exposure_from,
              "finished run whose exposures are used, for the same colours in all blocks; empty: "
              "none");
        field.choice(
            "masks", masks, {"auto", "object", "ignore", "none"},
            "pixels outside the masks; object: background, must stay empty; ignore: not compared; "
            "none: masks are not used; auto: the plan decides, none without a plan");
        field("coverage", coverage, {0, 1e6},
              "weight of splats that cover pixels outside object masks, and, with a soft "
              "background, of pixels left open where stereo measured a depth; 0: off");
        field("background", background,
              "colour behind the splats and outside object masks: black, white, R,G,B (0 to 255), "
              "random (object masks only), sky (by direction, from the photographs) or soft (all "
              "photographs blurred, by direction); none: black, and pixels outside object masks "
              "are not compared");
        field("sky_from", sky_from,
              "finished run whose sky is used, for the same sky in all blocks; empty: none");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        visit("exposure_start", o.exposure_start);
        visit("geometry_full", o.geometry_full);
    }

    /// The share `geometry` at an iteration.
    float geometry_at(int step) const {
        if (geometry_full == 0) return geometry;
        const float risen = std::min(float(step) / float(geometry_full), 1.0f);
        return geometry + (1 - geometry) * risen;
    }
};

template <class Device>
class PhotometricLoss final : public Loss<Device> {
public:
    explicit PhotometricLoss(const PhotometricOptions& o, const LossContext& context = {})
        : weights_{o.weight * (1 - o.ssim), o.weight * o.ssim},
          exposure_start_(o.held       ? 1
                          : o.exposure ? o.exposure_start
                                       : 0),
          views_(context.views),
          masks_(uses_masks(o.masks)),
          coverage_(o.masks == MaskUse::object ? o.weight * o.coverage : 0),
          open_(o.background == kSoftBackground ? o.weight * o.coverage : 0),
          background_(parse_background(o.background)),
          fills_(o.masks == MaskUse::object && background_.kind != PhotoBackground::Kind::none &&
                 background_.kind != PhotoBackground::Kind::sky),
          sky_(o.sky),
          seed_(context.seed),
          exposure_(o.exposure, o.held.get()) {
        // The plan has not resolved `automatic` yet.
        if (background_.kind == PhotoBackground::Kind::random && !fills_ &&
            o.masks != MaskUse::automatic)
            throw Error(ExitCode::usage, kRandomNeedsObject);
    }

    bool has_camera_gradient() const override { return true; }
    LossNeeds needs() const override {
        LossNeeds needs;
        if (masks_) needs.view_maps.insert("mask");
        if (open_ > 0) needs.view_maps.insert(prior_map::kConfidence);
        if (coverage_ > 0 || has_background()) needs.maps = Maps::coverage;
        return needs;
    }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        pixel_loss_.resize(in.images.color.size());
        const int pixels = int(pixel_loss_.size());
        const bool masks = masks_ || has_background();
        ComparedPhoto compared{
            in.images.color.span(), in.view.photo.span(), objective.dL_dimages.color.span(), {}};
        if (masks) compared = mask(in);
        const bool expose = exposes_at(in.step);
        PhotometricWeights weights = weights_;
        if (expose) weights.l1 = 0;  // SSIM always compares the render itself
        photometric_loss({compared.color, compared.photo, in.images.width, in.images.height,
                          weights, compared.dL_dcolor, pixel_loss_.span()},
                         scratch_);
        if (expose) {
            ssim_loss_.resize(1);
            ssim_loss_.fill_zero();
            add_sum(Device{}, pixels, ReadValue{pixel_loss_.span()}, 1, objective.partial.span(),
                    ssim_loss_.data());
            // Officially exposures are fitted once 1 - SSIM < 0.5. Without an SSIM term, or with
            // held exposures: always.
            const double limit = exposure_.held()   ? INFINITY
                                 : weights.ssim > 0 ? 0.5 * double(weights.ssim)
                                                    : 1;
            exposure_.add_l1(in, compared, views_, weights_.l1, ssim_loss_.data(), limit, objective,
                             pixel_loss_.span());
        }
        if (masks)
            parallel_for(
                Device{}, pixels,
                MaskPhotoVjpBody{by_, in.images.transmittance.span(), dL_dcolor_.span(),
                                 objective.dL_dimages.color.span(),
                                 objective.dL_dimages.transmittance.span(), pixel_loss_.span()});
        objective.add(pixel_loss_);
        if (expose && !exposure_.held()) exposure_.step(in.view.index, views_);
    }

    void state(StateVisitor<Device>& visit) override { exposure_.state(visit); }

    HeldExposures exposures() const override { return exposure_.values(); }

    const Exposure<Device>& exposure() const { return exposure_; }

private:
    bool exposes_at(int step) const { return exposure_start_ > 0 && step >= exposure_start_; }

    /// Whether the background of the render itself is not black.
    bool has_background() const {
        return background_.kind == PhotoBackground::Kind::random ||
               background_.kind == PhotoBackground::Kind::sky || !background_.black();
    }

    ComparedPhoto mask(const LossInputs<Device>& in) {
        const std::size_t pixels = in.images.color.size();
        const PhotoBackground behind = background_.at(seed_, in.step);
        const bool is_sky = behind.kind == PhotoBackground::Kind::sky;
        if (is_sky && sky_texels_.empty()) copy_sky();
        const DeviceMap<Device>* const map = masks_ ? in.view.map("mask") : nullptr;
        const DeviceMap<Device>* const confidence =
            open_ > 0 ? in.view.map(prior_map::kConfidence) : nullptr;
        by_ = {map != nullptr ? map->values.span() : Span<const float>{},
               {behind.linear(), is_sky ? SkyMap{sky_texels_.data(), sky_->width} : SkyMap{},
                in.view.camera},
               fills_,
               coverage_ / float(pixels),
               confidence != nullptr ? confidence->values.span() : Span<const float>{},
               open_ / float(pixels)};
        color_.resize(pixels), photo_.resize(3 * pixels), dL_dcolor_.resize(pixels);
        dL_dcolor_.fill_zero();
        parallel_for(Device{}, int(pixels),
                     MaskPhotoBody{by_,
                                   in.images.color.span(),
                                   in.images.transmittance.span(),
                                   in.view.photo.data(),
                                   color_.span(),
                                   photo_.data(),
                                   {behind.color[0], behind.color[1], behind.color[2]}});
        return {color_.span(), photo_.span(), dL_dcolor_.span(), by_.mask};
    }

    /// Runs at the first step: some terms are only made to read their needs.
    void copy_sky() {
        if (!sky_) throw Error(ExitCode::usage, kSkyNeedsMap);
        copy(std::vector<std::uint8_t>(sky_->pixels.begin(), sky_->pixels.end()), sky_texels_);
    }

    PhotometricWeights weights_;
    int exposure_start_;  // 0: never
    int views_;
    bool masks_;
    float coverage_, open_;  // 0: none
    PhotoBackground background_;
    bool fills_;
    std::shared_ptr<const ImageU8> sky_;
    std::uint64_t seed_;
    PhotometricScratch<Device> scratch_;
    Exposure<Device> exposure_;
    Buffer<float, Device> pixel_loss_;
    Buffer<double, Device> ssim_loss_;
    // Of the last step; used with masks or a background:
    MaskedPhoto by_{};
    Buffer<Vec3f, Device> color_, dL_dcolor_;
    Buffer<std::uint8_t, Device> photo_, sky_texels_;
};

}  // namespace tvsgs
