// Tests layouts other than COLMAP's: they give the same Scene, and bad input gives an error.
#include <zip.h>

#include <cmath>
#include <map>

#include "io/images/image_file.h"
#include "io/io_test.h"
#include "io/scene/colmap.h"
#include "io/scene/scene_layout.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

class SceneLayouts : public IoTest {
protected:
    SceneOptions options;

    void SetUp() override {
        IoTest::SetUp();
        options.path = folder.string();
        options.need_points = false;
    }
    void photo(const std::string& name, int width, int height, int channels = 3) const {
        fs::create_directories((folder / name).parent_path());
        replace_png((folder / name).string(), ImageU8(width, height, channels, 100));
    }
    Scene read() const { return read_scene(options); }
    void expect_input_error(const std::string& text) const {
        expect_error(ExitCode::input, text, [&] { read(); });
    }
    static void expect_centre(const View& view, Vec3f centre, Vec3d origin = {}) {
        const Vec3f found = vec_cast<float>(vec_cast<double>(camera_centre(view.camera)) + origin);
        for (int a = 0; a < 3; ++a)  // float, of coordinates up to 242
            EXPECT_NEAR(found[a], centre[a], 1e-4f) << view.name;
    }
    /// A camera at (1, 2, 3) that looks along world x, its y axis down along world -z.
    static constexpr const char* kOpenGl =
        "[[0, 0, -1, 1], [-1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]]";
    static void expect_looks_along_x(const View& view) {
        const Vec3f ahead = view.camera.camera_from_world * Vec3f{6, 2, 3};
        EXPECT_NEAR(ahead.x, 0, 1e-6f);
        EXPECT_NEAR(ahead.y, 0, 1e-6f);
        EXPECT_NEAR(ahead.z, 5, 1e-6f);
        const Vec3f up = view.camera.camera_from_world * Vec3f{1, 2, 4};
        EXPECT_NEAR(up.y, -1, 1e-6f);
        const Vec3f left = view.camera.camera_from_world * Vec3f{1, 3, 3};
        EXPECT_NEAR(left.x, -1, 1e-6f);
    }
};

TEST_F(SceneLayouts, NpzExample) {  // EXPECTED.txt
    fs::copy_file(kExample / "idr/cameras.npz", folder / "cameras.npz");
    photo("image/000.png", 400, 300), photo("image/001.png", 400, 300);
    photo("mask/000.png", 400, 300), photo("mask/001.png", 400, 300);
    const Scene scene = read();  // the cameras are for 1600x1200
    ASSERT_EQ(scene.train.size(), 2u);
    const Camera& camera = scene.train[1].camera;
    EXPECT_NEAR(camera.fx_px, 2892.33f / 4, 1e-3f);
    EXPECT_NEAR(camera.fy_px, 2883.18f / 4, 1e-3f);
    EXPECT_NEAR(camera.cx_px, 823.7f / 4, 1e-4f);
    EXPECT_NEAR(camera.cy_px, 619.57f / 4, 1e-4f);
    expect_centre(scene.train[0], {-4, 8.4f, -242}, scene.origin);
    expect_centre(scene.train[1], {-2.8f, 8.4f, -242}, scene.origin);
    EXPECT_NEAR(camera.camera_from_world.R[0][2], 0.389418342309, 1e-7);
    EXPECT_EQ(scene.train[1].mask.width, 400);
    options.pixel_offset = 0;
    EXPECT_NEAR(read().train[0].camera.cx_px, 823.2f / 4, 1e-4f);

    const NpzCameras cameras = read_npz_cameras((folder / "cameras.npz").string());
    EXPECT_EQ(cameras.scale, 2.5);
    EXPECT_EQ(cameras.offset.z, 600);
    photo("image/002.png", 400, 300);
    expect_input_error("E_VIEW_COUNT");
    fs::remove(folder / "image/002.png");
    photo("image/000.png", 1150, 862);
    expect_input_error("E_CAM_SCALE");
    // Every truncated file gives an error and no crash.
    const std::string whole = read_bytes((folder / "cameras.npz").string());
    for (std::size_t size = 0; size < whole.size(); size += 97) {
        write("cameras.npz", whole.substr(0, size));
        expect_input_error("cameras.npz");
    }
}

