// Priors of a synthetic scene in the formats of other programs: found, interpreted, fitted.
#include <tuple>

#include "apps/priors_test.h"
#include "pipeline/scene/planned_scene.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

// Scale and shift to 0.1 % for any quantity: the points determine both.
TEST_F(Priors, AreUnderstoodByThePoints) {
    for (const auto& [name, ray] : {std::pair{"depth", false},
                                    {"inverse_depth", false},
                                    {"inverse_depth", true},
                                    {"log_depth", true}}) {
        const std::string quantity = name;
        SCOPED_TRACE(quantity + (ray ? " along the ray" : ""));
        const Scene scene = read({.format = "npy", .quantity = quantity, .ray = ray});
        expect_depth(scene, 1e-3);
        EXPECT_EQ(said("along the ray"), ray) << said_;
        EXPECT_EQ(said("relative inverse depth"), quantity == "inverse_depth") << said_;
        EXPECT_EQ(said("log depth"), quantity == "log_depth") << said_;
    }
    EXPECT_TRUE(
        said("Priors: 5 depth maps (depth_npy/*_pred.npy: relative log depth along the "
             "ray), fitted to "))
        << said_;
}

TEST_F(Priors, OfEachFormat) {
    for (const auto& [format, what] :
         {std::pair{"vggt", "depth_vggt/*_pred.npy: up to scale depth"},
          {"params", "depths/*.png: in scene units inverse depth"},
          {"colmap", "depth_maps/*.geometric.bin: in scene units depth"},
          {"mvsnet", "depth_est/*.pfm: in scene units depth"},
          {"acmm", "ACMM/*/depths_geom.dmb: in scene units depth"},
          {"json", "depth/*.npy, tvsgs-synth: relative depth"}}) {
        SCOPED_TRACE(format);
        const Scene scene = read({.format = format});
        expect_depth(scene, 1e-3);
        EXPECT_TRUE(said(what)) << said_;
        const std::string name = format;
        if (name != "mvsnet" && name != "params") expect_normals(scene, 0.99);
        if (name == "vggt" || name == "mvsnet") {
            const ViewMap* const confidence = find(scene.train[0], prior_map::kConfidence);
            ASSERT_NE(confidence, nullptr);
            EXPECT_NEAR(*std::max_element(confidence->values.begin(), confidence->values.end()),
                        0.8f, 1e-6f);
            EXPECT_EQ(*std::min_element(confidence->values.begin(), confidence->values.end()), 0);
        } else {
            EXPECT_EQ(find(scene.train[0], prior_map::kConfidence), nullptr);
        }
    }
}

TEST_F(Priors, OfTheMiddleOfThePhotograph) {
    const Scene scene = read({.format = "omnidata"});
    expect_depth(scene, 1e-3, 0.5);
    expect_normals(scene, 0.99);
    const ViewMap* const depth = find(scene.train[0], prior_map::kDepth);
    for (int y = 0; y < 120; ++y)
        for (const int x : {0, 19, 140, 159})  // the square is 20 to 140
            EXPECT_EQ(depth->values[static_cast<std::size_t>(y * 160 + x)], 0);
}

TEST_F(Priors, WithNoiseAndHoles) {
    const Scene scene =
        read({.format = "npy", .quantity = "inverse_depth", .noise = 0.05, .holes = 0.3});
    expect_depth(scene, 0.06, 0.6);
    EXPECT_TRUE(said("median error 2.")) << said_;  // 0.674 of 5 %, of four pixels mixed
    const ViewMap* const depth = find(scene.train[0], prior_map::kDepth);
    double holes = 0, surface = 0;
    for (std::size_t i = 0; i < depth->values.size(); ++i)
        if (truth_[0].depth.pixels[i] > 0) ++surface, holes += depth->values[i] == 0;
    EXPECT_NEAR(holes / surface, 0.3, 0.06);
}

// The ranked quantity grows with depth, and is 0 and 1 at its percentiles.
TEST_F(Priors, HaveAnOrder) {
    for (const char* quantity : {"depth", "inverse_depth"}) {
        const Scene scene = read({.format = "npy", .quantity = quantity});
        const ViewMap& order = *find(scene.train[1], prior_map::kDepthOrder);
        const ViewMap& depth = *find(scene.train[1], prior_map::kDepth);
        std::vector<float> values;
        for (std::size_t i = 0; i < order.values.size(); ++i) {
            EXPECT_EQ(std::isnan(order.values[i]), depth.values[i] == 0);
            if (!std::isnan(order.values[i])) values.push_back(order.values[i]);
        }
        std::sort(values.begin(), values.end());
        EXPECT_EQ(values[(values.size() - 1) * 2 / 100], 0);
        EXPECT_EQ(values[(values.size() - 1) * 98 / 100], 1);
        int pairs = 0;
        for (std::size_t i = 0; i + 997 < depth.values.size(); i += 7) {
            const float a = depth.values[i], b = depth.values[i + 997];
            if (a == 0 || b == 0 || std::abs(a - b) < 1e-3f) continue;
            EXPECT_EQ(a < b, order.values[i] < order.values[i + 997]);
            ++pairs;
        }
        EXPECT_GT(pairs, 200);
    }
}

