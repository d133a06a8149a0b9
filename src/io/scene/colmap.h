// COLMAP sparse models, binary or text, with every field checked.  [docs/guide/input.md#checks]
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "core/math/rigid.h"
#include "io/scene/camera_model.h"

namespace tvsgs {

struct ColmapImage {
    std::uint32_t id = 0, camera_id = 0;
    Rigid3d camera_from_world;
    std::string name;                         // relative path
    std::vector<Vec2<float>> observations{};  // px, of points and of none
};

struct ColmapModel {
    std::map<std::uint32_t, Intrinsics> cameras;
    std::vector<ColmapImage> images;  // sorted by name, as byte strings
};

struct ColmapPoints {
    std::vector<Vec3d> positions;
    std::vector<Vec3f> colors;                     // [0, 1]
    std::vector<std::size_t> track_begin;          // [N + 1] into track
    std::vector<std::uint32_t> track;              // ids of the images that see the point
    std::vector<std::uint32_t> track_observation;  // [as track] which observation of these
};

/// What a model needs and the folder lacks, of "cameras.{bin,txt}" and "images.{bin,txt}".
std::vector<std::string> missing_colmap_files(const std::string& folder);

/// Of each file the binary form is preferred; a broken one is an error, never a reason to read the
/// text. Throws Error(ExitCode::input) with an E_ word for the case, the file and the byte or line.
ColmapModel read_colmap_model(const std::string& folder);

/// No file, or an empty one: no points.
ColmapPoints read_colmap_points(const std::string& folder);

}  // namespace tvsgs
