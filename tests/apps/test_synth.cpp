// tvsgs-synth as a user runs it: what it writes agrees with itself and with the readers.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "io/image_file.h"
#include "io/ply.h"
#include "io/scene_reader.h"
#include "mesh/mesh_render.h"

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
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_synth_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(synth("--out " + scene() + " --views 12 --width 80 --height 60"), 0);
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }
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

// The ground truth is exact: the mesh, seen by the cameras as read, is the photographs and masks.
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
            // 0.003 of noise at distance 3.3 to 5.7 is 0.09 px here; five of those.
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

}  // namespace
}  // namespace tvsgs
