// Camera models of COLMAP: parameters, limits and the removal of lens distortion.
// [docs/method/input.md#lens-distortion]
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/math/vec.h"
#include "core/scene/image.h"

namespace tvsgs {

/// Lens distortion of all supported models: maps a ray (u, v, 1) to its image on the plane z = 1.
/// radial:  factor (1 + k0 r^2 + k1 r^4 + k2 r^6) / (1 + k3 r^2 + k4 r^4 + k5 r^6)
/// fisheye: factor 1 + k0 a^2 + k1 a^4 + k2 a^6 + k3 a^8 on the angle a
/// fov:     k0 is the angle omega
struct Distortion {
    enum class Kind { none, radial, fisheye, fov };
    Kind kind = Kind::none;
    double k[6]{};
    double p1 = 0, p2 = 0;  // tangential, also for fisheyes
    double s1 = 0, s2 = 0;  // thin prism, only for fisheyes
};

/// One of COLMAP's camera models.
struct CameraModel {
    int id;
    const char* name;
    int params;
    int focals = 0;  // 1: both focal lengths are equal; 0: make_intrinsics() does not support it
    Distortion::Kind kind = Distortion::Kind::none;
    bool tangential = false;  // p1 and p2 follow the first two coefficients

    bool usable() const { return focals > 0; }
};

/// nullptr if COLMAP has no such model.
const CameraModel* find_camera_model(int id);
const CameraModel* find_camera_model(std::string_view name);

/// Place on the plane z = 1 at which the ray (uv, 1) appears.
Vec2<double> distort(const Distortion& distortion, Vec2<double> uv);

/// Inverse of distort() by Newton's method. `place` must lie where distort() is one-to-one.
Vec2<double> undistort(const Distortion& distortion, Vec2<double> place);

/// A camera without its pose. The principal point counts from the corner of the first pixel.
struct Intrinsics {
    int width_px = 0, height_px = 0;
    double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
    Distortion distortion;
    const char* model = "PINHOLE";  // name of the model in COLMAP
};

/// Checks the camera and its parameters. Throws Error(ExitCode::input): E_CAMERA_MODEL,
/// E_CAMERA_SIZE, E_CAMERA_FOCAL, E_CAMERA_PARAMS. Messages contain `path`.
Intrinsics make_intrinsics(const std::string& path,
                           std::uint32_t camera_id,
                           const CameraModel& model,
                           std::uint64_t width,
                           std::uint64_t height,
                           const std::vector<double>& params);

/// Throws E_CAMERA_MODEL for a model, or a model number, that is not supported.
[[noreturn]] void throw_camera_model(const std::string& path,
                                     std::uint32_t camera_id,
                                     const std::string& model);

/// The camera of the same view at another image size.
Intrinsics scaled(Intrinsics intrinsics, int width_px, int height_px);

/// Place in the photograph of a pinhole's pixel. Returns false outside the photograph, and where
/// the model's polynomials fold the image so that two pixels would show the same place.
bool find_in_photo(const Intrinsics& in, double x, double y, Vec2<double>& place);

/// Pixels lost by undistorted(), as shares.
struct UndistortionLoss {
    double cropped = 0;  // of the photograph: outside the pinhole's image
    double empty = 0;    // of the pinhole's image: outside the photograph
};
/// Measured with steps x steps samples; the error of a boundary is at most half a step.
UndistortionLoss undistortion_loss(const Intrinsics& in, int steps = 128);

/// The image that a pinhole camera with the same focal lengths, centre and size would have taken,
/// by bilinear interpolation. `valid` [H, W, 1] is 255 inside the photograph and 0 outside.
/// Fisheyes keep a field of view of 120 degrees.
ImageU8 undistorted(const Intrinsics& intrinsics, const ImageU8& image, ImageU8& valid);

}  // namespace tvsgs
