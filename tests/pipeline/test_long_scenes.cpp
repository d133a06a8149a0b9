// Support for scenes of thousands of photographs: photographs in a file, fast selection of views,
// exposures shared by parts of a scene.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "core/error.h"
#include "core/scene/pixel_file.h"
#include "core/scene/view_frustum.h"
#include "mesh/mend/mesh_evidence.h"
#include "optim/growth/init.h"
#include "optim/training_scene.h"
#include "optim/views/device_views.h"
#include "optim/views/matchable.h"
#include "pipeline/scene/exposures.h"
#include "plan/memory.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

ImageU8 noise(int width, int height, int channels, unsigned seed) {
    test::Random random(seed);
    ImageU8 image(width, height, channels);
    for (std::uint8_t& value : image.pixels)
        value = static_cast<std::uint8_t>(random.uniform(0, 255.99));
    return image;
}

TEST(PixelFile, KeepsWhatManyThreadsGiveIt) {
    std::vector<ImageU8> images(40);
    for (std::size_t i = 0; i < images.size(); ++i)
        images[i] = noise(31 + static_cast<int>(i), 17, 3, static_cast<unsigned>(i));
    const std::vector<ImageU8> before = images;
    {
        PixelFile file(testing::TempDir());
        std::vector<std::thread> threads;
        for (std::size_t t = 0; t < 4; ++t)
            threads.emplace_back([&, t] {
                for (std::size_t i = t; i < images.size(); i += 4) file.keep(images[i]);
            });
        for (std::thread& thread : threads) thread.join();
    }  // and lasts longer than it
    for (std::size_t i = 0; i < images.size(); ++i) {
        EXPECT_TRUE(images[i].pixels.in_file()) << i;
        EXPECT_EQ(images[i].pixels, before[i].pixels) << i;
    }
}

TEST(PixelFile, WhoeverWritesGetsItIntoMemoryFirst) {
    PixelFile file(testing::TempDir());
    ImageU8 image = noise(20, 10, 3, 1);
    const ImageU8 before = image;
    file.keep(image);
    ImageU8 other = image;
    EXPECT_EQ(std::as_const(other).pixels.data(), std::as_const(image).pixels.data())
        << "copies share";
    other.at(3, 4, 1) = static_cast<std::uint8_t>(before.at(3, 4, 1) + 1);
    EXPECT_FALSE(other.pixels.in_file());
    EXPECT_EQ(image.pixels, before.pixels);
    EXPECT_EQ(std::as_const(other).at(5, 4, 1), before.at(5, 4, 1));
    ImageU8 none;
    file.keep(none);
    EXPECT_TRUE(none.empty());
}

TEST(PixelFile, LeavesNothingAndSaysWhereItCannotBe) {
    const fs::path folder =
        fs::path(testing::TempDir()) / ("tvsgs_photos_" + std::to_string(getpid()));
    fs::create_directories(folder);
    PixelFile file(folder.string());
    ImageU8 image = noise(20, 10, 3, 1);
    file.keep(image);
    EXPECT_TRUE(fs::is_empty(folder)) << "it has no name";
    fs::remove_all(folder);
    try {
        PixelFile nowhere((folder / "missing").string());
        ADD_FAILURE() << "a folder that is not there";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::io);
        EXPECT_NE(std::string(error.what()).find("scene.photo_folder"), std::string::npos);
    }
}

Camera random_camera(test::Random& random) {
    Camera camera = test::test_camera(60, 40, static_cast<float>(random.uniform(-3, 3)));
    camera.cx_px += static_cast<float>(random.uniform(-20, 20));
    camera.camera_from_world.t += vec_cast<float>(3.0 * random.normal3());
    return camera;
}

TEST(ViewFrustum, NothingInViewIsMissed) {
    test::Random random(5);
    int missed = 0, seen = 0;
    for (int i = 0; i < 4000; ++i) {
        const Camera camera = random_camera(random);
        const ViewFrustum limits(camera);
        const Vec3f middle = vec_cast<float>(4.0 * random.normal3());
        const float size = static_cast<float>(random.uniform(0.01, 2));
        Box3f box;
        std::vector<Vec3f> corners;
        for (int k = 0; k < 8; ++k) {
            corners.push_back(middle + size * Vec3f{k & 1 ? 1.0f : -1.0f, k & 2 ? 1.0f : -1.0f,
                                                    k & 4 ? 1.0f : -1.0f});
            box.add(corners.back());
        }
        EXPECT_EQ(limits.misses(box), limits.misses(corners)) << "the same piece of space";
        bool any = false;
        for (int k = 0; k < 300; ++k) {
            const auto side = [&] { return static_cast<float>(random.uniform(-1, 1)); };
            any |= is_in_view(camera, middle + size * Vec3f{side(), side(), side()});
        }
        missed += limits.misses(box), seen += any;
        EXPECT_FALSE(any && limits.misses(box)) << i;
    }
    EXPECT_GT(missed, 1500) << "most pieces are left out";
    EXPECT_GT(seen, 300);
}

