// A complete COLMAP model in memory: reads, transforms and writes its binary files.
// [docs/guide/input.md#scene-folder]
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/math/rigid.h"
#include "io/scene/camera_model.h"

namespace tvsgs::prepare {

inline constexpr std::uint64_t kNoPoint = ~std::uint64_t{0};

struct SparseCamera {
    std::uint32_t id = 0;
    std::int32_t model = 0;
    std::uint64_t width = 0, height = 0;
    std::vector<double> params;
};

struct SparseObservation {
    Vec2<double> place;  // pixels
    std::uint64_t point = kNoPoint;
};

struct SparseImage {
    std::uint32_t id = 0, camera_id = 0;
    Quat<double> quat;  // camera_from_world
    Vec3d translation;
    std::string name;
    std::vector<SparseObservation> observations;

    Rigid3d camera_from_world() const { return {rotation(normalize(quat)), translation}; }
};

struct SparsePoint {
    std::uint64_t id = 0;
    Vec3d position;
    std::array<std::uint8_t, 3> color{};
    double error = 0;                                            // pixels
    std::vector<std::pair<std::uint32_t, std::uint32_t>> track;  // image, its observation
};

struct SparseModel {
    std::vector<SparseCamera> cameras;
    std::vector<SparseImage> images;  // sorted by name
    std::vector<SparsePoint> points;

    /// Throws if there is none.
    const SparseCamera& camera(std::uint32_t id) const;
};

/// World frames: p_new = scale R p_old + t.
struct Similarity {
    double scale = 1;
    Mat3<double> R{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    Vec3d t{};

    Vec3d operator*(Vec3d p) const { return scale * (R * p) + t; }
};

/// Reads cameras.bin, images.bin and points3D.bin of a folder. Throws Error(ExitCode::input) if one
/// is missing or truncated.
SparseModel read_sparse_model(const std::string& folder);

/// Number of images, without reading the rest; 0 if there is no model.
std::uint64_t count_images(const std::string& folder);

/// Throws Error(ExitCode::io).
void write_sparse_model(const std::string& folder, const SparseModel& model);

/// Transforms cameras and points to another world frame.
void move(SparseModel& model, const Similarity& to_new);

/// Changes SIMPLE_RADIAL or SIMPLE_RADIAL_FISHEYE to a model of the same family with more
/// coefficients, which start at 0, so images do not change. False for any other change.
bool take_lens(SparseCamera& camera, const std::string& lens);

/// Checks the parameters like the readers of scenes.
Intrinsics intrinsics_of(const SparseCamera& camera);

/// Ray of a pixel through a camera with lens distortion.
struct Ray {
    Vec3d origin, direction;  // world, unit length
};

Ray ray_of(const Intrinsics& camera, const Rigid3d& camera_from_world, Vec2<double> pixel);

/// Pixel at which the camera shows a point; empty: behind the camera.
std::optional<Vec2<double>> pixel_of(const Intrinsics& camera,
                                     const Rigid3d& camera_from_world,
                                     Vec3d point);

/// The point with the least sum of squared distances to the rays; empty if all directions differ by
/// less than 2 degrees.
std::optional<Vec3d> meeting_point(const std::vector<Ray>& rays);

}  // namespace tvsgs::prepare
