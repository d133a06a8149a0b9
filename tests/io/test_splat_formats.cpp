// Tests splats as GLB and as SOG, and the parts of SOG: codebooks, palettes, archives.
#include <gtest/gtest.h>
#include <zip.h>

#include <cstring>
#include <nlohmann/json.hpp>
#include <set>

#include "core/device/threads.h"
#include "io/files/zip_archive.h"
#include "io/images/image_file.h"
#include "io/splats/codebook.h"
#include "io/splats/sog_math.h"
#include "io/splats/splat_errors.h"
#include "io/splats/splat_files.h"
#include "io_test.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

using nlohmann::json;

json document_of(const std::string& glb) {
    std::uint32_t length = 0;
    std::memcpy(&length, &glb[12], 4);
    return json::parse(glb.substr(20, length));
}

/// The file with a changed document.
std::string with_document(const std::string& glb, const json& document) {
    std::uint32_t old = 0;
    std::memcpy(&old, &glb[12], 4);
    std::string text = document.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    std::string out = glb.substr(0, 20) + text + glb.substr(20 + old);
    const auto length = static_cast<std::uint32_t>(text.size()),
               total = static_cast<std::uint32_t>(out.size());
    std::memcpy(&out[8], &total, 4), std::memcpy(&out[12], &length, 4);
    return out;
}

TEST(SplatGlb, KeepsAllNumbers) {
    for (int degree = 0; degree <= 3; ++degree)
        for (const SplatFrame frame : {SplatFrame::luf, SplatFrame::rdf}) {
            const Gaussians<Cpu> g = test::random_gaussians(500, 3, 0.05, degree);
            SplatFileOptions options;
            options.frame = frame;
            const Gaussians<Cpu> read =
                parse_splat_glb(splat_glb_bytes("a.glb", g, options), "a.glb", frame);
            ASSERT_EQ(read.size(), g.size());
            ASSERT_EQ(read.sh_degree, degree);
            const SplatErrors e = errors_of(g, read);
            EXPECT_EQ(e.mean, 0);
            EXPECT_EQ(std::max({e.color, e.sh_1, e.sh_rest}), 0);
            EXPECT_LT(e.log_scale, 1e-6);
            EXPECT_LT(e.opacity, 1e-6);
            EXPECT_LT(e.degrees, 0.05);  // of single precision, near zero
        }
}

