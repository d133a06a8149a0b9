// tvsgs-extract-mesh on splats with a known surface, and the shipped mesh configurations.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <utility>

#include "core/error.h"
#include "io/config/config.h"
#include "io/mesh/mesh_files.h"
#include "io/splats/ply.h"
#include "pipeline/mesh/mesh_extraction.h"
#include "pipeline/run/run_folder.h"
#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr double kBall = 0.7, kDome = 100;

/// Flat, opaque splats on a sphere about the origin, evenly spread.
void add_sphere(int count, double radius, Gaussians<Cpu>& splats, int first) {
    for (int i = 0; i < count; ++i) {
        const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
        const double angle = M_PI * (1 + std::sqrt(5.0)) * i;
        const Vec3d n{r * std::cos(angle), r * std::sin(angle), z};
        const float size = static_cast<float>(std::log(2 * radius / std::sqrt(count)));
        const auto at = static_cast<std::size_t>(first + i);
        splats.means.data()[at] = vec_cast<float>(radius * n);
        splats.log_scales.data()[at] = {size, size, size - 5};
        // Rotates the z axis to n.
        splats.quats.data()[at] = quat_cast<float>(Quat<double>{1 + n.z, -n.y, n.x, 0});
        splats.opacity_logits.data()[at] = 6;
        splats.sh.data()[at] = radius > 1 ? Vec3f{0.5f, 0.5f, 1} : Vec3f{1, 0, 0};
    }
}

class ExtractMesh : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_extract_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        const Result synth =
            run_tool(folder_, "synth", "--out scene --views 6 --width 64 --height 48");
        ASSERT_EQ(synth.code, 0) << synth;
        Gaussians<Cpu> splats;
        resize(splats, 6000, 0);
        add_sphere(2000, kBall, splats, 0);
        add_sphere(4000, kDome, splats, 2000);
        write_splat_ply((folder_ / "splats.ply").string(), splats);
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static Result extract(const std::string& flags, const std::string& out = "mesh.ply") {
        fs::remove(folder_ / out);
        return run_tool(folder_, "extract-mesh",
                        "--model splats.ply --scene scene --device cpu --no-masks -v --out " + out +
                            " " + flags +
                            (flags.find("--error") == std::string::npos ? " --error 0" : ""));
    }
    static std::vector<double> radii(const std::string& out = "mesh.ply") {
        std::vector<double> r;
        for (const Vec3d v : read_ply_geometry((folder_ / out).string()).positions)
            r.push_back(norm(v));
        std::sort(r.begin(), r.end());
        return r;
    }

    static inline fs::path folder_;
};

TEST_F(ExtractMesh, BackgroundWhereAskedFor) {
    const std::string fine = "--mesh-resolution 200 --truncation 0.15 ";
    const Result bounded = extract(fine + "--no-preview");
    ASSERT_EQ(bounded.code, 0) << bounded;
    EXPECT_LT(radii().back(), 1);

    const Result unbounded = extract(fine + "--unbounded");
    ASSERT_EQ(unbounded.code, 0) << unbounded;
    EXPECT_TRUE(unbounded.says("Unbounded: voxels grow beyond 4.5 ")) << unbounded;
    EXPECT_TRUE(fs::exists(folder_ / "mesh.png"));
    // The cameras are at distance 4.5 from the focus: voxels of 0.045 are (100 / 4.5)^2 times as
    // long at the dome.
    const double voxel = 9.0 / 200, far_voxel = voxel * std::pow(kDome / 4.5, 2);
    std::size_t near = 0, far = 0;
    const std::vector<double> all = radii();
    for (const double r : all) {
        // Outlines of the ball are off by one pixel, 4.5 / 64.
        near += std::abs(r - kBall) < voxel + 0.07;
        far += std::abs(r - kDome) < far_voxel;
    }
    // Pixels on an outline blend the depths of both.
    EXPECT_GE(static_cast<double>(near + far), 0.99 * static_cast<double>(all.size()));
    EXPECT_GT(near, 500u);
    EXPECT_GT(far, 3000u);

    // Given limits apply, too.
    for (const char* limit : {"--depth-max 50", "--bbox=-2,-2,-2,2,2,2"}) {
        const Result limited = extract(fine + "--no-preview --unbounded " + limit, "limited.ply");
        ASSERT_EQ(limited.code, 0) << limited;
        EXPECT_LT(radii("limited.ply").back(), 1) << limit;
        EXPECT_TRUE(limited.says("Voxel size 0.045, ")) << limited;
    }
    // Reports depths beyond the contracted space.
    const Result coarse =
        extract("--mesh-resolution 100 --set mesh.truncation_voxels=5 --no-preview --unbounded");
    ASSERT_EQ(coarse.code, 0) << coarse;
    EXPECT_TRUE(coarse.says(" at 45 units or more from the object")) << coarse;
    EXPECT_LT(radii().back(), 1);
}

