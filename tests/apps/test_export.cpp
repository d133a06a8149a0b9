// tvsgs-export: each format from a run and from a file, options to leave splats out, and refused
// input.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "io/splats/ply.h"
#include "io/splats/splat_errors.h"
#include "io/splats/splat_files.h"
#include "pipeline/run/splat_selection.h"
#include "support/command.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class ExportCommand : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_export_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(call("synth", "--out scene --views 6 --width 96 --height 72"), 0) << err();
        ASSERT_EQ(call("train",
                       "--scene scene --eval --test-every 3 --device cpu --iterations 20 --out run "
                       "--quiet --set model.sh_degree=2"),
                  0)
            << err();
        write_splat_ply(at("some.ply"), test::random_gaussians(500, 3));
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static int call(const std::string& tool, const std::string& arguments) {
        return run_tool(folder_, tool, arguments).code;
    }
    static std::string err() { return contents(folder_ / "err.txt"); }
    static std::string at(const std::string& name) { return (folder_ / name).string(); }
    static std::string splats_of_run() {
        return at("run/point_cloud/iteration_20/point_cloud.ply");
    }
    /// Runs tvsgs-export and returns its JSON.
    static json exported(const std::string& arguments) {
        const Result result = run_tool(folder_, "export", arguments + " --json --device cpu");
        EXPECT_EQ(result.code, 0) << arguments << ": " << result.err;
        return result.code == 0 ? json::parse(result.out) : json::object();
    }
    static void expect_refused(const std::string& arguments, int code, const std::string& message) {
        EXPECT_EQ(call("export", arguments), code) << arguments << ": " << err();
        EXPECT_NE(err().find(message), std::string::npos) << "'" << message << "' not in " << err();
        EXPECT_EQ(contents(folder_ / "out.txt"), "");
    }

    static inline fs::path folder_;
};

TEST_F(ExportCommand, WritesEveryFormatAndSaysWhatItCosts) {
    for (const std::string format : {"ply", "spz", "sog", "glb"}) {
        const std::string name = "all." + format;
        const json report = exported("run " + name);
        EXPECT_EQ(report["format"], format);
        EXPECT_EQ(report["bytes"], fs::file_size(folder_ / name));
        EXPECT_EQ(report["views"]["kind"], "test");
        EXPECT_EQ(report["views"]["count"], 2);
        const double before = report["views"]["psnr_before"], after = report["views"]["psnr_after"];
        EXPECT_GT(before, 10);
        EXPECT_NEAR(after, before, 0.5);
        const json& between = report["views"]["psnr_between"];
        EXPECT_TRUE(format == "ply" ? between.is_null() : double(between) > 40) << between;
        const Gaussians<Cpu> read = read_splat_file(at(name));
        EXPECT_EQ(read.size(), report["splats"]);
        EXPECT_EQ(read.sh_degree, 2);
        EXPECT_NE(err().find("PSNR of 2 test views"), std::string::npos) << err();
    }
}

/// The check gives the scores of the run's views.
TEST_F(ExportCommand, FindsWhatTheRunWasScoredWith) {
    const json report = exported("run psnr.spz"),
               scores = json::parse(contents(folder_ / "run/eval/nvs.json"));
    EXPECT_NEAR(report["views"]["psnr_before"], double(scores["psnr"]), 0.02);
}

TEST_F(ExportCommand, GoesFromFormatToFormatAndBack) {
    const Gaussians<Cpu> original = read_splat_ply(at("some.ply"));
    for (const std::string through : {"a.spz", "a.glb"})
        for (const std::string frame : {"", "rdf", "rub", "luf"}) {
            const std::string to = frame.empty() ? "" : " --frame " + frame,
                              from = frame.empty() ? "" : " --input-frame " + frame;
            exported("some.ply " + through + to);
            exported(through + " back.ply" + from);
            Gaussians<Cpu> back = read_splat_ply(at("back.ply"));
            ASSERT_EQ(back.size(), original.size());
            // SPZ sorts splats; the reference is sorted alike.
            double sum = 0, sum_back = 0;
            for (std::size_t i = 0; i < 500; ++i)
                sum += double(original.means[i].x * original.sh[500 + i].x),
                    sum_back += double(back.means[i].x * back.sh[500 + i].x);
            EXPECT_NEAR(sum, sum_back, through == "a.spz" ? 2 : 1e-3) << through << frame;
            if (through == "a.glb") {
                EXPECT_LT(errors_of(original, back).degrees, 0.05);
            }
        }
    exported("some.ply turned.ply --frame rub");
    const Gaussians<Cpu> turned = read_splat_ply(at("turned.ply"));
    EXPECT_EQ(turned.means[7].y, -original.means[7].y);
    EXPECT_EQ(turned.sh[500 + 7].x, -original.sh[500 + 7].x);
    EXPECT_EQ(turned.sh[3 * 500 + 7].x, original.sh[3 * 500 + 7].x);
}

