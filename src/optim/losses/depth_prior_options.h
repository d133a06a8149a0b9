// Options of the terms that compare depths and normals with priors.
#pragma once

namespace tvsgs {

struct RelativeDepthOptions {
    float weight = 0, dead_zone = 0, min_confidence = 0;
    int start = 1;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "0 switches the term off");
        field("start", start, {1, 1e9}, "first iteration");
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
    float weight = 0, last_share = 1;
    int start = 1, end = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "0 switches the term off");
        field("start", start, {1, 1e9}, "first iteration");
        field("end", end, {0, 1e9}, "last iteration; 0: the term never ends");
        field("last_share", last_share, {1e-6, 1},
              "share of the weight that is left at `end`; it falls by the same factor each time");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        visit("start", o.start);
        visit("end", o.end);
    }
};

struct AnchoredDepthOptions {
    float weight = 0, anchor_confidence = 0, min_confidence = 0;
    int start = 1000, refresh_every = 500;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "0 switches the term off");
        field("start", start, {1, 1e9}, "first iteration");
        field("refresh_every", refresh_every, {1, 1e9},
              "iterations after which a view's target is made anew");
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
