#include <opencv2/calib3d.hpp>

#include "io/camera_model.h"
#include "io/io_test.h"

namespace tvsgs {
namespace {

Intrinsics make(const char* model, std::vector<double> params) {
    return make_intrinsics("cameras", 3, *find_camera_model(model), 640, 480, params);
}

TEST(CameraModel, NativeModels) {
    const Intrinsics simple = make("SIMPLE_PINHOLE", {500, 320, 240});
    EXPECT_EQ(simple.fx_px, 500);
    EXPECT_EQ(simple.fy_px, 500);
    EXPECT_EQ(simple.cx_px, 320);
    EXPECT_EQ(simple.cy_px, 240);
    const Intrinsics pinhole = make("PINHOLE", {500, 510, 320, 240});
    EXPECT_EQ(pinhole.fx_px, 500);
    EXPECT_EQ(pinhole.fy_px, 510);
    EXPECT_EQ(pinhole.cx_px, 320);
    EXPECT_EQ(pinhole.cy_px, 240);
    EXPECT_EQ(make("OPENCV", {500, 510, 320, 240, 0, 0, 0, 0}).distortion.kind,
              Distortion::Kind::none);
    EXPECT_EQ(make("SIMPLE_RADIAL", {500, 320, 240, 0}).distortion.kind, Distortion::Kind::none);
    EXPECT_EQ(make("SIMPLE_RADIAL", {500, 320, 240, 1e-9}).distortion.kind,
              Distortion::Kind::radial);
}

TEST(CameraModel, RejectsWhatItCannotUse) {
    const char* rejected[] = {
        "FOV",  "THIN_PRISM_FISHEYE", "RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION", "DIVISION",
        "EUCM", "EQUIRECTANGULAR"};
    for (const char* name : rejected) {
        const auto params = static_cast<std::size_t>(find_camera_model(name)->params);
        expect_error(ExitCode::input, str("camera 3 uses ", name, "; tvsgs needs PINHOLE"),
                     [&] { make(name, std::vector<double>(params, 500)); });
    }
    EXPECT_EQ(find_camera_model(99), nullptr);
}

TEST(CameraModel, RejectsWrongNumbers) {
    const double nan = std::nan("");
    for (const double focal : {0.0, -1.0, nan, HUGE_VAL})
        expect_error(ExitCode::input, "E_CAMERA_FOCAL", [&] {
            make("PINHOLE", {500, focal, 320, 240});
        });
    expect_error(ExitCode::input, "E_CAMERA_PARAMS", [&] {
        make("PINHOLE", {500, 500, nan, 240});
    });
    expect_error(ExitCode::input, "E_CAMERA_PARAMS", [&] {
        make("SIMPLE_RADIAL", {500, 320, 240, nan});
    });
    const std::pair<std::uint64_t, std::uint64_t> sizes[] = {
        {0, 1}, {1, 0}, {65536, 1}, {65535, 65535}, {~0ull, ~0ull}};
    for (const auto& [w, h] : sizes)
        expect_error(ExitCode::input, "E_CAMERA_SIZE", [&, width = w, height = h] {
            make_intrinsics("cameras", 3, *find_camera_model("SIMPLE_PINHOLE"), width, height,
                            {500, 1, 1});
        });
}

/// The pixel that OpenCV finds for a ray; our corner-origin pixels are its centre-origin pixels
/// plus one half.
Vec2<double> opencv_pixel(const Intrinsics& in, Vec2<double> uv) {
    const cv::Matx33d K(in.fx_px, 0, in.cx_px, 0, in.fy_px, in.cy_px, 0, 0, 1);
    const Distortion& d = in.distortion;
    std::vector<cv::Point2d> out;
    if (d.kind == Distortion::Kind::fisheye) {
        cv::fisheye::projectPoints(std::vector<cv::Point3d>{{uv.x, uv.y, 1}}, out, cv::Vec3d(),
                                   cv::Vec3d(), K, cv::Vec4d(d.k[0], d.k[1], d.k[2], d.k[3]));
    } else {
        const std::vector<double> k = {d.k[0], d.k[1], d.p1, d.p2, d.k[2], d.k[3], d.k[4], d.k[5]};
        cv::projectPoints(std::vector<cv::Point3d>{{uv.x, uv.y, 1}}, cv::Vec3d(), cv::Vec3d(), K, k,
                          out);
    }
    return {out[0].x, out[0].y};
}

TEST(CameraModel, DistortsAsOpenCvDoes) {
    const Intrinsics cameras[] = {
        make("SIMPLE_RADIAL", {500, 320, 240, -0.1}),
        make("RADIAL", {500, 320, 240, -0.1, 0.03}),
        make("OPENCV", {500, 510, 320, 240, -0.1, 0.03, 0.002, -0.003}),
        make("FULL_OPENCV",
             {500, 510, 320, 240, -0.1, 0.03, 0.002, -0.003, 0.01, 0.02, -0.01, 0.005}),
        make("OPENCV_FISHEYE", {300, 310, 320, 240, 0.01, -0.02, 0.003, 0.001}),
        make("SIMPLE_RADIAL_FISHEYE", {300, 320, 240, 0.05}),
        make("RADIAL_FISHEYE", {300, 320, 240, 0.05, 0.01}),
        make("SIMPLE_FISHEYE", {300, 320, 240}),
        make("FISHEYE", {300, 310, 320, 240}),
    };
    for (const Intrinsics& in : cameras)
        for (const Vec2<double> uv : {Vec2<double>{0, 0}, {0.3, -0.2}, {-0.6, 0.4}, {0.05, 0.5}}) {
            const Vec2<double> ours = distort(in.distortion, uv), theirs = opencv_pixel(in, uv);
            // The same formula in double: rounding only.
            EXPECT_NEAR(ours.x * in.fx_px + in.cx_px, theirs.x, 1e-9);
            EXPECT_NEAR(ours.y * in.fy_px + in.cy_px, theirs.y, 1e-9);
        }
}

TEST(CameraModel, UndistortionOfNothingIsTheIdentity) {
    Intrinsics in = make("PINHOLE", {500, 500, 320, 240});
    ImageU8 image(640, 480, 3), valid;
    for (std::size_t i = 0; i < image.pixels.size(); ++i)
        image.pixels[i] = static_cast<std::uint8_t>(i * 31);
    EXPECT_EQ(undistorted(in, image, valid).pixels, image.pixels);
    EXPECT_EQ(std::count(valid.pixels.begin(), valid.pixels.end(), 255), 640 * 480);
}

TEST(CameraModel, UndistortionMovesAStripeToWhereThePinholeSeesIt) {
    // Brightness equals the distorted radius in pixels from the centre; undone, it must equal the
    // distorted radius of the pinhole's pixel.
    const Intrinsics in = make("SIMPLE_RADIAL", {500, 320, 240, -0.2});
    ImageU8 image(640, 480, 1), valid;
    for (int y = 0; y < 480; ++y)
        for (int x = 0; x < 640; ++x)
            image.at(x, y) =
                static_cast<std::uint8_t>(std::hypot(x + 0.5 - 320, y + 0.5 - 240) / 2);
    const ImageU8 out = undistorted(in, image, valid);
    for (const auto& [x, y] : {std::pair{500, 240}, {320, 400}, {120, 60}, {600, 440}}) {
        const double r = std::hypot(x + 0.5 - 320, y + 0.5 - 240) / 500;
        EXPECT_NEAR(out.at(x, y), 250 * r * (1 - 0.2 * r * r),
                    1);  // truncated to bytes, then interpolated
    }
    // Barrel distortion shows the corners of the pinhole's image; pincushion distortion does not.
    EXPECT_EQ(valid.at(0, 0), 255);
    ImageU8 beyond;
    undistorted(make("SIMPLE_RADIAL", {500, 320, 240, 0.2}), image, beyond);
    EXPECT_EQ(beyond.at(0, 0), 0);
    EXPECT_EQ(beyond.at(320, 240), 255);
}

}  // namespace
}  // namespace tvsgs