TEST_F(ExportCommand, LeavesOutWhatIsAsked) {
    const json box = exported("some.ply box.spz --bbox 0,-2,-2,2,2,2");
    EXPECT_EQ(int(box["left_out"]["outside"]) + int(box["splats"]), 500);
    EXPECT_NEAR(int(box["splats"]), 250, 50);
    const SpzContents boxed = read_spz(at("box.spz"));
    for (const Vec3f p : boxed.splats.means.span()) EXPECT_GE(p.x, -1e-5f);

    const json small = exported("some.ply small.ply --max-splats 100 --sh-degree 1");
    EXPECT_EQ(small["splats"], 100);
    EXPECT_EQ(small["sh_degree"], 1);
    const auto mean_size = [](const Gaussians<Cpu>& splats) {
        double sum = 0;
        for (const double size : size_of_splats(splats)) sum += size;
        return sum / splats.size();
    };
    EXPECT_GT(mean_size(read_splat_ply(at("small.ply"))),
              2 * mean_size(read_splat_ply(at("some.ply"))));

    // With a run: no view sees splats behind all cameras; the renders of the others stay the same.
    Gaussians<Cpu> g = read_splat_ply(splats_of_run());
    const int count = g.size();
    for (std::size_t i = 0; i < 50; ++i) g.means[i] = {0, 0, 1000 + float(i)};
    write_splat_ply(at("with_unseen.ply"), g);
    const json seen = exported("with_unseen.ply seen.ply --scene scene --prune-unseen");
    EXPECT_GE(int(seen["left_out"]["unseen"]), 50);
    EXPECT_LT(int(seen["left_out"]["unseen"]), count / 2);
    EXPECT_NEAR(seen["views"]["psnr_input"], double(seen["views"]["psnr_after"]), 1e-6);
    const Gaussians<Cpu> left = read_splat_ply(at("seen.ply"));
    for (const Vec3f p : left.means.span()) EXPECT_LT(p.z, 1000);

    // The brightest half keeps more of the renders than another half would.
    const json bright = exported("run bright.ply --max-splats " + std::to_string(count / 2));
    EXPECT_EQ(bright["splats"], count / 2);
    EXPECT_LT(double(bright["views"]["psnr_input"]) - double(bright["views"]["psnr_after"]), 4);
}

TEST_F(ExportCommand, WritesTheSameForAnyNumberOfThreads) {
    for (const std::string format : {"spz", "sog", "glb"}) {
        for (const int threads : {1, 3})
            ASSERT_EQ(run_tool(folder_, "export",
                               "run threads" + std::to_string(threads) + "." + format +
                                   " --no-check --max-splats 900 --device cpu",
                               threads)
                          .code,
                      0)
                << err();
        EXPECT_EQ(contents(folder_ / ("threads1." + format)),
                  contents(folder_ / ("threads3." + format)));
    }
}

TEST_F(ExportCommand, StandsUpright) {
    exported("run up.glb");
    const std::string glb = contents(folder_ / "up.glb");
    std::uint32_t length = 0;
    std::memcpy(&length, &glb[12], 4);
    const json document = json::parse(glb.substr(20, length));
    EXPECT_TRUE(document["nodes"][0].contains("matrix"));
    exported("run axes.glb --keep-axes --no-check");
    const std::string kept = contents(folder_ / "axes.glb");
    std::memcpy(&length, &kept[12], 4);
    EXPECT_FALSE(json::parse(kept.substr(20, length))["nodes"][0].contains("matrix"));
}

/// Positions far from the origin keep their precision: the file is near zero, and a file next to it
/// stores the origin.
TEST_F(ExportCommand, TakesLargeCoordinatesOff) {
    write_splat_ply(at("far.ply"), test::random_gaussians(200, 4), {500000, 4000000, 100});
    const json report = exported("far.ply far.spz");
    EXPECT_LT(double(report["errors"]["position"]), 1e-4);
    const json beside = json::parse(contents(folder_ / "far.spz.json"));
    EXPECT_NEAR(double(beside["origin"][0]), 500000, 4);
    EXPECT_NEAR(double(beside["origin"][1]), 4000000, 4);
    EXPECT_FALSE(fs::exists(folder_ / "all.spz.json"));
    exported("far.ply far.glb");
    const PlyGeometry first = read_ply_geometry(at("far.ply"));
    // And from each of these again.
    for (const std::string from : {"far.ply", "far.spz", "far.glb"}) {
        exported(from + " again.ply");
        const PlyGeometry again = read_ply_geometry(at("again.ply"));
        double least = 1;  // SPZ sorts
        for (const Vec3d p : again.positions) least = std::min(least, norm(p - first.positions[5]));
        EXPECT_LT(least, 1e-5) << from;
    }
    // Splats near the origin must not use a stale origin file.
    for (const std::string name : {"stale.spz", "stale.sog"}) {
        exported("far.ply " + name);
        ASSERT_TRUE(fs::exists(at(name + ".json"))) << name;
        exported("some.ply " + name);
        EXPECT_FALSE(fs::exists(at(name + ".json"))) << name;
    }
    std::ofstream(folder_ / "others.spz.json") << R"({"generator": "another"})";
    exported("some.ply others.spz");
    EXPECT_TRUE(fs::exists(at("others.spz.json"))) << "somebody else's stays";
    std::ofstream(folder_ / "far.spz.json") << R"({"generator": "tvsgs 0.1.0", "origin": [1, 2]})";
    expect_refused("far.spz x.ply", 3, "expected three finite numbers");
}

