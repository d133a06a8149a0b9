// Tests SPZ: hand-made bytes, the format's error bounds, rotations of frames by rendering, and
// damaged files.
#include <gtest/gtest.h>
#include <zlib.h>

#include <cstring>

#include "core/device/threads.h"
#include "io/splats/splat_errors.h"
#include "io/splats/splat_files.h"
#include "io/splats/spz_math.h"
#include "io_test.h"
#include "render/backbone.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes gzip(const Bytes& bytes) {
    z_stream z{};
    deflateInit2(&z, 6, Z_DEFLATED, 16 + MAX_WBITS, 8, Z_DEFAULT_STRATEGY);
    Bytes out(deflateBound(&z, bytes.size()) + 64);
    z.next_in = const_cast<Bytef*>(bytes.data()), z.avail_in = uInt(bytes.size());
    z.next_out = out.data(), z.avail_out = uInt(out.size());
    EXPECT_EQ(deflate(&z, Z_FINISH), Z_STREAM_END);
    out.resize(z.total_out);
    deflateEnd(&z);
    return out;
}

Bytes gunzip(const Bytes& bytes) {
    z_stream z{};
    inflateInit2(&z, 16 + MAX_WBITS);
    Bytes out(1 << 20);
    z.next_in = const_cast<Bytef*>(bytes.data()), z.avail_in = uInt(bytes.size());
    z.next_out = out.data(), z.avail_out = uInt(out.size());
    EXPECT_EQ(inflate(&z, Z_FINISH), Z_STREAM_END);
    out.resize(z.total_out);
    inflateEnd(&z);
    return out;
}

void put_number(Bytes& out, std::uint64_t value, int bytes) {
    for (int b = 0; b < bytes; ++b) out.push_back(std::uint8_t(value >> (8 * b)));
}

/// A hand-made zstd frame without compression: one raw block.
Bytes raw_frame(const Bytes& bytes) {
    Bytes out{0x28, 0xb5, 0x2f, 0xfd, 0xa0};  // one segment, its size in four bytes
    put_number(out, bytes.size(), 4);
    put_number(out, bytes.size() << 3 | 1, 3);
    out.insert(out.end(), bytes.begin(), bytes.end());
    return out;
}

/// Hand-made version 4 with the content of version 3, and a gap before its table.
Bytes version_four(const Bytes& three, std::size_t before_table = 0) {
    std::uint32_t count = 0;
    std::memcpy(&count, &three[8], 4);
    const std::size_t rest = std::size_t(three[12] + 1) * std::size_t(three[12] + 1) - 1;
    std::vector<Bytes> frames;
    std::vector<std::size_t> sizes;
    std::size_t at = 16;
    for (const std::size_t width :
         {std::size_t{9}, std::size_t{1}, std::size_t{3}, std::size_t{3}, std::size_t{4}, 3 * rest})
        if (width > 0) {
            const auto from = three.begin() + std::ptrdiff_t(at);
            sizes.push_back(width * count), at += sizes.back();
            frames.push_back(raw_frame(Bytes(from, three.begin() + std::ptrdiff_t(at))));
        }
    Bytes out(three.begin(), three.begin() + 16);
    out[4] = 4, out[15] = std::uint8_t(frames.size());
    put_number(out, 32 + before_table, 4);
    out.resize(32 + before_table);
    for (std::size_t i = 0; i < frames.size(); ++i)
        put_number(out, frames[i].size(), 8), put_number(out, sizes[i], 8);
    for (const Bytes& frame : frames) out.insert(out.end(), frame.begin(), frame.end());
    return out;
}

Gaussians<Cpu> one_splat() {
    Gaussians<Cpu> g;
    resize(g, 1, 1);
    g.means[0] = {2000, 1, -0.25f};
    g.log_scales[0] = {-10, -9.5f, 0.03f};
    g.quats[0] = {2, 0, 0, 0};
    g.opacity_logits[0] = 0;
    g.sh[0] = {0, 3.33f, -4};
    g.sh[1] = {0.5f, -0.5f, 0}, g.sh[2] = {0.25f, 2, -2}, g.sh[3] = {0.02f, 0.04f, -0.04f};
    return g;
}

