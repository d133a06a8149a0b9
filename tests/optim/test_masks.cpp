// Masks and backgrounds in the photometric term, and derivatives by the transmittance.
#include <gtest/gtest.h>

#include <cstring>

#include "core/error.h"
#include "masks_case.h"
#include "optim/views/device_views.h"
#include "support/numeric.h"
#include "training_scene.h"

namespace tvsgs {
namespace {

using test::central_difference;
using test::close;
using test::MaskCase;
using test::MaskResult;

constexpr float kObject = 1, kNoObject = 0, kNoPixel = kNoPhoto / 255.0f;

MaskCase mask_case(MaskUse use, const std::string& background) {
    MaskCase c;
    test::Random random(3);
    for (int i = 0; i < c.width * c.height; ++i) {
        c.color.push_back({float(random.uniform(0, 1)), float(random.uniform(0, 1)),
                           float(random.uniform(0, 1))});
        c.transmittance.push_back(float(random.uniform(0.05, 0.95)));
        for (int k = 0; k < 3; ++k)
            c.photo.push_back(static_cast<std::uint8_t>(random.uniform(0, 256)));
        c.mask.push_back(i % 3 == 0 ? kNoObject : i % 7 == 0 ? kNoPixel : kObject);
        c.confidence.push_back(i % 5 == 0 ? kPlanarConfidence : i % 2 == 0 ? 0.4f : 0);
    }
    c.options.masks = use, c.options.background = background;
    c.options.coverage = 0.6f, c.options.weight = 0.8f;
    c.camera.camera_from_world.R = rotation(quat_cast<float>(random.quat()));
    if (background == "sky" || background == kSoftBackground) {
        ImageU8 sky(16, 16, 3);
        for (std::uint8_t& value : sky.pixels)
            value = static_cast<std::uint8_t>(random.uniform(0, 256));
        c.options.sky = std::make_shared<const ImageU8>(std::move(sky));
    }
    return c;
}

/// Background at pixel `p`.
Vec3d behind_of(const MaskCase& c, std::size_t p) {
    const PhotometricOptions& o = c.options;
    const int i = static_cast<int>(p);
    if (o.sky)
        return vec_cast<double>(SkyMap{o.sky->pixels.data(), o.sky->width}.at(
            world_direction(c.camera, i % c.width, i / c.width)));
    const PhotoBackground b = parse_background(o.background);
    return {b.color[0] / 255.0, b.color[1] / 255.0, b.color[2] / 255.0};
}

/// The term without SSIM, in double; adds `by` to channel `k` of pixel `i` (3: transmittance).
double definition(const MaskCase& c, std::size_t i, int k, double by) {
    const PhotometricOptions& o = c.options;
    const double n = static_cast<double>(c.color.size());
    const bool object = o.masks == MaskUse::object,
               fills = object && o.background != "none" && !o.sky;
    double loss = 0;
    for (std::size_t p = 0; p < c.color.size(); ++p) {
        const double T = static_cast<double>(c.transmittance[p]) + (p == i && k == 3 ? by : 0);
        const float mask = uses_masks(o.masks) ? c.mask[p] : kObject;
        const Vec3d behind = behind_of(c, p);
        const bool inside = mask == kObject, filled = fills && mask == kNoObject;
        for (int ch = 0; ch < 3 && (inside || filled); ++ch) {
            const double x = static_cast<double>(c.color[p][ch]) + (p == i && k == ch ? by : 0) +
                             T * behind[ch],
                         y = inside ? c.photo[3 * p + static_cast<std::size_t>(ch)] / 255.0
                                    : behind[ch];
            loss += static_cast<double>(o.weight) * std::abs(x - y) / (3 * n);
        }
        if (object && mask == kNoObject)
            loss += static_cast<double>(o.weight * o.coverage) * (1 - T) / n;
        if (o.background == kSoftBackground && c.confidence[p] > kPlanarConfidence)
            loss += static_cast<double>(o.weight * o.coverage) * T / n;
    }
    return loss;
}

TEST(Masks, ValueAndDerivativesByColourAndTransmittance) {
    for (const MaskUse use : {MaskUse::object, MaskUse::ignore, MaskUse::none})
        for (const char* const background : {"none", "white", "20,200,90", "sky", "soft"}) {
            MaskCase c = mask_case(use, background);
            c.options.ssim = 0;
            const MaskResult r = test::evaluate_masks<Cpu>(c);
            EXPECT_TRUE(close(r.value, definition(c, 0, 0, 0), 1e-5)) << background;
            for (std::size_t i = 0; i < c.color.size(); ++i)
                for (int k = 0; k < 4; ++k) {
                    if (k == 3 && r.dL_dtransmittance.empty()) continue;
                    const double expected =
                        central_difference([&](double h) { return definition(c, i, k, h); }, 1e-6);
                    const float found = k == 3 ? r.dL_dtransmittance[i] : r.dL_dcolor[i][k];
                    EXPECT_TRUE(close(found, expected, 1e-4, 1e-3))
                        << background << " pixel " << i << " of " << k;
                }
            EXPECT_EQ(r.dL_dtransmittance.empty(),
                      use != MaskUse::object && background == std::string("none"))
                << "nothing is allocated for what nothing goes by";
        }
}

TEST(Masks, WhatIsOutsideChangesNothing) {
    for (const MaskUse use : {MaskUse::object, MaskUse::ignore}) {
        const MaskCase a = mask_case(use, "none");
        MaskCase b = a;
        for (std::size_t i = 0; i < b.color.size(); ++i)
            if (b.mask[i] != kObject) {
                b.color[i] = {5, -3, 0.2f};
                for (std::size_t k = 0; k < 3; ++k)
                    b.photo[3 * i + k] = static_cast<std::uint8_t>(255 - b.photo[3 * i + k]);
            }
        const MaskResult x = test::evaluate_masks<Cpu>(a), y = test::evaluate_masks<Cpu>(b);
        EXPECT_EQ(x.value, y.value);
        for (std::size_t i = 0; i < a.color.size(); ++i)
            for (int k = 0; k < 3; ++k) {
                EXPECT_EQ(x.dL_dcolor[i][k], y.dL_dcolor[i][k]) << i;
                if (a.mask[i] != kObject) {
                    EXPECT_EQ(x.dL_dcolor[i][k], 0) << i;
                }
            }
    }
}

TEST(Masks, AViewWithoutOneIsComparedWhole) {
    MaskCase a = mask_case(MaskUse::object, "none"), b = mask_case(MaskUse::none, "none");
    a.mask.clear();
    const MaskResult x = test::evaluate_masks<Cpu>(a), y = test::evaluate_masks<Cpu>(b);
    EXPECT_EQ(x.value, y.value);
    for (const float dL : x.dL_dtransmittance) EXPECT_EQ(dL, 0);
}

TEST(Masks, AnExposureIsNotFittedToWhatIsOutside) {
    MaskCase a = mask_case(MaskUse::object, "white");
    a.options.exposure = true, a.options.exposure_start = 1, a.options.ssim = 0;
    MaskCase b = a, c = a;
    for (std::size_t i = 0; i < a.color.size(); ++i)
        (a.mask[i] == kObject ? c : b).color[i] = {0, 0, 0};
    const MaskResult x = test::evaluate_masks<Cpu>(a);
    ASSERT_EQ(x.exposure.size(), 2u);
    EXPECT_EQ(x.exposure, test::evaluate_masks<Cpu>(b).exposure);
    EXPECT_NE(x.exposure, test::evaluate_masks<Cpu>(c).exposure);
}

TEST(Background, RandomIsAFunctionOfSeedAndStep) {
    const PhotoBackground random = parse_background("random");
    const auto at = [&](std::uint64_t seed, int step) {
        const PhotoBackground b = random.at(seed, step);
        return b.color[0] << 16 | b.color[1] << 8 | b.color[2];
    };
    EXPECT_EQ(at(1, 5), at(1, 5));
    EXPECT_NE(at(1, 5), at(1, 6));
    EXPECT_NE(at(1, 5), at(2, 5));
}

TEST(Background, IsNamedOrThreeNumbers) {
    EXPECT_TRUE(parse_background("none").black());
    EXPECT_EQ(parse_background("white").color[1], 255);
    const PhotoBackground b = parse_background("1,2,255");
    EXPECT_EQ(b.color[0], 1);
    EXPECT_EQ(b.color[2], 255);
    for (const char* const bad :
         {"", "grey", "1,2", "1,2,256", "1,2,3,", "-1,2,3", "1;2;3", "1, 2, 3"})
        EXPECT_THROW(parse_background(bad), Error) << bad;
    PhotometricOptions options;
    options.background = "random", options.masks = MaskUse::ignore;
    EXPECT_THROW(PhotometricLoss<Cpu>{options}, Error);
}

/// Weight of a pixel in the sum of w T.
float weight_of(std::size_t pixel) {
    return 0.2f + static_cast<float>(pixel % 13) / 13;
}

TEST(Transmittance, DerivativesOfEachRasteriser) {
    const Camera camera = test::test_camera(24, 18);
    for (const char* const name : {"ewa", "rade", "surfel"})
        for (const Maps maps : {Maps::color, Maps::color | kGeometryMaps}) {
            Gaussians<Cpu> g = test::random_gaussians(25, 4, 0.2, 0);
            const auto backbone = make_backbone<Cpu>(name, {});
            ASSERT_TRUE(has(backbone->traits.maps, Maps::coverage)) << name;
            backbone->prepare(0, true, {camera}, g);
            const auto value = [&] {
                double sum = 0;
                const auto& T =
                    backbone->forward(g, camera, 0, maps | Maps::coverage).transmittance;
                for (std::size_t p = 0; p < T.size(); ++p)
                    sum += static_cast<double>(weight_of(p)) * static_cast<double>(T[p]);
                return sum;
            };
            value();
            ImageGradients<Cpu> dL_dimages;
            dL_dimages.transmittance.resize(24 * 18);
            for (std::size_t p = 0; p < 24 * 18; ++p) dL_dimages.transmittance[p] = weight_of(p);
            Gaussians<Cpu> dL;
            resize(dL, g.size(), 0), fill_zero(dL);
            backbone->backward(g, dL_dimages, dL);
            double largest = 0;
            for (std::size_t i = 0; i < g.means.size(); ++i) {
                float& parameter = g.opacity_logits[i];
                const float kept = parameter;
                const double expected = central_difference(
                    [&](double h) {
                        parameter = kept + static_cast<float>(h);
                        return value();
                    },
                    2e-3);
                parameter = kept;
                largest = std::max(largest, std::abs(expected));
                EXPECT_NEAR(dL.opacity_logits[i], expected, 0.02 + 0.02 * std::abs(expected))
                    << name << ' ' << i;
            }
            EXPECT_GT(largest, 1) << "something is measured";
            for (const Vec3f sh : to_host(dL.sh)) EXPECT_EQ(norm(sh), 0);
        }
}

Scene masked_scene() {
    Scene scene = test::rendered_scene();
    for (View& view : scene.train) {
        view.mask = ImageU8(40, 30, 1);
        for (int y = 5; y < 25; ++y)
            for (int x = 8; x < 32; ++x) view.mask.at(x, y) = 255;
    }
    return scene;
}

TEST(MaskedTraining, GoesOnWithTheSameBits) {
    const Scene scene = masked_scene();
    TrainOptions options = test::everything_on(24);
    options.loss.photometric.masks = MaskUse::object;
    options.loss.photometric.background = "random";
    std::vector<SharedState> saved;
    TrainCallbacks callbacks;
    callbacks.save_due = [](int done) { return done == 13; };
    callbacks.on_save = [&](int, const SharedState& state) { saved.push_back(state); };
    const Gaussians<Cpu> whole = train<Cpu>(scene, options, callbacks);
    ASSERT_EQ(saved.size(), 1u);
    const Gaussians<Cpu> rest = train<Cpu>(scene, options, {}, {}, saved[0]);
    ASSERT_EQ(whole.size(), rest.size());
    EXPECT_EQ(
        0, std::memcmp(whole.means.data(), rest.means.data(), whole.means.size() * sizeof(Vec3f)));
    EXPECT_EQ(0, std::memcmp(whole.log_scales.data(), rest.log_scales.data(),
                             whole.means.size() * sizeof(Vec3f)));
}

/// Compares the coverage outside of the object after training with and without object masks.
TEST(MaskedTraining, LeavesTheBackgroundEmpty) {
    const Scene scene = masked_scene();
    TrainOptions options;
    options.iterations = 120, options.densify.enabled = false;
    const auto coverage = [&](MaskUse use) {
        options.loss.photometric.masks = use;
        options.loss.photometric.coverage = 1;
        const Gaussians<Cpu> g = train<Cpu>(scene, options, {});
        double inside = 0, outside = 0;
        const auto backbone = make_backbone<Cpu>(options.backbone, {});
        const View& view = scene.train[1];
        const auto& T = backbone->forward(g, view.camera, 0, Maps::color).transmittance;
        for (std::size_t p = 0; p < T.size(); ++p)
            (view.mask.pixels[p] > 0 ? inside : outside) += 1 - static_cast<double>(T[p]);
        return std::pair(inside / (20 * 24), outside / (40 * 30 - 20 * 24));
    };
    const auto with = coverage(MaskUse::object), without = coverage(MaskUse::none);
    EXPECT_LT(with.second, 0.5 * without.second);
    EXPECT_GT(with.first, 0.7 * without.first);
}

TEST(MaskedTraining, WithoutMasksNothingIsAskedFor) {
    EXPECT_TRUE(needs_of(LossOptions{}).view_maps.empty());
    EXPECT_FALSE(has(needs_of(LossOptions{}).maps, Maps::coverage));
    const Scene scene = masked_scene();
    TrainOptions options;
    const DeviceViews<Cpu> views(scene.train, needs_of(options.loss), 0);
    EXPECT_EQ(views.views()[0].map("mask"), nullptr);
}

TEST(Twins, MasksAndBoundsOnBothDevices) {
    if (!test::no_cuda().empty()) GTEST_SKIP() << test::no_cuda();
    if constexpr (kHasCuda) {
        for (const MaskUse use : {MaskUse::object, MaskUse::ignore, MaskUse::none})
            for (const char* const background : {"none", "white", "9,80,200", "random", "sky"}) {
                if (use != MaskUse::object && background == std::string("random")) continue;
                const MaskCase c = mask_case(use, background);
                const MaskResult a = test::evaluate_masks<Cpu>(c), b = test::evaluate_masks_cuda(c);
                EXPECT_TRUE(close(a.value, b.value, 1e-5));
                ASSERT_EQ(a.dL_dtransmittance.size(), b.dL_dtransmittance.size());
                for (std::size_t i = 0; i < c.color.size(); ++i) {
                    for (int k = 0; k < 3; ++k)
                        EXPECT_TRUE(close(a.dL_dcolor[i][k], b.dL_dcolor[i][k], 1e-3, 1e-3)) << i;
                    if (!a.dL_dtransmittance.empty()) {
                        EXPECT_TRUE(
                            close(a.dL_dtransmittance[i], b.dL_dtransmittance[i], 1e-3, 1e-3));
                    }
                }
            }
        const Gaussians<Cpu> g = test::random_gaussians(500, 2, 0.3, 0);
        // Derivatives by the transmittance.
        const Camera camera = test::test_camera(70, 50);
        for (const char* const name : {"ewa", "rade", "surfel"}) {
            const auto gradient = [&]<class Device>(Device) {
                Gaussians<Device> splats, dL;
                copy(g, splats);
                const auto backbone = make_backbone<Device>(name, {});
                backbone->prepare(0, true, {camera}, splats);
                backbone->forward(splats, camera, 0, Maps::color | kGeometryMaps | Maps::coverage);
                ImageGradients<Device> by;
                std::vector<float> w(70 * 50);
                for (std::size_t p = 0; p < w.size(); ++p) w[p] = weight_of(p);
                copy(w, by.transmittance);
                resize(dL, splats.size(), 0), fill_zero(dL);
                backbone->backward(splats, by, dL);
                return to_host(dL.opacity_logits);
            };
            const auto x = gradient(Cpu{}), y = gradient(Cuda{});
            for (std::size_t i = 0; i < x.size(); ++i)
                EXPECT_TRUE(close(x[i], y[i], 2e-3, 0.1)) << name << ' ' << i;
        }
    }
}

}  // namespace
}  // namespace tvsgs