/// An archive of 4x4 matrices of doubles.
void write_npz(const std::string& path, const std::map<std::string, std::vector<double>>& arrays) {
    std::vector<std::string> files;  // libzip reads them when it closes
    for (const auto& [name, m] : arrays) {
        std::string header = "{'descr': '<f8', 'fortran_order': False, 'shape': (4, 4), }";
        header.resize(117, ' '), header += '\n';
        files.push_back(std::string("\x93NUMPY\1\0\x76\0", 10) + header +
                        std::string(reinterpret_cast<const char*>(m.data()), 128));
    }
    zip_t* const archive = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, nullptr);
    ASSERT_NE(archive, nullptr);
    std::size_t i = 0;
    for (const auto& [name, m] : arrays) {
        const std::string& bytes = files[i++];
        zip_source_t* const source = zip_source_buffer(archive, bytes.data(), bytes.size(), 0);
        ASSERT_GE(zip_file_add(archive, (name + ".npy").c_str(), source, 0), 0);
    }
    ASSERT_EQ(zip_close(archive), 0);
}

TEST_F(SceneLayouts, ScaleMatricesMustBeOneUniformScale) {
    const std::vector<double> world{500, 0, 200, 0, 0, 500, 150, 0, 0, 0, 1, 9, 0, 0, 0, 1};
    const std::vector<double> scale{2, 0, 0, 5, 0, 2, 0, 6, 0, 0, 2, 7, 0, 0, 0, 1};
    std::vector<double> stretched = scale, negative = scale, other = scale;
    stretched[5] = 2.01, negative[0] = negative[5] = negative[10] = -2, other[3] = 5.5;
    photo("image/000.png", 400, 300), photo("image/001.png", 400, 300);
    const auto file = [&](const char* name, const std::vector<double>& first,
                          const std::vector<double>& second) {
        write_npz((folder / name).string(), {{"world_mat_0", world},
                                             {"world_mat_1", world},
                                             {"scale_mat_0", first},
                                             {"scale_mat_1", second}});
    };
    file("cameras.npz", scale, scale);
    EXPECT_EQ(read().train.size(), 2u);
    for (const std::vector<double>& bad : {stretched, negative, other}) {
        file("cameras.npz", scale, bad);
        expect_input_error("scale_mat_1");
    }
    file("cameras.npz", stretched, scale);
    expect_input_error("E_SCALE_MAT");
    file("cameras.npz", scale, scale), file("cameras_sphere.npz", other, other);
    expect_input_error("differ in scale_mat_0");
}

TEST_F(SceneLayouts, NpzAgreesWithColmapOnDtu) {
    options.path = (kShared / "data/dtu_scan24").string();
    if (!fs::exists(options.path)) GTEST_SKIP() << "absent: " << options.path;
    options.images = "image";
    options.views = "0,22,48";
    const Scene colmap = read();
    options.format = SceneFormat::idr;
    options.cameras_file = "cameras_sphere.npz";
    options.pixel_offset = 0;  // its README: use K unchanged
    const Scene npz = read();
    const NpzCameras cameras = read_npz_cameras(options.path + "/cameras_sphere.npz");
    const auto points =
        read_ply((kShared / "data/dtu_scan24/ref/sfm_points.ply").string()).points.positions;
    ASSERT_GT(points.size(), 1000u);
    double worst = 0;
    for (std::size_t v = 0; v < 3; ++v) {
        EXPECT_EQ(npz.train[v].name, colmap.train[v].name);
        EXPECT_EQ(npz.train[v].mask.pixels, colmap.train[v].mask.pixels);
        for (std::size_t i = 0; i < points.size(); i += 10) {
            const Vec3f p = colmap.train[v].camera.camera_from_world * points[i];
            const Vec3d normalised = (vec_cast<double>(points[i]) - cameras.offset) / cameras.scale;
            const Vec3f q = npz.train[v].camera.camera_from_world * vec_cast<float>(normalised);
            const Camera &a = colmap.train[v].camera, &b = npz.train[v].camera;
            const double dx = double(a.fx_px * p.x / p.z + a.cx_px) -
                              double(b.fx_px * q.x / q.z + b.cx_px),
                         dy = double(a.fy_px * p.y / p.z + a.cy_px) -
                              double(b.fy_px * q.y / q.z + b.cy_px);
            worst = std::max(worst, std::hypot(dx, dy));
        }
    }
    EXPECT_LT(worst, 0.1);
    EXPECT_GT(npz.extent, 0);
}

