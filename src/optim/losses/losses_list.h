// List of losses. To add a loss, write its file, and add an include, options and an entry here.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "optim/losses/loss_anchored_depth.h"
#include "optim/losses/loss_depth_rank.h"
#include "optim/losses/loss_depth_smooth.h"
#include "optim/losses/loss_distortion.h"
#include "optim/losses/loss_features.h"
#include "optim/losses/loss_flatten.h"
#include "optim/losses/loss_multiview_geometry.h"
#include "optim/losses/loss_multiview_ncc.h"
#include "optim/losses/loss_normal.h"
#include "optim/losses/loss_normal_consistency.h"
#include "optim/losses/loss_photometric.h"
#include "optim/losses/loss_prior_depth.h"
#include "optim/losses/loss_prior_normal.h"
#include "optim/losses/loss_relative_depth.h"
#include "optim/losses/loss_tv.h"

namespace tvsgs {

/// The class of a term.
template <template <class> class Term>
struct TermClass {
    template <class Device>
    using On = Term<Device>;
};

/// Options of all terms; a member has the name of its key.
struct LossOptions : SharedLossOptions {
    PhotometricOptions photometric;
    ScheduledOptions flatten, normal{0, 7001}, distortion{0, 3001}, multi_view_geometry{0, 7001},
        multi_view_ncc{0, 7001}, depth_rank, depth_smooth, features, tv_normal, tv_position;
    NormalConsistencyOptions normal_consistency{{0, 7001}};
    RelativeDepthOptions relative_depth;
    PriorNormalOptions prior_normal;
    PriorDepthOptions prior_depth;
    AnchoredDepthOptions anchored_depth{{0, 1000}};

    /// The list: calls visit(TermClass, key, options, meaning), in the order in which the terms are
    /// added.
    template <class Options, class Visit>
    static void terms(Options& o, const Visit& visit) {
        visit(TermClass<PhotometricLoss>{}, "photometric", o.photometric,
              "render against photograph");
        visit(TermClass<FlattenLoss>{}, "flatten", o.flatten,
              "smallest scale of each visible splat (PGSR)");
        visit(TermClass<NormalLoss>{}, "normal", o.normal,
              "blended normals against normals of the depth map (PGSR, single view)");
        visit(TermClass<NormalConsistencyLoss>{}, "normal_consistency", o.normal_consistency,
              "directions of blended normals against the depth map (2DGS)");
        visit(TermClass<DistortionLoss>{}, "distortion", o.distortion,
              "spread of the depths that a pixel blends (2DGS)");
        visit(TermClass<MultiViewGeometryLoss>{}, "multi_view_geometry", o.multi_view_geometry,
              "depth maps of two views against each other (PGSR)");
        visit(TermClass<MultiViewNccLoss>{}, "multi_view_ncc", o.multi_view_ncc,
              "photograph patches of two views against each other (PGSR)");
        visit(TermClass<DepthRankLoss>{}, "depth_rank", o.depth_rank,
              "depth order of pixel pairs, render against prior (FatesGS)");
        visit(TermClass<DepthSmoothLoss>{}, "depth_smooth", o.depth_smooth,
              "smooth depth where the prior is smooth (FatesGS)");
        visit(TermClass<FeatureLoss>{}, "features", o.features,
              "descriptors of photographs where two views see the same surface (FatesGS)");
        visit(TermClass<RelativeDepthLoss>{}, "relative_depth", o.relative_depth,
              "depth order of pixel pairs, render against prior (VGGS)");
        visit(TermClass<PriorNormalLoss>{}, "prior_normal", o.prior_normal,
              "normals of the depth map against a prior (VGGS)");
        visit(TermClass<PriorDepthLoss>{}, "prior_depth", o.prior_depth,
              "depth against a prior in world units");
        visit(TermClass<AnchoredDepthLoss>{}, "anchored_depth", o.anchored_depth,
              "depth against a prior fitted to pixels where views agree (VGGS)");
        visit(TermClass<TvNormalLoss>{}, "tv_normal", o.tv_normal,
              "splat normals against voted normals");
        visit(TermClass<TvPositionLoss>{}, "tv_position", o.tv_position,
              "splat centres against voted positions");
    }

    template <class Visitor>
    void fields(Visitor& field) {
        terms(*this, [&](auto, const char* key, auto& options, const char* meaning) {
            field.group(key, options, meaning);
        });
        SharedLossOptions::fields(field);
    }
};

std::vector<TermOnList> terms_on_list(const LossOptions& options);

/// Union of the needs of all terms with a weight above 0, over all iterations.
LossNeeds needs_of(const LossOptions& options);

/// Terms added by the program, see add_loss().
inline std::vector<TermOnList>& added_terms() {
    static std::vector<TermOnList> terms;
    return terms;
}
template <class Device>
auto& added_losses() {
    static std::map<std::string, MakeLoss<Device>> added;
    return added;
}

template <class Device>
void add_loss(const TermOnList& term, MakeLoss<Device> make) {
    std::vector<TermOnList>& terms = added_terms();
    std::erase_if(terms, [&](const TermOnList& t) { return t.key == term.key; });
    terms.push_back(term);
    added_losses<Device>()[term.key] = std::move(make);
}

/// The terms with a weight above 0. The shared options of `context` come from `options`.
template <class Device>
std::vector<std::unique_ptr<Loss<Device>>> make_losses(const LossOptions& options,
                                                       LossContext context) {
    context.shared = options;
    std::vector<std::unique_ptr<Loss<Device>>> losses;
    LossOptions::terms(options, [&]<class Class>(Class, const char* key, const auto& of, auto) {
        if (!(of.weight > 0)) return;
        losses.push_back(std::make_unique<typename Class::template On<Device>>(of, context));
        losses.back()->key = key;
        if constexpr (requires { of.start; }) losses.back()->start = of.start;
    });
    for (const TermOnList& term : added_terms())
        if (term.weight > 0) {
            losses.push_back(added_losses<Device>().at(term.key)(context));
            losses.back()->key = term.key;
        }
    return losses;
}

}  // namespace tvsgs