TEST(Spz, HasTheBytesOfTheSpecification) {
    // 2000 leaves 12 fractional bits; y and z change sign, and with them the coefficients of y and
    // z, the first two of degree 1. Rotation: w, number 3, is the largest, and the rest is 0.
    const Bytes expected = {
        'N',  'G',  'S',  'P',  3, 0, 0,    0,    1,    0,
        0,    0,    1,    12,   0, 0, 0x00, 0x00, 0x7d,  // 2000 * 4096 = 0x7d0000
        0x00, 0xf0, 0xff,                                // -4096
        0x00, 0x04, 0x00,                                // 1024
        128,                                             // 127.5 away from zero
        128,  255,  0,                                   // 127.5; 254.9; below 0
        0,    8,    160,                                 // 160.48
        0,    0,    0,    0xc0,                          //
        64,   192,  128,                                 // of -0.5, 0.5, 0
        96,   0,    255,                                 // of -0.25, -2 and 2
        128,  136,  120,  // 131 and 133 and 123 in steps of 8, halves up: 128, 136, 120
    };
    EXPECT_EQ(gunzip(spz_bytes(one_splat())), expected);
}

TEST(Spz, OfVersionTwoDiffersInItsRotations) {
    Gaussians<Cpu> g = one_splat();
    g.quats[0] = {-0.5f, 0.5f, 0.5f, -0.5f};  // same as its negative: 0.5, -0.5, -0.5, 0.5
    SplatFileOptions options;
    options.spz_version = 2, options.frame = SplatFrame::rdf, options.antialiased = true;
    const Bytes bytes = gunzip(spz_bytes(g, options));
    ASSERT_EQ(bytes.size(), 16u + 19 + 9);
    EXPECT_EQ(bytes[4], 2);
    EXPECT_EQ(bytes[14], 1);
    EXPECT_EQ(Bytes(bytes.begin() + 32, bytes.begin() + 35), (Bytes{64, 64, 191}));
    g.quats[0] = {0, 0, 0, -1};
    options.spz_version = 3;  // z, number 2, counts as 1, so the zeros of the others are negative
    const Bytes three = gunzip(spz_bytes(g, options));
    EXPECT_EQ(Bytes(three.begin() + 32, three.begin() + 36), (Bytes{0, 2, 8, 0xa0}));
}

TEST(Spz, OfVersionFourHasTheNumbersOfVersionThree) {
    for (const int degree : {0, 3}) {
        const Gaussians<Cpu> g = test::random_gaussians(300, 4, 0.05, degree);
        SplatFileOptions options;
        options.antialiased = true;
        const Bytes three = spz_bytes(g, options), inside = gunzip(three);
        options.spz_version = 4;
        const Bytes four = spz_bytes(g, options);
        EXPECT_EQ(four, spz_bytes(g, options));
        // The header, and a table that ends with the file.
        const auto number = [&](std::size_t at, int bytes) {
            std::uint64_t value = 0;
            std::memcpy(&value, &four.at(at), std::size_t(bytes));
            return value;
        };
        EXPECT_EQ(Bytes(four.begin(), four.begin() + 4), Bytes(inside.begin(), inside.begin() + 4));
        EXPECT_EQ(four[4], 4);
        EXPECT_EQ(number(8, 4), 300u);
        EXPECT_EQ(four[12], degree);
        EXPECT_EQ(four[14], 1) << "antialiased, without extensions";
        ASSERT_EQ(four[15], degree == 0 ? 5 : 6);
        for (std::size_t at = 20; at < 32; ++at) EXPECT_EQ(four[at], 0);
        const std::size_t table = number(16, 4);
        std::size_t end = table + 16u * four[15];
        const std::size_t widths[] = {9, 1, 3, 3, 4, 45};
        for (std::size_t i = 0; i < four[15]; ++i) {
            EXPECT_EQ(number(table + 16 * i + 8, 8), 300 * widths[i]) << i;
            EXPECT_EQ(number(end, 4), 0xfd2fb528u) << "a frame of zstd";
            end += number(table + 16 * i, 8);
        }
        EXPECT_EQ(end, four.size());
        // Files of any writer, compressed or not, give the same splats.
        const SpzContents expected = parse_spz(three, "a.spz");
        for (const Bytes& file : {four, version_four(inside), version_four(inside, 24)}) {
            const SpzContents read = parse_spz(file, "a.spz");
            EXPECT_EQ(read.version, 4);
            EXPECT_TRUE(read.antialiased);
            EXPECT_EQ(read.fractional_bits, expected.fractional_bits);
            const SplatErrors e = errors_of(read.splats, expected.splats);
            EXPECT_EQ(e.mean + e.log_scale + e.color + e.sh_1 + e.sh_rest + e.opacity, 0);
            EXPECT_LT(e.degrees, 1e-3);
        }
    }
}