TEST_F(ExtractMesh, OnlyTheObject) {
    // Voxels of 2 hold the dome and lose the ball.
    const std::string coarse = "--depth-max 150 --voxel-size 2 --truncation 8 --no-preview ";
    const Result all = extract(coarse);
    ASSERT_EQ(all.code, 0) << all;
    EXPECT_NEAR(radii().back(), kDome, 3);
    EXPECT_FALSE(all.says("Left out")) << all;
    const Result everything = extract(coarse + "--set mesh.object=1 --everything");
    ASSERT_EQ(everything.code, 0) << everything;
    EXPECT_NEAR(radii().back(), kDome, 3);

    const std::string fine = "--mesh-resolution 200 --truncation 0.15 --no-preview ";
    const Result object = extract(fine + "--depth-max 150 --voxel-size 0.045 --set mesh.object=1");
    ASSERT_EQ(object.code, 0) << object;
    EXPECT_LT(radii().back(), 1);
    EXPECT_TRUE(object.says("Left out: everything farther than ")) << object;
    EXPECT_TRUE(object.says("--everything keeps it")) << object;

    // A smaller ball cuts the object, where the cameras look.
    const std::size_t vertices = radii().size();
    const Result part = extract(fine + "--set mesh.object=0.3");
    ASSERT_EQ(part.code, 0) << part;
    EXPECT_LT(radii().size(), vertices / 2);
    EXPECT_GT(radii().size(), vertices / 20);
}

TEST_F(ExtractMesh, CoarserVoxelsKeepTheTruncationOfFineOnes) {
    const std::string flags = "--no-preview --set mesh.voxel_scale=";
    const Result fine = extract(flags + "1");
    ASSERT_EQ(fine.code, 0) << fine;
    EXPECT_TRUE(fine.says("Voxel size 0.05882, truncation 0.2353,")) << fine;
    const double vertices = static_cast<double>(radii().size());
    const Result coarse = extract(flags + "1.5");
    ASSERT_EQ(coarse.code, 0) << coarse;
    EXPECT_TRUE(coarse.says("Voxel size 0.08824, truncation 0.2353,")) << coarse;
    // By area, except at the boundaries of the visible parts.
    EXPECT_NEAR(static_cast<double>(radii().size()) / vertices, 1 / (1.5 * 1.5), 0.07);
    EXPECT_EQ(extract(flags + "2.1").code, 2) << "less than two voxels of truncation";
    for (const std::string given : {" --mesh-resolution 150", " --voxel-size 0.06"}) {
        const Result r = extract(flags + "1.5" + given);
        EXPECT_TRUE(r.says("Voxel size 0.06, truncation 0.24,")) << r;
        EXPECT_TRUE(r.says("mesh.voxel_scale=1.5 has no effect")) << r;
    }
}

TEST_F(ExtractMesh, ALimitUndoesThePlannedBackground) {
    const fs::path run = folder_ / "planned", splats = run / "point_cloud/iteration_1";
    fs::create_directories(splats);
    fs::copy_file(folder_ / "splats.ply", splats / "point_cloud.ply");
    std::ofstream(run / "config.json") << R"({"mesh": {"unbounded": true}})";
    const auto says_unbounded = [&](const std::string& flags) {
        const Result r = run_tool(folder_, "extract-mesh",
                                  "--model planned --scene scene --device cpu --no-masks --error 0 "
                                  "--no-preview --mesh-resolution 100 --truncation 0.3 --out "
                                  "planned.ply -v " +
                                      flags);
        EXPECT_EQ(r.code, 0) << flags << ": " << r;
        EXPECT_EQ(r.says("Background left out"), !r.says("Unbounded: voxels grow")) << r;
        return r.says("Unbounded: voxels grow");
    };
    EXPECT_TRUE(says_unbounded(""));
    for (const std::string limit : {"--depth-max 50", "--bbox=-2,-2,-2,2,2,2"}) {
        EXPECT_FALSE(says_unbounded(limit));
        EXPECT_TRUE(says_unbounded(limit + " --unbounded"));
    }
}