TEST_F(SceneLayouts, Blender) {
    const auto frames = [](const std::string& part, int count) {
        std::string text = "{\"camera_angle_x\": 1.5707963267948966, \"frames\": [";
        for (int i = 0; i < count; ++i)
            text += str(i > 0 ? "," : "", "{\"file_path\": \"./", part, "/r_", i,
                        "\", \"transform_matrix\": ", kOpenGl, "}");
        return text + "]}";
    };
    write("transforms_train.json", frames("train", 3));
    write("transforms_test.json", frames("test", 2));
    for (const char* name :
         {"train/r_0.png", "train/r_1.png", "train/r_2.png", "test/r_0.png", "test/r_1.png"})
        photo(name, 8, 6);
    ImageU8 clear(8, 6, 4, 100);
    clear.at(0, 0, 3) = 0;
    replace_png((folder / "train/r_1.png").string(), clear);
    Scene scene = read();
    ASSERT_EQ(scene.train.size(), 3u);
    ASSERT_EQ(scene.test.size(), 2u);
    EXPECT_EQ(scene.train[0].name, "train/r_0.png");
    EXPECT_NEAR(scene.train[0].camera.fx_px, 4, 1e-5f);  // half the width, at 90 degrees
    EXPECT_NEAR(scene.train[0].camera.fy_px, 4, 1e-5f);
    EXPECT_EQ(scene.train[0].camera.cx_px, 4);
    expect_looks_along_x(scene.train[0]);
    EXPECT_EQ(scene.train[1].photo.at(0, 0), 0);  // transparent: black
    EXPECT_EQ(scene.train[1].mask.at(0, 0), 0);
    std::string sized = frames("train", 3);
    write("transforms_train.json", sized.insert(1, "\"w\": 16, \"h\": 12, \"fl_x\": 10, "));
    EXPECT_EQ(read().train[0].camera.fx_px, 5) << "the photographs are half as large";
    write("transforms_train.json", frames("train", 3));
    options.views = "2,3";  // of all images: test/r_0, test/r_1, train/r_0 ...
    EXPECT_EQ(read().train.size(), 2u);
    options.views.clear();
    options.need_points = true;
    expect_input_error("E_NO_POINTS");
    write_cloud_ply((folder / "points3d.ply").string(), {{{1, 2, 3}}, {}, {}});
    EXPECT_EQ(read().points.positions.size(), 1u);
    fs::remove(folder / "train/r_0.png"), fs::remove(folder / "train/r_1.png");
    expect_input_error("E_TOO_FEW_VIEWS");
}

TEST_F(SceneLayouts, Nerfstudio) {
    const auto write_frames = [&](const std::string& head, const std::string& matrix) {
        std::string text = "{" + head + "\"frames\": [";
        for (int i = 0; i < 3; ++i)
            text += str(i > 0 ? "," : "", "{\"file_path\": \"images/", i,
                        ".png\", \"transform_matrix\": ", matrix,
                        i == 2 ? ", \"fl_x\": 20, \"mask_path\": \"m/two.png\"}" : "}");
        write("transforms.json", text + "]}");
    };
    for (int i = 0; i < 3; ++i) photo(str("images/", i, ".png"), 8, 6);
    photo("m/two.png", 8, 6, 1);
    const std::string head = "\"w\": 16, \"h\": 12, \"fl_x\": 10, \"cx\": 7, \"cy\": 6.5, ";
    write_frames(head, kOpenGl);
    Scene scene = read();
    ASSERT_EQ(scene.train.size(), 3u);
    EXPECT_EQ(scene.train[0].camera.fx_px, 5);  // the photographs are half as large
    EXPECT_EQ(scene.train[0].camera.fy_px, 5);
    EXPECT_EQ(scene.train[0].camera.cx_px, 3.5f);
    EXPECT_EQ(scene.train[0].camera.cy_px, 3.25f);
    EXPECT_EQ(scene.train[2].camera.fx_px, 10);  // its own
    EXPECT_TRUE(scene.train[0].mask.empty());
    EXPECT_EQ(scene.train[2].mask.at(3, 3), 0);
    expect_looks_along_x(scene.train[1]);

    write_frames(head +
                     "\"train_filenames\": [\"images/0.png\", \"images/2.png\"], "
                     "\"test_filenames\": [\"images/1.png\"], ",
                 kOpenGl);
    EXPECT_EQ(read().test.size(), 1u);
    write_frames("\"camera_angle_x\": 1.5707963267948966, ", kOpenGl);  // no size: the files'
    EXPECT_NEAR(read().train[0].camera.fx_px, 4, 1e-5f);
    // The focal length is in pixels of the listed files, not of smaller copies.
    write_frames("\"fl_x\": 10, \"train_filenames\": [\"images/0.png\", \"images/2.png\"], ",
                 kOpenGl);
    for (int i = 0; i < 3; ++i) photo(str("images_2/", i, ".png"), 4, 3);
    options.images = "images_2";
    EXPECT_EQ(read().train[0].camera.fx_px, 5);
    write_frames("\"camera_angle_x\": 1.5707963267948966, ", kOpenGl);
    fs::rename(folder / "images", folder / "elsewhere");
    EXPECT_NEAR(read().train[0].camera.fx_px, 2, 1e-5f);
    fs::rename(folder / "elsewhere", folder / "images");
    options.images = "images";
    write_frames("\"fl_x\": 10, \"train_filenames\": [\"images/0.png\", \"images/2.png\"], ",
                 kOpenGl);
    // A lost photograph without a known size is left out, also of the scene's split.
    fs::remove(folder / "images/0.png");
    options.min_train_views = 1;
    EXPECT_EQ(read().train.size(), 1u);
    photo("images/0.png", 8, 6);
    options.min_train_views = 2;
    write_frames(head + "\"camera_model\": \"OPENCV\", \"k1\": 0.1, ", kOpenGl);
    EXPECT_EQ(read().train[0].photo.width, 8);  // undistorted
    write_frames(head + "\"camera_model\": \"EQUIRECTANGULAR\", ", kOpenGl);
    expect_input_error("E_CAMERA_MODEL");
    write_frames(head, "[[2, 0, 0, 1], [0, 2, 0, 2], [0, 0, 2, 3], [0, 0, 0, 1]]");
    expect_input_error("E_POSE_ROT");
    write_frames(head, "[[1, 0, 0, 1], [0, 1, 0, null], [0, 0, 1, 3]]");
    expect_input_error("E_POSE_NAN");
    write_frames(head, "[[1, 0, 0, 1], [0, 1, 0, 2]]");
    expect_input_error("expected 4x4 or 3x4");
    write_frames("\"w\": 16, \"h\": 12, \"fl_x\": 0, ", kOpenGl);
    expect_input_error("E_CAMERA_FOCAL");
    write_frames("\"w\": 16, \"h\": 0, \"fl_x\": 9, ", kOpenGl);
    expect_input_error("E_CAMERA_SIZE");
    write("transforms.json", "{\"frames\": []}");
    expect_input_error("no frames");
    write("transforms.json", "{\"frames\": [{\"file_path\": \"../x.png\"}]}");
    expect_input_error("E_BAD_NAME");
    write("transforms.json", "{\"frames\": [");
    expect_input_error("E_TRANSFORMS");
    expect_input_error("not valid JSON");
}