TEST_F(Priors, OfFewPointsHaveAnOrderAlone) {
    const std::vector<Vec3f> kept = scene_.points.positions;
    scene_.points.positions.resize(5);
    const Scene few = read({.format = "npy"});
    scene_.points.positions.clear();
    PriorOptions inverse;
    inverse.quantity = PriorQuantity::inverse_depth;
    const Scene none = read({.format = "npy", .quantity = "inverse_depth"}, inverse);
    scene_.points.positions = kept;
    EXPECT_TRUE(said("not checked")) << said_;
    EXPECT_TRUE(said("only the order")) << said_;
    for (const Scene* scene : {&few, &none}) {
        EXPECT_EQ(find(scene->train[0], prior_map::kDepth), nullptr);
        const ViewMap& order = *find(scene->train[0], prior_map::kDepthOrder);
        int pairs = 0;
        for (std::size_t i = 0; i + 997 < order.values.size(); i += 7) {
            const float a = truth_[0].depth.pixels[i], b = truth_[0].depth.pixels[i + 997];
            if (std::isnan(order.values[i]) || std::isnan(order.values[i + 997]) ||
                std::abs(a - b) < 1e-3f)
                continue;
            EXPECT_EQ(a < b, order.values[i] < order.values[i + 997]);
            ++pairs;
        }
        EXPECT_GT(pairs, 200);
    }
}

TEST_F(Priors, ThatContradictWhatIsDeclaredAreRefused) {
    expect_refused({.format = "json", .quantity = "inverse_depth", .declare = "depth"},
                   "set the quantity (priors.quantity) to inverse_depth");
    expect_refused({.format = "json", .declare = "inverse_depth"},
                   "set the quantity (priors.quantity) to depth");
    expect_refused({.format = "json", .quantity = "log_depth", .declare = "depth"}, "log_depth");
    expect_depth(read({.format = "json", .quantity = "log_depth", .declare = "log_depth"}), 1e-3);
    PriorOptions forced;
    forced.quantity = PriorQuantity::inverse_depth;
    expect_refused({.format = "npy"}, "priors.quantity: inverse depth against", forced);
    forced.quantity = PriorQuantity::depth;
    expect_depth(read({.format = "npy"}, forced), 1e-3);
}

// Finds units that the files do not state.
TEST_F(Priors, InOtherUnits) {
    for (const char* format : {"colmap", "params"}) {
        const Scene scene = read({.format = format, .scale = 1.7});
        expect_depth(scene, 1e-3);
        EXPECT_TRUE(said("up to scale")) << said_;
    }
}

TEST_F(Priors, ThatFitNothingAreRefused) {
    const std::string dir = write({.format = "npy"});
    const fs::path maps = folder_ / "scene" / dir / "depth_npy";
    for (int i = 0; i < 5; ++i) {
        ImageF other(160, 120, 1);
        for (std::size_t k = 0; k < other.pixels.size(); ++k)
            other.pixels[k] = static_cast<float>((k * 7919) % 1009);
        write_npy(maps / str("000", i, "_pred.npy"), {120, 160}, other.pixels.data());
    }
    try {
        PriorOptions strict;
        strict.max_residual = 0.03f;
        read_folder(dir, strict);
        ADD_FAILURE() << said_;
    } catch (const Error& error) {
        const std::string what = error.what();
        EXPECT_NE(what.find("do not fit within priors.max_residual"), std::string::npos) << what;
        EXPECT_NE(what.find("inverse depth (affine) fits"), std::string::npos) << what;
    }
}

