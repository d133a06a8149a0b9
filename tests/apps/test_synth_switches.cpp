// tvsgs-synth: each switch changes a scene as documented.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <utility>
#include <vector>

#include "apps/synth_test.h"
#include "io/files/json_value.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"
#include "mesh/draw/mesh_render.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// A small frontal scene, with and without switches.
class Switches : public SynthTest {
protected:
    static void SetUpTestSuite() {
        SynthTest::SetUpTestSuite();
        plain_ = make("plain", "");
    }
    static Scene make(const std::string& name, const std::string& flags) {
        EXPECT_EQ(synth("--quiet --out " + other(name) +
                        " --shape torus --views 5 --test-views 1 --arc 40 --width 64 --height 48 " +
                        flags),
                  0);
        SceneOptions options;
        options.path = other(name);
        options.split = "train_all";
        options.points_required = false;
        return read_scene(options);
    }
    static TriangleMesh surface() {
        const PlyContents ply = read_ply(other("plain") + "/gt/mesh.ply");
        return {ply.points.positions, ply.points.colors, ply.faces};
    }

    static inline Scene plain_;
};

/// Degrees around and above the target of all cameras.
std::pair<double, double> direction_deg(const View& view) {
    const Vec3f d = camera_centre(view.camera) - Vec3f{0, 0, 0.85f};
    const double degree = std::acos(-1.0) / 180;
    return {std::atan2(d.y, d.x) / degree, std::asin(d.z / norm(d)) / degree};
}

TEST_F(Switches, ViewsMasksAndPointsAreAsAsked) {
    ASSERT_EQ(plain_.train.size(), 4u);
    ASSERT_EQ(plain_.test.size(), 1u);
    // Positions go through float at distance 4.5: 1e-5 degrees.
    EXPECT_NEAR(direction_deg(plain_.train.back()).first - direction_deg(plain_.train[0]).first, 40,
                1e-3);
    EXPECT_NEAR(direction_deg(plain_.train[0]).second, 14, 1e-3);
    EXPECT_NEAR(direction_deg(plain_.train[1]).second, 32, 1e-3);
    EXPECT_NEAR(direction_deg(plain_.test[0]).second, 50, 1e-3);

    const Scene flat = make("flat", "--elevation-span 2 --test-views 0 --points 2000 --no-masks");
    EXPECT_FALSE(fs::exists(other("flat") + "/masks"));
    EXPECT_TRUE(flat.train[0].mask.empty());
    EXPECT_EQ(flat.train.size(), 5u);
    EXPECT_TRUE(flat.test.empty());
    EXPECT_NEAR(direction_deg(flat.train[0]).second, 31, 1e-3);
    EXPECT_NEAR(direction_deg(flat.train[2]).second, 33, 1e-3);
    // As dense on the visible surface; this is a fourth of the samples, and the views differ
    // slightly.
    EXPECT_NEAR(static_cast<double>(flat.points.positions.size()) / 2000,
                static_cast<double>(plain_.points.positions.size()) / 8000, 0.1);
}

TEST_F(Switches, ExposureDriftsAsWritten) {
    const Scene drift = make("drift", "--exposure-drift 0.3");
    const JsonValue info =
        parse_json_value(contents(other("drift") + "/gt/info.json"), "info.json");
    double least = 2, most = 0;
    for (std::size_t i = 0; i < drift.train.size(); ++i) {
        const std::size_t number = std::stoul(drift.train[i].name);
        const double gain = info["exposure_gains"].items.at(number).number;
        least = std::min(least, gain), most = std::max(most, gain);
        double sum = 0, plain_sum = 0;
        const ImageU8& plain = plain_.train[i].photo;
        for (std::size_t k = 0; k < plain.pixels.size(); ++k) {
            if (plain.pixels[k] > 190) continue;  // would saturate at 255
            plain_sum += plain.pixels[k], sum += drift.train[i].photo.pixels[k];
        }
        // Rounding errors of thousands of values average out; half a grey level on all would be 0.5
        // of a mean near 80.
        EXPECT_NEAR(sum / plain_sum, gain, 0.003) << number;
    }
    EXPECT_GE(least, 0.7 - 1e-6);
    EXPECT_LE(most, 1.3 + 1e-6);
    EXPECT_GT(most - least, 0.3);
}

