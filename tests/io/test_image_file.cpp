#include <cmath>

#include "io/images/image_file.h"
#include "io/io_test.h"

namespace tvsgs {
namespace {

class ImageFile : public IoTest {};

ImageU8 pattern(int width, int height, int channels) {
    ImageU8 image(width, height, channels);
    for (std::size_t i = 0; i < image.pixels.size(); ++i)
        image.pixels[i] = static_cast<std::uint8_t>(i * 37 + i / 7);
    return image;
}

TEST_F(ImageFile, PngRoundTrip) {
    start_manifest(folder);  // allows it to replace its own files
    for (const int channels : {1, 3, 4}) {
        const ImageU8 image = pattern(13, 7, channels);
        const std::string path = (folder / "a/b.png").string();
        write_png(path, image);
        const ImageU8 back = read_image(path);
        EXPECT_EQ(back.channels, channels);
        EXPECT_EQ(back.pixels, image.pixels);
        const ImageSize size = read_image_size(path);
        EXPECT_EQ(size.width, 13);
        EXPECT_EQ(size.height, 7);
        EXPECT_EQ(size.channels, channels);
        EXPECT_EQ(read_image(path, 3).channels, 3);
    }
}

TEST_F(ImageFile, GreyIsExpandedAndSixteenBitsAreRounded) {
    ImageU8 grey(2, 1, 1);
    grey.pixels = std::vector<std::uint8_t>{16, 128};
    write_png((folder / "grey.png").string(), grey);
    EXPECT_EQ(read_image((folder / "grey.png").string(), 3).pixels,
              (std::vector<std::uint8_t>{16, 16, 16, 128, 128, 128}));
    // Grey, 16 bit, 3x1: 128, 129, 65535. A plain shift would lose the 129.
    const char deep[] =
        "\x89PNG\r\n\x1A\n\x00\x00\x00\x0DIHDR\x00\x00\x00\x03\x00\x00\x00\x01\x10\x00\x00\x00\x00"
        "\x6E\x1B\x97\x2B"
        "\x00\x00\x00\x0FIDAT\x78\x9C\x63\x60\x68\x60\x68\xFC\xFF\x1F\x00\x07\x07\x03\x00\x04\xE8"
        "\x6D\x8D"
        "\x00\x00\x00\x00IEND\xAE\x42\x60\x82";
    const std::string path = write("deep.png", std::string(deep, sizeof deep - 1));
    EXPECT_EQ(read_image(path).pixels, (std::vector<std::uint8_t>{0, 1, 255}));
}

TEST_F(ImageFile, WebpIsRead) {
    ImageU8 image(40, 30, 3);
    for (int y = 0; y < 30; ++y)
        for (int x = 0; x < 40; ++x)
            for (int c = 0; c < 3; ++c)
                image.at(x, y, c) = static_cast<std::uint8_t>(40 + 3 * x + 2 * y);
    const std::string bytes = webp_bytes(image, 95);
    const std::string path = write("photo.webp", bytes);
    const ImageSize size = read_image_size(path);
    EXPECT_EQ(size.width, 40);
    EXPECT_EQ(size.height, 30);
    EXPECT_EQ(size.channels, 3);
    const ImageU8 back = read_image(path);
    for (const auto& [x, y] : {std::pair{3, 4}, {30, 20}, {39, 29}})
        EXPECT_NEAR(back.at(x, y, 1), image.at(x, y, 1), 4);
    EXPECT_EQ(read_image(path, 4).at(5, 5, 3), 255);
    EXPECT_NEAR(read_image(path, 1).at(30, 20), image.at(30, 20), 4);
    for (const std::size_t length : {std::size_t{12}, std::size_t{25}, bytes.size() / 2})
        expect_error(ExitCode::input, "E_IMAGE_READ",
                     [&] { read_image(write("cut.webp", bytes.substr(0, length))); });
    expect_error(ExitCode::input, "damaged or animated WebP",
                 [&] { read_image_size(write("cut.webp", bytes.substr(0, 25))); });
}

TEST_F(ImageFile, ProgressiveJpeg) {
    // 16x16, left half 200, right half 60, as OpenCV writes it.
    const ImageU8 image = read_image(test_data("images/progressive.jpg"));
    ASSERT_EQ(image.width, 16);
    EXPECT_NEAR(image.at(3, 8, 0), 200, 3);
    EXPECT_NEAR(image.at(12, 8, 2), 60, 3);
}

TEST_F(ImageFile, FilesOfOtherKindsAreNamed) {
    expect_error(ExitCode::input, "a TIFF or raw photograph",
                 [&] { read_image(write("a.tif", std::string("II*\0\x08\0\0\0", 8))); });
    expect_error(ExitCode::input, "HEIC, AVIF or similar, kind 'heic'", [&] {
        read_image_size(write("a.heic", std::string("\0\0\0\x18"
                                                    "ftypheic\0\0\0\0",
                                                    16)));
    });
}

/// The start of a PNG that claims the given size.
std::string png_claim(std::uint32_t width, std::uint32_t height) {
    std::string text("\x89PNG\r\n\x1A\n\x00\x00\x00\x0DIHDR", 16);
    for (const std::uint32_t number : {width, height})
        for (int shift = 24; shift >= 0; shift -= 8) text += static_cast<char>(number >> shift);
    return text + std::string("\x08\x02\x00\x00\x00\x00\x00\x00\x00", 9);
}

TEST_F(ImageFile, UnreadableFiles) {
    expect_error(ExitCode::input, "none.png", [&] { read_image((folder / "none.png").string()); });
    expect_error(ExitCode::input, "none.png",
                 [&] { read_image_size((folder / "none.png").string()); });
    expect_error(ExitCode::input, "nowhere.png: cannot open it: No such file",
                 [] { read_image_size("nowhere.png"); });
    expect_error(ExitCode::input, "E_IMAGE_READ",
                 [&] { read_image(write("text.png", "no image")); });
    expect_error(ExitCode::input, "E_IMAGE_READ", [&] { read_image(write("empty.png", "")); });
    expect_error(ExitCode::input, "folder", [&] { read_image(folder.string()); });
    // A claim that is too large must be refused before memory is allocated.
    expect_error(ExitCode::input, "E_IMAGE_READ",
                 [&] { read_image(write("big.png", png_claim(65535, 65535))); });
    expect_error(ExitCode::input, "E_IMAGE_READ",
                 [&] { read_image_size(write("big.png", png_claim(65535, 65535))); });
    expect_error(ExitCode::input, "E_IMAGE_READ",
                 [&] { read_image(write("wide.png", png_claim(70000, 1))); });
    write_png((folder / "whole.png").string(), pattern(40, 30, 3));
    const std::string whole = read_bytes((folder / "whole.png").string());
    for (const std::size_t size : {whole.size() / 4, whole.size() / 2})
        expect_error(ExitCode::input, "E_IMAGE_READ",
                     [&] { read_image(write("cut.png", whole.substr(0, size))); });
}

TEST_F(ImageFile, WritingIntoNowhere) {
    expect_error(ExitCode::io, "/proc/none",
                 [] { write_png("/proc/none/a.png", pattern(2, 2, 3)); });
}

TEST(Resize, ConstantsStayAndTheSameSizeIsACopy) {
    for (const auto& [w, h] : {std::pair{5, 3}, {40, 31}, {1, 1}, {13, 7}}) {
        const ImageU8 out = resize_bicubic(ImageU8(13, 7, 3, 201), w, h);
        EXPECT_EQ(out.width, w);
        EXPECT_EQ(out.height, h);
        EXPECT_EQ(std::count(out.pixels.begin(), out.pixels.end(), 201), w * h * 3);
    }
    const ImageU8 image = pattern(13, 7, 3);
    EXPECT_EQ(resize_bicubic(image, 13, 7).pixels, image.pixels);
    EXPECT_EQ(resize_nearest(image, 13, 7).pixels, image.pixels);
}

TEST(Resize, KeepsALinearRampAwayFromTheBorder) {
    // The kernel is symmetric and normalised, and every output centre lies between two inputs here,
    // so the weighted mean position is the centre itself.
    ImageU8 ramp(64, 4, 1);
    for (int y = 0; y < 4; ++y)
        for (int x = 0; x < 64; ++x) ramp.at(x, y) = static_cast<std::uint8_t>(4 * x);
    const ImageU8 half = resize_bicubic(ramp, 32, 2);
    for (int x = 2; x < 30; ++x) EXPECT_EQ(half.at(x, 1), 8 * x + 2);
}

TEST(Resize, ValuesOfPillowsFormula) {
    // Evaluated in double from Pillow's definition (window, normalisation, a = -0.5), then rounded
    // once.
    const auto row = [](std::vector<std::uint8_t> values) {
        ImageU8 image(static_cast<int>(values.size()), 1, 1);
        image.pixels = std::move(values);
        return image;
    };
    // -4.82, 54.857, 14.332, -1.607: overshoot is clamped.
    EXPECT_EQ(resize_bicubic(row({0, 0, 0, 128, 0, 0, 0, 0}), 4, 1).pixels,
              (std::vector<std::uint8_t>{0, 55, 14, 0}));
    const ImageU8 nine = row({0, 10, 250, 30, 90, 200, 5, 77, 140});
    EXPECT_EQ(resize_bicubic(nine, 4, 1).pixels, (std::vector<std::uint8_t>{50, 116, 104, 86}));
    EXPECT_EQ(
        resize_bicubic(nine, 14, 1).pixels,
        (std::vector<std::uint8_t>{0, 0, 28, 217, 184, 27, 57, 132, 201, 77, 4, 68, 117, 144}));
}

TEST(Resize, HalvingIsTransposedTogetherWithTheImage) {
    const ImageU8 image = pattern(12, 20, 1);
    ImageU8 turned(20, 12, 1);
    for (int y = 0; y < 20; ++y)
        for (int x = 0; x < 12; ++x) turned.at(y, x) = image.at(x, y);
    const ImageU8 a = resize_bicubic(image, 5, 9), b = resize_bicubic(turned, 9, 5);
    for (int y = 0; y < 9; ++y)
        for (int x = 0; x < 5; ++x)
            EXPECT_NEAR(a.at(x, y), b.at(y, x), 1);  // the order of the sums differs
}

TEST(Resize, Nearest) {
    ImageU8 image(4, 1, 1);
    image.pixels = std::vector<std::uint8_t>{1, 2, 3, 4};
    EXPECT_EQ(resize_nearest(image, 2, 1).pixels, (std::vector<std::uint8_t>{2, 4}));
    EXPECT_EQ(resize_nearest(image, 8, 1).pixels,
              (std::vector<std::uint8_t>{1, 1, 2, 2, 3, 3, 4, 4}));
}

}  // namespace
}  // namespace tvsgs
