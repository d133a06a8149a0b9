// Reading of scenes: layouts, views, points, cameras.
#include <sys/stat.h>

#include "io/scene_reader_test.h"
#include "io/splats/ply.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

TEST_F(SceneReader, ReadsViewsPointsAndExtent) {
    const Scene scene = read();
    ASSERT_EQ(scene.train.size(), 4u);
    EXPECT_TRUE(scene.test.empty());
    const View& view = scene.train[3];
    EXPECT_EQ(view.name, "3.png");
    EXPECT_EQ(view.photo.pixels, ImageU8(8, 6, 3, 30).pixels);
    EXPECT_TRUE(view.mask.empty());
    EXPECT_EQ(view.camera.width_px, 8);
    EXPECT_EQ(view.camera.fy_px, 11);
    EXPECT_EQ(view.camera.cx_px, 4);
    EXPECT_EQ(camera_centre(view.camera).x, 3);
    EXPECT_EQ(point_names(scene), (std::set<float>{12, 234, 44, 0}));
    EXPECT_EQ(scene.points.colors[1].y, 1);
    EXPECT_FLOAT_EQ(scene.extent, 1.1f * 1.5f);
}

TEST_F(SceneReader, ChoosesViewsWithoutTheirPixels) {
    options.eval = true, options.test_every = 4;
    for (int i = 0; i < 4; ++i) write(str("images/", i, ".png"), "no picture");
    const ChosenViews chosen = choose_views(options);
    EXPECT_EQ(chosen.split.train, (std::vector<int>{1, 2, 3}));
    EXPECT_EQ(chosen.split.test, (std::vector<int>{0}));
    expect_input_error("images/1.png");

    for (int i = 0; i < 4; ++i) photo(str("images/", i, ".png"), 8, 6, 10);
    options.grey_scale = 0.5;  // affects only how views are read, so it may change here
    const Scene scene = load_scene(chosen, options);
    EXPECT_EQ(scene.train.size(), 3u);
    EXPECT_EQ(scene.test.size(), 1u);
    EXPECT_EQ(point_names(scene), (std::set<float>{234}));
}

TEST_F(SceneReader, PointsOfTestViewsDoNotLeak) {
    options.views = "0,1";
    Scene scene = read();
    EXPECT_EQ(point_names(scene), (std::set<float>{12}));
    EXPECT_FLOAT_EQ(scene.extent, 1.1f * 0.5f);  // of the training views
    options.views = "2,3";
    EXPECT_EQ(point_names(read()), (std::set<float>{234}));  // one image twice is one image
    options.views = "0,3";
    expect_input_error("E_NO_POINTS");
    options.need_points = false;
    EXPECT_TRUE(read().points.positions.empty());
    // Clouds beside the model do not tell which views see their points.
    options.need_points = true;
    write_cloud_ply((folder / "dense/fused.ply").string(), {{{7, 7, 7}}, {}, {}});
    expect_input_error("E_NO_POINTS");
    options.views.clear();
    EXPECT_EQ(point_names(read()), (std::set<float>{7}));
    options.eval = true;
    options.test_every = 4;
    scene = read();
    EXPECT_EQ(scene.test.size(), 1u);
    EXPECT_EQ(point_names(scene), (std::set<float>{234}));
}

TEST_F(SceneReader, InitialCloudIsCleaned) {
    options.init_ply = write(
        "cloud.ply",
        "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty "
        "float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
        "1 0 0 255 0 0\nnan 0 0 0 0 0\n1 0 -0 0 0 0\n2 0 0 0 255 0\n1e10 0 0 0 0 0\n1 0 0 0 0 0\n");
    const Scene scene = read();
    EXPECT_EQ(point_names(scene), (std::set<float>{1, 2}));
    ASSERT_EQ(scene.points.positions.size(),
              2u);  // the first of equal positions stays, in the order of the file
    EXPECT_EQ(scene.points.colors[0].x, 1);
    EXPECT_EQ(scene.points.colors[1].y, 1);
    options.init_ply = write("none.ply",
                             "ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty "
                             "float y\nproperty float z\nend_header\n");
    expect_input_error("E_NO_POINTS");
    options.init_ply = "/no/such.ply";
    expect_input_error("/no/such.ply");
}