TEST(Spz, RefusesDamagedFilesOfVersionFour) {
    SplatFileOptions options;
    options.spz_version = 4;
    const Bytes inside = gunzip(spz_bytes(test::random_gaussians(40, 2))),
                ours = spz_bytes(test::random_gaussians(40, 2), options),
                file = version_four(inside);
    const auto refuses = [](const Bytes& bytes, const char* why) {
        expect_error(ExitCode::input, why, [&] { parse_spz(bytes, "a.spz"); });
    };
    for (const Bytes& good : {ours, file})
        for (std::size_t size = 4; size < good.size(); size += 1 + size / 16)
            refuses(Bytes(good.begin(), good.begin() + std::ptrdiff_t(size)),
                    size < 16 ? "not an SPZ file" : "");
    const auto changed = [&](std::size_t at, int value) {
        Bytes bytes = file;
        bytes[at] = std::uint8_t(value);
        return bytes;
    };
    Bytes longer = file;
    longer.push_back(0);
    refuses(longer, "1 bytes after its last array");
    refuses(gzip(file), "version 4 inside gzip");
    refuses(changed(4, 5), "SPZ version 5; expected 2, 3 or 4");
    refuses(changed(4, 3), "version 3 without gzip");
    refuses(changed(8, 41), "360 bytes of positions; its header (41 splats, degree 3) expects 369");
    refuses(changed(12, 0), "6 arrays; expected 5 for degree 0");
    refuses(changed(15, 5), "5 arrays; expected 6 for degree 3");
    refuses(changed(16, 31), "the table of arrays is at byte 31");
    refuses(changed(19, 0x7f), "outside the file");
    refuses(changed(39, 0x7f), "cut off in its positions");
    refuses(changed(128, 0), "its positions: damaged: zstd");
    refuses(changed(133, 0), "its positions: damaged: zstd");  // the size that the frame says
    Bytes claims = changed(10, 0x80);                          // 8,388,648 splats
    for (std::size_t i = 0, widths[] = {9, 1, 3, 3, 4, 45}; i < 6; ++i) {
        const std::uint64_t bytes = 8388648 * widths[i];
        std::memcpy(&claims[32 + 16 * i + 8], &bytes, 8);
    }
    refuses(claims, "more than its");
    Bytes broken = ours;
    broken[ours.size() - 2] ^= 1;  // a checksum
    refuses(broken, "its SH coefficients: damaged: zstd");
}

TEST(Spz, RoundsHarmonicsByTheirDegree) {
    SplatFileOptions options;
    options.spz_sh_bits_1 = 6, options.spz_sh_bits_rest = 3;
    const Bytes bytes = gunzip(spz_bytes(test::random_gaussians(1000, 3), options));
    for (std::size_t k = 0; k < 15; ++k) {
        int common = 0;  // bits that are set somewhere
        for (std::size_t i = 0; i < 1000; ++i) common |= bytes[16 + 20 * 1000 + 45 * i + 3 * k];
        EXPECT_EQ(common & -common, k < 3 ? 4 : 32) << k;  // the lowest of them
    }
}

TEST(Spz, KeepsTheBoundsOfEachAttribute) {
    for (const int version : {2, 3, 4}) {
        for (int degree = 0; degree <= 3; ++degree)
            for (const SplatFrame frame : {SplatFrame::rub, SplatFrame::rdf, SplatFrame::luf}) {
                Gaussians<Cpu> g = test::random_gaussians(1000, 7, 0.05, degree);
                for (Vec3f& p : g.means.span()) p = 300 * p;  // 14 fractional bits
                SplatFileOptions options;
                options.spz_version = version, options.frame = frame;
                const SpzContents read = parse_spz(spz_bytes(g, options), "a.spz", frame);
                const Gaussians<Cpu>& r = read.splats;
                EXPECT_EQ(read.version, version);
                EXPECT_EQ(read.fractional_bits, 14);
                EXPECT_FALSE(read.antialiased);
                ASSERT_EQ(r.size(), g.size());
                ASSERT_EQ(r.sh_degree, degree);
                const SplatErrors e = errors_of(r, g);
                EXPECT_LE(e.mean, std::ldexp(1, -15));
                EXPECT_LE(e.log_scale, 1.0 / 32 + 1e-6);
                EXPECT_LE(e.color, 0.013073);
                EXPECT_LE(e.sh_1, (8 + 1) / 256.0);
                EXPECT_LE(e.sh_rest, (16 + 1) / 256.0);
                EXPECT_LE(e.opacity, 1.0 / 510 + 1e-7);
                EXPECT_LT(e.degrees, version == 2 ? 12 : 0.22);
                EXPECT_GT(e.degrees, version == 2 ? 1 : 0.02);
            }
    }
}

