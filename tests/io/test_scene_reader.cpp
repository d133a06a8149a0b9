#include <spdlog/sinks/ostream_sink.h>

#include <cmath>
#include <set>
#include <sstream>

#include "core/log.h"
#include "io/images/image_file.h"
#include "io/images/webp.h"
#include "io/io_test.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// A scene of four views of 8x6 pixels on a line, and points with known tracks.
class SceneReader : public IoTest {
protected:
    SceneOptions options;

    void SetUp() override {
        IoTest::SetUp();
        options.path = folder.string();
        camera("1 PINHOLE 8 6 10 11 4 3");
        std::string images;
        for (int i = 0; i < 4; ++i) {
            images += str(i + 1, " 1 0 0 0 ", -i, " 0 0 1 ", i, ".png\n\n");
            photo(str("images/", i, ".png"), 8, 6, static_cast<std::uint8_t>(10 * i));
        }
        write("sparse/0/images.txt", images);
        // x lists the images that see the point: 1, 2; 2, 3, 4; 4 twice; none.
        write("sparse/0/points3D.txt",
              "1 12 0 5 255 0 0 0.1 1 0 2 0\n2 234 0 5 0 255 0 0.1 2 1 3 0 4 0\n3 44 0 5 0 0 255 "
              "0.1 4 1 4 2\n4 0 0 5 0 0 0 0.1\n");
    }
    void camera(const std::string& line) { write("sparse/0/cameras.txt", line + "\n"); }
    void photo(
        const std::string& name, int width, int height, std::uint8_t value, int channels = 3) {
        replace_png((folder / name).string(), ImageU8(width, height, channels, value));
    }
    Scene read() const { return read_scene(options); }
    void expect_input_error(const std::string& text) const {
        expect_error(ExitCode::input, text, [&] { read(); });
    }
    static std::set<float> point_names(const Scene& scene) {
        std::set<float> names;
        for (const Vec3f p : scene.points.positions) names.insert(p.x);
        return names;
    }
};

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

TEST_F(SceneReader, BrokenImage) {
    write("images/2.png", "no image");
    expect_input_error("images/2.png");
}

TEST_F(SceneReader, ImageSizes) {
    photo("images/1.png", 4, 3, 10);  // reduced beforehand: the camera is scaled
    Scene scene = read();
    EXPECT_EQ(scene.train[1].camera.fx_px, 5);
    EXPECT_EQ(scene.train[1].camera.cy_px, 1.5f);
    EXPECT_EQ(scene.train[0].camera.fx_px, 10);
    photo("images/1.png", 12, 6, 10);
    expect_input_error("E_IMAGE_SIZE");
    camera("1 PINHOLE 80 30 100 110 40 15");
    for (int i = 0; i < 4; ++i) photo(str("images/", i, ".png"), 30, 80, 10);
    expect_input_error("E_IMAGE_SIZE");
    expect_input_error("EXIF");
}

TEST_F(SceneReader, ResolutionAndPrincipalPoint) {
    camera("1 PINHOLE 8 6 10 11 5 2");
    options.resolution = 2;
    Scene scene = read();
    EXPECT_EQ(scene.train[2].photo.width, 4);
    EXPECT_EQ(scene.train[2].photo.height, 3);
    EXPECT_EQ(scene.train[2].photo.at(0, 0, 2), 20);
    EXPECT_EQ(scene.train[2].camera.fx_px, 5);
    EXPECT_EQ(scene.train[2].camera.cx_px, 2.5f);
    EXPECT_EQ(scene.train[2].camera.cy_px, 1);
    EXPECT_TRUE(scene.train[2].grey.empty());  // the photograph suffices
    options.grey_scale = 0.5f;
    EXPECT_EQ(read().train[2].grey.width, 8);
    EXPECT_EQ(read().train[2].grey.height, 6);
    EXPECT_EQ(read().train[2].grey.channels, 1);
    options.grey_scale = 0.25f;  // not finer than the file
    EXPECT_EQ(read().train[2].grey.width, 8);
    options.center_principal_point = true;
    scene = read();
    EXPECT_EQ(scene.train[2].camera.cx_px, 2);
    EXPECT_EQ(scene.train[2].camera.cy_px, 1.5f);
    options.resolution = 0;
    expect_error(ExitCode::usage, "--resolution", [&] { read(); });
}

TEST(ResizedSize, RoundsAsTheOfficialCodes) {
    const auto expect = [](int r, int w, int h, int out_w, int out_h) {
        const PixelSize size = resized_size(r, w, h);
        EXPECT_EQ(size.width_px, out_w) << r << ' ' << w << 'x' << h;
        EXPECT_EQ(size.height_px, out_h) << r << ' ' << w << 'x' << h;
    };
    expect(2, 1957, 1091, 978, 546);  // 978.5 and 545.5: half to even
    expect(1, 1957, 1091, 1957, 1091);
    expect(4, 1957, 1091, 489, 273);
    expect(8, 1957, 1091, 245, 136);
    expect(-1, 1600, 1200, 1600, 1200);
    expect(-1, 1957, 1091, 1600, 891);  // 891.97 is cut
    expect(800, 1600, 1200, 800, 600);
    expect(3, 800, 600, 3, 2);
    expect(8, 1, 1, 1, 1);
}

