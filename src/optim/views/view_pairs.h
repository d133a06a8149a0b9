// Which views are paired.  [PGSR, Section 3.3]
#pragma once

#include <vector>

#include "core/options.h"
#include "core/scene/scene.h"

namespace tvsgs {

/// In what the limits of the distance between two cameras are given. The official ones are world
/// units, which fit scenes as PGSR's authors normalise them; in millimetres or for few wide views
/// they silently leave no pairs. Relative ones are multiples of the depth of what the view
/// sees.
enum class PairLimits { official, relative };

struct ViewPairOptions {
    PairLimits limits = PairLimits::official;
    int count = 8;
    float max_angle_deg = 30, lone_angle_deg = 0, min_distance = 0.01f, max_distance = 1.5f,
          min_baseline = 0.005f, max_baseline = 1;
    int samples = 102400;

    template <class Visitor>
    void fields(Visitor& field) {
        field.choice(
            "limits", limits, {"official", "relative"},
            "distances of paired views: official: min/max_distance, world units; relative: "
            "min/max_baseline, in median depths of the view");
        field("count", count, {1, 1e6}, "most others that a view is paired with");
        field("max_angle_deg", max_angle_deg, {0, 180}, "between the optical axes");
        field("lone_angle_deg", lone_angle_deg, {0, 180},
              "the same for views that have no other within max_angle_deg, if larger");
        field("min_distance", min_distance, {0, 1e9}, "between the cameras, world units");
        field("max_distance", max_distance, {0, 1e9}, "between the cameras, world units");
        field("min_baseline", min_baseline, {0, 1e9}, "between the cameras, in depths");
        field("max_baseline", max_baseline, {0, 1e9}, "between the cameras, in depths");
        field("samples", samples, {1, 1e8}, "most patches matched per iteration");
    }
};

struct ViewPairs {
    std::vector<std::vector<int>> of_view;  // training views, nearest first
    float min_depth =
        0.1f;  // nearer to the other camera than this nothing is compared, world units
};

/// Who is paired with every training view: within the limits, the nearest `count`; equal distances
/// by angle. Logs which views have none, and why, unless `quiet`.
ViewPairs select_view_pairs(const Scene& scene, const ViewPairOptions& options, bool quiet = false);

/// Where a camera looks, unit, in the world.
Vec3d optical_axis(const Camera& camera);

/// Share of the training views that have one; says nothing.
double share_with_pair(const Scene& scene, const ViewPairOptions& options);

}  // namespace tvsgs
