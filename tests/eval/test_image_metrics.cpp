// PSNR, SSIM and images of renders, on cases by hand and compared with NumPy and scikit-image.
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <numbers>

#include "core/error.h"
#include "eval/image_metrics.h"
#include "eval/view_scores.h"
#include "render/depth/map_images.h"
#include "support/test_data.h"

namespace tvsgs {
namespace {

TEST(ImageMetrics, ConstantImages) {
    const ImageF a(32, 32, 3, 0.5f), b(32, 32, 3, 0.6f);
    EXPECT_NEAR(psnr(a, b), 20, 1e-5);  // 0.6f is not 0.6
    const Ssim s = ssim(a, b);
    EXPECT_NEAR(s.valid, 0.983609244386, 1e-7);
    EXPECT_NEAR(s.padded, 0.976263099480, 1e-7);
}

TEST(ImageMetrics, EqualAndDifferentShapes) {
    ImageU8 a(12, 13, 3, 100);
    a.at(3, 4, 1) = 7;
    EXPECT_TRUE(std::isinf(psnr(a, a)));
    EXPECT_NEAR(ssim(a, a).padded, 1, 1e-12);
    EXPECT_NEAR(ssim(a, a).valid, 1, 1e-12);
    EXPECT_TRUE(std::isnan(ssim(ImageU8(10, 40, 1), ImageU8(10, 40, 1)).valid));
    EXPECT_THROW(psnr(a, ImageU8(13, 12, 3)), Error);
    EXPECT_THROW(ssim(ImageU8(), ImageU8()), Error);

    ImageU8 b = a;
    b.at(0, 0, 0) = 110;  // one of 468 values is off by 10 / 255
    EXPECT_NEAR(psnr(a, b), 10 * std::log10(468 * 25.5 * 25.5), 1e-9);
    EXPECT_EQ(psnr(a, b), psnr(b, a));
}

/// Reads a little-endian float32 .npy file in C order.
ImageF read_npy(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), {}};
    const auto header = static_cast<std::size_t>(static_cast<unsigned char>(bytes[8]) +
                                                 256 * static_cast<unsigned char>(bytes[9]));
    ImageF image(64, 48, 3);
    EXPECT_NE(bytes.find("(48, 64, 3)"), std::string::npos);
    EXPECT_EQ(bytes.size(), 10 + header + image.pixels.size() * sizeof(float));
    std::memcpy(image.pixels.data(), bytes.data() + 10 + header,
                image.pixels.size() * sizeof(float));
    return image;
}

TEST(ImageMetrics, AgreeWithTheOracle) {
    const std::string folder = test_data("geometry");
    const ImageF a = read_npy(folder + "/nvs_render.npy"), b = read_npy(folder + "/nvs_gt.npy");
    // Results of NumPy and scikit-image in double on the same floats.
    EXPECT_NEAR(psnr(a, b), 26.02065099594689, 1e-6);
    EXPECT_NEAR(ssim(a, b).padded, 0.7115528602232194, 1e-6);
    EXPECT_NEAR(ssim(a, b).valid, 0.6388765927679918, 1e-6);
}

TEST(MapImages, Colors) {
    const float nan = std::nanf("");
    const ImageU8 image = color_image(2, 1, {{0.5f, -1, 2}, {nan, 1, 0.001f}});
    EXPECT_EQ(image.pixels,
              (std::vector<std::uint8_t>{128, 0, 255, 0, 255, 0}));  // 127.5 rounds up
}

TEST(MapImages, Normals) {
    // Towards the camera, up, right, none, NaN.
    const ImageU8 image =
        normal_image(5, 1, {{0, 0, -0.2f}, {0, -1, 0}, {1, 0, 0}, {}, {std::nanf(""), 0, 0}});
    EXPECT_EQ(image.pixels, (std::vector<std::uint8_t>{128, 128, 255, 128, 255, 128, 255, 128, 128,
                                                       0, 0, 0, 0, 0, 0}));
}

TEST(MapImages, Depth) {
    std::vector<float> depths;
    for (int i = 0; i < 200; ++i) depths.push_back(1 + 0.005f * static_cast<float>(i));
    depths[0] = 0;  // no depth
    depths[5] = std::numeric_limits<float>::infinity();
    depths[150] = 1e9f;  // an outlier does not spoil the range
    const ImageU8 image = depth_image(200, 1, depths);
    const auto brightness = [&](int x) {
        return image.at(x, 0, 0) + image.at(x, 0, 1) + image.at(x, 0, 2);
    };
    EXPECT_EQ(brightness(0), 0);
    EXPECT_EQ(brightness(5), 0);
    EXPECT_GT(brightness(10), brightness(100));
    EXPECT_GT(brightness(100), brightness(190));
    EXPECT_EQ(brightness(150), brightness(199));
    EXPECT_EQ(depth_image(2, 1, {0, 0}).pixels, std::vector<std::uint8_t>(6, 0));
    EXPECT_GT(depth_image(1, 1, {3}).at(0, 0, 0), 0);
}

/// A view whose camera is turned about the vertical axis; grey.
View turned_view(double degrees) {
    View view;
    const double angle = degrees * std::numbers::pi / 180;
    const auto c = static_cast<float>(std::cos(angle)), s = static_cast<float>(std::sin(angle));
    view.camera = {16, 16, 20, 20, 8, 8, {}};
    view.camera.camera_from_world.R = {{{c, 0, s}, {0, 1, 0}, {-s, 0, c}}};
    view.photo = ImageU8(16, 16, 3, 100);
    view.name = std::to_string(static_cast<int>(degrees));
    return view;
}

TEST(ViewScores, NearAndFarViewsHaveTheirOwnMeans) {
    const std::vector<View> trained = {turned_view(0), turned_view(90)};
    ViewScoring scoring;
    scoring.trained = &trained;
    ViewScorer scorer(scoring);
    // Errors of 1, 2, 4 and 8 steps.
    for (const auto& [degrees, level] :
         {std::pair(14.9, 101), {-10., 102}, {15.1, 104}, {200., 108}})
        scorer.add(turned_view(degrees), ImageU8(16, 16, 3, static_cast<std::uint8_t>(level)), {});
    const ViewScores scores = scorer.scores();
    const auto psnr_of = [](int steps) { return 20 * std::log10(255. / steps); };
    EXPECT_NEAR(scores.mean_near.psnr, (psnr_of(1) + psnr_of(2)) / 2, 1e-6);
    EXPECT_NEAR(scores.mean_far.psnr, (psnr_of(4) + psnr_of(8)) / 2, 1e-6);
    EXPECT_EQ(scores.near_views, 2u);
    EXPECT_EQ(scores.far_views, 2u);
    EXPECT_NEAR(scores.per_view["15"]["angle_deg"].number, 15.1, 1e-4);
    EXPECT_NEAR(scores.per_view["200"]["angle_deg"].number, 110, 1e-4);
    const JsonValue json = view_scores_json(scores, 4, scoring);
    EXPECT_EQ(json["psnr_near"].number, scores.mean_near.psnr);
    EXPECT_EQ(json["views_far"].number, 2);
    scoring.trained = nullptr;
    EXPECT_FALSE(view_scores_json(scores, 4, scoring)["psnr_near"]);
}

}  // namespace
}  // namespace tvsgs
