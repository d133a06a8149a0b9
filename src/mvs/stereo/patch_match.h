// Multi-view stereo without a network: PatchMatch estimates depth, normal and confidence of every
// view, and fusion merges them to a coloured cloud.  [Zheng14, ACMM] Rough start points for views
// that overlap too little for patches to match.
#pragma once

#include <cstdint>
#include <vector>

#include "core/options.h"
#include "core/scene/scene.h"

namespace tvsgs {

struct StereoOptions {
    int min_consistent = 0;
    float depth_near = 0, depth_far = 0;
    bool use_masks = false;
    std::int64_t seed = 0;

    template <class Visitor>
    void fields(Visitor& field) {
        field("depth_near", depth_near, {0, 1e9}, "nearest depth, world units; 0: from the scene");
        field("depth_far", depth_far, {0, 1e9}, "farthest depth, world units; 0: from the scene");
        field("min_consistent", min_consistent, {0, 8},
              "other views that must confirm a depth; 0: 1 if at most 4 can see it, else 2");
        field("use_masks", use_masks, "match only pixels inside the masks");
    }
};

/// Result of one view, row by row.
struct StereoMaps {
    Camera camera;                  // of the maps: halved if the photograph is wider than 1600
    std::vector<float> depth;       // z, world units; 0 = none
    std::vector<Vec3f> normals;     // camera frame, towards the camera; 0 = none
    std::vector<float> confidence;  // [0, 1]; 0 = none
};

/// Result of reconstruct_stereo().
struct StereoResult {
    std::vector<StereoMaps> maps;  // one per view
    PointCloud cloud;              // with colours, normals (world frame) and confidences
};

/// Computes depth maps of all views and their fused cloud. `points`: sparse points of the scene,
/// for the depth range and the choice of view pairs; may be empty. Bit-identical from run to run
/// and for any number of threads. Throws Error(ExitCode::input) for fewer than two views, if no
/// pair of views overlaps, and if the depth range is unknown.
template <class Device>
StereoResult reconstruct_stereo(Device,
                                const std::vector<View>& views,
                                const std::vector<Vec3f>& points,
                                const StereoOptions& options);

/// Sweeps the range of depths along a coarse grid of rays of each view, where at least half of the
/// views see it that see any point of the ray. A ray gives at most one point: with
/// `options.use_masks` and masks the first inside of all masks (the visual hull), else the one
/// whose mean colour agrees best with other views, if at least three of four others on the ray
/// differ by half of the mean or more. `points`: for the range of depths; may be empty. Throws
/// Error(ExitCode::input) if the range is unknown.
PointCloud coarse_cloud(const std::vector<View>& views,
                        const std::vector<Vec3f>& points,
                        const StereoOptions& options);

}  // namespace tvsgs
