// Selects pairs of training views that see the same surface.  [PGSR, Section 3.3]
#pragma once

#include <vector>

#include "core/options.h"
#include "core/scene/camera.h"
#include "core/scene/scene.h"

namespace tvsgs {

/// Unit of the limits on the distance between two cameras: world units, which fit scenes normalised
/// as by PGSR's authors, or multiples of the view's median depth.
enum class PairLimits { official, relative };

struct ViewPairOptions {
    PairLimits limits = PairLimits::official;
    int count = 8;
    float max_angle_deg = 30, fallback_angle_deg = 0, min_distance = 0.01f, max_distance = 1.5f,
          min_baseline = 0.005f, max_baseline = 1;
    int samples = 102400;

    template <class Visitor>
    void fields(Visitor& field) {
        field.choice("limits", limits, {"official", "relative"},
                     "limits of the distance of neighbour views; official: min_distance and "
                     "max_distance; relative: min_baseline and max_baseline");
        field("count", count, {1, 1e6}, "most neighbour views of a view");
        field("max_angle_deg", max_angle_deg, {0, 180},
              "largest angle between the optical axes, degrees");
        field("fallback_angle_deg", fallback_angle_deg, {0, 180},
              "the same for views without a neighbour within max_angle_deg, if larger");
        field("min_distance", min_distance, {0, 1e9},
              "smallest distance between the cameras, world units");
        field("max_distance", max_distance, {0, 1e9},
              "largest distance between the cameras, world units");
        field("min_baseline", min_baseline, {0, 1e9},
              "smallest distance between the cameras, in median depths of the view");
        field("max_baseline", max_baseline, {0, 1e9},
              "largest distance between the cameras, in median depths of the view");
        field("samples", samples, {1, 1e8}, "most patches compared per iteration");
    }
};

struct ViewPairs {
    std::vector<std::vector<int>> of_view;  // training views, nearest first
    // Points nearer to the other camera are not compared, world units.
    float min_depth = 0.1f;
};

/// Pairs every training view with at most `count` others within the limits, nearest first; equal
/// distances by angle. Logs views without a pair and the reason, unless `quiet`.
ViewPairs select_view_pairs(const Scene& scene, const ViewPairOptions& options, bool quiet = false);

/// Share of the training views that have a pair; logs nothing.
double share_with_pair(const Scene& scene, const ViewPairOptions& options);

}  // namespace tvsgs
