// Pages of tvsgs-view: their contents, and the browser's drawing compared with our renders.
#include <gtest/gtest.h>
#include <zlib.h>

#include <cmath>
#include <filesystem>

#include "io/files/atomic_file.h"
#include "io/images/image_file.h"
#include "io/mesh/mesh_files.h"
#include "io/splats/splat_files.h"
#include "render/backbone.h"
#include "report/page_data.h"
#include "report/view_page.h"
#include "support/numeric.h"
#include "view_cases.h"

namespace tvsgs {
namespace {

/// The splats in the page of a run.
Gaussians<Cpu> splats_in(const std::string& html, int run) {
    const std::string bytes = decoded_base64(text_of(html, "splats" + std::to_string(run)));
    return parse_spz({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, "page",
                     SplatFrame::rdf)
        .splats;
}

std::string pixels_of(const JsonValue& result, std::size_t run) {
    return decoded_base64(result["pixels"].items.at(run).text);
}

std::uint8_t byte_at(const std::string& rgba, int x, int y, int channel) {
    return static_cast<std::uint8_t>(
        rgba[4 * (static_cast<std::size_t>(y) * kWidth + static_cast<std::size_t>(x)) +
             static_cast<std::size_t>(channel)]);
}

/// PSNR of RGBA bytes against colours, which are clamped to [0, 1].
double psnr(const std::string& rgba, const std::vector<Vec3f>& colors) {
    EXPECT_EQ(rgba.size(), 4 * colors.size());
    double sum = 0;
    for (std::size_t i = 0; i < colors.size(); ++i)
        for (std::size_t c = 0; c < 3; ++c) {
            const double shown = static_cast<std::uint8_t>(rgba[4 * i + c]) / 255.0;
            const double d = shown - std::clamp(double(colors[i][int(c)]), 0.0, 1.0);
            sum += d * d;
        }
    return -10 * std::log10(sum / (3.0 * double(colors.size())));
}

std::vector<Vec3f> render(const std::string& backbone,
                          const Gaussians<Cpu>& splats,
                          const Camera& camera) {
    const auto rasteriser = make_backbone<Cpu>(backbone, {});
    return to_host(rasteriser->forward(splats, camera, splats.sh_degree, Maps::color).color);
}

/// A surface of typical splats: discs on a sphere, some much larger than thick.
Gaussians<Cpu> sphere(int count) {
    Gaussians<Cpu> g = test::random_gaussians(count, 5, 0.03, 1);
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const Vec3f n = normalize(g.means[i]);
        g.means[i] = n;
        g.log_scales[i].z = -9;
        // Turns z to n.
        const float half = std::sqrt(std::max(0.5f * (1 + n.z), 1e-6f));
        g.quats[i] = {half, -n.y / (2 * half), n.x / (2 * half), 0};
        g.opacity_logits[i] += 2;
    }
    return g;
}

Gaussians<Cpu> single() {
    Gaussians<Cpu> g;
    resize(g, 1, 0);
    g.means[0] = {0.0625f, -0.125f, 0.25f};
    g.log_scales[0] = {-2, -2, -2};
    g.quats[0] = {1, 0, 0, 0};
    g.opacity_logits[0] = std::log(0.8f / 0.2f);
    g.sh[0] = {1, 0, -1};
    return g;
}

TEST(ViewPage, HoldsWhatItShowsAndNothingFromElsewhere) {
    std::vector<ViewRun> runs;
    runs.push_back(run_of("</script><b>run", "ewa", test::random_gaussians(50, 1)));
    runs.push_back(run_of("other", "surfel", sphere(60)));
    std::vector<ViewCamera> cameras = two_cameras();
    cameras[0].name = "<img src=x>.jpg";
    const ViewPage page = view_page({std::move(runs), cameras});
    EXPECT_EQ(page.html.find("{{"), std::string::npos) << "a place that nobody filled";
    EXPECT_EQ(page.html.find("<b>run"), std::string::npos);
    EXPECT_EQ(page.html.find("<img src=x"), std::string::npos);
    EXPECT_EQ(page.html.find("http:"), std::string::npos);
    EXPECT_EQ(page.html.find("https:"), std::string::npos);
    EXPECT_NE(page.html.find("default-src 'none'"), std::string::npos);
    EXPECT_TRUE(page.notes.empty());
    EXPECT_EQ(splats_in(page.html, 0).size(), 50);
    EXPECT_EQ(splats_in(page.html, 1).size(), 60);
    const JsonValue about = parse_json_value(text_of(page.html, "about"), "about");
    EXPECT_EQ(about["runs"].items[0]["discs"].number, 0);
    EXPECT_EQ(about["runs"].items[1]["discs"].number, 1);
    EXPECT_EQ(about["cameras"].items[1]["test"].number, 1);
    EXPECT_FALSE(about["runs"].items[0]["mesh"]);
}

TEST(ViewPage, KeepsToItsSizeAndSaysWhatGaveWay) {
    const auto page_of = [](std::size_t bytes, int most = 50'000'000) {
        std::vector<ViewRun> runs;
        runs.push_back(run_of("run", "ewa", test::random_gaussians(20000, 2)));
        ViewPageOptions options;
        options.max_bytes = bytes, options.max_splats = most;
        return view_page({std::move(runs), two_cameras()}, options);
    };
    EXPECT_TRUE(page_of(40'000'000).notes.empty());
    const ViewPage lower = page_of(1'000'000), fewer = page_of(500'000);
    EXPECT_LT(lower.html.size(), 1'000'000u);
    ASSERT_EQ(lower.notes.size(), 1u);
    EXPECT_NE(lower.notes[0].find("SH degree"), std::string::npos);
    EXPECT_NE(lower.html.find(lower.notes[0]), std::string::npos);
    EXPECT_EQ(splats_in(lower.html, 0).size(), 20000);
    EXPECT_LT(fewer.html.size(), 500'000u);
    ASSERT_EQ(fewer.notes.size(), 2u);
    EXPECT_NE(fewer.notes[0].find("largest of 20,000"), std::string::npos) << fewer.notes[0];
    EXPECT_NE(fewer.notes[0].find("to limit the page size"), std::string::npos) << fewer.notes[0];
    EXPECT_EQ(splats_in(fewer.html, 0).sh_degree, 0);
    const ViewPage asked = page_of(40'000'000, 1000);
    ASSERT_EQ(asked.notes.size(), 1u);
    EXPECT_NE(asked.notes[0].find("1,000 largest of 20,000 splats (--max-splats)"),
              std::string::npos)
        << asked.notes[0];
}

TEST(ViewPack, TheLargestStay) {
    Gaussians<Cpu> g = test::random_gaussians(300, 3);
    for (std::size_t i = 0; i < 300; ++i) {
        g.means[i] = {static_cast<float>(i), 0, 0};
        g.log_scales[i] = {-3, i < 40 ? -2.0f : -3.0f, -7};  // the first are twice as large
        g.opacity_logits[i] = i >= 290 ? -9.0f : 1.0f;       // the last ones are invisible
    }
    const PackedSplats packed = pack_splats(std::move(g), 1 << 20, 40);
    EXPECT_EQ(packed.of, 290);
    ASSERT_EQ(packed.shown.size(), 40);
    for (const Vec3f p : packed.shown.means.span()) EXPECT_LT(p.x, 39.5f);
}

TEST(ViewPack, ManySplatsFillTheRoom) {
    const std::size_t room = 300'000;
    for (const bool alike : {false, true}) {
        // Of different sizes, so that few are large.
        Gaussians<Cpu> g = alike ? sphere(100'000) : test::random_gaussians(100'000, 5);
        for (std::size_t i = 0; i < g.means.size(); ++i) {
            g.log_scales[i].x = g.log_scales[i].y = static_cast<float>(i) / 1e5f - 3;
            if (!alike) continue;
            for (std::size_t k = 0; k < 4; ++k) g.sh[k * g.means.size() + i] = g.means[i];
        }
        const PackedSplats packed = pack_splats(std::move(g), room, 1 << 30);
        EXPECT_EQ(packed.shown.sh_degree, 0);
        EXPECT_LE(packed.bytes.size(), room);
        EXPECT_GE(packed.bytes.size(), room * 9 / 10) << alike;
    }
}

TEST(ViewPack, MeshesComeBack) {
    TriangleMesh mesh;
    mesh.vertices = {{0, -1, 2}, {1, 1, 2}, {3, 0, 2}};  // no thickness in z
    mesh.colors = {{0, 0.5f, 2}, {1, 1, 1}, {0, 0, 0}};
    mesh.faces = {{2, 1, 0}};
    const PackedMesh packed = pack_mesh(mesh, {0, 7, kNoError});
    std::string bytes(1000, '\0');
    uLongf size = 1000;
    ASSERT_EQ(uncompress(reinterpret_cast<Bytef*>(bytes.data()), &size,
                         reinterpret_cast<const Bytef*>(packed.data.data()), packed.data.size()),
              Z_OK);
    ASSERT_EQ(size, 3 * 6 + 3 * 3 + 3 + 12u);
    const auto at = [&](std::size_t i) { return static_cast<std::uint8_t>(bytes[i]); };
    EXPECT_EQ(at(6) | at(7) << 8, 21845) << "a third of the way in x";
    EXPECT_EQ(at(10) | at(11) << 8, 0);
    EXPECT_EQ(at(18 + 1), 128);
    EXPECT_EQ(at(18 + 2), 255) << "cut at white";
    EXPECT_EQ(at(27 + 1), 7);
    EXPECT_EQ(at(30), 2);
    EXPECT_EQ(packed.about["high"].items[0].number, 3);
}

TEST(ViewPack, ErrorsAreLevelsOfTheScale) {
    Truth truth;
    truth.surface = measured_points({{0, 0, 0}}, {}, {});
    truth.crop.kind = Crop::Kind::box;
    truth.crop.min = {-9, -9, -9}, truth.crop.max = {9, 9, 9};
    const std::vector<Vec3f> points{{0, 0, 0}, {1, 0, 0}, {0, 8, 0}, {10, 0, 0}};
    const auto levels = error_levels({points.data(), points.size()}, truth, 2);
    EXPECT_EQ(levels, (std::vector<std::uint8_t>{0, 127, 254, kNoError}));
}

/// Large splats all around the camera: beside the image their projection is clamped.
Gaussians<Cpu> around(int count) {
    Gaussians<Cpu> g = test::random_gaussians(count, 17, 0.3, 0);
    for (Vec3f& p : g.means.span()) p = 3.5f * p;
    for (float& logit : g.opacity_logits.span()) logit -= 2;
    return g;
}

// Rounding to 8 bits leaves 59 dB, rounding of each blend in the target 50 dB; the rest is the
// device's exponential. A missing dot of discs costs 13 dB, half a pixel 16.
TEST_F(ViewInBrowser, DrawsWhatTheRasterisersDraw) {
    struct Case {
        std::string backbone;
        Gaussians<Cpu> splats;
    };
    std::vector<Case> cases;
    cases.push_back({"ewa", test::random_gaussians(2000, 11, 0.05, 3)});
    cases.push_back({"ewa", test::random_gaussians(1000, 12, 0.05, 0)});
    cases.push_back({"surfel", sphere(4000)});
    cases.push_back({"surfel", test::random_gaussians(800, 13, 0.1, 2)});
    cases.push_back({"rade", sphere(3000)});
    cases.push_back({"ewa", around(600)});
    std::vector<ViewRun> runs;
    for (Case& c : cases) runs.push_back(run_of(c.backbone, c.backbone, std::move(c.splats)));
    const std::vector<ViewCamera> cameras = two_cameras();
    const ViewPage page = view_page({std::move(runs), cameras});
    const fs::path file = folder("draws") / "page.html";
    write_text_file(file, page.html);
    for (const int bits : {16, 8}) {
        const JsonValue result =
            test_of_page(file, bits == 8 ? "?test=0&bits=8" : "?test=1&bits=16");
        ASSERT_EQ(result["pixels"].items.size(), cases.size()) << result["failed"].text;
        EXPECT_EQ(result["bits"].number, bits);
        EXPECT_EQ(result["error"].number, 0) << "of OpenGL";
        EXPECT_EQ(result["width"].number, kWidth);
        for (std::size_t i = 0; i < cases.size(); ++i) {
            const auto expected =
                render(cases[i].backbone, splats_in(page.html, int(i)), cameras[bits == 16].camera);
            const double found = psnr(pixels_of(result, i), expected);
            EXPECT_GT(found, bits == 16 ? 50 : 45) << i << ": " << cases[i].backbone;
            std::printf("%d bits, %s: %.1f dB\n", bits, cases[i].backbone.c_str(), found);
        }
    }
}

TEST_F(ViewInBrowser, OneSplatIsItsFormulaAndNoneIsBlack) {
    std::vector<ViewRun> runs;
    runs.push_back(run_of("one", "ewa", single()));
    Gaussians<Cpu> none;
    resize(none, 0, 0);
    runs.push_back(run_of("none", "ewa", std::move(none)));
    const std::vector<ViewCamera> cameras = two_cameras();
    const ViewPage page = view_page({std::move(runs), cameras});
    const fs::path file = folder("single") / "page.html";
    write_text_file(file, page.html);
    const JsonValue result = test_of_page(file, "?test=0");
    ASSERT_EQ(result["pixels"].items.size(), 2u) << result["failed"].text;

    const Gaussians<Cpu> g = splats_in(page.html, 0);
    const Camera& c = cameras[0].camera;
    const Vec3d p = vec_cast<double>(c.camera_from_world * g.means[0]);
    const double s = std::exp(double(g.log_scales[0].x)), fx = double(c.fx_px),
                 fy = double(c.fy_px);
    const double u = p.x / p.z, v = p.y / p.z;
    // A ball: J J^T s^2 plus the low-pass.
    const double xx = 0.3 + std::pow(s * fx / p.z, 2) * (1 + u * u),
                 yy = 0.3 + std::pow(s * fy / p.z, 2) * (1 + v * v),
                 xy = s * s * fx * fy / (p.z * p.z) * u * v, det = xx * yy - xy * xy;
    const double opacity = 1 / (1 + std::exp(-double(g.opacity_logits[0])));
    std::vector<Vec3f> expected;
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const double dx = x + 0.5 - (fx * u + double(c.cx_px)),
                         dy = y + 0.5 - (fy * v + double(c.cy_px));
            double alpha =
                opacity * std::exp(-0.5 * (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / det);
            if (alpha < 1.0 / 255) alpha = 0;
            Vec3f color;
            for (int k = 0; k < 3; ++k)
                color[k] =
                    float(alpha * std::max(0.0, 0.5 + 0.28209479177387814 * double(g.sh[0][k])));
            expected.push_back(color);
        }
    EXPECT_GT(psnr(pixels_of(result, 0), expected), 50);
    EXPECT_GT(byte_at(pixels_of(result, 0), int(fx * u + double(c.cx_px)),
                      int(fy * v + double(c.cy_px)), 0),
              100)
        << "it is there";
    const std::string black = pixels_of(result, 1);
    for (std::size_t i = 0; i < black.size(); ++i)
        ASSERT_EQ(static_cast<std::uint8_t>(black[i]), i % 4 == 3 ? 255 : 0);
}

TEST_F(ViewInBrowser, MeshesCoverTheirPixelsAndErrorsHaveTheirColours) {
    ViewRun run = run_of("run", "ewa", single());
    // A square that faces the second camera, between x = -1 and 0.5, y = -0.5 and 0.75 there.
    const std::vector<ViewCamera> cameras = two_cameras();
    const Camera& c = cameras[1].camera;
    const Rigid3f world = inverse(c.camera_from_world);
    for (const float x : {-1.0f, 0.5f})
        for (const float y : {-0.5f, 0.75f}) run.mesh.vertices.push_back(world * Vec3f{x, y, 5});
    run.mesh.colors.assign(4, {1, 0.5f, 0});
    run.mesh.faces = {{0, 1, 2}, {2, 1, 3}};
    run.mesh_faces = 2;
    run.truth.emplace();
    // Far: all errors at the end of the scale.
    run.truth->surface = measured_points({{0, 0, -1000}}, {}, {});
    run.truth->taus = {0.5};
    std::vector<ViewRun> runs;
    runs.push_back(std::move(run));
    const fs::path file = folder("mesh") / "page.html";
    write_text_file(file, view_page({std::move(runs), cameras}).html);
    const JsonValue own = test_of_page(file, "?test=1&show=mesh"),
                    error = test_of_page(file, "?test=1&show=error"),
                    centres = test_of_page(file, "?test=1&show=centre-error");
    for (const JsonValue* result : {&own, &error, &centres})
        ASSERT_EQ((*result)["pixels"].items.size(), 1u) << (*result)["failed"].text;
    const auto inside = [&](int x, int y, double margin) {
        const double px = (x + 0.5 - double(c.cx_px)) / double(c.fx_px) * 5,
                     py = (y + 0.5 - double(c.cy_px)) / double(c.fy_px) * 5;
        return px > -1 - margin && px < 0.5 + margin && py > -0.5 - margin && py < 0.75 + margin;
    };
    const std::string pixels = pixels_of(own, 0);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            if (inside(x, y, -0.005)) {
                ASSERT_GT(byte_at(pixels, x, y, 0), 220) << x << " " << y;
                ASSERT_NEAR(byte_at(pixels, x, y, 1), 0.5 * byte_at(pixels, x, y, 0), 2);
                ASSERT_EQ(byte_at(pixels, x, y, 2), 0);
            } else if (!inside(x, y, 0.005)) {
                ASSERT_EQ(byte_at(pixels, x, y, 0), 0) << x << " " << y;
            }
        }
    const Rgb end = error_shade(1);
    const int x = int(c.cx_px), y = int(c.cy_px);
    EXPECT_NEAR(byte_at(pixels_of(error, 0), x, y, 0), end.r, 12) << "shaded a little";
    EXPECT_NEAR(byte_at(pixels_of(error, 0), x, y, 2), end.b, 12);
    const Vec3f p = c.camera_from_world * single().means[0];
    const int u = int(c.fx_px * p.x / p.z + c.cx_px), v = int(c.fy_px * p.y / p.z + c.cy_px);
    EXPECT_NEAR(byte_at(pixels_of(centres, 0), u, v, 0), end.r, 1);
    EXPECT_NEAR(byte_at(pixels_of(centres, 0), u, v, 1), end.g, 1);
    EXPECT_EQ(byte_at(pixels_of(centres, 0), u + 6, v, 0), 0) << "a dot, no splat";
}

/// A square before the second camera, red above and green below by a texture whose halves are two
/// charts; its vertices are blue.
ViewRun painted_run(const std::string& glb, const Camera& c) {
    TriangleMesh square;
    MeshTexture texture;
    const Rigid3f world = inverse(c.camera_from_world);
    for (const float y : {-1.0f, 0.0f, 1.0f})
        for (const float x : {-1.0f, 1.0f}) square.vertices.push_back(world * Vec3f{x, y, 5});
    square.faces = {{0, 2, 1}, {1, 2, 3}, {2, 4, 3}, {3, 4, 5}};
    texture.image = ImageU8(64, 64, 3);
    for (int y = 0; y < 64; ++y)
        for (int x = 0; x < 64; ++x) texture.image.at(x, y, x < 32 ? 0 : 1) = 250;
    for (const float left : {0.0f, 0.5f})
        for (const float y : {0.1f, 0.9f})
            for (const float x : {0.1f, 0.4f}) texture.places.push_back({left + x, y});
    texture.faces = {{0, 2, 1}, {1, 2, 3}, {4, 6, 5}, {5, 6, 7}};
    write_mesh(glb, square, texture);
    ViewRun run = run_of("run", "ewa", single());
    PlyContents read = read_mesh(glb, {}, true, &run.texture);
    run.mesh = {std::move(read.points.positions), {}, std::move(read.faces)};
    run.mesh.colors.assign(run.mesh.vertices.size(), {0, 0, 1});
    run.mesh_faces = run.mesh.faces.size();
    return run;
}

TEST(ViewPack, TexturesComeFromTheGlbAndKeepToTheirSize) {
    const fs::path file = folder("glb") / "mesh.glb";
    const ViewRun run = painted_run(file, two_cameras()[1].camera);
    EXPECT_EQ(run.mesh.vertices.size(), 6u) << "merged where the charts meet";
    ASSERT_EQ(run.texture.places.size(), 8u);
    TriangleMesh split = run.mesh;
    split_at_charts(split, run.texture);
    EXPECT_EQ(split.vertices.size(), 8u);
    EXPECT_TRUE(split.colors.empty());
    for (std::size_t f = 0; f < 4; ++f)
        for (int c = 0; c < 3; ++c)
            EXPECT_EQ(norm(split.vertices[std::size_t(split.faces[f][c])] -
                           run.mesh.vertices[std::size_t(run.mesh.faces[f][c])]),
                      0);
    EXPECT_EQ(texture_for_page(run.texture.image, 1'000'000), run.texture.image);
    ImageU8 noise(400, 300, 3);
    test::Random random(1);
    for (auto& value : noise.pixels) value = std::uint8_t(random.uniform(0, 255));
    const std::string small = texture_for_page(png_bytes(noise), 20'000);
    EXPECT_LE(small.size(), 20'000u);
    const ImageU8 shrunk = decode_image("texture", small);
    EXPECT_LT(shrunk.width, 400);
    EXPECT_NEAR(double(shrunk.width) / shrunk.height, 4.0 / 3, 0.05);
}

TEST_F(ViewInBrowser, TheMeshHasItsTexture) {
    const std::vector<ViewCamera> cameras = two_cameras();
    const Camera& c = cameras[1].camera;
    const fs::path where = folder("texture"), file = where / "page.html";
    std::vector<ViewRun> runs;
    runs.push_back(painted_run(where / "mesh.glb", c));
    write_text_file(file, view_page({std::move(runs), cameras}).html);
    const JsonValue result = test_of_page(file, "?test=1&show=mesh");
    ASSERT_EQ(result["pixels"].items.size(), 1u) << result["failed"].text;
    const std::string pixels = pixels_of(result, 0);
    const int x = int(c.cx_px), y = int(c.cy_px), step = int(0.5f * c.fy_px / 5);
    for (const bool below : {false, true}) {
        const int at = below ? y + step : y - step;
        EXPECT_NEAR(byte_at(pixels, x, at, below ? 1 : 0), 250, 6) << "unshaded";
        EXPECT_LT(byte_at(pixels, x, at, below ? 0 : 1), 8);
        EXPECT_LT(byte_at(pixels, x, at, 2), 8) << "not the colour of the vertices";
    }
}

TEST_F(ViewInBrowser, WithoutWebGlThereArePicturesAndANotice) {
    std::vector<ViewRun> runs;
    runs.push_back(run_of("run", "ewa", test::random_gaussians(100, 4)));
    const fs::path file = folder("refused") / "page.html";
    write_text_file(file, view_page({std::move(runs), two_cameras()}).html);
    const std::string html = page_in_browser(file, "", "--disable-3d-apis");
    EXPECT_NE(text_of(html, "status").find("No view in 3D"), std::string::npos)
        << text_of(html, "status");
    EXPECT_NE(html.find("<img class=\"poster\" alt"), std::string::npos);
    EXPECT_NE(html.find("<canvas id=\"canvas\" hidden"), std::string::npos);
}

TEST_F(ViewInBrowser, ThePageComesToRestReady) {
    std::vector<ViewRun> runs;
    runs.push_back(run_of("a", "ewa", test::random_gaussians(100, 4)));
    runs.push_back(run_of("b", "surfel", sphere(100)));
    const fs::path file = folder("ready") / "page.html";
    write_text_file(file, view_page({std::move(runs), two_cameras()}).html);
    const std::string html = page_in_browser(file, "?wait");
    EXPECT_NE(text_of(html, "status").find("Drag to turn"), std::string::npos)
        << text_of(html, "status");
    EXPECT_EQ(html.find("<canvas id=\"canvas\" hidden"), std::string::npos);
    EXPECT_NE(html.find("<div id=\"controls\">"), std::string::npos);
    EXPECT_EQ(html.find("class=\"pane\" hidden"), std::string::npos);
}

}  // namespace
}  // namespace tvsgs
