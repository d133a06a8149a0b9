// List of losses. To add a loss, write its file, and add an include and an entry here.
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

/// An entry holds the options of a loss, in a member that has the name of its key, and names the
/// key, its meaning and the class.
template <class... Entries>
struct LossList : Entries..., SharedLossOptions {
    /// visit<Entry>(options) for each term.
    template <class Options, class Visit>
    static void terms(Options& o, const Visit& visit) {
        (visit.template operator()<Entries>(o.*Entries::kOptions), ...);
    }

    template <class Visitor>
    void fields(Visitor& field) {
        (field.group(Entries::kKey, this->*Entries::kOptions, Entries::kMeaning), ...);
        SharedLossOptions::fields(field);
    }
};

/// The list, in the order in which the terms are added.
struct LossOptions : LossList<PhotometricEntry,
                              FlattenEntry,
                              NormalEntry,
                              NormalConsistencyEntry,
                              DistortionEntry,
                              MultiViewGeometryEntry,
                              MultiViewNccEntry,
                              DepthRankEntry,
                              DepthSmoothEntry,
                              FeatureEntry,
                              RelativeDepthEntry,
                              PriorNormalEntry,
                              PriorDepthEntry,
                              AnchoredDepthEntry,
                              TvNormalEntry,
                              TvPositionEntry> {};

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
    LossOptions::terms(options, [&]<class Entry>(const auto& of) {
        if (!(of.weight > 0)) return;
        losses.push_back(std::make_unique<typename Entry::template Term<Device>>(of, context));
        losses.back()->key = Entry::kKey;
    });
    for (const TermOnList& term : added_terms())
        if (term.weight > 0) {
            losses.push_back(added_losses<Device>().at(term.key)(context));
            losses.back()->key = term.key;
        }
    return losses;
}

}  // namespace tvsgs