TEST(SplatGlb, SaysWhatTheExtensionAsksFor) {
    Gaussians<Cpu> g;
    resize(g, 1, 1);
    g.means[0] = {1, 2, 3};
    g.log_scales[0] = {0, std::log(2.0f), std::log(0.5f)};
    g.quats[0] = {0, 3, 4, 0};
    g.opacity_logits[0] = 0;
    g.sh[0] = {0, 1, -9}, g.sh[1] = {1, 2, 3}, g.sh[2] = {4, 5, 6}, g.sh[3] = {7, 8, 9};
    const std::string glb = splat_glb_bytes("a.glb", g);
    const json document = document_of(glb);
    EXPECT_EQ(document["extensionsUsed"], json::parse(R"(["KHR_gaussian_splatting"])"));
    EXPECT_FALSE(document.contains("extensionsRequired"));
    EXPECT_FALSE(document["nodes"][0].contains("matrix"));  // y down turned up is glTF's frame
    const json& primitive = document["meshes"][0]["primitives"][0];
    EXPECT_EQ(primitive["mode"], 0);
    EXPECT_EQ(primitive["extensions"]["KHR_gaussian_splatting"], json::parse(R"({
        "kernel": "ellipse", "colorSpace": "srgb_rec709_display", "projection": "perspective",
        "sortingMethod": "cameraDistance"})"));
    const auto floats = [&](const std::string& name) {
        const json& accessor = document["accessors"][int(primitive["attributes"][name])];
        const json& view = document["bufferViews"][int(accessor["bufferView"])];
        EXPECT_EQ(view["target"], 34962);
        EXPECT_EQ(int(view["byteOffset"]) % 4, 0);
        std::vector<float> out(view["byteLength"].get<std::size_t>() / 4);
        std::uint32_t length = 0;
        std::memcpy(&length, &glb[12], 4);
        std::memcpy(out.data(), &glb[28 + length + std::size_t(view["byteOffset"])],
                    4 * out.size());
        return out;
    };
    using F = std::vector<float>;
    const auto expect_near = [](const F& found, const F& expected) {
        ASSERT_EQ(found.size(), expected.size());
        for (std::size_t i = 0; i < found.size(); ++i) EXPECT_NEAR(found[i], expected[i], 1e-6);
    };
    EXPECT_EQ(floats("POSITION"), (F{-1, -2, 3}));
    EXPECT_EQ(document["accessors"][int(primitive["attributes"]["POSITION"])]["max"],
              (json{-1, -2, 3}));
    expect_near(floats("KHR_gaussian_splatting:ROTATION"), {-0.6f, -0.8f, 0, 0});  // x y z w
    expect_near(floats("KHR_gaussian_splatting:SCALE"), {1, 2, 0.5f});
    expect_near(floats("KHR_gaussian_splatting:OPACITY"), {0.5f});
    EXPECT_EQ(floats("KHR_gaussian_splatting:SH_DEGREE_0_COEF_0"), (F{0, 1, -9}));
    EXPECT_EQ(floats("KHR_gaussian_splatting:SH_DEGREE_1_COEF_0"), (F{-1, -2, -3}));  // y
    EXPECT_EQ(floats("KHR_gaussian_splatting:SH_DEGREE_1_COEF_1"), (F{4, 5, 6}));     // z
    EXPECT_EQ(floats("KHR_gaussian_splatting:SH_DEGREE_1_COEF_2"), (F{-7, -8, -9}));  // x
    // 0.5 and 0.782 as sRGB are 0.214 and 0.573 of the light.
    const json& color = document["accessors"][int(primitive["attributes"]["COLOR_0"])];
    EXPECT_EQ(color["componentType"], 5123);
    EXPECT_EQ(color["normalized"], true);
    const F packed = floats("COLOR_0");
    std::uint16_t rgba[4];
    std::memcpy(rgba, packed.data(), sizeof rgba);
    EXPECT_NEAR(rgba[0] / 65535.0, 0.2140, 1e-4);
    EXPECT_NEAR(rgba[1] / 65535.0, 0.5738, 1e-3);
    EXPECT_EQ(rgba[2], 0);
    EXPECT_NEAR(rgba[3], 32768, 1);
}

/// Viewers show the scene upright: the node's rotation times that of the numbers is the scene's.
TEST(SplatGlb, TurnsItsNodeByWhatTheFrameHasNotTurned) {
    Gaussians<Cpu> g = test::random_gaussians(3, 1);
    SplatFileOptions options;
    options.origin = {5e5, 4e6, 100};
    options.projection = "EPSG:32632";
    options.upright_from_scene = {{{0, 0, 1}, {1, 0, 0}, {0, 1, 0}}};
    for (const SplatFrame frame : {SplatFrame::luf, SplatFrame::rub, SplatFrame::rdf}) {
        options.frame = frame;
        const std::string glb = splat_glb_bytes("a.glb", g, options);
        const json document = document_of(glb);
        EXPECT_EQ(document["asset"]["extras"]["origin"], (json{5e5, 4e6, 100}));
        EXPECT_EQ(splat_glb_place(glb, "a.glb").projection, "EPSG:32632");
        const json& m = document["nodes"][0]["matrix"];  // by columns
        const Vec3f p = half_turn(frame)(g.means[0]);
        const Vec3f expected{g.means[0].z, g.means[0].x, g.means[0].y};
        for (std::size_t row = 0; row < 3; ++row) {
            const double shown = double(m[row]) * double{p.x} + double(m[4 + row]) * double{p.y} +
                                 double(m[8 + row]) * double{p.z};
            EXPECT_NEAR(shown, expected[int(row)], 1e-6);
        }
        const Gaussians<Cpu> read = parse_splat_glb(glb, "a.glb", frame);  // in our frame again
        EXPECT_EQ(errors_of(g, read).mean, 0);
    }
}