TEST_F(ExtractMesh, OneViewIsTrustedBesideJumpsUpToALimit) {
    const std::string flags = "--mesh-resolution 120 --truncation 0.25 --no-preview --set ";
    std::size_t vertices = 0;
    for (const char* limit : {"0.01", "1000"}) {
        const Result r = extract(flags + "mesh.single_view_jump_px=" + limit);
        ASSERT_EQ(r.code, 0) << r;
        EXPECT_GT(radii().size(), vertices);
        vertices = radii().size();
    }
}

/// All formats of one mesh have the same scores, with the rotation of a GLB and its copied vertices
/// at seams or without.
TEST_F(ExtractMesh, EveryFormatHasTheSameScores) {
    std::string expected;
    for (const std::string out : {"same.ply", "same.glb", "same.obj"}) {
        const Result mesh =
            extract("--mesh-resolution 120 --truncation 0.25 --texture-format png", out);
        ASSERT_EQ(mesh.code, 0) << mesh;
        EXPECT_EQ(mesh.says("\nTexture "), out != "same.ply") << mesh;
        const Result score = run_tool(folder_, "eval",
                                      "geometry --quiet --point-samples 50000 --tau 0.01,0.1 --gt "
                                      "scene/gt/points.ply --pred " +
                                          out);
        ASSERT_EQ(score.code, 0) << score;
        const std::string all = score.out.substr(0, score.out.find("\"inputs\""));
        if (expected.empty()) expected = all;
        EXPECT_EQ(all, expected) << out;
    }
    for (const char* file : {"same.mtl", "same_texture.png", "same.png"})
        EXPECT_TRUE(fs::exists(folder_ / file)) << file;
    // The same bytes from run to run, for any number of threads.
    const std::string glb = contents(folder_ / "same.glb");
    fs::remove(folder_ / "same.glb");
    ASSERT_EQ(run_tool(folder_, "extract-mesh",
                       "--model splats.ply --scene scene --device cpu --no-masks --out same.glb "
                       "--mesh-resolution 120 --truncation 0.25 --error 0 --texture-format png "
                       "--no-preview",
                       4)
                  .code,
              0);
    EXPECT_TRUE(contents(folder_ / "same.glb") == glb);

    const Result plain =
        extract("--mesh-resolution 120 --truncation 0.25 --texture none --keep-axes", "plain.glb");
    ASSERT_EQ(plain.code, 0) << plain;
    EXPECT_FALSE(plain.says("\nTexture ")) << plain;
    const std::string bytes = contents(folder_ / "plain.glb");
    EXPECT_NE(bytes.find("COLOR_0"), std::string::npos);
    EXPECT_EQ(bytes.find("\"matrix\""), std::string::npos);
    EXPECT_NE(glb.find("\"matrix\""), std::string::npos);
}

TEST_F(ExtractMesh, SimplifiedToABoundOrANumber) {
    const std::string flags = "--mesh-resolution 200 --truncation 0.15 --no-preview ";
    ASSERT_EQ(extract(flags).code, 0);
    const std::size_t all = radii().size();
    const Result bound = extract(flags + "--error 0.5");
    ASSERT_EQ(bound.code, 0) << bound;
    EXPECT_TRUE(bound.says("\nSimplified ")) << bound;
    EXPECT_LT(radii().size(), all / 4);
    EXPECT_NEAR(radii().front(), kBall, 0.1);  // half a pixel of 4.5 / 64, and the error before
    const Result number = extract(flags + "--error 0 --faces 400");
    ASSERT_EQ(number.code, 0) << number;
    EXPECT_LE(read_ply_geometry((folder_ / "mesh.ply").string()).faces.size(), 400u);
    EXPECT_FALSE(number.says("fewer faces would tear or fold it")) << number;
    const Result too_few = extract(flags + "--error 0 --faces 3");  // the ball has holes
    ASSERT_EQ(too_few.code, 0) << too_few;
    EXPECT_TRUE(too_few.says("fewer faces would tear or fold it")) << too_few;
}

