// Loss: patches of a photograph against patches of another view, warped by the rendered surface.
#pragma once

#include "optim/losses/loss.h"
#include "optim/losses/patch_pair.h"

namespace tvsgs {

struct ListValidBody {
    Span<const int> valid, place;
    Span<int> pixels;
    TVSGS_HD void operator()(int at) const {
        if (valid[at]) pixels[place[at]] = at;
    }
};

struct PatchTerm {
    int pixel;  // -1: none
    float loss;
    Vec3f dL_dnormal;
    float dL_ddepth;
};

/// Draws and scores patch `i`; no two patches have the same pixel.
struct PatchBody {
    PatchPair patches;
    Span<const Vec3f> normal;
    Span<const float> depth, pixel_weight;
    Span<const int> pixels;
    const double* count;  // number of comparable pixels
    Random4 key;
    Span<PatchTerm> terms;  // overwritten

    TVSGS_HD void operator()(int i) const {
        PatchTerm term{-1, 0, {}, 0};
        const auto valid = std::uint32_t(*count);
        if (std::uint32_t(i) < valid) {
            const int at = pixels[permuted(std::uint32_t(i), valid, key)];
            const Camera& camera = patches.camera;
            // The plane with this normal through the surface point.
            const Vec3f n = normal[at], point = depth[at] * pixel_ray(camera, at % camera.width_px,
                                                                      at / camera.width_px);
            const auto score = patches.score(at, n, point);
            const float w = pixel_weight[at];
            if (score.valid)
                term = {at, w * score.error,
                        w * (score.derror_dnormal - score.derror_ddistance * point),
                        -w * score.derror_ddistance * dot(n, point) / depth[at]};
        }
        terms[i] = term;
    }
};

struct PatchPasses {
    Span<const PatchTerm> terms;
    TVSGS_HD int operator()(int i) const { return terms[i].pixel >= 0; }
};

struct PatchLoss {
    Span<const PatchTerm> terms;
    const double* count;
    TVSGS_HD double operator()(int i) const {
        return terms[i].pixel >= 0 ? double(terms[i].loss) / *count : 0.0;
    }
};

/// All patches have different pixels, so each pixel is written once.
struct PatchGradientBody {
    Span<const PatchTerm> terms;
    const double* count;  // number of valid patches
    float weight;
    Span<Vec3f> dL_dnormal;  // added to
    Span<float> dL_ddepth;   // added to

    TVSGS_HD void operator()(int i) const {
        const PatchTerm& t = terms[i];
        if (t.pixel < 0) return;
        const float scale = weight / float(*count);
        dL_dnormal[t.pixel] += scale * t.dL_dnormal;
        dL_ddepth[t.pixel] += scale * t.dL_ddepth;
    }
};

/// mean over patches of w (1 - NCC^2) between the grey photographs. Patches are warped by the plane
/// rendered at their centre; w is the weight of the geometric term.  [PGSR, Eq. 14]
template <class Device>
class MultiViewNccLoss final : public Loss<Device> {
public:
    explicit MultiViewNccLoss(const ScheduledOptions& options, const LossContext& context = {})
        : options_(options),
          samples_(context.shared.multi_view.samples),
          seed_(context.seed),
          pixel_center_(context.pixel_center) {}

    LossNeeds needs() const override {
        return {.maps = kGeometryMaps,
                .neighbour_views = 1,
                .rendered_views = 1,
                .grey = true,
                .splat_gradients = true};
    }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        if (in.others == nullptr) return;
        const NeighbourView<Device>& other = (*in.others)[0];
        const auto& images = in.images;
        const int all = int(images.depth.size());
        pixels_.resize(images.depth.size());
        exclusive_scan(other.valid(), place_, scratch_);
        parallel_for(Device{}, all,
                     ListValidBody{other.valid().span(), place_.span(), pixels_.span()});

        const int samples = samples_ < all ? samples_ : all;
        terms_.resize(samples);
        const Buffer<PatchTerm, Device>& terms = terms_;
        parallel_for(
            Device{}, samples,
            PatchBody{patch_pair(images, in.view, other, pixel_center_), images.normal.span(),
                      images.depth.span(), other.weight(), pixels_.span(), other.valid_count(),
                      random4(seed_, RandomStream::patches, std::uint64_t(in.step)),
                      terms_.span()});
        objective.count_of(samples, PatchPasses{terms.span()});
        add_sum(Device{}, samples, PatchLoss{terms.span(), objective.count.data()}, options_.weight,
                objective.partial.span(), objective.value());
        parallel_for(Device{}, samples,
                     PatchGradientBody{terms.span(), objective.count.data(), options_.weight,
                                       objective.dL_dimages.normal.span(),
                                       objective.dL_dimages.depth.span()});
    }

private:
    ScheduledOptions options_;
    int samples_;
    std::uint64_t seed_;
    PixelCenter pixel_center_;
    Buffer<int, Device> place_, pixels_;
    Buffer<std::uint8_t, Device> scratch_;
    Buffer<PatchTerm, Device> terms_;
};

}  // namespace tvsgs
