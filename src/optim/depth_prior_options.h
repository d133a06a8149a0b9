// Options of the terms that compare depth and normals with priors.
#pragma once

namespace tvsgs {

struct RelativeDepthOptions {
    float weight = 0, margin = 1e-4f, dead_zone = 0, min_confidence = 0;
    int start = 1, reach = 16;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "0 switches the term off");
        field("start", start, {1, 1e9}, "first iteration");
        field("reach", reach, {1, 1024}, "most pixels between the two of a pair, along each axis");
        field("margin", margin, {0, 1e3},
              "by how much the farther pixel has to be farther, in loss.length_unit");
        field("dead_zone", dead_zone, {0, 1},
              "pairs whose priors differ by less have no order, in the prior's range");
        field("min_confidence", min_confidence, {0, 1},
              "of the prior; pixels at or below are in no pair");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        visit("start", o.start);
    }
};

struct PriorNormalOptions {
    float weight = 0;
    int start = 1;
    bool by_confidence = true;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "0 switches the term off");
        field("start", start, {1, 1e9}, "first iteration");
        field("by_confidence", by_confidence,
              "pixels count by the confidence of the prior, or alike where it is above 0");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        visit("start", o.start);
    }
};

struct PriorDepthOptions {
    float weight = 0, softness = 0.01f, last_share = 1;
    int start = 1, end = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "0 switches the term off");
        field("start", start, {1, 1e9}, "first iteration");
        field("end", end, {0, 1e9}, "last iteration; 0: the term never ends");
        field("last_share", last_share, {1e-6, 1},
              "share of the weight that is left at `end`; it falls by the same factor each time");
        field("softness", softness, {1e-6, 10},
              "relative error up to which the pull grows with the error");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        visit("start", o.start);
        visit("end", o.end);
    }
};

/// top30: 20 of the 30 pixels that views agree on best. stratified: the best pixel of each cell of
/// a grid, which conditions the fit far better.
enum class AnchorChoice { top30, stratified };

/// Least squares; or reweighted five times, with Huber's weights, so that single wrong anchors
/// lose.
enum class AnchorFit { lsq, irls };

struct AnchoredDepthOptions {
    float weight = 0, anchor_confidence = 0, min_confidence = 0;
    int start = 1000, refresh_every = 500;
    AnchorChoice anchors = AnchorChoice::top30;
    AnchorFit fit = AnchorFit::lsq;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "0 switches the term off");
        field("start", start, {1, 1e9}, "first iteration");
        field("refresh_every", refresh_every, {1, 1e9},
              "iterations after which a view's target is made anew");
        field.choice("anchors", anchors, {"top30", "stratified"},
                     "pixels that the prior is fitted at: 20 of the 30 that views agree on best, "
                     "or the best of each cell of a grid");
        field.choice("fit", fit, {"lsq", "irls"},
                     "least squares, or robust against single anchors");
        field("anchor_confidence", anchor_confidence, {0, 1},
              "of the prior; pixels at or below are no anchors");
        field("min_confidence", min_confidence, {0, 1},
              "of the prior; pixels at or below are not compared");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        visit("start", o.start);
    }
};

}  // namespace tvsgs
