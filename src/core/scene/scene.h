// What the readers deliver and the trainer consumes.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/gaussians.h"
#include "core/scene/image.h"

namespace tvsgs {

/// What is known of a view beside its photograph, per pixel: a prior depth, normals, features. Its
/// size need not be the photograph's.
struct ViewMap {
    std::string name;  // what terms ask for; "mask" is View::mask
    int width_px = 0, height_px = 0, channels = 1;
    std::vector<float> values{};  // [height width channels]
};

/// Of View::mask: the object from here on; below it, of views whose lens was undone, where there is
/// no photograph.
inline constexpr std::uint8_t kObjectMask = 128, kNoPhoto = 1;

/// One photograph with its camera; photo and mask have its size.
struct View {
    std::string name;  // relative path as listed in the model
    Camera camera;
    ImageU8 photo;  // [H, W, 3]
    ImageU8 mask;   // [H, W, 1], from kObjectMask on the object, 0 not; empty: none
    ImageU8 grey;   // [H', W', 1] finer than the photo, for matching patches; empty: none
    std::vector<ViewMap> maps{};  // of different names
    /// What its points' images would move by if the view alone moved to where they fit best; NaN:
    /// not known.
    double pose_error_px = std::numeric_limits<double>::quiet_NaN();
    double reduction = 1;  // width of the photograph's file over that of the photo
};

struct PointCloud {
    std::vector<Vec3f> positions;      // world units
    std::vector<Vec3f> colors;         // [0, 1]; empty: grey
    std::vector<Vec3f> normals;        // unit; empty: none
    std::vector<float> confidences{};  // stereo: [0, 1]; empty: none
};

struct Scene {
    std::string path;
    /// Of the frame of all that follows, in that of the files; float has no digits for places far
    /// from zero (UTM). Readers take it off and writers add it again, in double. See
    /// core/scene/local_origin.h.
    Vec3d origin{};
    std::vector<View> train, test;  // each sorted by name
    PointCloud points;              // initial cloud
    PointCloud fixed_voters;        // measured points of tv.fixed_voters; confidences are weights
    std::shared_ptr<const Gaussians<Cpu>> fixed_splats;  // drawn, never trained; null: none
    float extent = 0;  // 1.1 x the largest distance of a training camera from their mean
};

}  // namespace tvsgs
