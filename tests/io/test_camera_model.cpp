#include "io/io_test.h"
#include "io/scene/camera_model.h"

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
    const char* rejected[] = {"RAD_TAN_THIN_PRISM_FISHEYE", "SIMPLE_DIVISION", "DIVISION", "EUCM",
                              "EQUIRECTANGULAR"};
    for (const char* name : rejected) {
        const auto params = static_cast<std::size_t>(find_camera_model(name)->params);
        expect_error(ExitCode::input, str("camera 3 uses ", name, "; expected PINHOLE"),
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
    for (const double focal : {1e-6, 6.3})  // the picture is 640 pixels wide
        expect_error(ExitCode::input, "see 179 degrees or more", [&] {
            make("PINHOLE", {500, focal, 320, 240});
        });
    EXPECT_EQ(make("PINHOLE", {500, 6.5, 320, 240}).fy_px, 6.5);
    for (const auto& [x, y] : {std::pair(100000.0, 240.0), {-5001.0, 240.0}, {320.0, 5481.0}})
        expect_error(ExitCode::input, "turns the whole picture", [&, x = x, y = y] {
            make("PINHOLE", {500, 500, x, y});
        });
    EXPECT_EQ(make("PINHOLE", {500, 500, -4999, 5479}).cx_px, -4999);
    const std::pair<std::uint64_t, std::uint64_t> sizes[] = {
        {0, 1}, {1, 0}, {65536, 1}, {65535, 65535}, {~0ull, ~0ull}};
    for (const auto& [w, h] : sizes)
        expect_error(ExitCode::input, "E_CAMERA_SIZE", [&, width = w, height = h] {
            make_intrinsics("cameras", 3, *find_camera_model("SIMPLE_PINHOLE"), width, height,
                            {500, 1, 1});
        });
}

TEST(CameraModel, DistortsAsOpenCvDoes) {
    // Pixels of the rays (-0.6, 0.4, 1) and (0.05, 0.5, 1) from projectPoints() and
    // fisheye::projectPoints() of OpenCV 4.6.
    const struct {
        const char* model;
        std::vector<double> params;
        Vec2<double> first, second;
    } cases[] = {
        {"SIMPLE_RADIAL", {500, 320, 240, -0.1}, {35.6, 429.6}, {344.36875, 483.6875}},
        {"RADIAL",
         {500, 320, 240, -0.1, 0.03},
         {33.1664, 431.2224},
         {344.4165671875, 484.165671875}},
        {"OPENCV",
         {500, 510, 320, 240, -0.1, 0.03, 0.002, -0.003},
         {30.8264, 436.638048},
         {344.0803171875, 489.7400353125}},
        {"FULL_OPENCV",
         {500, 510, 320, 240, -0.1, 0.03, 0.002, -0.003, 0.01, 0.02, -0.01, 0.005},
         {32.79715046774, 435.2979376819},
         {343.9751125563, 488.6669480744}},
        {"OPENCV_FISHEYE",
         {300, 310, 320, 240, 0.01, -0.02, 0.003, 0.001},
         {163.8870426312, 347.544481743},
         {333.9174173203, 383.8133123096}},
        {"SIMPLE_RADIAL_FISHEYE",
         {300, 320, 240, 0.05},
         {161.0085471677, 345.9943018882},
         {334.0505822924, 380.5058229242}},
        {"RADIAL_FISHEYE",
         {300, 320, 240, 0.05, 0.01},
         {160.7709640352, 346.1526906432},
         {334.0571168317, 380.5711683165}},
        {"THIN_PRISM_FISHEYE",  // maps the angle to a radius, then projectPoints()
         {300, 310, 320, 240, 0.01, -0.02, 0.002, -0.003, 0.003, 0, 0.004, -0.005},
         {163.30518606, 347.6629866863},
         {334.0043297584, 383.8376180326}},
        {"THIN_PRISM_FISHEYE",
         {300, 310, 320, 240, 0.01, -0.02, 0, 0, 0.003, 0.001, 0, 0},
         {163.8870426312, 347.544481743},
         {333.9174173203, 383.8133123096}},
        {"SIMPLE_FISHEYE",
         {300, 320, 240},
         {164.0520078816, 343.9653280789},
         {333.8998927156, 378.9989271556}},
        {"FISHEYE",
         {300, 310, 320, 240},
         {164.0520078816, 347.4308390149},
         {333.8998927156, 383.6322247275}},
    };
    for (const auto& c : cases) {
        const Intrinsics in = make(c.model, c.params);
        const std::pair<Vec2<double>, Vec2<double>> rays[] = {{{-0.6, 0.4}, c.first},
                                                              {{0.05, 0.5}, c.second}};
        for (const auto& [uv, theirs] : rays) {
            const Vec2<double> ours = distort(in.distortion, uv);
            const Vec2<double> back = undistort(in.distortion, ours);
            EXPECT_NEAR(back.x, uv.x, 1e-12) << c.model;
            EXPECT_NEAR(back.y, uv.y, 1e-12) << c.model;
            // The same formula in double, printed with 13 digits.
            EXPECT_NEAR(ours.x * in.fx_px + in.cx_px, theirs.x, 1e-9) << c.model;
            EXPECT_NEAR(ours.y * in.fy_px + in.cy_px, theirs.y, 1e-9) << c.model;
        }
    }
}

TEST(CameraModel, FovIsTheInverseOfItsPaper) {
    // Bisection for the radius at which tan(r omega) / (2 tan(omega / 2)) equals that of the ray.
    const struct {
        double omega;
        Vec2<double> first, second;
    } cases[] = {{0.9, {151.2355544949, 356.259951348}, {334.9902883973, 394.8996467724}},
                 {1.4, {162.730759404, 348.3410324106}, {334.9778487911, 394.7711041748}}};
    for (const auto& c : cases) {
        const Intrinsics in = make("FOV", {300, 310, 320, 240, c.omega});
        const std::pair<Vec2<double>, Vec2<double>> rays[] = {{{-0.6, 0.4}, c.first},
                                                              {{0.05, 0.5}, c.second}};
        for (const auto& [uv, theirs] : rays) {
            const Vec2<double> ours = distort(in.distortion, uv);
            EXPECT_NEAR(ours.x * in.fx_px + in.cx_px, theirs.x, 1e-9);
            EXPECT_NEAR(ours.y * in.fy_px + in.cy_px, theirs.y, 1e-9);
        }
        // The same at the centre, where the quotient is undefined.
        const Vec2<double> near = distort(in.distortion, {1e-9, 0}),
                           middle = distort(in.distortion, {1e-13, 0});
        EXPECT_NEAR(middle.x / 1e-13, near.x / 1e-9, 1e-6);
    }
    EXPECT_EQ(make("FOV", {300, 310, 320, 240, 0}).distortion.kind, Distortion::Kind::none);
    expect_error(ExitCode::input, "of the picture, expected", [] {
        make("FOV", {300, 310, 320, 240, 3.3});
    });
}

TEST(CameraModel, WhatUndistortionCosts) {
    EXPECT_EQ(undistortion_loss(make("PINHOLE", {500, 500, 320, 240})).cropped, 0);
    // The boundary of the pinhole's image as a curve in the photograph; its area by Green's
    // theorem.
    const double k = -0.2, f = 500;
    double area = 0;
    const auto rim = [&](double x, double y) {
        const double r2 = (x * x + y * y) / (f * f);
        return Vec2<double>{x * (1 + k * r2), y * (1 + k * r2)};
    };
    const Vec2<double> corners[] = {{-320, -240}, {320, -240}, {320, 240}, {-320, 240}};
    constexpr int kParts = 2000;
    for (int side = 0; side < 4; ++side)
        for (int i = 0; i < kParts; ++i) {
            const auto at = [&](int j) {
                const double t = double(j) / kParts;
                const Vec2<double> p = corners[side], q = corners[(side + 1) % 4];
                return rim(p.x + t * (q.x - p.x), p.y + t * (q.y - p.y));
            };
            const Vec2<double> a = at(i), b = at(i + 1);
            area += (a.x * b.y - a.y * b.x) / 2;
        }
    const UndistortionLoss barrel = undistortion_loss(make("SIMPLE_RADIAL", {f, 320, 240, k}));
    EXPECT_NEAR(barrel.cropped, 1 - area / (640 * 480), 1e-4);
    EXPECT_EQ(barrel.empty, 0);
    // In the other direction no pixel is lost, but the pinhole's corners are empty.
    const Intrinsics pincushion = make("SIMPLE_RADIAL", {f, 320, 240, 0.2});
    ImageU8 valid;
    undistorted(pincushion, ImageU8(640, 480, 1), valid);
    const double masked =
        static_cast<double>(std::count(valid.pixels.begin(), valid.pixels.end(), 0)) / (640 * 480);
    EXPECT_NEAR(undistortion_loss(pincushion).empty, masked, 2e-3);
    EXPECT_NEAR(undistortion_loss(pincushion).cropped, 0, 5e-3);
    EXPECT_GT(masked, 0.05);
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
    // The brightness is the distorted radius in pixels from the centre. After undistortion it must
    // be the distorted radius of the pinhole's pixel.
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

TEST(CameraModel, DistortionThatCannotBeUndone) {
    // r (1 - r^2) turns back at r = 0.58: places beyond would appear a second time.
    const Intrinsics folded = make("SIMPLE_RADIAL", {500, 320, 240, -1});
    ImageU8 valid;
    undistorted(folded, ImageU8(640, 480, 1), valid);
    for (const auto& [x, y] : {std::pair{320, 240}, {590, 240}, {320, 479}})
        EXPECT_EQ(valid.at(x, y), 255) << x << " " << y;
    for (const auto& [x, y] : {std::pair{0, 0}, {635, 240}, {639, 479}})
        EXPECT_EQ(valid.at(x, y), 0) << x << " " << y;
    for (const double k : {50.0, 1e6, -20.0})
        expect_error(ExitCode::input, "of the picture, expected", [&] {
            make("SIMPLE_RADIAL", {500, 320, 240, k});
        });
    EXPECT_NO_THROW(make("SIMPLE_RADIAL", {500, 320, 240, 1}));
}

}  // namespace
}  // namespace tvsgs
