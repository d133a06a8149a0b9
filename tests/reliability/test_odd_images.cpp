// Photographs of every kind that stands in real folders: what their pixels become.
#include <zlib.h>

#include <filesystem>

#include "io/images/image_file.h"
#include "io/io_test.h"

namespace tvsgs {
namespace {

using Bytes = std::vector<std::uint8_t>;

class OddImages : public IoTest {
protected:
    Bytes pixels(const std::string& name, const std::string& bytes, int channels = 3) const {
        return read_image(write(name, bytes), channels).pixels.to_vector();
    }
};

std::string big_endian(std::uint32_t value, int bytes = 4) {
    std::string out;
    for (int i = bytes; i-- > 0;) out += static_cast<char>(value >> 8 * i);
    return out;
}

std::string png_chunk(const std::string& kind, const std::string& data) {
    const std::string body = kind + data;
    const auto sum =
        crc32(0, reinterpret_cast<const Bytef*>(body.data()), static_cast<uInt>(body.size()));
    return big_endian(static_cast<std::uint32_t>(data.size())) + body +
           big_endian(static_cast<std::uint32_t>(sum));
}

/// `rows` begin with a filter byte each; `extra` are chunks before the pixels.
std::string png(int width,
                int height,
                int depth,
                int kind,
                const std::string& rows,
                const std::string& extra = "") {
    uLongf size = compressBound(static_cast<uLong>(rows.size()));
    std::string packed(size, '\0');
    compress(reinterpret_cast<Bytef*>(packed.data()), &size,
             reinterpret_cast<const Bytef*>(rows.data()), static_cast<uLong>(rows.size()));
    packed.resize(size);
    const std::string head =
        big_endian(static_cast<std::uint32_t>(width)) +
        big_endian(static_cast<std::uint32_t>(height)) +
        std::string{static_cast<char>(depth), static_cast<char>(kind), 0, 0, 0};
    return "\x89PNG\r\n\x1A\n" + png_chunk("IHDR", head) + extra + png_chunk("IDAT", packed) +
           png_chunk("IEND", "");
}

TEST_F(OddImages, SixteenBitsOfEveryKind) {
    // 0x8080 = 128 * 257 is level 128 of 256 exactly.
    const std::string half = "\x80\x80", full = "\xFF\xFF", none("\0\0", 2), filter(1, '\0');
    EXPECT_EQ(pixels("rgb.png", png(1, 1, 16, 2, filter + none + half + full)),
              (Bytes{0, 128, 255}));
    EXPECT_EQ(pixels("grey_alpha.png", png(1, 1, 16, 4, filter + half + full), 4),
              (Bytes{128, 128, 128, 255}));
}

TEST_F(OddImages, PalettesAreExpanded) {
    const std::string palette = png_chunk("PLTE", "\x0A\x14\x1E\xC8\xD2\xDC");
    // Two pixels of one bit each: colours 1 and 0.
    const std::string rows("\0\x80", 2);
    EXPECT_EQ(pixels("palette.png", png(2, 1, 1, 3, rows, palette)),
              (Bytes{200, 210, 220, 10, 20, 30}));
    EXPECT_EQ(read_image_size((folder / "palette.png").string()).channels, 3);
    // A transparent colour makes a mask.
    const std::string clear = png(2, 1, 1, 3, rows, palette + png_chunk("tRNS", std::string(1, 0)));
    EXPECT_EQ(pixels("clear.png", clear, 0), (Bytes{200, 210, 220, 255, 10, 20, 30, 0}));
    // An index beyond the palette is no colour.
    const std::string one = png_chunk("PLTE", "\x0A\x14\x1E");
    const std::string beyond = png(1, 1, 8, 3, std::string("\0\x07", 2), one);
    EXPECT_NO_THROW(pixels("beyond.png", beyond));
}

/// A baseline JPEG of 8x8 pixels of one colour, 4 components without compression by frequency:
/// each is 128 + its DC coefficient / 8.
std::string cmyk_jpeg(const int (&levels)[4]) {
    std::string out = "\xFF\xD8";
    const auto segment = [&](int marker, const std::string& data) {
        out += '\xFF';
        out += static_cast<char>(marker);
        out += big_endian(static_cast<std::uint32_t>(data.size() + 2), 2) + data;
    };
    segment(0xEE, std::string("Adobe\0\x64\0\0\0\0\0", 12));  // CMYK, inverted as Adobe has it
    segment(0xDB, std::string(1, '\0') + std::string(64, '\1'));
    std::string frame("\x08\0\x08\0\x08\4", 6), scan("\4", 1);
    for (const char c : {'\1', '\2', '\3', '\4'}) frame += {c, 0x11, 0}, scan += {c, 0};
    segment(0xC0, frame);
    // Differences of 11 bits have the code 0; the only AC code, 0, is the end of the block.
    const std::string one_code = std::string(1, '\1') + std::string(15, '\0');
    segment(0xC4, std::string(1, '\0') + one_code + '\x0B');
    segment(0xC4, std::string(1, '\x10') + one_code + std::string(1, '\0'));
    segment(0xDA, scan + std::string("\0\x3F\0", 3));
    std::string bits;
    for (const int level : levels) {
        const int dc = 8 * (level - 128);  // at least 1024 either way, so that it takes 11 bits
        const int code = dc > 0 ? dc : dc + 2047;
        bits += '0';
        for (int i = 11; i-- > 0;) bits += code >> i & 1 ? '1' : '0';
        bits += '0';
    }
    bits.resize((bits.size() + 7) / 8 * 8, '1');
    for (std::size_t i = 0; i < bits.size(); i += 8) {
        out += static_cast<char>(std::stoi(bits.substr(i, 8), nullptr, 2));
        if (out.back() == '\xFF') out += '\0';
    }
    return out + "\xFF\xD9";
}

TEST_F(OddImages, CmykBecomesRgb) {
    // Adobe's inverted CMYK: 255 is no ink. Levels of 0 and 255 clip, which is what they mean.
    const auto color = [&](int c, int m, int y, int k) {
        const ImageU8 image = read_image(write("cmyk.jpg", cmyk_jpeg({c, m, y, k})), 3);
        EXPECT_EQ(image.width, 8);
        return Bytes(image.pixels.begin(), image.pixels.begin() + 3);
    };
    EXPECT_EQ(color(256, 256, 256, 256), (Bytes{255, 255, 255}));
    EXPECT_EQ(color(0, 256, 256, 256), (Bytes{0, 255, 255})) << "cyan ink takes the red";
    EXPECT_EQ(color(256, 256, 256, 0), (Bytes{0, 0, 0})) << "black ink takes all";
    EXPECT_EQ(read_image((folder / "cmyk.jpg").string()).channels, 3) << "ink is no mask";
}

TEST_F(OddImages, ExifOrientationIsLeftAlone) {
    // As COLMAP does: the poses belong to the pixels as they are stored.
    ImageU8 image(16, 8, 3);
    for (std::size_t i = 0; i < image.pixels.size(); ++i)
        image.pixels[i] = static_cast<std::uint8_t>(i / 48 * 20);
    const std::string plain = jpeg_bytes(image, 95);
    const Bytes expected = pixels("plain.jpg", plain);
    for (const char orientation :
         {'\0', '\1', '\6', '\b'}) {  // 0 is none, and stands in real files
        const std::string exif =
            std::string("Exif\0\0MM\0\x2A\0\0\0\x08\0\1\1\x12\0\3\0\0\0\1\0", 25) + orientation +
            std::string(6, '\0');
        const std::string turned = plain.substr(0, 2) + "\xFF\xE1" +
                                   big_endian(static_cast<std::uint32_t>(exif.size() + 2), 2) +
                                   exif + plain.substr(2);
        EXPECT_EQ(pixels("turned.jpg", turned), expected);
        EXPECT_EQ(read_image_size((folder / "turned.jpg").string()).width, 16);
    }
}

/// A decoder would take a gigabyte for 80 bytes.
TEST_F(OddImages, ChunksThatClaimMoreThanTheFile) {
    const std::string rows(4, '\0');
    EXPECT_EQ(pixels("whole.png", png(1, 1, 8, 2, rows, png_chunk("tEXt", "a"))), Bytes(3, 0));
    for (const std::string kind : {"IDAT", "tEXt"})
        expect_error(ExitCode::input, "claims 1073741823 bytes of", [&] {
            pixels("claims.png", png(1, 1, 8, 2, rows, big_endian(0x3fffffff) + kind));
        });
}

TEST_F(OddImages, CutOffAnywhereIsAnErrorOrAnImage) {
    ImageU8 image(24, 16, 3);
    for (std::size_t i = 0; i < image.pixels.size(); ++i)
        image.pixels[i] = static_cast<std::uint8_t>(i * 7);
    for (const std::string& whole : {png_bytes(image), jpeg_bytes(image, 80)}) {
        std::size_t refused = 0;
        for (std::size_t size = 0; size < whole.size(); ++size) {
            try {
                // Baseline JPEG decoders fill in what is missing at the end of the data.
                EXPECT_EQ(read_image(write("cut", whole.substr(0, size)), 3).pixels.size(),
                          image.pixels.size());
            } catch (const Error& error) {
                EXPECT_EQ(error.code(), ExitCode::input);
                ++refused;
            }
        }
        EXPECT_GT(refused, whole.size() / 4) << "at least the headers are needed";
    }
}

}  // namespace
}  // namespace tvsgs