TEST(SplatGlb, RefusesWhatItDoesNotUnderstand) {
    const std::string good = splat_glb_bytes("a.glb", test::random_gaussians(20, 1));
    const auto refuses = [&](const std::string& why, const auto& change) {
        json document = document_of(good);
        change(document, document["meshes"][0]["primitives"][0]);
        const std::string bytes = with_document(good, document);
        expect_error(ExitCode::input, why, [&] { parse_splat_glb(bytes, "a.glb"); });
    };
    const std::string attribute = "KHR_gaussian_splatting:";
    refuses("no splats", [](json&, json& p) { p.erase("extensions"); });
    refuses("unknown kind", [](json&, json& p) { p["mode"] = 4; });
    refuses("unknown kind",
            [](json&, json& p) { p["extensions"]["KHR_gaussian_splatting"]["kernel"] = "disc"; });
    refuses("compressed", [](json&, json& p) {
        p["extensions"]["KHR_gaussian_splatting"]["extensions"]["X"] = json::object();
    });
    refuses("needs the unknown extension",
            [](json& d, json&) { d["extensionsRequired"] = {"EXT_x"}; });
    refuses("a node has a rotation", [](json& d, json&) {
        d["asset"]["generator"] = "another";
        d["nodes"][0]["rotation"] = {0, 0, 0, 1};
    });
    refuses("20 positions", [&](json& d, json& p) {
        d["accessors"][int(p["attributes"][attribute + "SCALE"])]["count"] = 19;
    });
    refuses("do not fit", [](json& d, json&) { d["accessors"][0]["count"] = 1 << 30; });
    refuses("refers to a missing element",
            [&](json&, json& p) { p["attributes"].erase(attribute + "OPACITY"); });
    refuses("refers to a missing element",  // a degree has to be whole
            [&](json&, json& p) { p["attributes"].erase(attribute + "SH_DEGREE_3_COEF_6"); });
    refuses("expected 1 to 2^30", [](json& d, json&) {
        for (json& accessor : d["accessors"]) accessor["count"] = 0;
    });
    std::string bytes = good;
    const float nan = std::numeric_limits<float>::quiet_NaN();
    std::memcpy(&bytes[bytes.size() - 20 * 8 - 4], &nan, 4);  // the last coefficient
    expect_error(ExitCode::input, "a colour of splat 19", [&] { parse_splat_glb(bytes, "a.glb"); });
    for (const std::size_t size : {std::size_t{0}, std::size_t{19}, good.size() / 2})
        expect_error(ExitCode::input, "", [&] { parse_splat_glb(good.substr(0, size), "a.glb"); });
}

TEST(Codebook, HasFewValuesExactly) {
    std::vector<float> values;
    for (int i = 0; i < 1000; ++i) values.push_back(float(i * 7 % 256) * 0.1f);
    const Codebook codes = make_codebook(values);
    for (const float v : values) EXPECT_EQ(codes[nearest_code(codes, v)], v);
    EXPECT_EQ(codes[nearest_code(codes, -9)], 0);
    EXPECT_EQ(codes[nearest_code(codes, 99)], 25.5f);
}

TEST(Codebook, SuitsItsValues) {
    test::Random random(1);
    std::vector<float> values;
    for (int i = 0; i < 50000; ++i) values.push_back(float(random.normal()));
    const Codebook codes = make_codebook(values);
    EXPECT_TRUE(std::is_sorted(codes.begin(), codes.end()));
    double squares = 0;
    for (const float v : values) {
        const float code = codes[nearest_code(codes, v)];
        for (const float other : {codes[0], codes[100], codes[255]})
            ASSERT_LE(std::abs(v - code), std::abs(v - other));
        squares += double(v - code) * double(v - code);
    }
    // Panter and Dite: sqrt(3) pi / 2 / 256^2 for a normal distribution and many codes.
    EXPECT_LT(squares / 50000, 1.1 * 2.7207 / 65536);
}

TEST(ShPalette, FindsKindsThatAreThere) {
    test::Random random(2);
    std::vector<float> kinds(40 * 9), vectors;
    for (float& k : kinds) k = float(random.normal());
    for (int i = 0; i < 5000; ++i)
        for (std::size_t k = 0; k < 9; ++k)
            vectors.push_back(kinds[std::size_t(i * 13 % 40) * 9 + k]);
    for (const int count : {256, 2000}) {  // in one step, and by cells
        const ShPalette palette = make_sh_palette(vectors, 9, count);
        EXPECT_LE(palette.count, count);
        double most = 0;
        for (std::size_t i = 0; i < vectors.size(); ++i)
            most = std::max(
                most,
                std::abs(double(vectors[i]) -
                         double(palette.centres[std::size_t(palette.labels[i / 9]) * 9 + i % 9])));
        EXPECT_LT(most, 1e-6);
    }
}