TEST_F(SceneReader, MasksOfAFolder) {
    for (int i = 0; i < 4; ++i) {
        ImageU8 mask(16, 12, 3);
        for (int y = 0; y < 12; ++y)
            for (int x = 0; x < 2 * i; ++x)
                for (int c = 0; c < 3; ++c) mask.at(x, y, c) = 255;
        replace_png((folder / str("mask/00", i, ".png")).string(),
                    mask);  // 001.png belongs to 1.png
    }
    const Scene scene = read();
    for (std::size_t i = 0; i < 4; ++i) {
        const ImageU8& mask = scene.train[i].mask;
        ASSERT_EQ(mask.width, 8);
        ASSERT_EQ(mask.channels, 1);
        EXPECT_EQ(std::count(mask.pixels.begin(), mask.pixels.end(), 255),
                  static_cast<std::ptrdiff_t>(6 * i));
        EXPECT_EQ(std::count(mask.pixels.begin(), mask.pixels.end(), 0),
                  static_cast<std::ptrdiff_t>(48 - 6 * i));
    }
    photo("other/1.png", 8, 6, 255, 1);
    options.masks = "other";
    expect_input_error("E_MASKS");  // requested, and three are missing
    options.views = "1";
    options.min_train_views = 1;
    options.need_points = false;
    EXPECT_EQ(read().train[0].mask.at(0, 0), 255);
    options.masks = "no/such";
    expect_input_error("E_MASKS");
}

TEST_F(SceneReader, MaskOfTheAlphaChannel) {
    ImageU8 image(8, 6, 4, 200);
    for (int x = 0; x < 8; ++x) image.at(x, 2, 3) = 100;
    replace_png((folder / "images/1.png").string(), image);
    photo("images/2.png", 8, 6, 255, 4);
    photo("images/3.png", 8, 6, 77, 1);
    const Scene scene = read();
    EXPECT_TRUE(scene.train[0].mask.empty());
    const ImageU8& mask = scene.train[1].mask;
    EXPECT_EQ(mask.at(3, 2), 0);
    EXPECT_EQ(mask.at(3, 3), 255);
    EXPECT_EQ(scene.train[1].photo.at(3, 2, 1), 200);  // colour is not multiplied
    EXPECT_TRUE(scene.train[2].mask.empty());          // opaque everywhere: no mask
    EXPECT_EQ(scene.train[3].photo.pixels, ImageU8(8, 6, 3, 77).pixels);
}

TEST_F(SceneReader, DistortedCameras) {
    camera("1 SIMPLE_RADIAL 8 6 10 4 3 2");
    const Scene scene = read();
    const View& view = scene.train[1];
    EXPECT_EQ(view.camera.fy_px, 10);
    EXPECT_EQ(view.mask.at(0, 0), kNoPhoto);  // the pinhole sees farther than the lens
    EXPECT_EQ(view.mask.at(4, 3), 255);
    EXPECT_EQ(view.photo.at(4, 3), 10);
    camera("1 SIMPLE_RADIAL 8 6 10 4 3 -0.1");
    EXPECT_TRUE(read().train[1].mask.empty()) << "the lens saw it all: nothing is left out";
    for (const char* line : {"1 OPENCV_FISHEYE 8 6 10 10 4 3 0 0 0 0", "1 FOV 8 6 10 10 4 3 0.9",
                             "1 THIN_PRISM_FISHEYE 8 6 10 10 4 3 0.1 0 0.01 0 0 0 0.02 0"}) {
        camera(line);
        EXPECT_EQ(read().train[1].photo.at(4, 3), 10) << line;
    }
    camera("1 EUCM 8 6 10 10 4 3 0.9 1");
    expect_input_error("camera 1 uses EUCM");
    expect_input_error("colmap image_undistorter");
}

/// A pixel outside the photograph is black; pixels that the filter mixed with it do not count.
TEST_F(SceneReader, TheRimOfUndistortionIsMasked) {
    for (int i = 0; i < 4; ++i) photo(str("images/", i, ".png"), 160, 120, 200);
    camera("1 OPENCV 160 120 100 100 80 60 0.3 0.1 0 0");
    for (const int resolution : {1, 2, 4}) {
        options.resolution = resolution;
        const View view = read().train[1];
        int masked = 0, off = 0;
        for (std::size_t i = 0; i < view.mask.pixels.size(); ++i) {
            masked += view.mask.pixels[i] == kNoPhoto;
            for (std::size_t c = 0; view.mask.pixels[i] != kNoPhoto && c < 3; ++c)
                off += view.photo.pixels[3 * i + c] != 200;
        }
        EXPECT_EQ(off, 0) << resolution;
        EXPECT_GT(masked, 0);
        EXPECT_LT(masked, 0.5 * double(view.mask.pixels.size()));
    }
}

