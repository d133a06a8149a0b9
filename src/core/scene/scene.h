// Scene, views and point clouds: output of the readers, input of the training.
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/gaussians.h"
#include "core/scene/image.h"

namespace tvsgs {

/// A map of a view beside its photograph: prior depth, normals or features. It may differ in size
/// from the photograph.
struct ViewMap {
    std::string name;  // name by which losses find it; "mask" is View::mask
    int width_px = 0, height_px = 0, channels = 1;
    std::vector<float> values{};  // [height width channels]
};

/// Values of View::mask. kObjectMask and above: the object. kNoPhoto and below: no photograph, at
/// the edge of views whose lens distortion was removed.
inline constexpr std::uint8_t kObjectMask = 128, kNoPhoto = 1;

/// One photograph with its camera. The photo and the mask have the camera's size.
struct View {
    std::string name;  // relative path as listed in the model
    Camera camera;
    ImageU8 photo;  // [H, W, 3]
    ImageU8 mask;   // [H, W, 1], kObjectMask or more on the object, 0 elsewhere; empty: none
    ImageU8 grey;   // [H', W', 1] finer than the photo, to match patches; empty: none
    std::vector<ViewMap> maps{};  // with different names
    /// RMS shift in pixels of the view's points if this view alone moved to its best pose; NaN:
    /// unknown.
    double pose_error_px = std::numeric_limits<double>::quiet_NaN();
    double reduction = 1;   // width of the photograph's file / width of `photo`
    int upright_turns = 0;  // clockwise quarter turns of `photo` that show it upright (EXIF)
};

/// The views' cameras, as if each photograph were turned upright.
inline std::vector<Camera> upright_cameras(const std::vector<View>& views) {
    std::vector<Camera> cameras;
    for (const View& view : views)
        cameras.push_back(turned_camera(view.camera, view.upright_turns));
    return cameras;
}

/// Points with optional attributes: an array is empty or has an entry per point.
struct PointCloud {
    std::vector<Vec3f> positions;      // world units
    std::vector<Vec3f> colors;         // [0, 1]; empty: grey
    std::vector<Vec3f> normals;        // unit; empty: none
    std::vector<float> confidences{};  // stereo: [0, 1]; empty: none
};

/// Origin to subtract from a scene far from zero, so that float keeps its precision.
/// Zero unless the places (for example camera centres) lie more than 100 of their radii from zero;
/// up to there float loses fewer than 7 of its 24 bits. Otherwise the mean of the places, rounded
/// to few digits. A single place has radius 1.
inline Vec3d local_origin(const std::vector<Vec3d>& places) {
    Vec3d mean;
    for (const Vec3d p : places) mean += p / static_cast<double>(places.size());
    double radius = 0;
    for (const Vec3d p : places) radius = std::max(radius, norm(p - mean));
    if (radius == 0) radius = 1;
    if (!(norm(mean) > 100 * radius)) return {};
    const double unit = std::exp2(std::floor(std::log2(radius)));
    for (int axis = 0; axis < 3; ++axis) mean[axis] = unit * std::nearbyint(mean[axis] / unit);
    return mean;
}

/// All views, points and fixed splats of one scene.
struct Scene {
    std::string path;
    /// Origin of the scene's frame in the frame of the files: local_origin(). Readers subtract it
    /// and writers add it, in double.
    Vec3d origin{};
    std::vector<View> train, test;  // each sorted by name
    PointCloud points;              // initial cloud
    PointCloud fixed_voters;        // measured points of tv.fixed_voters; confidences are weights
    std::shared_ptr<const Gaussians<Cpu>> fixed_splats;  // rendered, never trained; null: none
    float extent = 0;  // 1.1 x the largest distance of a training camera from the cameras' mean
};

}  // namespace tvsgs