TEST_F(ExtractMesh, UnboundedWithinABudget) {
    const std::string flags = "--mesh-resolution 200 --no-preview --unbounded --carve ";
    const Result whole = extract(flags, "whole.ply");
    ASSERT_EQ(whole.code, 0) << whole;
    const Result parts = extract(flags + "--memory 4M", "parts.ply");
    ASSERT_EQ(parts.code, 0) << parts;
    EXPECT_TRUE(parts.says("parts to stay within --memory")) << parts;
    EXPECT_GT(contents(folder_ / "whole.ply").size(), 100000u);
    EXPECT_TRUE(contents(folder_ / "whole.ply") == contents(folder_ / "parts.ply"));
}

TEST_F(ExtractMesh, Tetrahedra) {
    const std::string flags = "--method tetrahedra --no-preview ";
    const Result bounded = extract(flags);
    ASSERT_EQ(bounded.code, 0) << bounded;
    EXPECT_TRUE(bounded.says("4008 points of 6000 splats")) << bounded;  // of the ball, and a box
    std::vector<double> all = radii();
    EXPECT_GT(all.size(), 3000u);
    // If fewer than two views see a splat, its points decide, at most 3/4 px away, 4.5 / 64.
    EXPECT_NEAR(all.front(), kBall, 0.055);
    EXPECT_NEAR(all.back(), kBall, 0.055);
    EXPECT_NEAR(all[all.size() / 2], kBall, 0.004);

    // The dome's splats are 2 to 3 wide, seen by one or two views each.
    const Result unbounded = extract(flags + "--unbounded");
    ASSERT_EQ(unbounded.code, 0) << unbounded;
    std::size_t near = 0, far = 0;
    all = radii();
    for (const double r : all) near += std::abs(r - kBall) < 0.055, far += std::abs(r - kDome) < 2;
    EXPECT_GT(near, 3000u);
    EXPECT_GT(far, 500u);
    EXPECT_EQ(near + far, all.size());

    const Result boxed = extract(flags + "--bbox=-2,-2,0,2,2,2");
    ASSERT_EQ(boxed.code, 0) << boxed;
    EXPECT_LT(static_cast<double>(radii().size()), 0.6 * static_cast<double>(all.size()));

    const Result small = extract(flags + "--memory 4M");
    ASSERT_EQ(small.code, 0) << small;
    EXPECT_TRUE(small.says("to stay within --memory")) << small;
    EXPECT_NEAR(radii().front(), kBall, 0.06);
}

/// Edges that do not have two faces, one in each direction.
std::size_t loose_edges(const PlyGeometry& mesh) {
    std::map<std::pair<int, int>, int> balance, count;
    for (const Vec3i f : mesh.faces)
        for (int k = 0; k < 3; ++k) {
            const int a = f[k], b = f[(k + 1) % 3];
            const auto edge = std::minmax(a, b);
            balance[edge] += a < b ? 1 : -1, ++count[edge];
        }
    std::size_t loose = 0;
    for (const auto& [edge, faces] : count) loose += faces != 2 || balance[edge] != 0;
    return loose;
}

TEST_F(ExtractMesh, WatertightWhateverFollows) {
    const std::string flags = "--method watertight --bbox=-1,-1,-0.3,1,1,1 --no-preview ";
    std::size_t all = 0;
    for (const std::string more : {"", "--error 0.5", "--faces 300 --memory 60M"})
        for (const std::string out : {"closed.ply", "closed.glb", "closed.obj"}) {
            if (out != "closed.ply" && more != "--error 0.5") continue;
            const Result r = extract(flags + more, out);
            ASSERT_EQ(r.code, 0) << more << r;
            const PlyGeometry mesh = read_mesh_geometry((folder_ / out).string());
            EXPECT_EQ(loose_edges(mesh), 0u) << more << out;
            EXPECT_EQ(r.says("\nTexture "), out != "closed.ply") << r;
            if (more.empty()) all = mesh.faces.size();
            EXPECT_TRUE(more != "--error 0.5" || mesh.faces.size() < all / 2);
            EXPECT_TRUE(!more.starts_with("--faces") || mesh.faces.size() <= 300);
            double volume = 0;
            for (const Vec3i f : mesh.faces)
                volume +=
                    dot(mesh.positions[f.x], cross(mesh.positions[f.y], mesh.positions[f.z])) / 6;
            // The ball above z = -0.3, closed below, in voxels of a tenth of its radius.
            const double cap = M_PI * 0.4 * 0.4 * (kBall - 0.4 / 3);
            EXPECT_NEAR(volume / (4 * M_PI / 3 * std::pow(kBall, 3) - cap), 1, 0.2) << more << out;
        }
    // Unseen vertices are marked.
    ASSERT_EQ(extract(flags + "--set mesh.evidence=false").code, 0);
    const std::string bytes = contents(folder_ / "mesh.ply");
    EXPECT_NE(bytes.find("property uchar views"), std::string::npos);
}