TEST_F(ExportCommand, WritesOverItsOwnFilesOnly) {
    for (const std::string name : {"twice.ply", "twice.spz", "twice.glb", "twice.sog"}) {
        exported("some.ply " + name);
        exported("some.ply " + name);
        std::ofstream(folder_ / name) << "mine";
        expect_refused("some.ply " + name, 2, "already exists and is not ours");
        EXPECT_EQ(contents(folder_ / name), "mine");
    }
    exported("some.ply four.spz --spz-version 4");
    // Must find our name in front of the packed frame.
    exported("some.ply four.spz --spz-version 4");
    exported("some.ply r.spz --out-report r.json");
    EXPECT_EQ(contents(folder_ / "r.json"), contents(folder_ / "out.txt"));
}

TEST_F(ExportCommand, ItsReportTakesNoNameOfTheSplats) {
    exported("some.ply in.spz");
    const std::string before = contents(folder_ / "in.spz");
    fs::create_symlink("in.spz", folder_ / "link.json");
    for (const std::string report : {"in.spz", "./in.spz", "in.spz.json", "out.spz",
                                     "run/../out.spz", "out.spz.json", "link.json"})
        expect_refused("in.spz out.spz --out-report " + report, 2, "--out-report " + report);
    EXPECT_EQ(contents(folder_ / "in.spz"), before);
    EXPECT_FALSE(fs::exists(folder_ / "out.spz"));
    expect_refused("run x.spz --out-report " + splats_of_run(), 2, "needs this file");
}

TEST_F(ExportCommand, RefusesWithOneLine) {
    expect_refused("run x.spz --input-frame rub", 2, "run is a run folder");
    expect_refused("nothing x.spz", 3, "nothing: not found");
    expect_refused("some.ply", 2, "expected tvsgs-export INPUT OUTPUT");
    expect_refused("some.ply x.splat", 2, "; use .ply, .spz, .sog or .glb");
    expect_refused("some.ply x.Compressed.ply", 2, "compressed PLY is not written");
    expect_refused("some.ply some.ply", 2, "this is the input file");
    expect_refused("some.ply x.spz --spz-version 5", 2, "--spz-version");
    expect_refused("some.ply x.spz --spz-sh-bits 5", 2, "two numbers from 1 to 8");
    expect_refused("some.ply x.sog --spz-version 2", 2, "--spz-version: only for .spz");
    expect_refused("some.ply x.ply --spz-sh-bits 5,4", 2, "--spz-sh-bits: only for .spz");
    expect_refused("some.ply x.spz --sh-palette 10", 2, "--sh-palette: only for .sog");
    expect_refused("some.ply " + splats_of_run(), 2, "needs this file");
    expect_refused("some.ply x.spz --bbox 1,2,3", 2, "x0 < x1");
    expect_refused("some.ply x.spz --bbox 8,8,8,9,9,9", 3, "none of its 500 splats is left");
    expect_refused("some.ply x.spz --prune-unseen", 2, "give --scene DIR");
    expect_refused("some.ply x.spz --frame xyz", 2, "--frame");
    expect_refused("some.ply x.spz --max-splat 3", 2, "--max-splats");
    std::ofstream(folder_ / "bad.spz") << "no gzip";
    expect_refused("bad.spz x.ply", 3, "neither gzip nor");
    std::ofstream(folder_ / "bad.glb") << std::string(40, 'x');
    expect_refused("bad.glb x.ply", 3, "bad.glb");
    std::ofstream(folder_ / "bad.sog") << "no archive";
    expect_refused("bad.sog x.ply", 3, "(ZIP)");
    fs::rename(folder_ / "scene", folder_ / "elsewhere");
    expect_refused("run x.spz --device cpu", 3, "--no-check");
    EXPECT_EQ(call("export", "run x.spz --no-check --device cpu"), 0) << err();
    fs::rename(folder_ / "elsewhere", folder_ / "scene");
}

}  // namespace
}  // namespace tvsgs