TEST_F(Priors, WithoutANumberAreLeftOutOrRefused) {
    const std::string dir = write({.format = "json"}) + "/priors";
    const auto empty = [&](int i) {
        const ImageF none(160, 120, 3, NAN);
        const fs::path priors = folder_ / "scene" / dir;
        write_npy(priors / str("depth/000", i, ".npy"), {120, 160}, none.pixels.data());
        write_npy(priors / str("normal/000", i, ".npy"), {120, 160, 3}, none.pixels.data());
    };
    empty(2);
    const Scene scene = read_folder(dir);
    EXPECT_TRUE(said("depth maps of 1 views have no valid number: 0002.png")) << said_;
    EXPECT_TRUE(said("normal maps of 1 views have no valid number: 0002.png")) << said_;
    EXPECT_EQ(find(scene.train[2], prior_map::kDepth), nullptr);
    EXPECT_EQ(find(scene.train[2], prior_map::kNormal), nullptr);
    EXPECT_NE(find(scene.train[1], prior_map::kNormal), nullptr);
    for (int i = 0; i < 5; ++i) empty(i);
    for (const std::string_view map : {prior_map::kDepth, prior_map::kNormal})
        EXPECT_THROW(
            try { read_folder(dir, {}, {map}); } catch (const Error& error) {
                EXPECT_EQ(error.code(), ExitCode::input);
                EXPECT_NE(std::string(error.what()).find("maps of 5 views have no valid number"),
                          std::string::npos)
                    << error.what();
                throw;
            },
            Error);
}

TEST_F(Priors, OfOneBadViewAreLeftOut) {
    const std::string dir = write({.format = "vggt"});
    const fs::path maps = folder_ / "scene" / dir / "depth_vggt";
    ImageF other(160, 120, 1);
    for (std::size_t k = 0; k < other.pixels.size(); ++k)
        other.pixels[k] = 1 + static_cast<float>((k * 7919) % 1009);
    write_npy(maps / "0002_pred.npy", {120, 160}, other.pixels.data());
    const Scene scene = read_folder(dir);
    EXPECT_TRUE(said("ignores the depth maps of 1 views")) << said_;
    EXPECT_TRUE(said("0002.png (")) << said_;
    EXPECT_TRUE(said("Priors: 4 depth maps of 5 views")) << said_;
    EXPECT_EQ(find(scene.train[2], prior_map::kDepth), nullptr);
    EXPECT_EQ(find(scene.train[2], prior_map::kDepthOrder), nullptr);
    EXPECT_NE(find(scene.train[1], prior_map::kDepth), nullptr);
}

// A map that fits no better than one depth, or one normal, for all points has no information,
// however small its error is in a shallow scene.
TEST_F(Priors, OfOtherPhotographsAreRefused) {
    const std::string dir = write({.format = "json"}) + "/priors";
    const fs::path priors = folder_ / "scene" / dir;
    const auto roll = [&](const char* kind, int by) {
        for (int i = 0; i < 5; ++i)
            fs::rename(priors / kind / str("000", i, ".npy"),
                       priors / kind / str("x", (i + by) % 5, ".npy"));
        for (int i = 0; i < 5; ++i)
            fs::rename(priors / kind / str("x", i, ".npy"), priors / kind / str("000", i, ".npy"));
    };
    const auto expect = [&](const char* text, const MapNames& wanted) {
        try {
            read_folder(dir, {}, wanted);
            ADD_FAILURE() << said_;
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
            EXPECT_NE(std::string(error.what()).find(text), std::string::npos) << error.what();
        }
    };
    roll("depth", 2);
    expect("of 5 depth maps fit the points hardly better", {prior_map::kDepth});
    roll("depth", 3);
    roll("normal", 2);
    expect("of 5 views fit the points hardly better", {prior_map::kNormal});
    roll("normal", 3);
    expect_depth(read_folder(dir), 1e-3);
}

// With a fitted shift, depths far beyond the points are uncertain; their order is not.
TEST_F(Priors, FarBeyondThePointsHaveAnOrderAlone) {
    const std::string dir = write({.format = "npy", .quantity = "inverse_depth"});
    const fs::path file = folder_ / "scene" / dir / "depth_npy/0001_pred.npy";
    ImageF map(160, 120, 1);
    for (std::size_t i = 0; i < map.pixels.size(); ++i)
        map.pixels[i] = truth_[1].depth.pixels[i] > 0 ? 1 / truth_[1].depth.pixels[i] + 3 : NAN;
    // Four times the farthest point is at most 30, a quarter of the nearest is 1.
    const std::pair<std::size_t, float> odd[] = {
        {0, 3 + 1 / 8.f}, {2, 3 + 1 / 80.f}, {4, 2.9f}, {6, 3 + 1 / 0.1f}};
    for (const auto& [at, value] : odd) map.pixels[at] = value;
    write_npy(file, {120, 160}, map.pixels.data());
    const Scene scene = read_folder(dir);
    const std::vector<float>&depth = find(scene.train[1], prior_map::kDepth)->values,
          &order = find(scene.train[1], prior_map::kDepthOrder)->values;
    EXPECT_NEAR(depth[0], 8, 0.05f);
    for (const std::size_t at : {2, 4, 6}) EXPECT_EQ(depth[at], 0) << at;
    EXPECT_EQ(order[2], order[4]);
    EXPECT_LT(order[0], order[2]);
    EXPECT_LT(order[6], order[0]);
    EXPECT_LT(order[6], 0);
}

