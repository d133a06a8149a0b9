// Tests descriptors of photographs: differences that they show, and changes that they ignore.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "core/scene/prior_maps.h"
#include "mvs/stereo/descriptors.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

constexpr int kWidth = 48, kHeight = 40;

/// Waves in grey, moved to the right by `shift` px.
ImageU8 waves(double shift, double gain = 1, double offset = 0) {
    ImageU8 photo(kWidth, kHeight, 3);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const double u = x - shift;
            const double grey = 128 + 45 * std::sin(0.5 * u + 0.2 * y) +
                                40 * std::sin(0.37 * y - 0.13 * u + 0.01 * u * y);
            for (int k = 0; k < 3; ++k)
                photo.at(x, y, k) = static_cast<std::uint8_t>(gain * grey + offset);
        }
    return photo;
}

ViewMap describe(const ImageU8& photo) {
    return describe_photo(photo, "features", photo.width, photo.height);
}

double cosine(const ViewMap& a, int ax, int ay, const ViewMap& b, int bx, int by) {
    double aa = 0, bb = 0, ab = 0;
    for (int k = 0; k < 32; ++k) {
        const double p = a.values[static_cast<std::size_t>(32 * (ay * a.width_px + ax) + k)],
                     q = b.values[static_cast<std::size_t>(32 * (by * b.width_px + bx) + k)];
        aa += p * p, bb += q * q, ab += p * q;
    }
    return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

TEST(Descriptors, AreOfTheirPlaceAlone) {
    const ViewMap a = describe(waves(0)), b = describe(waves(5));
    ASSERT_EQ(a.channels, 32);
    ASSERT_EQ(a.values.size(), std::size_t{32 * kWidth * kHeight});
    double alike = 0, apart = 0;
    int count = 0;
    for (int y = 12; y < 28; ++y)
        for (int x = 14; x < 28; ++x, ++count) {
            alike += cosine(a, x, y, b, x + 5, y);
            apart += cosine(a, x, y, b, x, y);
        }
    // The border, which is repeated outwards, reaches in by the widest blur.
    EXPECT_GT(alike / count, 0.97);
    EXPECT_LT(apart / count, 0.5) << "another place looks the same";
}

TEST(Descriptors, DoNotNoticeTheExposure) {
    const ViewMap a = describe(waves(0)), b = describe(waves(0, 0.8, 20));
    double least = 1;
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) least = std::min(least, cosine(a, x, y, b, x, y));
    EXPECT_GT(least, 0.9);
}

TEST(Descriptors, AreNothingWhereThereIsNoContrast) {
    ImageU8 photo(kWidth, kHeight, 3, 90);
    for (int y = 18; y < 22; ++y)
        for (int x = 40; x < 44; ++x) photo.at(x, y, 0) = photo.at(x, y, 1) = 250;
    const ViewMap map = describe(photo);
    const auto squares = [&](int x, int y) {
        double sum = 0;
        for (int k = 0; k < 32; ++k)
            sum += std::pow(map.values[static_cast<std::size_t>(32 * (y * kWidth + x) + k)], 2);
        return sum;
    };
    EXPECT_EQ(squares(3, 20), 0);
    EXPECT_GT(squares(39, 20), 0.5);
}

TEST(Descriptors, ComeAtAnySizeWithTheSameContent) {
    const ViewMap map = describe_photo(waves(0), "coarse", kWidth / 2, kHeight / 2);
    EXPECT_EQ(map.name, "coarse");
    EXPECT_EQ(map.values.size(), std::size_t{32 * kWidth * kHeight / 4});
    for (const float v : map.values) ASSERT_TRUE(std::isfinite(v));
    const ImageU8 odd(33, 1, 3, 7);
    EXPECT_EQ(describe_photo(odd, "m", 17, 1).values.size(), std::size_t{32 * 17});
}