TEST(Matchable, LooksAtFewViewsAndFindsWhatAllShow) {
    test::Random random(8);
    std::vector<View> views(12);
    for (View& view : views) {
        view.camera = random_camera(random);
        view.photo = noise(60, 40, 3, 3);
    }
    int elsewhere = 0, nowhere = 0;
    for (const View& view : views) {
        const double depth = random.uniform(0.5, 6);
        const Matchable could_match(view, views, false, depth);
        const Rigid3f world = inverse(view.camera.camera_from_world);
        for (int y = 0; y < 40; y += 3)
            for (int x = 0; x < 60; x += 3) {
                const Vec3f point =
                    world * (static_cast<float>(depth) * pixel_ray(view.camera, x, y));
                const bool any = std::any_of(views.begin(), views.end(), [&](const View& other) {
                    return &other != &view && is_in_view(other.camera, point);
                });
                EXPECT_EQ(could_match.at(x, y), any);
                ++(any ? elsewhere : nowhere);
            }
    }
    EXPECT_GT(elsewhere, 1000);
    EXPECT_GT(nowhere, 100);
}

TEST(Evidence, OfRunsThatAViewMissesIsWhatEachSampleSays) {
    test::Random random(12);
    std::vector<SurfaceSample> samples;  // in clusters, like consecutive faces of a mesh
    while (samples.size() < 20 * SampleRuns::kSize + 17) {
        const Vec3f middle = vec_cast<float>(6.0 * random.normal3());
        for (std::size_t i = 0; i < SampleRuns::kSize; ++i)
            samples.push_back({middle + vec_cast<float>(0.3 * random.normal3()),
                               vec_cast<float>(0.01 * random.normal3())});
    }
    std::vector<EvidenceView> views;
    for (int v = 0; v < 12; ++v) {
        EvidenceView view{random_camera(random), {}, {}};
        for (int i = 0; i < view.camera.width_px * view.camera.height_px; ++i) {
            view.depth.push_back(static_cast<float>(random.uniform(-1, 12)));
            view.weight.push_back(static_cast<float>(random.uniform(0, 2)));
        }
        views.push_back(std::move(view));
    }
    const EvidenceSource source{static_cast<int>(views.size()),
                                [&](int i) { return views[static_cast<std::size_t>(i)]; }};
    std::vector<Evidence> expected(samples.size());
    std::size_t v = 0, said = 0, missed = 0;
    const std::vector<Evidence> found =
        gather_evidence(source, samples, [&](const std::vector<Judgement>& judged) {
            for (std::size_t s = 0; s < samples.size(); ++s) {
                const Judgement one = judge(views[v], samples[s]);
                ASSERT_EQ(judged[s].verdict, one.verdict) << v << ' ' << s;
                ASSERT_EQ(judged[s].pixels, one.pixels);
                said += one.verdict != Verdict::nothing;
                if (is_seen(one.verdict)) ++expected[s].sees;
                if (one.verdict == Verdict::sees_surely) ++expected[s].surely;
            }
            ++v;
        });
    for (std::size_t s = 0; s < samples.size(); ++s) {
        ASSERT_EQ(found[s].sees, expected[s].sees);
        ASSERT_EQ(found[s].surely, expected[s].surely);
    }
    const SampleRuns runs(samples);
    for (const EvidenceView& view : views)
        for (int run = 0; run < runs.count(); ++run)
            missed += runs.misses(ViewFrustum(view.camera), run);
    EXPECT_GT(said, 1000u);
    EXPECT_GT(missed, 60u);
}