TEST_F(SceneLayouts, Mvsnet) {
    const auto camera = [](double x, double f, double cx, double cy) {
        return str("extrinsic\n1 0 0 ", -x, "\n0 1 0 0\n0 0 1 0\n0 0 0 1\n\nintrinsic\n", f, " 0 ",
                   cx, "\n0 ", f, " ", cy, "\n0 0 1\n\n425 2.5\n");
    };
    for (int i = 0; i < 3; ++i) {
        photo(str("images/0000000", i, ".png"), 32, 24);
        write(str("cams/0000000", i, "_cam.txt"), camera(i, 40, 15.5, 11.5));
    }
    Scene scene = read();
    ASSERT_EQ(scene.train.size(), 3u);
    expect_centre(scene.train[2], {2, 0, 0});
    EXPECT_EQ(scene.train[0].camera.cx_px, 16);  // counts from the corner
    EXPECT_EQ(scene.train[0].camera.fx_px, 40);
    // Made for images reduced to a quarter.
    for (int i = 0; i < 3; ++i) write(str("cams/0000000", i, "_cam.txt"), camera(i, 10, 3.5, 2.5));
    EXPECT_EQ(read().train[0].camera.fx_px, 40);
    EXPECT_EQ(read().train[0].camera.cx_px, 16);
    write("cams/00000001_cam.txt", camera(1, 10, 6, 4));
    expect_input_error("E_CAM_SCALE");
    write("cams/00000001_cam.txt", camera(1, 10, 3.5, 2.5).substr(0, 60));
    expect_input_error("E_MVSNET_CAM");
    write("cams/00000001_cam.txt",
          "extrinsic 1 0 0 nan 0 1 0 0 0 0 1 0 0 0 0 1 intrinsic 9 0 16 "
          "0 9 12 0 0 1");
    expect_input_error("E_POSE_NAN");
}

TEST_F(SceneLayouts, AFormatThatWasAskedForIsNotGuessed) {
    options.format = SceneFormat::idr;
    expect_input_error("no cameras_sphere.npz or cameras.npz");
    options.format = SceneFormat::blender;
    expect_input_error("transforms_train.json");
    options.format = SceneFormat::mvsnet;
    expect_input_error("E_NO_IMAGES");
    options.format = SceneFormat::automatic;
    expect_input_error("E_SCENE_LAYOUT");
    expect_input_error("cams/*_cam.txt");
    write("images/0001.png", "");  // only photographs
    expect_input_error("tvsgs-prepare " + (folder / "images").string() + " SCENE");
}

}  // namespace
}  // namespace tvsgs