TEST(Spz, PositionsGetTheBitsThatTheFarthestLeaves) {
    EXPECT_EQ(spz::fractional_bits(0), 20);
    EXPECT_EQ(spz::fractional_bits(7.99f), 20);
    EXPECT_EQ(spz::fractional_bits(8), 19);  // 2^23 does not fit
    EXPECT_EQ(spz::fractional_bits(2047.99f), 12);
    EXPECT_EQ(spz::fractional_bits(8388607), 0);
    EXPECT_EQ(spz::fractional_bits(8388608), -1);
    Gaussians<Cpu> g = one_splat();
    for (const float far : {8388607.0f, -8388607.0f, 7.99f, -8.01f}) {
        g.means[0] = {1, far, 0};
        const SpzContents read = parse_spz(spz_bytes(g), "a.spz");
        EXPECT_NEAR(read.splats.means[0].y, far, std::ldexp(1, -read.fractional_bits - 1));
    }
    g.means[0].x = 9e6f;
    expect_error(ExitCode::input, "lies 9e+06 units from zero", [&] { spz_bytes(g); });
}

/// Rotations at the limits of their packing, opacities of 0 and 1, and values outside the ranges.
TEST(Spz, KeepsExtremes) {
    for (const Quatf q : {Quatf{1, 1, 1, 1}, Quatf{-1, 1, -1, 1}, Quatf{0, 0, 0, -1},
                          Quatf{0, 1, 1, 0}, Quatf{1e-3f, -1, 0, 1}})
        EXPECT_LT(angle_deg(spz::unpack_smallest_three(spz::pack_smallest_three(q)), q), 0.22);
    EXPECT_EQ(spz::unpack_opacity(spz::pack_opacity(-90)), -kMaxLogit);
    EXPECT_EQ(spz::unpack_opacity(spz::pack_opacity(900)), kMaxLogit);
    EXPECT_EQ(spz::unpack_log_scale(spz::pack_log_scale(-30)), -10);
    EXPECT_EQ(spz::unpack_log_scale(spz::pack_log_scale(30)), 5.9375f);
    EXPECT_EQ(spz::unpack_sh(spz::pack_sh(-7, 8)), -1);
    EXPECT_EQ(spz::unpack_sh(spz::pack_sh(7, 8)), 127 / 128.0f);
    for (int i = -64; i < 64; ++i)  // with all bits: to the nearest
        EXPECT_EQ(spz::unpack_sh(spz::pack_sh(float(i) / 128, 8)), float(i) / 128);
}

/// A camera in the file's frame sees the same image as the camera in our frame.
TEST(SplatFrame, TurnsHarmonicsAndShapesAlike) {
    const Gaussians<Cpu> g = test::random_gaussians(300, 3, 0.15);
    const Camera camera = test::test_camera(48, 40);
    const auto render = [](const Gaussians<Cpu>& splats, const Camera& from) {
        const auto backbone = make_backbone<Cpu>("ewa", {});
        const auto& images = backbone->forward(splats, from, 3, Maps::color);
        return std::vector<Vec3f>(images.color.span().begin(), images.color.span().end());
    };
    const auto difference = [](const std::vector<Vec3f>& a, const std::vector<Vec3f>& b) {
        double most = 0;
        for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, double(norm(a[i] - b[i])));
        return most;
    };
    const std::vector<Vec3f> expected = render(g, camera);
    for (const SplatFrame frame : {SplatFrame::rub, SplatFrame::luf}) {
        const HalfTurn turn = half_turn(frame);
        Gaussians<Cpu> turned;
        copy(g, turned);
        tvsgs::turn(turned, turn);
        Camera from = camera;
        for (int row = 0; row < 3; ++row)
            for (int c = 0; c < 3; ++c) from.camera_from_world.R[row][c] *= turn.signs[c];
        EXPECT_LT(difference(render(turned, from), expected), 1e-4);
        copy(g.sh, turned.sh);  // otherwise the test would not notice
        EXPECT_GT(difference(render(turned, from), expected), 0.05);
    }
}

TEST(Spz, IsTheSameForAnyNumberOfThreads) {
    const Gaussians<Cpu> g = test::random_gaussians(3000, 5);
    const int threads = thread_count();
    set_thread_count(1);
    const Bytes one = spz_bytes(g);
    set_thread_count(5);
    const Bytes five = spz_bytes(g);
    set_thread_count(threads);
    EXPECT_EQ(one, five);
}

class SpzFiles : public IoTest {};

