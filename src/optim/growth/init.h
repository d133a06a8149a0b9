// Makes the first Gaussians from a point cloud.
#pragma once

#include <string>

#include "core/options.h"
#include "core/scene/gaussians.h"
#include "core/scene/scene.h"

namespace tvsgs {

struct InitOptions {
    float opacity = 0.1f;
    int min_points = 2000;
    bool use_normals = true, random_rotations = false, support = false;
    float max_extent = 0.05f;
    int gap_px = 0;
    // For a cloud from a file:
    float thin = 0;
    int max_points = 1500000, votes = 0;
    float min_in_frame = 0.1f;
    std::string fixed_splats;
    bool force = false;

    template <class Visitor>
    void fields(Visitor& field) {
        field("opacity", opacity, {0.001, 0.999}, "opacity of all Gaussians at the start");
        field("min_points", min_points, {0, 1e9},
              "fewer start points than this: tvsgs-train first makes a cloud by stereo; 0: never");
        field("use_normals", use_normals,
              "lay Gaussians flat along the normals of the cloud, if it has any");
        field("random_rotations", random_rotations,
              "give Gaussians without a normal random rotations; false: none");
        field("support", support,
              "use the distance to the nearest points of a stereo cloud as the uncertainty of a "
              "Gaussian's position, for loss.photometric.geometry and lr.supported_*");
        field("gap_px", gap_px, {0, 100},
              "pixels between the points that fill the gaps of a stereo cloud; 0: none");
        field(
            "votes", votes, {0, 100},
            "rounds in which votes move the points of a stereo cloud along their normals; 0: none");
        field("max_extent", max_extent, {0, 1e9},
              "largest standard deviation at the start, in longer sides of a photograph; 0: no "
              "limit");
        field("thin", thin, {0, 1e9},
              "keep one point of scene.init_ply per cube of this edge, world units; 0: all");
        field("max_points", max_points, {0, 1e9},
              "most points of scene.init_ply or stereo, thinned to it; 0: all");
        field("min_in_frame", min_in_frame, {0, 1},
              "least share of scene.init_ply that two training views see; 0: no check");
        field("fixed_splats", fixed_splats,
              "file of fixed splats in the frame of the scene, drawn but not saved; empty: none");
        field("force", force,
              "train from fewer than 100 start points, or on less than 1 % of the photographs");
    }
};

/// Makes one isotropic Gaussian per point. Its standard deviation is the root mean square distance
/// to the three nearest other points, at least 1e-3.5 guard units, and at most `max_extent` of a
/// photograph: else a point near a camera would cover the view. With normals (and use_normals) the
/// third axis is the normal and a tenth as long. With `support`, points with a confidence above 0
/// get that distance as their uncertainty, the others 0. Drops points within 1e-2 guard units of a
/// training camera, where projections are ill-defined. Throws Error(ExitCode::input) when no point
/// remains.
Gaussians<Cpu> init_gaussians(const Scene& scene, const InitOptions& options, int sh_degree);

/// Median depth of the initial points in front of the training cameras; 0 if there are none.
float median_depth(const Scene& scene);

/// Factor from guard units to world units; limits in guard units suit scenes some units deep. The
/// median depth of a scene less than one unit deep (for instance one in kilometres), else 1.
float guard_unit(const Scene& scene);

/// Mean squared distance to the `k` (at most 30) nearest other points. Exact; duplicates have
/// distance 0. A point that is not finite gets 0 and is no point's neighbour.
std::vector<float> mean_squared_neighbour_distance(const std::vector<Vec3f>& points, int k);

}  // namespace tvsgs
