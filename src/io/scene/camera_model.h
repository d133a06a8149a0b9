// COLMAP's camera models: which exist, what is read from them, and how lens distortion is removed.
// [docs/method/input.md#lens-distortion]
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/math/vec.h"
#include "core/scene/image.h"

namespace tvsgs {

struct CameraModel {
    int id;
    const char* name;
    int params;
    bool usable = true;  // by make_intrinsics()
};

/// nullptr when COLMAP has no such model.
const CameraModel* find_camera_model(int id);
const CameraModel* find_camera_model(std::string_view name);

/// Where a ray (u, v, 1) really lands on the plane z = 1; the coefficients of all models that we
/// undo.
struct Distortion {
    enum class Kind { none, radial, fisheye, fov };
    Kind kind = Kind::none;
    double k[6]{};  // radial: (1 + k0 r^2 + k1 r^4 + k2 r^6) / (1 + k3 r^2 + ...); fisheye: k0 ...
                    // k3 of angle^2 ... angle^8; fov: k0 is the angle omega
    double p1 = 0, p2 = 0;  // tangential; of fisheyes as well
    double s1 = 0, s2 = 0;  // thin prism, of fisheyes
};
Vec2<double> distort(const Distortion& distortion, Vec2<double> uv);

/// The ray that lands there: the inverse, by Newton's method, for places that distort() reaches
/// without folding.
Vec2<double> undistort(const Distortion& distortion, Vec2<double> place);

/// A camera without its pose; the principal point counts from the corner of the first pixel.
struct Intrinsics {
    int width_px = 0, height_px = 0;
    double fx_px = 0, fy_px = 0, cx_px = 0, cy_px = 0;
    Distortion distortion;
    const char* model = "PINHOLE";  // as COLMAP names it
};

/// Checks the camera and reads the model's parameters. Throws Error(ExitCode::input):
/// E_CAMERA_MODEL, E_CAMERA_SIZE, E_CAMERA_FOCAL. `path` is for messages.
Intrinsics make_intrinsics(const std::string& path,
                           std::uint32_t camera_id,
                           const CameraModel& model,
                           std::uint64_t width,
                           std::uint64_t height,
                           const std::vector<double>& params);

/// Throws E_CAMERA_MODEL: the model, or its number, is not one that we can use.
[[noreturn]] void throw_camera_model(const std::string& path,
                                     std::uint32_t camera_id,
                                     const std::string& model);

/// The camera of the same view at another image size.
Intrinsics scaled(Intrinsics intrinsics, int width_px, int height_px);

/// Where a pinhole's pixel lies in the photograph; false where it shows nothing: outside, or where
/// the model's polynomials fold the picture over, so that another pixel is seen in the same place.
bool find_in_photo(const Intrinsics& in, double x, double y, Vec2<double>& place);

/// What undistorted() costs, in shares of the pixels.
struct UndistortionLoss {
    double cropped = 0;  // of the photograph: beyond the rim of the pinhole's image
    double empty = 0;    // of the pinhole's image: beyond the rim of the photograph
};
/// By steps x steps samples: a rim is off by half a step at most.
UndistortionLoss undistortion_loss(const Intrinsics& in, int steps = 128);

/// The image that the pinhole camera of the same focal lengths, centre and size would have taken,
/// sampled bilinearly. `valid` [H, W, 1] becomes 0 where the image does not reach, and 255
/// elsewhere. Fisheyes keep 120 degrees.
ImageU8 undistorted(const Intrinsics& intrinsics, const ImageU8& image, ImageU8& valid);

}  // namespace tvsgs
