// Renders and cleans the depth maps of all views for the meshers.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "core/scene/scene.h"
#include "mesh/fuse/depth_clean.h"
#include "mesh/fuse/depth_view.h"
#include "mesh/mend/mesh_evidence.h"

namespace tvsgs {

/// Median of the positive depths; 0 if there is none.
double median_depth(std::vector<float> depths);

/// The depth limit as text; "any" if there is none.
std::string limit_text(const DepthRules& rules);

namespace detail {

std::string why_none_passed(const DepthCounts& counts,
                            const DepthRules& rules,
                            double median_depth);

}  // namespace detail

template <class Device>
class DepthViews {
public:
    /// `masks`: drop pixels outside of the views' masks, too. References must outlive the object.
    DepthViews(const std::vector<View>& views,
               const Gaussians<Device>& gaussians,
               Backbone<Device>& backbone,
               const DepthRules& rules,
               bool masks)
        : views_(views),
          gaussians_(gaussians),
          backbone_(backbone),
          rules_(rules),
          masks_(masks),
          counts_(views.size()) {}

    int size() const { return static_cast<int>(views_.size()); }

    /// A mesher may tighten them before the first view.
    DepthRules& rules() { return rules_; }

    /// Whether pixels outside of the views' masks are dropped.
    bool masks() const { return masks_; }

    /// [H W] 255: object; empty: everything.
    std::vector<std::uint8_t> mask(int i) const {
        return masks_ ? views_[i].mask.pixels.to_vector() : std::vector<std::uint8_t>();
    }

    /// Renders view i; valid until the next call, or another render by the backbone.
    DepthView<Device> view(int i) {
        const View& view = views_[i];
        DepthCounts& count = counts_[i];
        const auto& rendered = backbone_.forward(gaussians_, view.camera, gaussians_.sh_degree,
                                                 Maps::color | kGeometryMaps);
        const Camera& camera = rendered.camera;  // of the depths
        copy(mask(i), mask_);
        count = clean_depth(rendered, camera, mask_.span(), rules_, clean_);
        if (count[DepthOutcome::kept] == 0) median_ = median_depth(to_host(rendered.depth));
        return {camera, clean_.depth.span(), rendered.color.span(), clean_.weight.span(),
                rendered.normal.span()};
    }

    /// The depth of the last view() call.
    std::vector<float> depth_on_host() const { return to_host(clean_.depth); }

    /// The weights of the last view() call; empty: 1 each.
    std::vector<float> weight_on_host() const { return to_host(clean_.weight); }

    /// Pixel counts of a rendered view.
    const DepthCounts& counts(int i) const { return counts_[i]; }

    /// Logs how many pixels were dropped, and why. Returns why none passed the rules; empty if one
    /// did.
    std::string why_none_passed() const {
        DepthCounts total;
        for (const DepthCounts& count : counts_)
            for (std::size_t k = 0; k < count.of.size(); ++k) total.of[k] += count.of[k];
        return detail::why_none_passed(total, rules_, median_);
    }

private:
    const std::vector<View>& views_;
    const Gaussians<Device>& gaussians_;
    Backbone<Device>& backbone_;
    DepthRules rules_;
    bool masks_;
    std::vector<DepthCounts> counts_;  // by view, because a view may be rendered twice
    double median_ = 0;                // of the last view without kept pixels
    // Of the last view:
    CleanDepth<Device> clean_;
    Buffer<std::uint8_t, Device> mask_;
};

/// Depth maps and trust of all views. `depth` must outlive the result and computes weights of trust
/// from now on.
template <class Device>
EvidenceSource evidence_of(DepthViews<Device>& depth) {
    depth.rules().trust = true;
    return {depth.size(), [&depth](int i) -> EvidenceView {
                const Camera camera = depth.view(i).camera;
                return {camera, depth.depth_on_host(), depth.weight_on_host(), depth.mask(i)};
            }};
}

}  // namespace tvsgs