/// More centres give smaller errors. Rate-distortion theory bounds the error of random vectors: 1,
/// 2 and 4 bits for each of three numbers.
TEST(ShPalette, IsNearerWithMoreKinds) {
    test::Random random(3);
    std::vector<float> vectors(3 * 20000);
    for (float& v : vectors) v = float(random.normal());
    for (const auto& [count, bound] : {std::pair{8, 0.40}, {64, 0.125}, {4096, 0.012}}) {
        const ShPalette palette = make_sh_palette(vectors, 3, count);
        double squares = 0;
        for (std::size_t i = 0; i < vectors.size(); ++i) {
            const double off =
                double(vectors[i]) -
                double(palette.centres[std::size_t(palette.labels[i / 3]) * 3 + i % 3]);
            squares += off * off;
        }
        EXPECT_LT(squares / double(vectors.size()), bound) << count;
        EXPECT_GT(palette.count, 0.9 * count);
    }
}

class Zip : public IoTest {};

TEST_F(Zip, IsReadAsWrittenAndTheSameAgain) {
    const std::vector<std::pair<std::string, std::string>> entries{
        {"b", "two"}, {"a/c", std::string(1000, 'x')}, {"empty", ""}};
    const std::string bytes = zip_bytes(entries);
    EXPECT_EQ(bytes, zip_bytes(entries));
    EXPECT_NE(bytes.find(std::string(1000, 'x')), std::string::npos);  // stored
    const std::string path = write("a.zip", bytes);
    std::vector<std::pair<std::string, std::string>> read;
    read_zip(path, "test", {},
             [&](const auto& name, auto content) { read.emplace_back(name, std::move(content)); });
    EXPECT_EQ(read, entries);
    const auto none = [](const std::string&, const std::string&) {};
    expect_error(ExitCode::input, "limit 2", [&] { read_zip(path, "test", {.entries = 2}, none); });
    expect_error(ExitCode::input, "exceed the limit",
                 [&] { read_zip(path, "test", {.entry_bytes = 999}, none); });
    expect_error(ExitCode::input, "limit 1002",
                 [&] { read_zip(path, "test", {.total_bytes = 1002}, none); });
    std::string damaged = bytes;
    damaged[damaged.find("xxx") + 5] = 'y';
    expect_error(ExitCode::input, "checksum is wrong",
                 [&] { read_zip(write("b.zip", damaged), "test", {}, none); });
}

class Sog : public IoTest {
protected:
    Gaussians<Cpu> through(const Gaussians<Cpu>& g, const SplatFileOptions& options = {}) const {
        return read_sog(write("a.sog", sog_bytes("a.sog", g, options)),
                        options.frame.value_or(SplatFrame::rdf));
    }
};

TEST_F(Sog, KeepsTheBoundsOfEachAttribute) {
    for (int degree = 0; degree <= 3; ++degree)
        for (const SplatFrame frame : {SplatFrame::rdf, SplatFrame::rub}) {
            Gaussians<Cpu> g = test::random_gaussians(1000, 5, 0.05, degree);
            for (std::size_t i = 0; i < 100; ++i) g.means[i] = 200 * g.means[i];
            SplatFileOptions options;
            options.frame = frame;
            const Gaussians<Cpu> read = through(g, options);
            ASSERT_EQ(read.size(), g.size());
            ASSERT_EQ(read.sh_degree, degree);
            const SplatErrors e = errors_of(g, read);
            EXPECT_LT(e.mean_log, 2 * std::log1p(200.0) / 131070 * 1.01 + 1e-6);
            EXPECT_GT(e.mean_log, 1e-5);
            EXPECT_LT(e.degrees, 0.99);
            EXPECT_GT(e.degrees, 0.3);
            EXPECT_LE(e.opacity, 1.0 / 510 + 1e-6);
            EXPECT_LT(e.log_scale, 0.15);  // of the few outliers
            EXPECT_LT(e.color, 0.15);
        }
}

TEST_F(Sog, OneAbsurdColourCostsTheOthersLittle) {
    Gaussians<Cpu> g = test::random_gaussians(5000, 5, 0.05, 0);
    const double usual = errors_of(g, through(g)).color;
    for (const float absurd : {1e30f, -1e30f}) {
        g.sh[0].x = absurd;
        Gaussians<Cpu> read = through(g);
        EXPECT_EQ(read.sh[0].x, std::copysign(64.0f, absurd));
        read.sh[0].x = absurd;
        EXPECT_LT(errors_of(g, read).color, 2 * usual + 0.01);
    }
}

