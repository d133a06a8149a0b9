// Loss: descriptors of two photographs agree where the rendered depth places one surface point.
#pragma once

#include <limits>

#include "optim/losses/feature_math.h"
#include "optim/losses/loss.h"

namespace tvsgs {

struct FillNoPointBody {
    Span<std::int64_t> nearest;
    TVSGS_HD void operator()(int i) const { nearest[i] = std::numeric_limits<std::int64_t>::max(); }
};

/// Sort key of a surface point; the nearest has the smallest. Ties are ordered by pixel.
TVSGS_HD inline std::int64_t nearness(Vec3f there, int at) {
    const float distance = std::sqrt(dot(there, there));
    return std::int64_t(__builtin_bit_cast(std::uint32_t, distance)) << 32 | at;
}

/// Whether the key belongs to pixel `at`. Compares indices: a distance computed again may be
/// rounded differently.
TVSGS_HD inline bool is_nearest(std::int64_t nearness, int at) {
    return std::uint32_t(nearness) == std::uint32_t(at);
}

TVSGS_HD inline int pixel_of(const ViewPair<float>& pair, const SeenPoint<float>& seen) {
    return int(seen.point.y) * pair.other.width + int(seen.point.x);
}

/// Writes a z-buffer of the other view's pixels.
struct NearestPointBody {
    ViewPair<float> pair;
    Camera camera;  // of the reference
    Span<const float> depth;
    Span<std::int64_t> nearest;  // [H W] of the other view

    TVSGS_HD void operator()(int at) const {
        const auto seen = seen_point(
            pair, pixel_ray(camera, at % camera.width_px, at / camera.width_px), depth[at]);
        if (seen.inside) min_atomically(&nearest[pixel_of(pair, seen)], nearness(seen.there, at));
    }
};

struct FeatureBody {
    // Larger values of 1 - cosine mean that the descriptors show different things.  [FatesGS]
    static constexpr float kMaxError = 0.5f;

    ViewPair<float> pair;
    Camera camera;  // of the reference
    FeatureMap here, there;
    Span<const float> depth, transmittance;
    Span<const std::int64_t> nearest;  // [H W] of the other view
    const double* count;               // number of pixels with depth
    float weight;                      // of their mean
    Span<float> pixel_loss;            // added to
    Span<float> dL_ddepth;             // added to

    TVSGS_HD void operator()(int at) const {
        const int x = at % camera.width_px, y = at / camera.width_px;
        const Vec3f ray = pixel_ray(camera, x, y);
        const auto seen = seen_point(pair, ray, depth[at]);
        if (!seen.inside || !(transmittance[at] <= 0.5f) ||
            !is_nearest(nearest[pixel_of(pair, seen)], at))
            return;
        const Vec2f scale_here{float(here.width) / float(camera.width_px),
                               float(here.height) / float(camera.height_px)},
            scale_there{float(there.width) / float(pair.other.width),
                        float(there.height) / float(pair.other.height)};
        const auto match = feature_match(
            here, Vec2f{scale_here.x * (float(x) + 0.5f), scale_here.y * (float(y) + 0.5f)}, there,
            Vec2f{scale_there.x * seen.point.x, scale_there.y * seen.point.y}, kMaxError);
        if (!match.valid) return;
        const float scale = weight / float(*count);
        pixel_loss[at] += scale * match.error;
        dL_ddepth[at] += seen_point_vjp(pair, ray, seen,
                                        Vec2f{scale * scale_there.x * match.derror_dpoint.x,
                                              scale * scale_there.y * match.derror_dpoint.y});
    }
};

/// mean, over pixels with depth and over neighbour views, of |1 - cosine| between the descriptor of
/// a pixel and the descriptor where the other view sees its surface point. A pixel costs nothing,
/// but counts in the mean, if the other view does not see the point, if the descriptors differ too
/// much, or if its coverage is below one half. Uses two resolutions where both views have them, the
/// coarse one with half weight. The derivative is by the depth of this view.
/// [docs/method/fates.md#descriptors]
template <class Device>
class FeatureLoss final : public Loss<Device> {
public:
    explicit FeatureLoss(const ScheduledOptions& options, const LossContext& = {})
        : options_(options) {}

    LossNeeds needs() const override {
        return {.maps = Maps::depth,
                .neighbour_views = kOthers,
                .view_maps = {prior_map::kFeatures, prior_map::kCoarseFeatures}};
    }

    void add_to(Objective<Device>& objective, const LossInputs<Device>& in) override {
        if (in.others == nullptr || in.view.map(prior_map::kFeatures) == nullptr) return;
        std::vector<const NeighbourView<Device>*> others;
        for (int i = 0; i < in.others->count() && i < kOthers; ++i)
            if ((*in.others)[i].view().map(prior_map::kFeatures) != nullptr)
                others.push_back(&(*in.others)[i]);
        if (others.empty()) return;

        const auto& images = in.images;
        const int pixels = images.width * images.height;
        pixel_loss_.resize(images.depth.size());
        pixel_loss_.fill_zero();
        objective.count_of(pixels, CountPositive{images.depth.span()});
        for (const NeighbourView<Device>* other : others)
            compare(objective, in, *other, options_.weight / float(others.size()));
        objective.add(pixel_loss_);
    }

private:
    void compare(Objective<Device>& objective,
                 const LossInputs<Device>& in,
                 const NeighbourView<Device>& other,
                 float weight) {
        const auto& images = in.images;
        const int pixels = images.width * images.height;
        const ViewPair<float>& pair = other.pair();
        nearest_.resize(std::size_t(pair.other.width) * std::size_t(pair.other.height));
        parallel_for(Device{}, int(nearest_.size()), FillNoPointBody{nearest_.span()});
        parallel_for(Device{}, pixels,
                     NearestPointBody{pair, images.camera, images.depth.span(), nearest_.span()});
        const bool both = in.view.map(prior_map::kCoarseFeatures) != nullptr &&
                          other.view().map(prior_map::kCoarseFeatures) != nullptr;
        const auto at_scale = [&](std::string_view name, float share) {
            const DeviceMap<Device>&a = *in.view.map(name), &b = *other.view().map(name);
            if (a.channels != b.channels)
                throw Error(ExitCode::input, "map '", name, "': ", a.channels, " channels in view ",
                            in.view.index, ", ", b.channels, " in view ", other.view().index,
                            "; expected the same number in all views");
            parallel_for(
                Device{}, pixels,
                FeatureBody{pair, images.camera, features(a), features(b), images.depth.span(),
                            images.transmittance.span(), nearest_.span(), objective.count.data(),
                            share * weight, pixel_loss_.span(), objective.dL_dimages.depth.span()});
        };
        at_scale(prior_map::kFeatures, both ? 2.0f / 3 : 1.0f);
        if (both) at_scale(prior_map::kCoarseFeatures, 1.0f / 3);
    }

    static constexpr int kOthers = 2;

    static FeatureMap features(const DeviceMap<Device>& map) {
        return {map.values.data(), map.width_px, map.height_px, map.channels};
    }

    ScheduledOptions options_;
    Buffer<float, Device> pixel_loss_;
    Buffer<std::int64_t, Device> nearest_;
};

}  // namespace tvsgs
