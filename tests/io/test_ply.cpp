#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "core/math/rng.h"
#include "core/math/smoothing_filter.h"
#include "io/io_test.h"
#include "io/splats/ply.h"

namespace tvsgs {
namespace {

class Ply : public IoTest {};
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

template <class T>
std::string bytes_of(T value, bool swapped) {
    std::string out(reinterpret_cast<const char*>(&value), sizeof value);
    if (swapped) std::reverse(out.begin(), out.end());
    return out;
}

const char* const kMeshHeader =
    "element thing 2\nproperty list uchar short numbers\nproperty char c\n"
    "element vertex 4\nproperty double x\nproperty uchar blue\nproperty float y\nproperty uchar "
    "red\nproperty int extra\nproperty float z\nproperty uchar green\n"
    "element face 2\nproperty uchar flags\nproperty list uchar uint vertex_index\nproperty list "
    "int float texcoord\n";

void expect_mesh(const PlyContents& ply) {
    ASSERT_EQ(ply.points.positions.size(), 4u);
    EXPECT_EQ(ply.points.positions[2].x, 2.5f);
    EXPECT_EQ(ply.points.positions[2].y, -2);
    EXPECT_EQ(ply.points.positions[2].z, 102);
    ASSERT_EQ(ply.points.colors.size(), 4u);
    EXPECT_FLOAT_EQ(ply.points.colors[1].x, 51 / 255.f);
    EXPECT_FLOAT_EQ(ply.points.colors[1].y, 1);
    EXPECT_FLOAT_EQ(ply.points.colors[1].z, 0);
    ASSERT_EQ(ply.faces.size(), 3u);  // a triangle, and a quadrangle as a fan
    EXPECT_EQ(ply.faces[0].z, 2);
    EXPECT_EQ(ply.faces[2].x, 3);
    EXPECT_EQ(ply.faces[2].y, 1);
    EXPECT_EQ(ply.faces[2].z, 0);
    EXPECT_FALSE(ply.is_splats);
}

TEST_F(Ply, TextAndBothByteOrdersWithPropertiesInAnyOrder) {
    std::string text = "ply\r\nformat ascii 1.0\r\ncomment any\n" + std::string(kMeshHeader) +
                       "end_header\n2 7 8 1\n0 1\n";
    for (int i = 0; i < 4; ++i) text += str(i + 0.5, " 0 ", -i, " 51 9 ", 100 + i, " 255\n");
    text += "0 3 0 1 2 2 0.5 0.5\n0 4 3 2 1 0 0";
    expect_mesh(read_ply(write("text.ply", text)));

    for (const bool big : {false, true}) {
        std::string b = str("ply\nformat binary_", big ? "big" : "little", "_endian 1.0\n",
                            kMeshHeader, "end_header\n");
        const auto u8 = [&](int v) { b += static_cast<char>(v); };
        u8(2), b += bytes_of<std::int16_t>(7, big), b += bytes_of<std::int16_t>(8, big), u8(1);
        u8(0), u8(1);
        for (int i = 0; i < 4; ++i) {
            b += bytes_of(i + 0.5, big), u8(0), b += bytes_of(static_cast<float>(-i), big), u8(51);
            b += bytes_of(9, big), b += bytes_of(static_cast<float>(100 + i), big), u8(255);
        }
        const auto face = [&](std::vector<std::uint32_t> indices, int coordinates) {
            u8(0), u8(static_cast<int>(indices.size()));
            for (const auto index : indices) b += bytes_of(index, big);
            b += bytes_of(coordinates, big);
            for (int i = 0; i < coordinates; ++i) b += bytes_of(0.5f, big);
        };
        face({0, 1, 2}, 2), face({3, 2, 1, 0}, 0);
        expect_mesh(read_ply(write("binary.ply", b)));
        // Every truncated file gives an error with a code.
        for (std::size_t size = 0; size < b.size(); ++size)
            expect_error(ExitCode::input, "E_PLY_",
                         [&] { read_ply(write("cut.ply", b.substr(0, size))); });
    }
}

TEST_F(Ply, FloatColorsAndNormals) {
    const std::string header =
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty "
        "float z\n"
        "property float nx\nproperty float ny\nproperty float nz\nproperty float red\nproperty "
        "float green\nproperty float blue\nend_header\n";
    const PlyContents ply = read_ply(write("a.ply", header + "1 2 3 0 0 2 0.25 -1 nan"));
    EXPECT_EQ(ply.points.normals[0].z, 1);  // unit
    EXPECT_EQ(ply.points.colors[0].x, 0.25f);
    EXPECT_EQ(ply.points.colors[0].y, 0);
    EXPECT_EQ(ply.points.colors[0].z, 0);
}

TEST_F(Ply, HostileHeaders) {
    const auto fails = [&](const std::string& word, const std::string& text) {
        expect_error(ExitCode::input, word, [&] { read_ply(write("a.ply", text)); });
    };
    const std::string start = "ply\nformat binary_little_endian 1.0\n",
                      xyz = "property float x\nproperty float y\nproperty float z\n";
    fails("E_PLY_HEADER", "");
    fails("E_PLY_HEADER", "plx\n");
    fails("E_PLY_HEADER", "ply\nformat binary_middle_endian 1.0\nend_header\n");
    fails("E_PLY_HEADER", "ply\nelement vertex 0\n" + xyz + "end_header\n");
    fails("E_PLY_HEADER", start + "end_header\n");
    fails("E_PLY_HEADER", start + "element vertex 1\n" + xyz);
    fails("E_PLY_HEADER", start + "comment " + std::string(2 << 20, 'x') + "\nend_header\n");
    fails("E_PLY_HEADER", start + "element vertex 1\nproperty half x\nend_header\n");
    fails("E_PLY_HEADER", start + "element vertex -1\n" + xyz + "end_header\n");
    fails("E_PLY_HEADER", start + "element vertex 1\n" + xyz + "property float x\nend_header\n");
    fails("E_PLY_HEADER",
          start + "element vertex 0\n" + xyz + "property list uchar int l\nend_header\n");
    fails("E_PLY_HEADER",
          start + "element vertex 0\n" + xyz +
              "element face 0\nproperty list float int vertex_indices\nend_header\n");
    fails("E_PLY_HEADER", start + "property float x\nend_header\n");
    for (const char* count : {"2", "4294967296", "9223372036854775808", "18446744073709551615"}) {
        fails("E_PLY_COUNT", start + "element vertex " + count + "\n" + xyz + "end_header\n" +
                                 std::string(12, '\0'));
        fails("E_PLY_COUNT", start + "element other " + count +
                                 "\nproperty list int int l\nelement vertex 0\n" + xyz +
                                 "end_header\nxyz");
        fails("E_PLY_COUNT", std::string("ply\nformat ascii 1.0\nelement vertex ") + count + "\n" +
                                 xyz + "end_header\n1 2 3");
    }
    fails("E_PLY_COUNT",
          "ply\nformat ascii 1.0\nelement vertex 1\n" + xyz + "end_header\n1 2 three");
    const std::string face = "element face 1\nproperty list int int vertex_indices\nend_header\n";
    const std::string one = start + "element vertex 1\n" + xyz + face + std::string(12, '\0');
    fails("E_PLY_COUNT", one + bytes_of(-1, false));
    fails("E_PLY_COUNT", one + bytes_of(0x7fffffff, false));
    fails("E_PLY_FACE", one + bytes_of(1, false) + bytes_of(1, false));
    fails("E_PLY_FACE", one + bytes_of(1, false) + bytes_of(-1, false));
}

Gaussians<Cpu> random_splats(int count, int degree) {
    Gaussians<Cpu> g;
    resize(g, count, degree);
    std::uint32_t draw = 0;
    const auto next = [&] { return normal3(random4(1, RandomStream::test, draw++)); };
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        g.means[i] = next(), g.log_scales[i] = next();
        const Vec3f v = next();
        g.quats[i] = {v.x, v.y, v.z, 0.5f};
        g.opacity_logits[i] = next().x;
    }
    for (std::size_t i = 0; i < g.sh.size(); ++i) g.sh[i] = next();
    return g;
}

template <class T>
bool same(const Buffer<T, Cpu>& a, const Buffer<T, Cpu>& b) {
    return a.size() == b.size() &&
           (a.size() == 0 || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

TEST_F(Ply, SplatsComeBackBitForBit) {
    start_manifest(folder);  // allows it to replace its own files
    for (const int degree : {0, 1, 2, 3})
        for (const int count : {0, 1, 6000}) {  // 6000 splats: more than one piece of a MiB
            const Gaussians<Cpu> g = random_splats(count, degree);
            const std::string path = (folder / "splats.ply").string();
            write_splat_ply(path, g);
            const Gaussians<Cpu> back = read_splat_ply(path);
            EXPECT_EQ(back.sh_degree, degree);
            EXPECT_TRUE(same(g.means, back.means) && same(g.log_scales, back.log_scales) &&
                        same(g.quats, back.quats) && same(g.opacity_logits, back.opacity_logits) &&
                        same(g.sh, back.sh));
            EXPECT_TRUE(read_ply(path).is_splats);
        }
}

TEST_F(Ply, DiscsHaveTwoScalesOrAThinThirdOne) {
    start_manifest(folder);
    const Gaussians<Cpu> g = random_splats(50, 1);
    const std::string path = (folder / "discs.ply").string();
    for (const PlyScales written : {PlyScales::two, PlyScales::three}) {
        write_splat_ply(path, g, {}, written);
        PlyScales found = written == PlyScales::two ? PlyScales::three : PlyScales::two;
        const Gaussians<Cpu> back = read_splat_ply(path, {}, &found);
        EXPECT_EQ(found, written);
        EXPECT_TRUE(same(g.means, back.means) && same(g.quats, back.quats) &&
                    same(g.opacity_logits, back.opacity_logits) && same(g.sh, back.sh));
        for (std::size_t i = 0; i < g.means.size(); ++i) {
            const Vec3f was = g.log_scales[i], now = back.log_scales[i];
            EXPECT_EQ(now.x, was.x);
            EXPECT_EQ(now.y, was.y);
            EXPECT_EQ(now.z,
                      written == PlyScales::two ? std::max(was.x, was.y) + std::log(1e-6f) : was.z);
        }
    }
}

TEST_F(Ply, SplatFileIsExactlyThatOf3dgs) {
    const Gaussians<Cpu> g = random_splats(2, 3);
    const std::string path = (folder / "splats.ply").string();
    write_splat_ply(path, g);
    std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex 2\n";
    for (const char* name : {"x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"})
        header += str("property float ", name, "\n");
    for (int i = 0; i < 45; ++i) header += str("property float f_rest_", i, "\n");
    for (const char* name :
         {"opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"})
        header += str("property float ", name, "\n");
    header += "end_header\n";
    const std::string bytes = read_bytes(path);
    ASSERT_EQ(bytes.size(), header.size() + 2 * 248);
    EXPECT_EQ(bytes.substr(0, header.size()), header);
    float row[62];
    std::memcpy(row, &bytes[header.size() + 248], sizeof row);
    EXPECT_EQ(row[2], g.means[1].z);
    EXPECT_EQ(row[5], 0);
    EXPECT_EQ(row[7], g.sh[1].y);
    EXPECT_EQ(row[9], g.sh[2 * 1 + 1].x);           // red of coefficient 1
    EXPECT_EQ(row[9 + 15 + 3], g.sh[2 * 4 + 1].y);  // green of coefficient 4
    EXPECT_EQ(row[9 + 44], g.sh[2 * 15 + 1].z);
    EXPECT_EQ(row[54], g.opacity_logits[1]);
    EXPECT_EQ(row[58], g.quats[1].w);
    EXPECT_EQ(row[61], g.quats[1].z);
}

TEST_F(Ply, ExampleSplats) {
    const Gaussians<Cpu> g = read_splat_ply((kExample / "splat_3dgs.ply").string());
    ASSERT_EQ(g.size(), 2);
    EXPECT_EQ(g.sh_degree, 1);
    // EXPECTED.txt: floats of rounded numbers.
    const Vec3f rgb = 0.28209479f * g.sh[0] + Vec3f{0.5f, 0.5f, 0.5f};
    EXPECT_NEAR(rgb.x, 0.8f, 1e-6);
    EXPECT_NEAR(rgb.y, 0.5f, 1e-6);
    EXPECT_NEAR(rgb.z, 0.2f, 1e-6);
    EXPECT_NEAR(1 / (1 + std::exp(-g.opacity_logits[0])), 0.25f, 1e-6);
    const Vec3f scale = exp(g.log_scales[0]);
    EXPECT_NEAR(scale.x, 0.01f, 1e-8);
    EXPECT_NEAR(scale.y, 0.02f, 1e-8);
    EXPECT_NEAR(scale.z, 0.0001f, 1e-10);
    EXPECT_EQ(normalize(g.quats[0]).w, 1);
    for (int k = 1; k < 4; ++k)
        for (int c = 0; c < 3; ++c)
            EXPECT_FLOAT_EQ(g.sh[static_cast<std::size_t>(2 * k)][c],
                            0.01f * static_cast<float>(3 * c + k - 1));
}

/// A hand-made splat file: 14 properties and the given extra ones.
std::string splat_text(const std::string& more_properties,
                       const std::vector<std::string>& rows,
                       bool third_scale = true) {
    std::string text =
        str("ply\nformat ascii 1.0\nelement vertex ", rows.size(), "\n", more_properties);
    for (const char* name : {"opacity", "rot_3", "rot_2", "rot_1", "rot_0", "z", "y", "x", "f_dc_0",
                             "f_dc_1", "f_dc_2", "scale_0", "scale_1", "scale_2"})
        if (third_scale || std::string(name) != "scale_2")
            text += str("property float ", name, "\n");
    text += "end_header\n";
    for (const std::string& row : rows) text += row + "\n";
    return text;
}

TEST_F(Ply, SplatsThatAreNotFiniteAreDropped) {
    const std::string path = write(
        "a.ply",
        splat_text(
            "", {"0.5 0 0 0 1 3 2 1 0 0 0 -1 -2 -3", "nan 0 0 0 1 3 2 1 0 0 0 -1 -2 -3",
                 "0.5 0 0 0 0 3 2 1 0 0 0 -1 -2 -3", "0.5 0 0 0 1 3 2 nan 0 0 0 -1 -2 -3",
                 "0.5 0 0 0 1 3 2 1 0 0 0 -1 inf -3", "0.5 0 0 0 1 3 2 1 0 nan 0 -1 -2 -3",
                 "inf 0 0 0 1 3 2 1 0 0 0 -1 -2 -inf", "0.5 0 0 0 1 3 2 1 0 0 0 -inf -inf -inf"}));
    const Gaussians<Cpu> g = read_splat_ply(path);
    ASSERT_EQ(g.size(), 2);
    EXPECT_EQ(g.means[0].x, 1);
    EXPECT_EQ(g.quats[0].w, 1);
    EXPECT_EQ(g.log_scales[0].z, -3);
    EXPECT_GT(g.opacity_logits[1], 20);  // infinite: opaque, now finite
    EXPECT_FLOAT_EQ(g.log_scales[1].z, -1 + std::log(1e-6f));
    write_splat_ply((folder / "b.ply").string(), g);
}

TEST_F(Ply, FlatSplatsAndFilters) {
    const Gaussians<Cpu> flat =
        read_splat_ply(write("a.ply", splat_text("", {"0.5 0 0 0 1 3 2 1 0 0 0 -1 -2"}, false)));
    EXPECT_FLOAT_EQ(flat.log_scales[0].z, -1 + std::log(1e-6f));
    // Scales 1 with a filter of sqrt(3): 2, and the opacity falls by 2^3, from 1/2 to 1/16 (to the
    // precision of float).
    const Gaussians<Cpu> g = read_splat_ply(
        write("b.ply", splat_text("property double filter_3D\n",
                                  {"1.7320508075688772 0 0 0 0 1 3 2 1 0 0 0 0 0 0"})));
    EXPECT_NEAR(g.log_scales[0].y, std::log(2.0), 1e-6);
    EXPECT_NEAR(1 / (1 + std::exp(-g.opacity_logits[0])), 1.0 / 16, 1e-6);
}

TEST_F(Ply, AFilterComesBackInScalesAndOpacities) {
    Gaussians<Cpu> g = random_splats(20, 3);
    copy(std::vector<float>(20, 0.05f), g.filter);
    g.filter[7] = 0;
    const std::string path = (folder / "filtered.ply").string();
    write_splat_ply(path, g);
    const Gaussians<Cpu> read = read_splat_ply(path);
    EXPECT_TRUE(read.filter.empty());
    ASSERT_EQ(read.size(), 20);
    for (std::size_t i = 0; i < 20; ++i) {
        const auto s = smoothed(g.log_scales[i], g.filter[i]);
        for (int c = 0; c < 3; ++c)
            EXPECT_NEAR(std::exp(read.log_scales[i][c]), s.scales[c], 1e-6 * s.scales[c]);
        EXPECT_NEAR(1 / (1 + std::exp(-read.opacity_logits[i])),
                    s.dimming / (1 + std::exp(-g.opacity_logits[i])), 1e-6);
        EXPECT_EQ(read.quats[i].x, g.quats[i].x);
    }
    EXPECT_NEAR(read.opacity_logits[7], g.opacity_logits[7], 1e-5);
    g.filter[3] = kNan;
    expect_error(ExitCode::numerical, "filter_3D of splat 3 is nan",
                 [&] { write_splat_ply((folder / "none.ply").string(), g); });
    g.filter.resize(19);
    expect_error(ExitCode::internal, "19 filters for 20",
                 [&] { write_splat_ply((folder / "none.ply").string(), g); });
}

TEST_F(Ply, HarmonicsOfDegreeFourAreCutAndOddNumbersRefused) {
    const auto with_rest = [](int count) {
        std::string properties, row;
        for (int i = 0; i < count; ++i)
            properties += str("property float f_rest_", i, "\n"), row += str(i, " ");
        return splat_text(properties, {row + "0.5 0 0 0 1 3 2 1 0 0 0 -1 -2 -3"});
    };
    const Gaussians<Cpu> g = read_splat_ply(write("a.ply", with_rest(72)));
    EXPECT_EQ(g.sh_degree, 3);
    EXPECT_EQ(g.sh[15].x, 14);
    EXPECT_EQ(g.sh[1].y, 24);
    EXPECT_EQ(g.sh[15].z, 48 + 14);
    for (const int count : {1, 3, 10, 46})
        expect_error(ExitCode::input, "E_PLY_HEADER",
                     [&] { read_splat_ply(write("b.ply", with_rest(count))); });
    expect_error(ExitCode::input, "E_PLY_HEADER", [&] {
        read_splat_ply(write("b.ply", splat_text("property float f_rest_7\n", {})));
    });
}

TEST_F(Ply, CloudsAreNoSplats) {
    write_cloud_ply((folder / "cloud.ply").string(), {{{1, 2, 3}}, {}, {}});
    expect_error(ExitCode::input, "E_PLY_NOT_SPLAT",
                 [&] { read_splat_ply((folder / "cloud.ply").string()); });
}

TEST_F(Ply, WritersRefuseWhatIsNotFinite) {
    const std::string path = (folder / "out.ply").string();
    Gaussians<Cpu> g = random_splats(5, 1);
    g.sh[5 * 2 + 3].y = kNan;  // coefficient 2 of splat 3, green: f_rest_(3 + 1)
    expect_error(ExitCode::numerical, "f_rest_4 of splat 3 is nan",
                 [&] { write_splat_ply(path, g); });
    expect_error(ExitCode::numerical, "vertex 1", [&] {
        write_mesh_ply(path, {{{0, 0, 0}, {0, kInf, 0}}, {}, {}});
    });
    expect_error(ExitCode::numerical, "normal 0", [&] {
        write_cloud_ply(path, {{{0, 0, 0}}, {}, {{0, 0, kNan}}});
    });
    EXPECT_TRUE(std::filesystem::is_empty(folder));
}

TEST_F(Ply, MeshesAndCloudsComeBack) {
    const std::string path = (folder / "out.ply").string();
    write_mesh_ply(path, {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0.25f}},
                          {{1, 0, 0.2f}, {0, 1, 0}, {2, -1, 1}},
                          {{0, 1, 2}, {2, 1, 0}}});
    const PlyContents mesh = read_ply(path);
    ASSERT_EQ(mesh.faces.size(), 2u);
    EXPECT_EQ(mesh.faces[1].x, 2);
    EXPECT_EQ(mesh.points.positions[2].z, 0.25f);
    EXPECT_FLOAT_EQ(mesh.points.colors[0].z, 0.2f);
    EXPECT_EQ(mesh.points.colors[2].x, 1);
    EXPECT_EQ(mesh.points.colors[2].y, 0);  // clamped
    // Other readers may ignore the property with the numbers of views.
    write_mesh_ply(path, {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0.25f}}, {}, {{0, 1, 2}}, {3, 0, 255}});
    const std::string bytes = read_bytes(path);
    EXPECT_NE(bytes.find("property float z\nproperty uchar views\nelement face 1\n"),
              std::string::npos);
    EXPECT_EQ(bytes.size() - bytes.find("end_header\n") - 11, 3 * 13 + 13u);
    EXPECT_EQ(static_cast<unsigned char>(bytes[bytes.size() - 14]), 255);
    EXPECT_EQ(read_ply(path).points.positions[2].y, 1);
    expect_error(ExitCode::internal, "numbers of views", [&] {
        write_mesh_ply(path, {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {}, {{0, 1, 2}}, {3}});
    });
    write_cloud_ply(path, {{{1, 2, 3}}, {{0, 1, 0}}, {{0, 0, -1}}});
    const PlyContents cloud = read_ply(path);
    EXPECT_EQ(cloud.points.positions[0].y, 2);
    EXPECT_EQ(cloud.points.colors[0].y, 1);
    EXPECT_EQ(cloud.points.normals[0].z, -1);
    EXPECT_TRUE(cloud.faces.empty());
    write_cloud_ply(path, {});
    EXPECT_TRUE(read_ply(path).points.positions.empty());
}

}  // namespace
}  // namespace tvsgs