TEST_F(Sog, HarmonicsOfFewKindsAndNumbersAreExact) {
    Gaussians<Cpu> g = test::random_gaussians(2000, 5, 0.05, 2);
    for (std::size_t k = 1; k < 9; ++k)
        for (std::size_t i = 0; i < 2000; ++i) {
            const auto kind = float(i % 200);
            g.sh[k * 2000 + i] = {std::fmod(kind * float(k), 17.0f) / 8 - 1,
                                  std::fmod(kind + float(k), 29.0f) / 32, 0.25f};
        }
    const SplatErrors e = errors_of(g, through(g));
    EXPECT_EQ(e.sh_1, 0);
    EXPECT_EQ(e.sh_rest, 0);
    SplatFileOptions few;
    few.sog_palette = 20;
    EXPECT_GT(errors_of(g, through(g, few)).sh_1, 0.1);
}

TEST_F(Sog, HasTheFilesAndPixelsOfTheSpecification) {
    Gaussians<Cpu> g;
    resize(g, 2, 1);
    g.means[0] = {0, 1, -1}, g.means[1] = {float(std::numbers::e) - 1, 1, 1};
    g.log_scales[0] = {-3, -2, -1}, g.log_scales[1] = {-1, -1, -1};
    g.quats[0] = {1, 0, 0, 0}, g.quats[1] = {0.5f, 0.5f, 0.5f, -0.5f};
    g.opacity_logits[0] = 0, g.opacity_logits[1] = -40;
    for (std::size_t k = 0; k < 4; ++k) g.sh[2 * k] = {0, 0.5f, 1}, g.sh[2 * k + 1] = {0, 0, 0};
    g.sh[1] = {1, 0.5f, 0};
    std::map<std::string, std::string> files;
    std::string first;
    read_zip(write("a.sog", sog_bytes("a.sog", g)), "SOG", {}, [&](const auto& name, auto bytes) {
        if (first.empty()) first = name;
        files[name] = std::move(bytes);
    });
    EXPECT_EQ(first, "meta.json");
    EXPECT_EQ(files.size(), 8u);
    const json meta = json::parse(files["meta.json"]);
    EXPECT_EQ(meta["version"], 2);
    EXPECT_EQ(meta["count"], 2);
    EXPECT_EQ(meta["means"]["files"], (json{"means_l.webp", "means_u.webp"}));
    EXPECT_NEAR(float(meta["means"]["maxs"][0]), 1, 1e-6);  // ln(1 + (e - 1))
    EXPECT_EQ(meta["shN"]["files"], (json{"shN_centroids.webp", "shN_labels.webp"}));
    EXPECT_EQ(meta["shN"]["bands"], 1);
    const auto pixel = [&](const std::string& name, int i) {
        const ImageU8 image = decode_image(name, files[name], 4);
        EXPECT_EQ(image.width, name == "shN_centroids.webp" ? 192 : 4);
        std::vector<int> out;
        for (int c = 0; c < 4; ++c) out.push_back(image.at(i % image.width, i / image.width, c));
        return out;
    };
    using P = std::vector<int>;
    EXPECT_EQ(pixel("means_l.webp", 0), (P{0, 0, 0, 255}));  // where all are alike: 0
    EXPECT_EQ(pixel("means_u.webp", 1), (P{255, 0, 255, 255}));
    EXPECT_EQ(pixel("scales.webp", 0), (P{0, 1, 2, 255}));
    EXPECT_EQ(pixel("quats.webp", 0), (P{128, 128, 128, 252}));
    EXPECT_EQ(pixel("quats.webp", 1), (P{218, 218, 37, 252}));  // sqrt(1/2) / 2 from the middle
    EXPECT_EQ(pixel("sh0.webp", 0), (P{0, 1, 2, 128}));
    EXPECT_EQ(pixel("sh0.webp", 1), (P{2, 1, 0, 0}));  // colours under alpha 0 stay
    EXPECT_EQ(pixel("shN_labels.webp", 0)[0], 0);
    EXPECT_EQ(pixel("shN_labels.webp", 1)[0], 1);
    EXPECT_EQ(pixel("shN_centroids.webp", 2), (P{0, 1, 2, 255}));
    EXPECT_EQ(pixel("shN_centroids.webp", 3), (P{0, 0, 0, 255}));
}

