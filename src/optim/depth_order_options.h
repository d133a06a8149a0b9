// Options of the terms that go by the order of depths and by descriptors of photographs.
#pragma once

namespace tvsgs {

struct DepthRankOptions {
    float weight = 0, margin = 1e-4f, dead_zone = 0;
    int start = 1;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "0 switches the term off");
        field("start", start, {1, 1e9}, "first iteration");
        field("margin", margin, {0, 1e3},
              "by how much the farther pixel of a pair is to be farther, in loss.length_unit");
        field(
            "dead_zone", dead_zone, {0, 1},
            "pairs whose map 'depth' differs by a smaller share say nothing (0.002 suits stereo); "
            "0: all do, and that map is not needed");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        visit("start", o.start);
    }
};

struct DepthSmoothOptions {
    float weight = 0, tolerance = 1e-4f, prior_step = 0.01f, color_step = 1;
    int start = 1;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "0 switches the term off");
        field("start", start, {1, 1e9}, "first iteration");
        field("tolerance", tolerance, {0, 1e3},
              "steps in depth up to that cost nothing, in loss.length_unit");
        field("prior_step", prior_step, {0, 1},
              "neighbours whose map 'depth_order' differs by that are an edge");
        field("color_step", color_step, {0, 1},
              "and so are those whose colours differ by more, mean of the channels (0.1 suits "
              "stereo); 1: none");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        visit("start", o.start);
    }
};

struct FeatureOptions {
    float weight = 0, max_error = 0.5f;
    bool z_buffer = true;
    int start = 1;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "0 switches the term off");
        field("start", start, {1, 1e9}, "first iteration");
        field("max_error", max_error, {0, 2},
              "1 - cosine of two descriptors from which on they do not show the same");
        field("z_buffer", z_buffer,
              "of points that meet in a pixel of the other view only the nearest counts");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        visit("start", o.start);
    }
};

}  // namespace tvsgs
