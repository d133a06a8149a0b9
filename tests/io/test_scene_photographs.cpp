// Photographs of scenes: sizes, masks, lenses, EXIF orientation, file formats.
#include <spdlog/sinks/ostream_sink.h>

#include <algorithm>
#include <sstream>
#include <utility>

#include "core/log.h"
#include "io/images/image_file.h"
#include "io/scene_reader_test.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

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

TEST_F(SceneReader, MasksOfAnotherFolderAreNotTaken) {
    write("sparse/0/images.txt",
          "1 1 0 0 0 0 0 0 1 a/01.png\n\n2 1 0 0 0 -1 0 0 1 b/01.png\n\n"
          "3 1 0 0 0 -2 0 0 1 b/02.png\n\n4 1 0 0 0 -3 0 0 1 b/03.png\n\n");
    for (const char* name : {"a/01.png", "b/01.png", "b/02.png", "b/03.png"})
        photo(str("images/", name), 8, 6, 90);
    options.need_points = false;
    const auto with_mask = [&] {
        std::set<std::string> names;
        for (const View& view : read().train)
            if (!view.mask.empty()) names.insert(view.name);
        return names;
    };
    photo("masks/a/01.png", 8, 6, 7, 1);
    EXPECT_EQ(with_mask(), std::set<std::string>{"a/01.png"});
    fs::remove_all(folder / "masks");
    photo("masks/01.png", 8, 6, 7, 1);  // of a or of b
    photo("masks/2.png", 8, 6, 7, 1);   // by its number
    photo("masks/03.png", 8, 6, 7, 1);  // by its name
    write("masks/03.json", "{}");       // the polygons of the mask
    init_log(Verbosity::normal);
    testing::internal::CaptureStderr();
    EXPECT_EQ(with_mask(), (std::set<std::string>{"b/02.png", "b/03.png"}));
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_NE(said.find("masks/01.png: may belong to several images, such as a/01.png"),
              std::string::npos)
        << said;
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

TEST_F(SceneReader, TurnsThatShowAPhotographUpright) {
    ImageU8 stored(64, 32, 3);
    for (int y = 0; y < 32; ++y)
        for (int x = 0; x < 64; ++x)
            stored.at(x, y, 0) = static_cast<std::uint8_t>(32 * (x % 8) + y);
    camera("1 PINHOLE 64 32 100 110 30 17");
    // 1 is upright; 8, 3 and 6 are turned by one, two and three quarters against the clock; the
    // others are mirrored.
    const int turns[] = {0, 0, 2, 2, 1, 1, 3, 3};
    const auto write_all = [&](int orientation) {
        for (int i = 0; i < 4; ++i) {
            fs::remove(folder / str("images/", i, ".png"));
            write(str("images/", i, ".jpg"), oriented_jpeg(stored, static_cast<char>(orientation)));
        }
    };
    for (int orientation = 1; orientation <= 8; ++orientation) {
        write_all(orientation);
        for (const View& view : read().train)
            EXPECT_EQ(view.upright_turns, turns[orientation - 1]) << orientation;
    }
    // Level cameras all around: the sideways photographs cannot be so, unless they are all turned.
    const std::string around = read_bytes((folder / "sparse/0/images.txt").string());
    std::string level, sideways;
    const double r = std::sqrt(0.5);
    const double about_y[][2] = {{1, 0}, {r, r}, {0, 1}, {r, -r}};  // w and y of quaternions
    for (int i = 0; i < 4; ++i) {
        const double w = about_y[i][0], y = about_y[i][1];
        level += fmt::format("{} {} 0 {} 0 0 0 0 1 {}.png\n\n", i + 1, w, y, i);
        // The same camera, on its side: a quarter turn about z first.
        sideways +=
            fmt::format("{} {} {} {} {} 0 0 0 1 {}.png\n\n", i + 1, r * w, r * y, r * y, -r * w, i);
    }
    write_all(6);
    options.need_points = false;
    write("sparse/0/images.txt", level);
    for (const View& view : read().train) EXPECT_EQ(view.upright_turns, 0) << "a stale orientation";
    write("sparse/0/images.txt", sideways);
    for (const View& view : read().train) EXPECT_EQ(view.upright_turns, 1);
    write("sparse/0/images.txt", around);
    options.need_points = true;
    // A turned camera sees each place where the turned image has its pixel.
    const Camera as_stored = read().train[0].camera;
    for (int quarters = 0; quarters < 4; ++quarters) {
        const ImageU8 image = turned_clockwise(stored, quarters);
        const Camera turned = turned_camera(as_stored, quarters);
        ASSERT_EQ(turned.width_px, image.width);
        ASSERT_EQ(turned.height_px, image.height);
        for (int y = 0; y < 32; ++y)
            for (int x = 0; x < 64; ++x) {
                const Vec3f ray = pixel_ray(as_stored, x, y);
                const Rigid3f& pose = as_stored.camera_from_world;
                const Vec3f p =
                    turned.camera_from_world * transpose_times(pose.R, 3 * ray - pose.t);
                const int u = static_cast<int>(turned.fx_px * p.x / p.z + turned.cx_px),
                          v = static_cast<int>(turned.fy_px * p.y / p.z + turned.cy_px);
                ASSERT_EQ(image.at(u, v, 0), stored.at(x, y, 0))
                    << quarters << " " << x << " " << y;
            }
    }
    EXPECT_EQ(turned_clockwise(stored, 1).at(31, 0, 0), stored.at(0, 0, 0)) << "clockwise";
    // Other programs' cameras describe turned pixels.
    camera("1 PINHOLE 32 64 100 110 16 32");
    for (const View& view : read().train) EXPECT_EQ(view.upright_turns, 0);
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

}  // namespace
}  // namespace tvsgs