TEST_F(Priors, OfAnUnlikelyScaleAreFitted) {
    const std::string dir = write({.format = "params"});
    const std::string file = folder_ / "scene" / dir / "sparse/0/depth_params.json";
    std::string text = contents(file);
    const std::size_t at = text.find("\"scale\": ", text.find("0002")) + 9;
    text.insert(at, "-");
    std::ofstream(file) << text;
    expect_depth(read_folder(dir), 1e-3);
    EXPECT_TRUE(said("in scene units inverse depth")) << said_;
}

TEST_F(Priors, NormalsThatFaceAwayAreDropped) {
    const std::string dir = write({.format = "npy"});
    const fs::path file = folder_ / "scene" / dir / "normal/0000_normal.npy";
    ImageF map = truth_[0].normal;
    const std::size_t pixel = 60 * 160 + 80;
    for (std::size_t i = 0; i < map.pixels.size() / 3; ++i) {
        float* const n = &map.pixels[3 * i];
        const Vec3f ray =
            pixel_ray(scene_.train[0].camera, static_cast<int>(i) % 160, static_cast<int>(i) / 160);
        const bool away = dot(Vec3f{n[0], n[1], n[2]}, ray) > 0;
        if (away != (i == pixel))
            for (int c = 0; c < 3; ++c) n[c] = -n[c];
    }
    write_npy(file, {120, 160, 3}, map.pixels.data());
    const Scene scene = read_folder(dir);
    const std::vector<float>& normal = find(scene.train[0], prior_map::kNormal)->values;
    EXPECT_EQ(normal[3 * pixel + 2], 0);
    EXPECT_LT(normal[3 * (pixel + 3) + 2], 0);
}

TEST_F(Priors, NormalsOfAnyFrame) {
    for (const auto& [name, away] : {std::pair{"camera_opencv", true},
                                     {"camera_opengl", false},
                                     {"world", false},
                                     {"world", true}}) {
        const std::string frame = name;
        SCOPED_TRACE(frame + (away ? " away" : ""));
        const Scene scene = read({.format = "npy", .frame = frame, .normals_away = away});
        expect_normals(scene, 0.99);
        EXPECT_TRUE(said(frame + (away ? ", facing away, within" : ", within"))) << said_;
    }
}

TEST_F(Priors, NormalsThatContradictWhatIsDeclaredAreRefused) {
    const std::string dir = write({.format = "json", .frame = "camera_opengl"});
    const std::string file = folder_ / "scene" / dir / "priors/priors.json";
    std::string text = contents(file);
    text.replace(text.find("\"layout\""), 0, "\"frame\": \"camera_opencv\", ");
    std::ofstream(file) << text;
    try {
        read_folder(dir + "/priors");
        ADD_FAILURE() << said_;
    } catch (const Error& error) {
        EXPECT_NE(std::string(error.what()).find("in frame camera_opengl with"), std::string::npos)
            << error.what();
    }
}

TEST_F(Priors, FeaturesKeepTheirSize) {
    const Scene scene = read({.format = "npy"});
    const ViewMap &fine = *find(scene.train[0], prior_map::kFeatures),
                  &coarse = *find(scene.train[0], prior_map::kCoarseFeatures);
    EXPECT_EQ(std::tuple(fine.width_px, fine.height_px, fine.channels), std::tuple(80, 60, 8));
    EXPECT_EQ(std::tuple(coarse.width_px, coarse.height_px, coarse.channels),
              std::tuple(40, 30, 8));
    // Channels are adjacent: of one pixel, eight sines of one position.
    double most = 0;
    for (int c = 0; c < 8; ++c) {
        float mean = 0;
        for (const int at : {0, 1, 80, 81})
            mean += fine.values[static_cast<std::size_t>((40 * 80 + 40 + at) * 8 + c)] / 4;
        const float half = coarse.values[static_cast<std::size_t>((20 * 40 + 20) * 8 + c)];
        EXPECT_NEAR(half, mean, 1e-6f) << c;
        most = std::max(most, std::abs(double(half)));
    }
    EXPECT_GT(most, 0.1);
}

