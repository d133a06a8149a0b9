// Tests the mapping from a view's pixels to maps of other sizes, of windows, and with lenses.
#include <cmath>
#include <limits>

#include "io/io_test.h"
#include "io/priors/prior_placement.h"

namespace tvsgs {
namespace {

View view_of(int width, int height, double reduction = 1) {
    View view;
    view.photo = ImageU8(width, height, 3);
    view.reduction = reduction;
    return view;
}
ImageF ramp(int width, int height, double a, double b) {
    ImageF map(width, height, 1);
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            map.at(x, y) = static_cast<float>(a * (x + 0.5) / width + b * (y + 0.5) / height);
    return map;
}

TEST(MapPlacement, AMapOfAnotherSizeShowsTheSame) {
    const View view = view_of(40, 30);
    for (const auto& [width, height] : {std::pair{40, 30}, {80, 60}, {20, 15}, {37, 28}}) {
        const ImageF map = ramp(width, height, 3, 5);
        const MapPlacement placement("a", view, {}, {}, map);
        const ImageF out = resample_map(map, placement, view, 40, 30, MapBlend::linear);
        for (int y = 3; y < 27; ++y)
            for (int x = 3; x < 37; ++x)
                ASSERT_NEAR(out.at(x, y), 3 * (x + 0.5) / 40 + 5 * (y + 0.5) / 30, 1e-5)
                    << width << ' ' << x << ' ' << y;
    }
}

TEST(MapPlacement, AWindowIsOfTheFile) {
    const View view = view_of(40, 30, 2);  // a file of 80 x 60
    const ImageF map = ramp(10, 10, 1, 0);
    const MapPlacement placement("a", view, {}, centre_square(view), map);
    const ImageF out = resample_map(map, placement, view, 40, 30, MapBlend::linear);
    for (int x = 0; x < 40; ++x) {
        // The square begins at 10 and is 60 wide: in the photo 30 wide from 5.
        EXPECT_EQ(std::isnan(out.at(x, 12)), x < 5 || x >= 35) << x;
        if (x > 7 && x < 32) {
            EXPECT_NEAR(out.at(x, 12), (x + 0.5 - 5) / 30, 1e-6) << x;
        }
    }
}

TEST(MapPlacement, OtherShapesAreRefused) {
    const View view = view_of(777, 581);
    const auto place = [&](int width, int height) {
        MapPlacement("m.npy", view, {}, {}, ImageF(width, height, 1));
    };
    place(1554, 1162), place(388, 290), place(384, 287);
    place(518, 392);  // multiples of 14
    place(384, 288);  // of 32
    for (const auto& [width, height] : {std::pair{384, 384}, {518, 364}, {777, 590}, {1000, 581}})
        expect_error(ExitCode::input, "its photograph has 777x581",
                     [&, w = width, h = height] { place(w, h); });
    expect_error(ExitCode::input, "turned", [&] { place(581, 777); });
}

TEST(MapPlacement, HolesAreNotMixedIn) {
    const float none = std::numeric_limits<float>::quiet_NaN();
    ImageF map(4, 1, 1);
    map.pixels = {1, 3, none, 8};
    float value = 0;
    EXPECT_TRUE(sample_map(map, MapBlend::linear, 1.0, 0.5, &value));
    EXPECT_EQ(value, 2);
    EXPECT_TRUE(sample_map(map, MapBlend::nearest, 1.0, 0.5, &value));
    EXPECT_EQ(value, 3);
    EXPECT_TRUE(sample_map(map, MapBlend::inverse, 1.0, 0.5, &value));
    EXPECT_EQ(value, 1.5f);
    EXPECT_TRUE(sample_map(map, MapBlend::linear, 1.9, 0.5, &value));  // beside the hole
    EXPECT_EQ(value, 3);
    EXPECT_FALSE(sample_map(map, MapBlend::linear, 2.1, 0.5, &value));
    EXPECT_TRUE(sample_map(map, MapBlend::linear, 3.1, 0.5, &value));
    EXPECT_EQ(value, 8);
    EXPECT_TRUE(sample_map(map, MapBlend::linear, 0.0, 0.5, &value));  // the border repeats
    EXPECT_EQ(value, 1);
    map.pixels = {-1, 3, 3, 3};
    EXPECT_TRUE(sample_map(map, MapBlend::inverse, 1.0, 0.5, &value));
    EXPECT_EQ(value, 1);
}

TEST(MapPlacement, GoesThroughTheLens) {
    Intrinsics camera;
    camera.width_px = 80, camera.height_px = 60;
    camera.fx_px = camera.fy_px = 70, camera.cx_px = 40, camera.cy_px = 30;
    camera.distortion.kind = Distortion::Kind::radial;
    camera.distortion.k[0] = -0.2;
    const View view = view_of(40, 30, 2);
    const ImageF map = ramp(80, 60, 80, 0);  // the column of the file
    const MapPlacement placement("a", view, camera, {}, map);
    const ImageF out = resample_map(map, placement, view, 40, 30, MapBlend::linear);
    const double u = (35.5 - 20) / 35, v = (20.5 - 15) / 35;  // of pixel (35, 20) of the photo
    const double factor = 1 - 0.2 * (u * u + v * v);
    EXPECT_NEAR(out.at(35, 20), 70 * u * factor + 40, 1e-4);
    EXPECT_GT(71 - out.at(35, 20), 1);  // without the lens it would be column 71
}

}  // namespace
}  // namespace tvsgs