TEST_F(SceneReader, NoPoints) {
    write("sparse/0/points3D.txt", "");
    expect_input_error("E_NO_POINTS");
    write_cloud_ply((folder / "sparse/0/points3D.ply").string(), {{{7, 7, 7}}, {}, {}});
    EXPECT_EQ(point_names(read()), (std::set<float>{7}));
}

TEST_F(SceneReader, Layouts) {
    for (const char* place : {"sparse", "dense/sparse", "colmap/sparse/0", "."}) {
        fs::create_directories(folder / place);
        for (const char* file : {"cameras.txt", "images.txt", "points3D.txt"})
            fs::rename(folder / "sparse/0" / file, folder / place / file);
        EXPECT_EQ(read().train.size(), 4u) << place;
        for (const char* file : {"cameras.txt", "images.txt", "points3D.txt"})
            fs::rename(folder / place / file, folder / "sparse/0" / file);
    }
    fs::remove(folder / "sparse/0/images.txt");
    expect_input_error("E_SCENE_LAYOUT");
    for (const char* tried : {"/sparse/0\n", "/sparse\n", "/dense/sparse\n", "/colmap/sparse/0\n"})
        expect_input_error(tried);
    write("transforms.json", "{}");
    expect_input_error("E_TRANSFORMS");  // detected as nerfstudio's
    options.format = SceneFormat::colmap;
    expect_input_error("/dense/sparse\n");
    options.format = SceneFormat::automatic;
    options.path = "/no/such/scene";
    expect_input_error("/no/such/scene: not found");
    expect_input_error("while reading scene /no/such/scene");
}

TEST_F(SceneReader, ImagesAreFoundByNameExtensionAndBaseName) {
    fs::rename(folder / "images", folder / "photos");
    expect_input_error("E_NO_IMAGES");
    options.images = "photos";
    EXPECT_EQ(read().train.size(), 4u);
    write("sparse/0/images.txt",
          "1 1 0 0 0 0 0 0 1 0.jpg\n\n2 1 0 0 0 1 0 0 1 cam/1.jpg\n\n3 1 0 0 0 2 0 0 1 "
          "a/2.png\n\n4 1 0 0 0 3 0 0 1 b/2.png\n\n");
    const Scene scene = read();  // 2.png could be either
    ASSERT_EQ(scene.train.size(), 2u);
    EXPECT_EQ(scene.train[1].name, "cam/1.jpg");
    EXPECT_EQ(scene.train[1].photo.at(0, 0), 10);
    photo("photos/b/2.png", 8, 6, 99);
    EXPECT_EQ(read().train.size(), 3u);
}

TEST_F(SceneReader, MissingImages) {
    fs::remove(folder / "images/1.png");
    EXPECT_EQ(read().train.size(), 3u);
    options.views = "0,1";
    expect_input_error("E_MISSING_IMAGE");
    options.views.clear();
    fs::remove(folder / "images/2.png"), fs::remove(folder / "images/3.png");
    expect_input_error("E_TOO_FEW_VIEWS");
    fs::remove(folder / "images/0.png");
    expect_input_error("E_NO_IMAGES");
}

TEST_F(SceneReader, WhatIsNoFileIsNamed) {
    fs::remove(folder / "images/1.png");
    fs::create_symlink("nothing", folder / "images/1.png");
    EXPECT_EQ(read().train.size(), 3u) << "missing";
    const auto photo = [&](const auto& make) {
        fs::remove(folder / "images/1.png");
        make(folder / "images/1.png");
        expect_input_error("images/1.png: ");
    };
    photo([](const fs::path& path) { ASSERT_EQ(::mkfifo(path.c_str(), 0600), 0); });
    photo([](const fs::path& path) { fs::create_directory(path); });
    photo([](const fs::path& path) { fs::create_symlink("1.png", path); });
    fs::create_symlink("masks", folder / "masks");
    expect_input_error("masks: Too many levels of symbolic links");
    fs::remove(folder / "masks"), fs::remove_all(folder / "images");
    fs::create_symlink("images", folder / "images");
    expect_input_error("images/0.png: cannot open it: Too many levels of symbolic links");
}

TEST_F(SceneReader, BrokenImage) {
    write("images/2.png", "no image");
    expect_input_error("images/2.png");
}