TEST_F(Priors, TheSkyHasNone) {
    synth_.background = "sky";
    const std::string dir = write({.format = "json"});
    synth_.background = "empty";
    // Networks predict a depth for the sky, too.
    const fs::path maps = folder_ / "scene" / dir / "priors";
    for (std::size_t v = 0; v < scene_.train.size(); ++v) {
        std::vector<float> depth = truth_[v].depth.pixels, normal = truth_[v].normal.pixels;
        for (std::size_t i = 0; i < depth.size(); ++i)
            if (depth[i] == 0) depth[i] = 7, normal[3 * i + 2] = -1;
        const std::string name = fs::path(scene_.train[v].name).stem().string() + ".npy";
        write_npy(maps / "depth" / name, {120, 160}, depth.data());
        write_npy(maps / "normal" / name, {120, 160, 3}, normal.data());
    }
    const Scene scene = read_folder(dir + "/priors");
    for (const std::string_view name :
         {prior_map::kDepth, prior_map::kDepthOrder, prior_map::kNormal}) {
        const ViewMap& map = *find(scene.train[0], name);
        for (std::size_t i = 0; i < truth_[0].depth.pixels.size(); ++i) {
            const float value = map.values[i * static_cast<std::size_t>(map.channels) +
                                           static_cast<std::size_t>(map.channels) - 1];
            const bool none = name == prior_map::kDepthOrder ? std::isnan(value) : value == 0;
            EXPECT_EQ(none, truth_[0].depth.pixels[i] == 0) << name << ' ' << i;
            if (::testing::Test::HasFailure()) return;
        }
    }
}

TEST_F(Priors, AreReadOnlyWhereALossAsksForThem) {
    const std::string dir = write({.format = "npy"});
    EXPECT_TRUE(read_folder(dir, {}, {}).train[0].maps.empty());
    EXPECT_TRUE(said("no loss of this configuration uses them")) << said_;
    EXPECT_TRUE(read_folder("", {}, {}).train[0].maps.empty());
    EXPECT_EQ(said_, "");
    const Scene order = read_folder(dir, {}, {prior_map::kDepthOrder});
    ASSERT_EQ(order.train[0].maps.size(), 1u);
    EXPECT_EQ(order.train[0].maps[0].name, prior_map::kDepthOrder);
    PriorOptions none;
    none.source = PriorOptions::Source::none;
    EXPECT_TRUE(read_folder(dir, none).train[0].maps.empty());
}

TEST_F(Priors, ThatAreMissingAreSaid) {
    const Scene scene = read_folder("");
    EXPECT_TRUE(scene.train[0].maps.empty());
    EXPECT_EQ(said_, "") << "stereo may bring them, and what is missing in the end is an error";
    PriorOptions disk;
    disk.source = PriorOptions::Source::disk;
    try {
        read_folder("", disk);
        ADD_FAILURE() << said_;
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
    }
    EXPECT_THROW(read_folder("nowhere"), Error);
}

/// A term of another program that needs depth.
void add_depth_term() {
    static const bool once = [] {
        add_loss<Cpu>({"wants_depth", 1, {.view_maps = {prior_map::kDepth}}},
                      [](const LossContext&) { return nullptr; });
        return true;
    }();
    ASSERT_TRUE(once);
}

// A resumed run has the points of its checkpoint, so it gets the same maps, bit for bit.
TEST_F(Priors, OfARunAreThoseItBeganWith) {
    const std::string dir = write({.format = "npy", .quantity = "inverse_depth", .noise = 0.01});
    add_depth_term();
    Configuration asked;
    asked.table.set("scene.path", (folder_ / "scene").string(), "the test");
    asked.table.set("priors.dir", dir, "the test");
    asked.table.set("init.min_points", "0", "the test");
    const Scene fresh = resolve({}, asked, false).scene;
    ASSERT_NE(find(fresh.train[0], prior_map::kDepth), nullptr);
    Scene resumed = read_scene(asked.options.scene);
    resumed.points = {};
    resumed.points.positions = fresh.points.positions;
    provide_maps({}, asked.options, {}, resumed);
    for (std::size_t v = 0; v < fresh.train.size(); ++v)
        EXPECT_EQ(find(fresh.train[v], prior_map::kDepth)->values,
                  find(resumed.train[v], prior_map::kDepth)->values);
    EXPECT_EQ(fresh.train[0].maps.size(), 1u) << "nobody asks for more";
}

}  // namespace
}  // namespace tvsgs