TEST_F(SceneReader, SaysWhatUndistortionCosts) {
    const auto said = [&](const std::string& line) {
        camera(line);
        std::ostringstream out;
        const auto before = spdlog::default_logger();
        spdlog::set_default_logger(std::make_shared<spdlog::logger>(
            "said", std::make_shared<spdlog::sinks::ostream_sink_mt>(out)));
        read();
        spdlog::set_default_logger(before);
        return out.str();
    };
    const auto expect_said = [&](const char* line, const char* text) {
        const std::string all = said(line);
        EXPECT_NE(all.find(text), std::string::npos) << all;
    };
    // The mean of (1 + k r^2)(1 + 3 k r^2) over 0.4 x 0.3, half the sides, is 0.9345.
    expect_said("1 SIMPLE_RADIAL 8 6 10 4 3 -0.2",
                "Undistorted lens SIMPLE_RADIAL: cropped 6.5 % of the pixels");
    expect_said("1 OPENCV 8 6 10 10 4 3 0.2 0 0 0", "% of the views are empty and masked");
    EXPECT_EQ(said("1 OPENCV 8 6 10 10 4 3 0 0 0 0").find("lens"), std::string::npos);
}

/// A JPEG with an EXIF orientation, which viewers turn and COLMAP does not.
std::string oriented_jpeg(const ImageU8& image, char orientation) {
    const std::string plain = jpeg_bytes(image, 100);
    const std::string exif = std::string("Exif\0\0II\x2A\0\x08\0\0\0\1\0\x12\1\3\0\1\0\0\0", 24) +
                             orientation + std::string(7, '\0');
    return plain.substr(0, 2) + "\xFF\xE1" + std::string(1, '\0') +
           static_cast<char>(exif.size() + 2) + exif + plain.substr(2);
}

TEST_F(SceneReader, PhotographsThatFitOnlyWhenTurned) {
    // Bright where the stored image has its top left corner.
    ImageU8 stored(64, 32, 3, 10);
    for (int y = 0; y < 16; ++y)
        for (int x = 0; x < 32; ++x)
            for (int c = 0; c < 3; ++c) stored.at(x, y, c) = 240;
    camera("1 PINHOLE 64 32 100 110 32 16");
    for (int i = 0; i < 4; ++i) {
        fs::remove(folder / str("images/", i, ".png"));
        write(str("images/", i, ".jpg"), oriented_jpeg(stored, static_cast<char>(5 + i)));
    }
    // As COLMAP computes: the pixels as they are stored.
    for (const View& view : read().train) EXPECT_NEAR(view.photo.at(8, 4), 240, 3);
    // Cameras of other programs describe turned pixels.
    camera("1 PINHOLE 32 64 100 110 16 32");
    const Scene scene = read();
    const std::pair<int, int> bright[] = {{8, 8}, {24, 8}, {24, 56}, {8, 56}};
    for (std::size_t i = 0; i < 4; ++i) {
        const View& view = scene.train[i];
        ASSERT_EQ(view.photo.width, 32);
        for (const auto& [x, y] : bright)
            EXPECT_NEAR(view.photo.at(x, y), std::pair(x, y) == bright[i] ? 240 : 10, 3)
                << "orientation " << 5 + i << " at " << x << ", " << y;
    }
    // Without an orientation that swaps the sides the image is refused.
    for (const char orientation : {'\0', '\1', '\3', '\x09'}) {
        write("images/2.jpg", oriented_jpeg(stored, orientation));
        expect_input_error("2.jpg: 64x32 pixels; its camera has 32x64 (turned");
    }
    write("images/2.jpg", jpeg_bytes(stored, 90));
    expect_input_error("E_IMAGE_SIZE");
}

TEST_F(SceneReader, ExtensionsOfEveryKind) {
    const ImageU8 image(8, 6, 3, 90);
    const auto put = [&](int i, const std::string& extension, const std::string& bytes) {
        const fs::path old = folder / str("images/", i);
        for (const char* other : {".png", ".PNG", ".JPG", ".JPEG", ".webp", ".tif"})
            fs::remove(fs::path(old).concat(other));
        write(str("images/", i, extension), bytes);
    };
    put(0, ".JPG", jpeg_bytes(image, 95));
    put(1, ".PNG", png_bytes(image));
    put(2, ".JPEG", jpeg_bytes(image, 95));
    put(3, ".webp", webp_bytes(image, 95));
    const Scene scene = read();
    ASSERT_EQ(scene.train.size(), 4u);
    for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(scene.train[i].photo.at(3, 3), 90, 2) << i;
    // A TIFF in the model: a PNG with its name replaces it; alone, the error names the format.
    std::string images = read_bytes((folder / "sparse/0/images.txt").string());
    images.replace(images.find("0.png"), 5, "0.tif");
    write("sparse/0/images.txt", images);
    write("images/0.tif", std::string("II*\0\x08\0\0\0", 8));
    EXPECT_EQ(read().train.size(), 4u);
    fs::remove(folder / "images/0.JPG");
    expect_input_error(
        "0.tif: cannot read it as an image (a TIFF or raw photograph); expected JPEG");
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