TEST_F(ExtractMesh, MessagesFitOnOneScreen) {
    const auto lines = [&](const std::string& flags) {
        fs::remove(folder_ / "few.png");
        const Result r = run_tool(folder_, "extract-mesh",
                                  "--model splats.ply --scene scene --device cpu --no-masks "
                                  "--mesh-resolution 120 --truncation 0.25 --out few.glb" +
                                      flags);
        EXPECT_EQ(r.code, 0) << r;
        for (const char* text : {"Input: 6,000 splats of splats.ply, ", "Mesh: ", "Wrote few.glb\n",
                                 "Wrote few.png (preview)\n"})
            EXPECT_TRUE(r.says(text)) << r;
        return std::count(r.err.begin(), r.err.end(), '\n');
    };
    EXPECT_LE(lines(""), 8);
    EXPECT_GT(lines(" -v"), 12);
}

TEST_F(ExtractMesh, StandardOutputThatIsAFileGetsThePly) {
    const Result r = run_tool(
        folder_, "extract-mesh",
        "--model splats.ply --scene scene --device cpu --no-masks --error 0 --out /dev/stdout");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.out.starts_with("ply\n")) << r.out.substr(0, 20);
    EXPECT_TRUE(r.says("Wrote /dev/stdout\n")) << r;
    EXPECT_FALSE(r.says(".png")) << "no picture in /dev: " << r;
}

TEST_F(ExtractMesh, ARunHasTheMeshWrittenLastInItsFolderOrBesideIt) {
    const fs::path run = folder_ / "run";
    EXPECT_EQ(find_mesh(run.string()), "");
    fs::create_directories(run / "mesh");
    const auto now = fs::file_time_type::clock::now();
    const auto write = [&](const char* name, int seconds) {
        std::ofstream(run / name) << "a mesh";
        fs::last_write_time(run / name, now + std::chrono::seconds(seconds));
    };
    write("another.ply", 9);
    EXPECT_EQ(find_mesh(run.string()), "");
    write("mesh.ply", 1);
    EXPECT_EQ(find_mesh(run.string()), (run / "mesh.ply").string());
    write("mesh/mesh.obj", 2);
    EXPECT_EQ(find_mesh(run.string()), (run / "mesh/mesh.obj").string());
    write("mesh.glb", 3);
    EXPECT_EQ(find_mesh(run.string()), (run / "mesh.glb").string());
}