TEST_F(Sog, IsTheSameForAnyNumberOfThreads) {
    const Gaussians<Cpu> g = test::random_gaussians(5000, 5);
    const int threads = thread_count();
    set_thread_count(1);
    const std::string one = sog_bytes("a.sog", g);
    set_thread_count(4);
    const std::string four = sog_bytes("a.sog", g);
    set_thread_count(threads);
    EXPECT_EQ(one, four);
}

TEST_F(Sog, RefusesDamagedFiles) {
    const std::string good = sog_bytes("a.sog", test::random_gaussians(200, 1, 0.05, 2));
    std::vector<std::pair<std::string, std::string>> files;
    read_zip(write("a.sog", good), "SOG", {},
             [&](const auto& name, auto bytes) { files.emplace_back(name, std::move(bytes)); });
    const auto refuses = [&](const std::string& why, const auto& change) {
        auto changed = files;
        json meta = json::parse(files[0].second);
        change(meta, changed);
        if (changed[0].second == files[0].second) changed[0].second = meta.dump();
        const std::string path = write("b.sog", zip_bytes(changed));
        expect_error(ExitCode::input, why, [&] { read_sog(path); });
    };
    using Files = decltype(files);
    refuses("no meta.json", [](json&, Files& f) { f[0].first = "other.json"; });
    refuses("meta.json: line 1", [](json&, Files& f) { f[0].second = "{"; });
    refuses("SOG version 1", [](json& m, Files&) { m.erase("version"); });
    refuses("claims 0 splats", [](json& m, Files&) { m["count"] = 0; });
    refuses("expected 1 to", [](json& m, Files&) { m["count"] = 49000000; });
    refuses("whole number", [](json& m, Files&) { m["count"] = -1; });
    refuses("pixels; expected at least 10000", [](json& m, Files&) { m["count"] = 10000; });
    refuses("\"mins\": expected 3 finite", [](json& m, Files&) { m["means"]["mins"] = {1, 2}; });
    refuses("\"codebook\": expected 256", [](json& m, Files&) { m["sh0"]["codebook"][7] = "x"; });
    refuses("x.webp is missing", [](json& m, Files&) { m["quats"]["files"] = {"x.webp"}; });
    refuses("list of files is missing", [](json& m, Files&) { m["quats"] = 3; });
    refuses("4 bands", [](json& m, Files&) { m["shN"]["bands"] = 4; });
    refuses("0 bands", [](json& m, Files&) { m["shN"]["bands"] = 0; });
    refuses("512x2 pixels; expected at least", [](json& m, Files&) { m["shN"]["bands"] = 3; });
    refuses("centroids in a picture 512", [](json& m, Files&) { m["shN"]["bands"] = 1; });
    refuses("a palette of", [](json& m, Files&) { m["shN"]["count"] = 65537; });
    refuses("the centre of splat", [](json& m, Files&) { m["means"]["maxs"][0] = 1e30; });
    refuses("not a WebP picture", [](json&, Files& f) { f[3].second = "RIFF"; });
    refuses("decoding failed", [](json&, Files& f) { f[3].second.resize(f[3].second.size() / 2); });
    // Bytes that compress to almost nothing must not allow more memory or splats.
    const auto padded = [&](std::size_t bytes, std::int64_t count) {
        const std::string path = write("e.sog", "");
        json meta = json::parse(files[0].second);
        meta["count"] = count;
        auto entries = files;
        entries[0].second = meta.dump();
        entries.emplace_back("more", std::string(bytes, 'x'));
        zip_t* const zip = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, nullptr);
        for (const auto& [name, content] : entries)
            zip_file_add(zip, name.c_str(),
                         zip_source_buffer(zip, content.data(), content.size(), 0), 0);
        EXPECT_EQ(zip_close(zip), 0);
        return path;
    };
    EXPECT_EQ(read_sog(padded(1000, 200)).size(), 200);
    expect_error(ExitCode::input, "bytes up to here (limit",
                 [&] { read_sog(padded(1 << 25, 200)); });
    expect_error(ExitCode::input, "claims 4000000 splats; expected 1 to",
                 [&] { read_sog(padded(900000, 4000000)); });
    expect_error(ExitCode::input, "(ZIP)", [&] { read_sog(write("c.sog", "no archive")); });
    expect_error(ExitCode::input, "(ZIP)",
                 [&] { read_sog(write("d.sog", good.substr(0, good.size() / 2))); });
}

}  // namespace
}  // namespace tvsgs
