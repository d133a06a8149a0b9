// List of losses; included by one file per device. To add a loss, write its file, add its options
// to LossOptions::terms(), and a line here.
#pragma once

#include <map>
#include <string>
#include <type_traits>
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

/// visit(type, key, constructor arguments...) for each term.
template <class Device, class Visit>
void visit_losses(const LossOptions& o, const LossContext& c, const Visit& visit) {
    using std::type_identity;
    visit(type_identity<PhotometricLoss<Device>>{}, "photometric", o.photometric, c.views, c.seed);
    visit(type_identity<FlattenLoss<Device>>{}, "flatten", o.flatten, c.length_unit);
    visit(type_identity<NormalLoss<Device>>{}, "normal", o.normal);
    visit(type_identity<NormalConsistencyLoss<Device>>{}, "normal_consistency",
          o.normal_consistency);
    visit(type_identity<DistortionLoss<Device>>{}, "distortion", o.distortion, c.length_unit);
    visit(type_identity<MultiViewGeometryLoss<Device>>{}, "multi_view_geometry",
          o.multi_view_geometry);
    visit(type_identity<MultiViewNccLoss<Device>>{}, "multi_view_ncc", o.multi_view_ncc,
          o.multi_view.samples, c.seed, c.pixel_center);
    visit(type_identity<DepthRankLoss<Device>>{}, "depth_rank", o.depth_rank, c.length_unit,
          c.seed);
    visit(type_identity<DepthSmoothLoss<Device>>{}, "depth_smooth", o.depth_smooth, c.length_unit);
    visit(type_identity<FeatureLoss<Device>>{}, "features", o.features);
    visit(type_identity<RelativeDepthLoss<Device>>{}, "relative_depth", o.relative_depth,
          c.length_unit, c.seed);
    visit(type_identity<PriorNormalLoss<Device>>{}, "prior_normal", o.prior_normal);
    visit(type_identity<PriorDepthLoss<Device>>{}, "prior_depth", o.prior_depth);
    visit(type_identity<AnchoredDepthLoss<Device>>{}, "anchored_depth", o.anchored_depth,
          c.length_unit, c.views, c.pixel_center);
    visit(type_identity<TvLoss<Device, false>>{}, "tv_normal", o.tv_normal, o.tv_reduction);
    visit(type_identity<TvLoss<Device, true>>{}, "tv_position", o.tv_position, o.tv_reduction,
          c.length_unit);
}

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

template <class Device>
std::vector<std::unique_ptr<Loss<Device>>> make_losses(const LossOptions& options,
                                                       const LossContext& context) {
    std::vector<std::unique_ptr<Loss<Device>>> losses;
    visit_losses<Device>(options, context,
                         [&]<class Term>(std::type_identity<Term>, const char*, const auto& of,
                                         const auto&... more) {
                             if (of.weight > 0)
                                 losses.push_back(std::make_unique<Term>(of, more...));
                         });
    for (const TermOnList& term : added_terms())
        if (term.weight > 0) losses.push_back(added_losses<Device>().at(term.key)(context));
    return losses;
}

}  // namespace tvsgs