TEST(Descriptors, TurnWithTheirCamera) {
    // A quarter turn from x to y: the right side moves to the bottom.
    const ImageU8 photo = waves(0);
    ImageU8 turned(kHeight, kWidth, 3);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
            for (int k = 0; k < 3; ++k) turned.at(kHeight - 1 - y, x, k) = photo.at(x, y, k);
    Camera straight, rolled;
    rolled.camera_from_world.R = {{{0, -1, 0}, {1, 0, 0}, {0, 0, 1}}};
    const Vec3f up{0, -1, 0};
    EXPECT_EQ(image_roll(straight, up), 0);
    const float roll = image_roll(rolled, up);
    EXPECT_NEAR(roll, std::acos(-1) / 2, 1e-6);
    const ViewMap a = describe(photo),
                  b = describe_photo(turned, "features", kHeight, kWidth, roll),
                  not_told = describe(turned);
    double least = 1, without = 0;
    for (int y = 8; y < kHeight - 8; ++y)
        for (int x = 8; x < kWidth - 8; ++x) {
            least = std::min(least, cosine(a, x, y, b, kHeight - 1 - y, x));
            without += cosine(a, x, y, not_told, kHeight - 1 - y, x);
        }
    EXPECT_GT(least, 0.999);
    EXPECT_LT(without, 0.5 * (kHeight - 16) * (kWidth - 16));
}

TEST(ImageRoll, IsNothingWhereTheCameraLooksAlongIt) {
    EXPECT_EQ(image_roll(Camera{}, {0.05f, 0.05f, 1}), 0);
    EXPECT_NEAR(image_roll(Camera{}, {1, -1, 0}), std::acos(-1) / 4, 1e-6);
}

TEST(Descriptors, SaysWhatIsBrighter) {
    ImageU8 photo(kWidth, kHeight, 3);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
            for (int k = 0; k < 3; ++k) photo.at(x, y, k) = static_cast<std::uint8_t>(5 * x);
    const ViewMap map = describe(photo);
    const float* const d = &map.values[32 * (20 * kWidth + 24)];
    // To the right on the ring of 1.5 px: 7.5 of 255.
    EXPECT_NEAR(d[0], std::tanh(7.5 / 255 / 0.02), 0.01);
    EXPECT_NEAR(d[4], -std::tanh(7.5 / 255 / 0.02), 0.01);
    EXPECT_NEAR(d[2], 0, 0.01);
    EXPECT_NEAR(d[16], std::tanh(22.5 / 255 / 0.02), 0.01);  // the ring of 4.5 px
}

TEST(AddDescriptors, ViewsThatAreRolledGetTheSameDirections) {
    std::vector<View> views(2);
    views[0].photo = waves(0), views[1].photo = ImageU8(kHeight, kWidth, 3);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x)
            for (int k = 0; k < 3; ++k)
                views[1].photo.at(kHeight - 1 - y, x, k) = views[0].photo.at(x, y, k);
    views[1].camera.camera_from_world.R = {{{0, -1, 0}, {1, 0, 0}, {0, 0, 1}}};
    add_descriptors(views);
    EXPECT_GT(cosine(views[0].maps[0], 7, 9, views[1].maps[0], kHeight / 2 - 1 - 9, 7), 0.999);
    std::vector<View> none;
    EXPECT_EQ(add_descriptors(none), 0);
}

TEST(AddDescriptors, GivesAllViewsBothSizes) {
    std::vector<View> views(2);
    views[0].photo = waves(0), views[1].photo = ImageU8(33, 21, 3, 5);
    const std::int64_t bytes = add_descriptors(views);
    EXPECT_EQ(bytes, 4 * 32 * (24 * 20 + 12 * 10 + 17 * 11 + 9 * 6));
    for (const View& view : views) {
        ASSERT_EQ(view.maps.size(), 2u);
        EXPECT_EQ(view.maps[0].name, prior_map::kFeatures);
        EXPECT_EQ(view.maps[1].name, prior_map::kCoarseFeatures);
    }
}

}  // namespace
}  // namespace tvsgs