TEST_F(SceneReader, PosesAndNumbersOfViews) {
    write("sparse/0/images.txt", "1 1 0 0 0 nan 0 0 1 0.png\n\n2 1 0 0 0 1 0 0 1 1.png\n\n");
    expect_input_error("E_POSE_NAN");
    write("sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 0.png\n\n");
    expect_input_error("E_TOO_FEW_VIEWS");
    write("sparse/0/images.txt", "# none\n");
    expect_input_error("E_NO_IMAGES");
    // All cameras at one place: the extent is the median distance of the points to it.
    write("sparse/0/images.txt", "1 1 0 0 0 0 0 0 1 0.png\n\n2 1 0 0 0 0 0 0 1 1.png\n\n");
    write("sparse/0/points3D.txt", "1 0 0 5 0 0 0 0\n2 0 0 6 0 0 0 0\n3 0 0 70 0 0 0 0\n");
    EXPECT_EQ(read().extent, 6);
}

TEST_F(SceneReader, ExampleModel) {
    fs::remove_all(folder / "sparse");
    fs::create_directories(folder / "sparse");
    fs::copy(kExample / "colmap", folder / "sparse/0");
    fs::permissions(folder / "sparse/0", fs::perms::owner_all);
    photo("images/a/0001.png", 640, 480, 1);
    photo("images/b/0001.png", 320, 240, 2);
    const Scene scene = read();
    ASSERT_EQ(scene.train.size(), 2u);
    EXPECT_EQ(scene.train[1].photo.at(0, 0), 2);
    EXPECT_NEAR(scene.extent, 2.0579115627, 1e-6);  // EXPECTED.txt; centres are floats here
    EXPECT_EQ(scene.points.positions.size(), 2u);
}

class RealScenes : public testing::Test {
protected:
    static SceneOptions at(const char* name, const char* split) {
        SceneOptions options;
        options.path = (kShared / "data" / name).string();
        options.split = split;
        return options;
    }
    static bool absent(const SceneOptions& options) { return !fs::exists(options.path); }
};

TEST_F(RealScenes, DtuScan24) {
    SceneOptions options = at("dtu_scan24", "train_3");
    options.images = "image";
    if (absent(options)) GTEST_SKIP() << "absent: " << options.path;
    const Scene scene = read_scene(options);
    ASSERT_EQ(scene.train.size(), 3u);
    EXPECT_EQ(scene.test.size(), 25u);
    EXPECT_EQ(scene.train[0].name, "000022.jpg");
    for (const View& view : scene.train) {
        EXPECT_EQ(view.photo.width, 800);
        EXPECT_EQ(view.photo.height, 600);
        EXPECT_EQ(view.mask.width, 800);  // mask/022.png
    }
    EXPECT_FLOAT_EQ(scene.train[0].camera.fx_px, 1446.165911f);
    EXPECT_GT(scene.points.positions.size(), 100u);
    options.split = "large_overlap_train_3";
    options.resolution = 8;
    EXPECT_EQ(read_scene(options).test.size(), 22u);
}

TEST_F(RealScenes, Fountain) {
    const SceneOptions options = at("fountain-P11", "train_7");
    if (absent(options)) GTEST_SKIP() << "absent: " << options.path;
    const Scene scene = read_scene(options);
    EXPECT_EQ(scene.train.size(), 7u);
    EXPECT_EQ(scene.test.size(), 4u);
    EXPECT_EQ(scene.train[0].photo.width, 1536);
    EXPECT_EQ(scene.train[0].photo.height, 1024);
    EXPECT_TRUE(scene.train[0].mask.empty());
    EXPECT_GT(scene.points.positions.size(), 1000u);
}

TEST_F(RealScenes, StoneBustWithAGivenCloud) {
    SceneOptions options = at("stone_bust", "train_3");
    if (absent(options)) GTEST_SKIP() << "absent: " << options.path;
    options.init_ply = options.path + "/init/train_3.ply";
    options.resolution = 4;
    const Scene scene = read_scene(options);
    EXPECT_EQ(scene.train.size(), 3u);
    EXPECT_EQ(scene.test.size(), 8u);
    EXPECT_EQ(scene.train[0].photo.width, 200);
    EXPECT_EQ(scene.train[0].mask.height, 150);
    EXPECT_LE(scene.points.positions.size(), 150000u);
    EXPECT_GT(scene.points.positions.size(), 149000u);  // few repeated positions
    EXPECT_EQ(scene.points.colors.size(), scene.points.positions.size());
    EXPECT_GT(scene.extent, 0);
}

}  // namespace
}  // namespace tvsgs