TEST_F(SpzFiles, AreWrittenOverOursAndNoOthers) {
    const std::string path = (folder / "a.spz").string();
    const Gaussians<Cpu> g = one_splat();
    write_splat_file(path, g);
    write_splat_file(path, g);
    const std::string bytes = read_bytes(path);
    EXPECT_EQ(Bytes(bytes.begin(), bytes.end()), spz_bytes(g));
    EXPECT_EQ(read_spz(path).splats.size(), 1);
    write("b.spz", "holiday");
    expect_error(ExitCode::usage, "already exists and is not ours",
                 [&] { write_splat_file((folder / "b.spz").string(), g); });
}

TEST(Spz, RefusesToWriteWhatItCannotSay) {
    expect_error(ExitCode::input, "0 splats", [] {
        Gaussians<Cpu> none;
        resize(none, 0, 0);
        spz_bytes(none);
    });
    constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
    const auto refuses = [](const char* what, const auto& spoil) {
        Gaussians<Cpu> g = one_splat();
        spoil(g);
        expect_error(ExitCode::numerical, what, [&] { spz_bytes(g); });
    };
    refuses("the centre of splat 0", [](auto& g) { g.means[0].y = kNan; });
    refuses("a scale of splat 0", [](auto& g) { g.log_scales[0].z = -1 / 0.0f; });
    refuses("the rotation of splat 0", [](auto& g) { g.quats[0].w = kNan; });
    refuses("the opacity of splat 0", [](auto& g) { g.opacity_logits[0] = kNan; });
    refuses("a colour of splat 0", [](auto& g) { g.sh[3].x = kNan; });
}

TEST(Spz, RefusesDamagedFiles) {
    const Bytes file = spz_bytes(test::random_gaussians(40, 2)), good = gunzip(file);
    const auto refuses = [](const Bytes& bytes, const char* why) {
        expect_error(ExitCode::input, why, [&] { parse_spz(bytes, "a.spz"); });
    };
    for (std::size_t size = 0; size < file.size(); size += 1 + size / 16) {
        const Bytes cut(file.begin(), file.begin() + std::ptrdiff_t(size));
        refuses(cut, size < 2 ? "neither gzip nor" : "cut off");
    }
    refuses(Bytes(file.begin(), file.end() - 1), "cut off");
    const auto changed = [&](std::size_t at, int value) {
        Bytes bytes = good;
        bytes[at] = std::uint8_t(value);
        return gzip(bytes);
    };
    refuses(good, "without gzip");
    refuses({'P', 'K', 3, 4}, "neither gzip nor");
    refuses(changed(0, 'X'), "no SPZ header");
    refuses(gzip({'N', 'G', 'S', 'P', 3}), "no SPZ header");
    refuses(changed(4, 1), "SPZ version 1; expected 2, 3 or 4");
    refuses(changed(4, 4), "SPZ version 4 inside gzip");
    refuses(changed(8, 0), "claims 0 splats");
    refuses(changed(11, 0x7f), "expected 1 to 50000000");
    refuses(changed(10, 2), "more than its");  // 131112: none of them are there
    refuses(changed(8, 41), "bytes of splats; its header (41 splats, degree 3)");
    refuses(changed(12, 5), "SH degree 5");
    refuses(changed(13, 32), "32 fractional bits");
    Bytes broken = file;
    broken[file.size() / 2] ^= 0x10;
    refuses(broken, "damaged");
    broken = file, broken[file.size() - 6] ^= 1;  // its checksum
    refuses(broken, "damaged");
    Bytes bomb = good;
    bomb.resize(64 << 20);
    refuses(gzip(bomb), "bytes after its splats");
}

TEST(Spz, TakesWhatOtherReadersTake) {
    Bytes bytes = gunzip(spz_bytes(test::random_gaussians(40, 2)));
    bytes[14] = 3,
    bytes[15] = 9;  // flags, among them extensions behind the arrays; a reserved byte
    bytes.resize(bytes.size() + 24);
    const SpzContents read = parse_spz(gzip(bytes), "a.spz");
    EXPECT_EQ(read.splats.size(), 40);
    EXPECT_TRUE(read.antialiased);

    Bytes four = gunzip(spz_bytes(one_splat()));  // degree 4: 24 coefficients, of which 15 are ours
    four[12] = 4;
    four.resize(four.size() - 9 + 72, 192);
    const SpzContents cut = parse_spz(gzip(four), "a.spz");
    EXPECT_EQ(cut.splats.sh_degree, 3);
    EXPECT_EQ(std::abs(cut.splats.sh[15].x), 0.5f);
}

}  // namespace
}  // namespace tvsgs