// Where a highlight is brightest, the normal is that of a mirror; another view shows no highlight
// there.
TEST_F(Switches, HighlightsMoveWithTheView) {
    constexpr float kStrength = 0.6f;
    const Scene shiny = make("shiny", "--shininess 0.6");
    const auto added = [&](std::size_t view, int x, int y) {
        int least = 255;  // of the channels; none then saturates at 255
        for (int c = 0; c < 3; ++c)
            least = std::min(
                least, shiny.train[view].photo.at(x, y, c) - plain_.train[view].photo.at(x, y, c));
        return least;
    };
    std::vector<MeshRender> renders;
    for (const View& view : shiny.train) renders.push_back(render_mesh(surface(), view.camera));
    const Vec3f to_light = normalize(Vec3f{0.7f, -0.5f, 1.1f});
    int moved = 0;
    for (std::size_t view = 0; view < shiny.train.size(); ++view) {
        const Camera& camera = shiny.train[view].camera;
        int best = 0, best_x = 0, best_y = 0;
        for (int y = 0; y < camera.height_px; ++y)
            for (int x = 0; x < camera.width_px; ++x) {
                ASSERT_GE(added(view, x, y), 0);
                if (added(view, x, y) > best) best = added(view, x, y), best_x = x, best_y = y;
            }
        ASSERT_GT(best, 60) << "a highlight of 0.6 is up to 153 grey levels";
        EXPECT_LE(static_cast<float>(best), 255 * kStrength + 1);

        const MeshRender& render = renders[view];
        const Vec3f ray = pixel_ray(camera, best_x, best_y);
        const Vec3f point =
            inverse(camera.camera_from_world) * (render.depth.at(best_x, best_y) * ray);
        Vec3f normal;
        for (int c = 0; c < 3; ++c) normal[c] = render.normal.at(best_x, best_y, c);
        normal = transpose_times(camera.camera_from_world.R, normal);
        const Vec3f half = normalize(normalize(camera_centre(camera) - point) + to_light);
        // A pixel covers many degrees of the small torus; the lobe falls to half at 12.
        EXPECT_GT(dot(normal, half), std::cos(12 * std::acos(-1.0) / 180)) << view;

        for (std::size_t from = 0; from < shiny.train.size(); ++from) {
            const Camera& seen_by = shiny.train[from].camera;
            ASSERT_TRUE(is_in_view(seen_by, point));
            const Vec3f p = seen_by.camera_from_world * point;
            const int x = static_cast<int>(seen_by.fx_px * p.x / p.z + seen_by.cx_px);
            const int y = static_cast<int>(seen_by.fy_px * p.y / p.z + seen_by.cy_px);
            // Skips hidden points. A pixel is 0.06 wide.
            if (std::abs(renders[from].depth.at(x, y) - p.z) > 0.06f) continue;
            if (added(from, x, y) < best / 2) ++moved;
        }
    }
    EXPECT_GE(moved, 4) << "points bright in one view and not in another";
}

TEST_F(Switches, MasksCoverWhatIsSeen) {
    TriangleMesh white = surface();
    white.colors.clear();
    for (const View& view : plain_.train) {
        const ImageU8 share = to_8bit(render_mesh(white, view.camera, {.supersampling = 3}).color);
        ASSERT_EQ(view.mask.pixels.size(), share.pixels.size() / 3);
        for (std::size_t i = 0; i < view.mask.pixels.size(); ++i)
            ASSERT_EQ(view.mask.pixels[i], share.pixels[3 * i] > 127 ? 255 : 0) << view.name;
    }
}

