// tvsgs-synth: its files agree with each other and with the readers.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "io/files/json_value.h"
#include "io/images/image_file.h"
#include "io/scene/crop_file.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"
#include "mesh/draw/mesh_render.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

int synth(const std::string& arguments) {
    const std::string log = testing::TempDir() + "synth.log";
    const int status =
        std::system((TVSGS_BIN_DIR "/tvsgs-synth " + arguments + " 2>" + log).c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

std::string contents(const fs::path& path) {
    std::ifstream in(path, std::ios::binary);
    std::ostringstream out;
    out << in.rdbuf();
    return out.str();
}

class Synth : public testing::Test {
protected:
    static void SetUpTestSuite() {
        make_folder();
        ASSERT_EQ(synth("--out " + scene() + " --views 12 --width 80 --height 60"), 0);
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }
    static void make_folder() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_synth_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
    }
    static std::string scene() { return folder_ / "scene"; }
    static std::string other(const std::string& name) { return folder_ / name; }

    static inline fs::path folder_;
};

TEST_F(Synth, IsReadAsAScene) {
    SceneOptions options;
    options.path = scene();
    options.split = "train_9";
    const Scene read = read_scene(options);
    EXPECT_EQ(read.train.size(), 9u);
    ASSERT_FALSE(read.test.empty());
    for (const View& test : read.test)
        for (const View& train : read.train) EXPECT_NE(test.name, train.name);
    EXPECT_GT(read.points.positions.size(), 1000u);
    EXPECT_EQ(read.train[0].photo.width, 80);
    EXPECT_FALSE(read.train[0].mask.empty());

    options.split = "train_3";
    const Scene sparse = read_scene(options);
    EXPECT_EQ(sparse.train.size(), 3u);
    EXPECT_GT(sparse.points.positions.size(), 300u);
    EXPECT_LT(sparse.points.positions.size(), read.points.positions.size());
}

// The ground truth is exact: the mesh rendered with the cameras as read equals photographs and
// masks.
TEST_F(Synth, MeshAndCamerasExplainThePhotographs) {
    const PlyContents ply = read_ply(scene() + "/gt/mesh.ply");
    const TriangleMesh mesh{ply.points.positions, ply.points.colors, ply.faces};
    SceneOptions options;
    options.path = scene();
    options.split = "train_9";
    const Scene read = read_scene(options);
    for (const View& view : {read.train[0], read.train[5], read.test[0]}) {
        const ImageU8 image = to_8bit(render_mesh(mesh, view.camera, {.supersampling = 3}).color);
        ASSERT_EQ(image.pixels.size(), view.photo.pixels.size());
        double difference = 0;
        for (std::size_t i = 0; i < image.pixels.size(); ++i)
            difference += std::abs(static_cast<double>(image.pixels[i]) - view.photo.pixels[i]);
        // Colours in the file have 8 bits; half a step each way, plus single samples on edges.
        EXPECT_LT(difference / static_cast<double>(image.pixels.size()), 0.75) << view.name;
    }
}

// The same for each lens: undistorted photographs equal the pinhole's image, and points are where
// the model projects them.
TEST_F(Synth, LensesAreUndoneByTheReaders) {
    for (const char* const lens : {"FULL_OPENCV", "FOV", "OPENCV_FISHEYE", "THIN_PRISM_FISHEYE"}) {
        const std::string name = other("lens");
        ASSERT_EQ(synth("--out " + name +
                        " --views 2 --width 120 --height 90 --points 500 --lens " + lens),
                  0);
        const PlyContents ply = read_ply(name + "/gt/mesh.ply");
        const TriangleMesh mesh{ply.points.positions, ply.points.colors, ply.faces};
        SceneOptions options;
        options.path = name;
        const Scene read = read_scene(options);
        const View& view = read.train[0];
        const ImageU8 image = to_8bit(render_mesh(mesh, view.camera, {.supersampling = 3}).color);
        const ImageU8 bent = read_image(name + "/images/" + view.name, 3);
        double undone = 0, left = 0;
        int seen = 0;
        for (std::size_t i = 0; i < image.pixels.size(); ++i) {
            // The background, and parts outside of the lens's view.
            if (view.photo.pixels[i] == 0) continue;
            ++seen;
            undone += std::abs(static_cast<double>(image.pixels[i]) - view.photo.pixels[i]);
            left += std::abs(static_cast<double>(image.pixels[i]) - bent.pixels[i]);
        }
        ASSERT_GT(seen, 5000) << lens;
        // Interpolated once: the texture is slightly blurred, but in place.
        EXPECT_LT(undone / seen, 4) << lens;
        EXPECT_GT(left / seen, 2 * undone / seen) << lens;
        fs::remove_all(name);
    }
    EXPECT_EQ(synth("--out " + other("lens") + " --views 2 --lens PINHOLE --width 32 --height 24"),
              0);
    EXPECT_EQ(synth("--out " + other("bad") + " --views 2 --lens FISH"), 2);
    EXPECT_EQ(synth("--out " + other("bad") + " --views 2 --lens FOV --priors vggt"), 2);
}

TEST_F(Synth, PointsLieNearTheSurface) {
    const PlyContents truth = read_ply(scene() + "/gt/points.ply");
    const PlyContents sparse_truth = read_ply(scene() + "/gt/points_train_3.ply");
    EXPECT_GT(truth.points.positions.size(), 2 * sparse_truth.points.positions.size() / 3);
    EXPECT_GT(sparse_truth.points.positions.size(), 5000u);
    SceneOptions options;
    options.path = scene();
    options.split = "train_all";
    const Scene read = read_scene(options);
    double sum = 0;
    const std::size_t count = 200;
    for (std::size_t i = 0; i < count; ++i) {
        const Vec3f p = read.points.positions[i * read.points.positions.size() / count];
        float nearest = 1e30f;
        for (const Vec3f& q : truth.points.positions) nearest = std::min(nearest, norm(p - q));
        sum += static_cast<double>(nearest);
    }
    // The noise is 0.003 per axis (0.005 in length) and the samples are about 0.01 apart.
    EXPECT_LT(sum / count, 0.012);
}

// Each observation in images.txt is where its camera sees the point, up to the points' noise.
TEST_F(Synth, TracksPointAtTheirPoints) {
    SceneOptions options;
    options.path = scene();
    options.split = "train_all";
    const Scene read = read_scene(options);
    std::vector<Vec3f> positions;
    std::istringstream points(contents(scene() + "/sparse/0/points3D.txt"));
    for (std::string line; std::getline(points, line);) {
        if (line.starts_with('#')) continue;
        std::istringstream fields(line);
        std::size_t id = 0;
        Vec3f p;
        fields >> id >> p.x >> p.y >> p.z;
        ASSERT_EQ(id, positions.size() + 1);
        positions.push_back(p);
    }
    std::istringstream images(contents(scene() + "/sparse/0/images.txt"));
    int checked = 0;
    for (std::string line; std::getline(images, line);) {
        if (line.starts_with('#')) continue;
        const std::string name = line.substr(line.rfind(' ') + 1);
        std::getline(images, line);
        const auto view = std::find_if(read.train.begin(), read.train.end(),
                                       [&](const View& v) { return v.name == name; });
        if (view == read.train.end()) continue;
        std::istringstream observations(line);
        double x = 0, y = 0;
        for (std::size_t id = 0; observations >> x >> y >> id; ++checked) {
            const Vec3f p = view->camera.camera_from_world * positions.at(id - 1);
            // 0.003 of noise at distance 3.3 to 5.7 is 0.09 px here; five standard deviations.
            ASSERT_NEAR(view->camera.fx_px * p.x / p.z + view->camera.cx_px, x, 0.45)
                << name << ' ' << id;
            ASSERT_NEAR(view->camera.fy_px * p.y / p.z + view->camera.cy_px, y, 0.45)
                << name << ' ' << id;
        }
    }
    EXPECT_GT(checked, 5000);
}

TEST_F(Synth, SameSeedSameFiles) {
    const std::string flags = " --views 2 --width 32 --height 24 --shape spheres --noise 2 --seed ";
    ASSERT_EQ(synth("--out " + other("a") + flags + "5"), 0);
    ASSERT_EQ(synth("--out " + other("b") + flags + "5"), 0);
    ASSERT_EQ(synth("--out " + other("c") + flags + "6"), 0);
    for (const char* file :
         {"images/0001.png", "sparse/0/points3D.txt", "gt/points.ply", "splits.json"})
        EXPECT_EQ(contents(fs::path(other("a")) / file), contents(fs::path(other("b")) / file))
            << file;
    EXPECT_NE(contents(other("a") + "/images/0001.png"), contents(other("c") + "/images/0001.png"));
}

TEST_F(Synth, RefusesAndLeavesNothingBehind) {
    EXPECT_EQ(synth("--out " + scene()), 2) << "an existing scene needs --overwrite";
    EXPECT_EQ(synth("--out " + other("x") + " --shape cow"), 2);
    EXPECT_EQ(synth("--out " + other("x") + " --veiws 3"), 2);
    EXPECT_EQ(synth("--out " + other("x") + " --views 1"), 2);
    EXPECT_EQ(synth("--out " + other("x") + " --views 5 --test-views 4"), 2);
    for (const char* flag :
         {"--elevation-span 57", "--points -1", "--texture 1.1", "--shininess -1",
          "--background room", "--exposure-drift 1", "--noise -1", "--arc 361"})
        EXPECT_EQ(synth("--out " + other("x") + " " + flag), 2) << flag;
    EXPECT_EQ(synth(""), 2);
    EXPECT_FALSE(fs::exists(other("x")));

    std::ofstream(other("file")) << "not a folder";
    EXPECT_EQ(synth("--out " + other("file") + "/scene --views 2 --width 16 --height 16"), 6);
    EXPECT_EQ(contents(other("file")), "not a folder");

    fs::create_directories(other("foreign"));
    std::ofstream(other("foreign") + "/thesis.txt") << "precious";
    EXPECT_EQ(synth("--overwrite --out " + other("foreign")), 2);
    EXPECT_EQ(contents(other("foreign") + "/thesis.txt"), "precious");
}

// Scenes without switches stay the same.
TEST_F(Synth, DefaultsKeepTheirPictures) {
    ASSERT_EQ(synth("--out " + other("spelled") +
                    " --views 12 --width 80 --height 60 --elevation-span 36 --points 8000"
                    " --texture 1 --shininess 0 --background empty --masks --exposure-drift 0"
                    " --noise 0 --seed 1 --arc 360 --shape bust"),
              0);
    for (const auto& entry : fs::recursive_directory_iterator(scene())) {
        if (!entry.is_regular_file()) continue;
        const fs::path file = entry.path().lexically_relative(scene());
        EXPECT_EQ(contents(fs::path(other("spelled")) / file), contents(entry.path())) << file;
    }

    const ImageU8 photo = read_image(scene() + "/images/0006.png", 3);
    double sums[3] = {};  // one per channel; each pixel weighted by its position
    for (std::size_t i = 0; i < photo.pixels.size(); ++i)
        sums[i % 3] += static_cast<double>(i % 101) / 101 * photo.pixels[i];
    // Another compiler may round a few pixels the other way, each worth up to 1.
    EXPECT_NEAR(sums[0], 69537.7, 10);
    EXPECT_NEAR(sums[1], 74708.6, 10);
    EXPECT_NEAR(sums[2], 80210.5, 10);
    std::istringstream images(contents(scene() + "/sparse/0/images.txt"));
    std::string line;
    for (int i = 0; i < 3; ++i) std::getline(images, line);  // after two lines of comment
    std::istringstream fields(line);
    for (const double expected :
         {1.0, 0.43533840411808733, 0.55720774752323488, -0.55720774752323476, 0.43533840411808727,
          0.0, 0.82475136733459675, 4.705633611259719}) {
        double value = 0;
        fields >> value;
        EXPECT_NEAR(value, expected, 1e-12);  // sines and cosines of another C library
    }
}

// Many objects on uneven ground, from two heights: the surface explains the photographs, the box
// contains it, and the views see nearly all surface that faces up.
TEST_F(Synth, WideScenesAreExactAndSeen) {
    const std::string wide = other("wide");
    ASSERT_EQ(synth("--quiet --out " + wide + " --wide 5 --views 16 --width 64 --height 48"), 0);
    const PlyContents ply = read_ply(wide + "/gt/mesh.ply");
    const TriangleMesh mesh{ply.points.positions, ply.points.colors, ply.faces};
    SceneOptions options;
    options.path = wide;
    options.split = "train_all";
    const Scene read = read_scene(options);
    ASSERT_EQ(read.train.size() + read.test.size(), 16u);
    for (const View& view : {read.train[0], read.train[5], read.test[0]}) {
        const ImageU8 image = to_8bit(render_mesh(mesh, view.camera, {.supersampling = 3}).color);
        double difference = 0;
        for (std::size_t i = 0; i < image.pixels.size(); ++i)
            difference += std::abs(static_cast<double>(image.pixels[i]) - view.photo.pixels[i]);
        EXPECT_LT(difference / static_cast<double>(image.pixels.size()), 0.75) << view.name;
    }

    const Crop box = read_crop(wide + "/gt/info.json");
    float lowest = 1e9f, highest = -1e9f, rim_low = 1e9f, rim_high = -1e9f;
    for (const Vec3f v : mesh.vertices) {
        EXPECT_TRUE(contains(box, vec_cast<double>(v)));
        lowest = std::min(lowest, v.z), highest = std::max(highest, v.z);
        if (std::max(std::abs(v.x), std::abs(v.y)) < 2.4999f) continue;
        rim_low = std::min(rim_low, v.z), rim_high = std::max(rim_high, v.z);
    }
    EXPECT_GT(highest - lowest, 0.8f);     // objects
    EXPECT_GT(rim_high - rim_low, 0.05f);  // relief, of the ground alone

    int low = 0, high = 0;
    for (const View& view : read.train) (camera_centre(view.camera).z < 4.6f ? low : high) += 1;
    EXPECT_GE(low, 6);
    EXPECT_GE(high, 6);
    int up = 0, seen = 0;
    for (std::size_t f = 0; f < mesh.faces.size(); f += 97) {
        const Vec3i face = mesh.faces[f];
        const Vec3f a = mesh.vertices[static_cast<std::size_t>(face.x)];
        const Vec3f n = normalize(cross(mesh.vertices[static_cast<std::size_t>(face.y)] - a,
                                        mesh.vertices[static_cast<std::size_t>(face.z)] - a));
        if (n.z < 0.9f) continue;
        int views = 0;
        for (const View& view : read.train) views += is_in_view(view.camera, a);
        ++up, seen += views >= 3;
    }
    EXPECT_GT(seen, 0.95 * up) << up;

    // Another side, other sizes; with highlights, refused.
    EXPECT_EQ(synth("--quiet --out " + other("x") + " --wide 5 --views 4 --shininess 1"), 2);
    EXPECT_EQ(synth("--quiet --out " + other("x") + " --wide 1 --views 4"), 2);
    EXPECT_FALSE(fs::exists(other("x")));
}

/// A small frontal scene, with and without switches.
class Switches : public Synth {
protected:
    static void SetUpTestSuite() {
        make_folder();
        plain_ = make("plain", "");
    }
    static std::string folder(const std::string& name) { return other("switches_" + name); }
    static Scene make(const std::string& name, const std::string& flags) {
        EXPECT_EQ(synth("--quiet --out " + folder(name) +
                        " --shape torus --views 5 --test-views 1 --arc 40 --width 64 --height 48 " +
                        flags),
                  0);
        SceneOptions options;
        options.path = folder(name);
        options.split = "train_all";
        options.points_required = false;
        return read_scene(options);
    }
    static TriangleMesh surface() {
        const PlyContents ply = read_ply(folder("plain") + "/gt/mesh.ply");
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
    EXPECT_FALSE(fs::exists(folder("flat") + "/masks"));
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
        parse_json_value(contents(folder("drift") + "/gt/info.json"), "info.json");
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
    const std::vector<Vec3f> none = read_ply(folder("grey") + "/gt/mesh.ply").points.colors;
    const std::vector<Vec3f> half = read_ply(folder("half") + "/gt/mesh.ply").points.colors;
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
