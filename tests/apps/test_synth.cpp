// tvsgs-synth: its files agree with each other and with the readers.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "apps/synth_test.h"
#include "io/images/image_file.h"
#include "io/scene/crop_file.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"
#include "mesh/draw/mesh_render.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

class Synth : public SynthTest {
protected:
    static void SetUpTestSuite() {
        SynthTest::SetUpTestSuite();
        ASSERT_EQ(synth("--out " + scene() + " --views 12 --width 80 --height 60"), 0);
    }
    static std::string scene() { return other("scene"); }
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

}  // namespace
}  // namespace tvsgs