TEST_F(ExtractMesh, RefusesWhatContradictsItself) {
    const auto expect_refused = [&](const std::string& flags, int code, const char* says) {
        const Result r = extract(flags, "refused.ply");
        EXPECT_EQ(r.code, code) << flags << ": " << r;
        EXPECT_TRUE(r.says(says)) << flags << ": " << r;
        EXPECT_FALSE(fs::exists(folder_ / "refused.ply")) << flags;
    };
    expect_refused("--set mesh.max_scale_px=1e-6", 7, "are larger than 1e-06 pixels");
    expect_refused("--texture 4096", 2, "would be a PLY, which has no texture");
    expect_refused("--texture big", 2, "expected auto, none, or a side of 256 to 8192");
    expect_refused("--texture-format tga", 2, "jpg, png, webp");
    ::setenv("TVSGS_MESH__NOSUCH", "1", 1);
    const Result warned = extract("", "warned.ply");
    EXPECT_EQ(warned.code, 0) << warned;
    EXPECT_TRUE(warned.says("environment variable TVSGS_MESH__NOSUCH: unknown key")) << warned;
    ::unsetenv("TVSGS_MESH__NOSUCH");
    const Result bad = extract("", "refused.stl");
    EXPECT_EQ(bad.code, 2) << bad;
    EXPECT_TRUE(bad.says("; use .glb, .obj or .ply")) << bad;
    EXPECT_FALSE(bad.says("training views")) << "before any work";
    const Result webp = extract("--texture-format webp", "refused.obj");
    EXPECT_EQ(webp.code, 2) << webp;
    EXPECT_TRUE(webp.says("jpg or png, not WebP")) << webp;
    expect_refused(
        "--method tsfd", 2,
        "mesh.method = 'tsfd': expected one of tsdf, tetrahedra, watertight; did you mean 'tsdf'?");
    expect_refused("--method tetrahedra --bbox=5,5,5,6,6,6", 7, "is in the image of a view");
    expect_refused("--method tetrahedra --memory 1M", 4, "raise --memory");
    expect_refused("--method watertight --memory 2K", 4, "raise --memory");
    expect_refused("--method watertight --bbox=5,5,5,6,6,6", 7, "all depth pixels were dropped");
    expect_refused("--method watertight --memory 100K", 4, "raise --memory");
    expect_refused("--method watertight --voxel-size 1e-9", 3, "too far out for voxels of 1e-09");
    expect_refused("--unbounded --truncation 5", 2, "ball of radius 4.5");
    expect_refused("--unbounded --set mesh.radius=-1", 2, "mesh.radius");
    MeshOptions late;
    EXPECT_NO_THROW(check_mesh_options(late));
    late.box = "0,0,0,1,1";
    EXPECT_THROW(check_mesh_options(late), Error) << "tvsgs-train --eval-mesh says it at once";
}

TEST(MeshOverlays, SetWhatTheTableSays) {
    // docs/guide/evaluation.md
    struct Row {
        const char* file;
        float voxel_size, truncation, depth_max, depth_step, max_angle, alpha_min;
        int resolution, clusters;
    };
    for (const Row row : {Row{"dtu_2dgs", 0.004f, 0.016f, 3, 0, 90, 0, 0, 1},
                          Row{"tnt_2dgs", 0.004f, 0.016f, 3, 0, 90, 0, 0, 1},
                          Row{"tnt_2dgs_large", 0.006f, 0.024f, 4.5f, 0, 90, 0, 0, 1},
                          Row{"dtu_pgsr", 0.002f, 0.008f, 5, 0.001f, 90, 0, 0, 1},
                          Row{"tnt_pgsr", 0.002f, 0.008f, 20, 0.001f, 80, 0, 0, 1},
                          Row{"dtu_fates", 0, 0, 0, 0, 90, 0.5f, 1024, 50}}) {
        SCOPED_TRACE(row.file);
        MeshOptions mesh;
        OptionTable table;
        table.add("mesh", mesh);
        // As the configuration of a run may have it, by its plan or by its user.
        mesh.method = "watertight", mesh.unbounded = true, mesh.max_scale_px = 16;
        table.read_file(std::string(TVSGS_SOURCE_DIR "/configs/mesh_") + row.file + ".json");
        EXPECT_EQ(mesh.meshers.tsdf.voxel_size, row.voxel_size);
        EXPECT_EQ(mesh.meshers.tsdf.truncation, row.truncation);
        if (row.truncation == 0) {
            EXPECT_EQ(mesh.meshers.tsdf.truncation_voxels, 5);
        }
        EXPECT_EQ(mesh.depth_max, row.depth_max);
        EXPECT_EQ(mesh.depth_step, row.depth_step);
        EXPECT_EQ(mesh.max_angle, row.max_angle);
        EXPECT_EQ(mesh.alpha_min, row.alpha_min);
        EXPECT_EQ(mesh.meshers.tsdf.resolution, row.resolution);
        EXPECT_EQ(mesh.clusters, row.clusters);
        EXPECT_EQ(mesh.simplify.error, 0);
        EXPECT_EQ(mesh.simplify.faces, 0);
        EXPECT_TRUE(mesh.masks);
        EXPECT_FALSE(mesh.evidence);
        EXPECT_EQ(mesh.method, "tsdf");
        EXPECT_EQ(mesh.max_scale_px, 0);
        EXPECT_EQ(mesh.holes, 0);
        EXPECT_EQ(mesh.smooth, 0);
        EXPECT_FALSE(mesh.unbounded || mesh.meshers.tsdf.carve);
        EXPECT_EQ(mesh.meshers.tsdf.single_view, SingleView::all);
    }
}

}  // namespace
}  // namespace tvsgs