TEST(Init, ScalesAreLimitedByNearCamerasAsByAll) {
    test::Random random(31);
    Scene scene;
    for (int i = 0; i < 40; ++i) scene.train.emplace_back().camera = random_camera(random);
    for (int i = 0; i < 3000; ++i)
        scene.points.positions.push_back(vec_cast<float>((i % 2 ? 3.0 : 20.0) * random.normal3()));
    InitOptions options;
    options.max_extent = 0.02f;
    const Gaussians<Cpu> limited = init_gaussians(scene, options, 0);
    options.max_extent = 0;
    const Gaussians<Cpu> free = init_gaussians(scene, options, 0);
    int smaller = 0;
    for (std::size_t i = 0; i < free.means.size(); ++i) {
        float most = std::exp(free.log_scales[i].x);
        for (const View& view : scene.train) {
            const Camera& c = view.camera;
            const Vec3f p = c.camera_from_world * free.means[i];
            const float w = static_cast<float>(c.width_px), h = static_cast<float>(c.height_px);
            if (std::abs(c.fx_px * p.x + p.z * (c.cx_px - 0.5f * w)) < p.z * w &&
                std::abs(c.fy_px * p.y + p.z * (c.cy_px - 0.5f * h)) < p.z * h)
                most = std::min(most, 0.02f * p.z * std::max(w / c.fx_px, h / c.fy_px));
        }
        EXPECT_NEAR(std::exp(limited.log_scales[i].x) / most, 1, 1e-4) << i;
        smaller += limited.log_scales[i].x < free.log_scales[i].x;
    }
    EXPECT_GT(smaller, 300);
    EXPECT_LT(smaller, 2900);
}

TEST(DeviceViews, MasksAndGreysAreThoseThatAreAlwaysThere) {
    std::vector<View> views(9);
    for (std::size_t i = 0; i < views.size(); ++i) {
        const int width = 20 + 2 * static_cast<int>(i);
        views[i].camera = test::test_camera(width, 12, 0);
        views[i].photo = noise(width, 12, 3, static_cast<unsigned>(i));
        if (i != 4) views[i].mask = noise(width, 12, 1, static_cast<unsigned>(i) + 50);
        if (i == 2) views[i].grey = noise(2 * width, 24, 1, 99);
    }
    LossNeeds needs;
    needs.grey = true, needs.view_maps.insert("mask");
    DeviceViews<Cpu> all(views, needs, 0), some(views, needs, 1);
    ASSERT_TRUE(all.all_resident());
    ASSERT_FALSE(some.all_resident());
    for (const int i : {0, 1, 5, 4, 3, 2, 1, 8, 4, 7, 2, 6, 0, 5}) {
        some.prefetch((i + 3) % 9);
        const DeviceView<Cpu>&a = all.get(i), &b = some.get(i);
        const View& view = views[static_cast<std::size_t>(i)];
        EXPECT_EQ(to_host(a.photo), view.photo.pixels.to_vector());
        EXPECT_EQ(to_host(b.photo), to_host(a.photo));
        EXPECT_EQ(to_host(a.grey),
                  (view.grey.empty() ? grey_of(view.photo) : view.grey).pixels.to_vector());
        EXPECT_EQ(to_host(b.grey), to_host(a.grey)) << i;
        ASSERT_EQ(b.map("mask") == nullptr, i == 4);
        if (i == 4) continue;
        const std::vector<float> mask = to_host(b.map("mask")->values);
        EXPECT_EQ(mask, to_host(a.map("mask")->values)) << i;
        for (std::size_t p = 0; p < mask.size(); ++p)
            EXPECT_EQ(mask[p], static_cast<float>(std::as_const(view.mask.pixels)[p]) / 255);
    }
}

TEST(MemoryPlan, PhotographsInAFileAreNotTheHosts) {
    Scene scene;
    for (int i = 0; i < 9; ++i) {
        View& view = scene.train.emplace_back();
        view.camera.width_px = 200, view.camera.height_px = 100;
        view.photo = ImageU8(200, 100, 3), view.mask = ImageU8(200, 100, 1, 255);
    }
    TrainOptions o;
    const MemoryPlan held = estimate_memory(scene, o, 100, true),
                     on_cpu = estimate_memory(scene, o, 100, false);
    EXPECT_EQ(photo_budget(scene, o, false), 0);
    PixelFile file(testing::TempDir());
    for (View& view : scene.train) file.keep(view.photo), file.keep(view.mask);
    const MemoryPlan filed = estimate_memory(scene, o, 100, true);
    EXPECT_EQ(held.host.fixed - filed.host.fixed, 9 * 200 * 100 * 4);
    EXPECT_EQ(held.buffers.fixed, filed.buffers.fixed);
    EXPECT_EQ(photo_budget(scene, o, true), 0);
    EXPECT_EQ(photo_budget(scene, o, false), 1) << "a CPU takes them as they are needed";
    EXPECT_LT(estimate_memory(scene, o, 100, false).host.fixed,
              on_cpu.host.fixed - 9 * 200 * 100 * 4 - 5 * 200 * 100 * 3);
}

class Exposures : public testing::Test {
protected:
    void SetUp() override {
        folder_ = (fs::path(testing::TempDir()) / ("tvsgs_exposures_" + std::to_string(getpid())))
                      .string();
        fs::create_directories(folder_);
    }
    void TearDown() override { fs::remove_all(folder_); }
    PhotometricOptions from_here() const {
        PhotometricOptions options;
        options.exposure_from = folder_;
        return options;
    }
    void expect_refused(const std::vector<View>& train, const std::string& why) const {
        PhotometricOptions options = from_here();
        try {
            read_exposures(options, train);
            ADD_FAILURE() << why;
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
            EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
        }
    }
    std::string folder_;
};