TEST_F(Switches, SkyFillsTheRestAndHasNoParallax) {
    const Scene sky = make("sky", "--background sky --elevation-span 0");
    // A direction has one colour in all views, and another one ten pixels on.
    double same = 0, shifted = 0;
    int count = 0;
    const Camera &from = sky.train[1].camera, &to = sky.train[2].camera;
    const auto is_sky = [&](std::size_t view, int x, int y) {
        return sky.train[view].mask.at(x, y) == 0;
    };
    for (int y = 0; y < from.height_px; ++y)
        for (int x = 0; x < from.width_px; ++x) {
            if (!is_sky(1, x, y)) continue;
            ASSERT_GT(sky.train[1].photo.at(x, y, 2), 4);  // five ninths, at least, of 0.04 x 255
            const Vec3f p = to.camera_from_world.R *
                            transpose_times(from.camera_from_world.R, pixel_ray(from, x, y));
            const int u = static_cast<int>(std::floor(to.fx_px * p.x / p.z + to.cx_px));
            const int v = static_cast<int>(std::floor(to.fy_px * p.y / p.z + to.cy_px));
            if (p.z <= 0 || u < 0 || v < 0 || u + 10 >= to.width_px || v >= to.height_px) continue;
            if (!is_sky(2, u, v) || !is_sky(2, u + 10, v)) continue;
            const int here = sky.train[1].photo.at(x, y, 1);
            same += std::abs(here - sky.train[2].photo.at(u, v, 1));
            shifted += std::abs(here - sky.train[2].photo.at(u + 10, v, 1));
            ++count;
        }
    EXPECT_GT(count, 100);
    EXPECT_LT(same, 0.6 * shifted);  // not 0: the nearest pixel is up to half a pixel off
}

TEST_F(Switches, NoiseHasItsDeviation) {
    const Scene noisy = make("noisy", "--noise 4");
    double sum = 0, squares = 0;
    int count = 0;
    for (std::size_t i = 0; i < noisy.train.size(); ++i)
        for (std::size_t k = 0; k < noisy.train[i].photo.pixels.size(); ++k) {
            const double plain = plain_.train[i].photo.pixels[k];
            if (plain < 30 || plain > 225) continue;  // the noise could saturate at 0 or 255
            const double d = noisy.train[i].photo.pixels[k] - plain;
            sum += d, squares += d * d, ++count;
        }
    ASSERT_GT(count, 5000);
    // Standard errors of both at 5,000 values: 0.06 and 0.04.
    EXPECT_NEAR(sum / count, 0, 0.2);
    EXPECT_NEAR(std::sqrt(squares / count), 4, 0.15);
}

TEST_F(Switches, TextureScalesTheContrast) {
    const Scene grey = make("grey", "--texture 0");
    make("half", "--texture 0.5");
    for (const View& view : grey.train)
        for (std::size_t k = 0; k < view.photo.pixels.size(); k += 3) {
            ASSERT_EQ(view.photo.pixels[k], view.photo.pixels[k + 1]);
            ASSERT_EQ(view.photo.pixels[k], view.photo.pixels[k + 2]);
        }
    // Light times colour is linear in the contrast, up to 8 bits in each file and saturation at 1.
    const std::vector<Vec3f> full = surface().colors;
    const std::vector<Vec3f> none = read_ply(other("grey") + "/gt/mesh.ply").points.colors;
    const std::vector<Vec3f> half = read_ply(other("half") + "/gt/mesh.ply").points.colors;
    ASSERT_EQ(full.size(), half.size());
    float contrast = 0;
    for (std::size_t i = 0; i < full.size(); ++i)
        for (int c = 0; c < 3; ++c) {
            contrast = std::max(contrast, std::abs(full[i][c] - none[i][c]));
            if (full[i][c] >= 1) continue;
            ASSERT_NEAR(half[i][c], (none[i][c] + full[i][c]) / 2, 1.01f / 255);
        }
    EXPECT_GT(contrast, 0.3f);
}

}  // namespace
}  // namespace tvsgs
