// Measures a scene before the first step: the figures that the decisions use.  docs/guide/plan.md
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "optim/photo/sky.h"
#include "optim/views/matchable.h"
#include "optim/views/view_pairs.h"

namespace tvsgs {

/// Angles between the optical axes of two views. Up to kWideAngleDeg, comparison is known to help
/// as much as at small angles. Up to kWidestAngleDeg, views without a nearer view are compared.
inline constexpr float kWideAngleDeg = 37, kWidestAngleDeg = 60;

/// Trust in a comparison of two views at this angle: 1 up to 45 degrees, 0 from kWidestAngleDeg on.
double comparable(double pair_angle_deg);

struct SceneLook {
    int train_views = 0, test_views = 0;
    double megapixels = 0;        // of all training views
    std::size_t points = 0;       // of the initial cloud
    double pixels = 0;            // number of a view's pixels that stereo could match, median
    double matchable = 1;         // share of these pixels in the view, median
    double points_per_pixel = 0;  // initial points on these pixels / their number, median
    double reduction = 1;         // width of the photograph's file / of the view, median
    /// Colour of the images' borders, 0 to 255; share of a border with it, smallest over the views,
    /// 0 if the views' borders differ; share of the points' projections that fall on it.
    int background[3] = {0, 0, 0};
    double background_border = 0, background_points = 0;
    bool outside = false;              // a mask leaves out a part of its photograph
    double views_in_pairs = 0;         // share with a pair within loss.multi_view's relative limits
    double views_in_wide_pairs = 0;    // the share if views without a pair may use kWideAngleDeg
    double views_in_widest_pairs = 0;  // the share if they may use kWidestAngleDeg
    double pair_angle_deg = 0;         // of these pairs: from a view to its nearest partner; median
    double pose_error = NAN;           // View::pose_error_px, median of the views that have one
    /// |ratio - 1| of the brightness of a view and its nearest view, median over their common
    /// points, largest over the views. NaN: no two views share enough points.
    double exposure_drift = 0;
};

/// `masks`: only pixels inside of masks count. `sky`: its pixels cannot be matched.
SceneLook look_at(const Scene& scene,
                  const ViewPairOptions& limits,
                  bool masks = false,
                  const SkyDetection& sky = {});

struct MaskLook {
    int views = 0, masked = 0;  // training views; training views with a mask
    int outside = 0;            // views whose mask leaves out pixels that the lens saw
    int empties = 0;            // views whose mask has no pixel of the object
    std::string empty;          // the first of them
    double border = 0;          // share of an image's border outside the mask, median
    double matched = 0;         // share of the points' projections that are outside the masks
};
MaskLook look_at_masks(const std::vector<View>& train, const std::vector<Vec3f>& points);

struct StartLook {
    std::size_t points = 0;
    /// Share of the cells (inside masks) that show a point; 64 along a photograph's longer side.
    double covered = 0;
    double behind = 0;  // share of points and cameras with the point behind the camera
};
StartLook look_at_start(const std::vector<View>& train,
                        const std::vector<Vec3f>& points,
                        bool masks);

/// Of the points in two or more images, the share that lies at or beyond the depth limit of a
/// bounded mesh in all these images. NaN: no such points, or the cameras look at no common point.
double share_beyond(const std::vector<Camera>& cameras, const std::vector<Vec3f>& points);

/// The ball that the cameras see, and how far they stand on one side of it; see mesh/fuse/focus.h.
struct CommonBall {
    double radius = 0, one_sidedness = 1;  // radius 0: the cameras look at no common point
    double points = 0;                     // share of the initial points in the ball
};
CommonBall common_ball(const std::vector<Camera>& cameras, const std::vector<Vec3f>& points);

/// "0.67 start points per textured pixel: they cover the scene", against kSparseCloud and
/// kCoveringCloud.
std::string coverage_text(double points_per_pixel);

}  // namespace tvsgs