TEST_F(Exposures, AreReadByNameAsTheyWereWritten) {
    Scene scene;
    for (const char* name : {"a.png", "b \"x\".png", "c.png"})
        scene.train.emplace_back().name = name;
    expect_refused(scene.train, "no exposure.json");
    write_exposures(folder_, scene, {{0.1f, -0.003f}, {1.0f / 3, 1e-9f}, {-0.2f, 0}});
    ASSERT_TRUE(has_exposures(folder_));
    PhotometricOptions options = from_here();
    const std::vector<View> some{scene.train[2], scene.train[1]};
    read_exposures(options, some);
    EXPECT_EQ(*options.held, (HeldExposures{{-0.2f, 0}, {1.0f / 3, 1e-9f}}));
    options.exposure_from = "";
    read_exposures(options, some);
    EXPECT_EQ(options.held, nullptr);

    std::vector<View> more = scene.train;
    more.emplace_back().name = "d.png";
    expect_refused(more, "no exposure of d.png");
    for (const char* numbers : {"[0.1]", "[0.1,0,0]", "[\"x\",0]", "[0,1e30]", "0"}) {
        std::ofstream(folder_ + "/exposure.json")
            << "{\"version\":1,\"views\":{\"a.png\":" << numbers << "}}";
        expect_refused(scene.train, "a.png: expected 2 numbers");
    }
}

/// Mean colour of the second view of rendered_scene() after training on `views` of `scene`.
double brightness(const Scene& scene,
                  const std::vector<std::size_t>& views,
                  TrainOptions options,
                  HeldExposures* fitted = nullptr) {
    Scene part = scene;
    part.train.clear();
    for (const std::size_t v : views) part.train.push_back(scene.train[v]);
    TrainCallbacks told;
    told.on_exposures = [&](const HeldExposures& found) {
        if (fitted != nullptr) *fitted = found;
    };
    const Gaussians<Cpu> trained = train<Cpu>(part, options, told);
    const auto backbone = make_backbone<Cpu>(options.backbone, options.render);
    double sum = 0;
    for (const Vec3f c :
         backbone->forward(trained, scene.train[1].camera, 0, Maps::color).color.span())
        sum += c.x + c.y + c.z;
    return sum;
}

TEST_F(Exposures, PartsThatHoldThoseOfTheWholeHaveItsColours) {
    Scene scene = test::rendered_scene();
    scene.train[0] = scene.train[2] = scene.train[1];  // one place in different light
    const double gains[] = {0.8, 1, 1.2};
    for (std::size_t v = 0; v < 3; ++v) {
        scene.train[v].name = std::to_string(v);
        for (std::uint8_t& value : scene.train[v].photo.pixels)
            value = static_cast<std::uint8_t>(std::min(255.0, 0.7 * gains[v] * value + 0.5));
    }
    TrainOptions o;
    o.iterations = 2000, o.backbone = "ewa", o.model.sh_degree = 0;
    o.densify.enabled = o.tv.enabled = false;
    o.loss.photometric.ssim = 0;
    o.loss.photometric.exposure = true, o.loss.photometric.exposure_start = 1;
    HeldExposures fitted;
    const double whole = brightness(scene, {0, 1, 2}, o, &fitted);
    ASSERT_EQ(fitted.size(), 3u);
    EXPECT_GT(fitted[2][0] - fitted[0][0], 0.2f) << "or there is nothing to hold";
    write_exposures(folder_, scene, fitted);
    o.iterations = 300;
    double with[2], without[2];
    for (const std::size_t part : {std::size_t{0}, std::size_t{1}}) {
        const std::vector<std::size_t> views{2 * part};
        without[part] = brightness(scene, views, o) / whole;
        TrainOptions holds = o;
        holds.loss.photometric.exposure_from = folder_;
        read_exposures(holds.loss.photometric, {scene.train[2 * part]});
        HeldExposures after;
        with[part] = brightness(scene, views, holds, &after) / whole;
        EXPECT_EQ(after, HeldExposures{fitted[2 * part]}) << "they stay";
    }
    std::printf("brightness over the whole's: held %.3f %.3f, fitted alone %.3f %.3f\n", with[0],
                with[1], without[0], without[1]);
    EXPECT_LT(std::abs(with[1] / with[0] - 1), 0.05);
    EXPECT_GT(std::abs(without[1] / without[0] - 1), 0.3);
}

}  // namespace
}  // namespace tvsgs
