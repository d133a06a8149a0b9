// Reading of COLMAP sparse models, binary or text, with checks of every field.
// [docs/guide/input.md#checks]
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/math/rigid.h"
#include "io/scene/camera_model.h"

namespace tvsgs {

/// One registered image.
struct ColmapImage {
    std::uint32_t id = 0, camera_id = 0;
    Rigid3d camera_from_world;
    std::string name;                         // relative path
    std::vector<Vec2<float>> observations{};  // px; with and without a point
};

/// Cameras and images of a model.
struct ColmapModel {
    std::map<std::uint32_t, Intrinsics> cameras;
    std::vector<ColmapImage> images;  // sorted by name, as byte strings
};

/// Points of a model with their tracks.
struct ColmapPoints {
    std::vector<Vec3d> positions;
    std::vector<Vec3f> colors;                     // [0, 1]
    std::vector<std::size_t> track_begin{0};       // [N + 1] into track
    std::vector<std::uint32_t> track;              // ids of the images that observe the point
    std::vector<std::uint32_t> track_observation;  // [as track] index into `observations`
};

/// Throws E_DUPLICATE_ID that names `source` if two images have the same name.
void sort_by_name(std::vector<ColmapImage>& images, const std::string& source);

/// The files that a model needs and the folder lacks, of "cameras.{bin,txt}" and
/// "images.{bin,txt}".
std::vector<std::string> missing_colmap_files(const std::string& folder);

/// Reads the binary form of each file if it exists, else the text. A damaged binary file is an
/// error even if the text exists. Throws Error(ExitCode::input) with an E_ code, the file, and the
/// byte or line.
ColmapModel read_colmap_model(const std::string& folder);

/// Reads the points. A missing or empty file gives no points.
ColmapPoints read_colmap_points(const std::string& folder);

}  // namespace tvsgs
