// tvsgs-view; tests/report/test_view.cpp checks the page's rendering.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "support/command.h"
#include "support/count_of.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

using test::count_of;

class ViewCommand : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_view_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(run_tool(folder_, "synth", "--out scene --views 6 --width 64 --height 48").code,
                  0);
        const Result trained =
            run_tool(folder_, "train",
                     "--scene scene --split train_3 --iterations 40 --device cpu --out run --gt "
                     "scene/gt/points.ply "
                     "--eval-every 20 --set backbone=surfel --set densify.enabled=false");
        ASSERT_EQ(trained.code, 0) << trained;
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static void expect_refused(const std::string& arguments, int code, const std::string& message) {
        const Result result = run_tool(folder_, "view", arguments);
        EXPECT_EQ(result.code, code) << arguments << ": " << result;
        EXPECT_TRUE(result.says(message)) << arguments << ": " << result;
    }

    static fs::path folder_;
};
fs::path ViewCommand::folder_;

TEST_F(ViewCommand, OpensThePageAndSaysWhereThatFails) {
    fs::create_directories(folder_ / "bin");
    const auto open = [](const std::string& opener) {
        const fs::path program = folder_ / "bin/xdg-open";
        fs::remove(program);
        if (!opener.empty()) {
            std::ofstream(program) << "#!/bin/sh\n" << opener << "\n";
            fs::permissions(program, fs::perms::owner_all);
        }
        return run_script(folder_, "PATH=$PWD/bin " TVSGS_BIN_DIR
                                   "/tvsgs-view run --out open.html --open >out.txt 2>err.txt");
    };
    const Result opened = open("echo $# \"$1\" >opened.txt");
    EXPECT_EQ(opened.code, 0) << opened;
    EXPECT_FALSE(opened.says("warning")) << opened;
    EXPECT_EQ(contents(folder_ / "opened.txt"), "1 " + (folder_ / "open.html").string() + "\n");
    const Result failed = open("exit 3"), missing = open("");
    EXPECT_EQ(failed.code, 0) << failed;
    EXPECT_TRUE(failed.says("found no browser (exit code 3); open open.html")) << failed;
    EXPECT_EQ(missing.code, 0) << missing;
    EXPECT_TRUE(missing.says("xdg-open: No such file or directory; open open.html")) << missing;
    expect_refused("run --open", 2, "--open needs --out");
}

TEST_F(ViewCommand, APageHasAllThatTheRunHas) {
    const Result result = run_tool(folder_, "view", "run --out page.html");
    ASSERT_EQ(result.code, 0) << result;
    const std::string page = contents(folder_ / "page.html");
    EXPECT_EQ(count_of(page, "<li><button type=\"button\" data-camera="), 4u) << "all cameras";
    EXPECT_EQ(count_of(page, "<img id=\"photo"), 4u);
    EXPECT_EQ(count_of(page, "(test)</span></button>"), 1u);
    EXPECT_NE(page.find("id=\"splats0\""), std::string::npos);
    EXPECT_NE(page.find("id=\"errors0\""), std::string::npos) << "the run knows its truth";
    EXPECT_NE(page.find("Distance of the centres"), std::string::npos) << "error against time";
    EXPECT_NE(page.find("\"discs\": 1"), std::string::npos);
    EXPECT_EQ(page.find("id=\"mesh0\""), std::string::npos);
    const Result again = run_tool(folder_, "view", "run --out page.html", 1);
    EXPECT_EQ(again.code, 0) << "a page of ours is replaced: " << again;
    EXPECT_EQ(page, contents(folder_ / "page.html")) << "the same bytes, also on one thread";
}

TEST_F(ViewCommand, DistancesAreInMetresIfTheSceneIs) {
    fs::copy(folder_ / "run", folder_ / "placed", fs::copy_options::recursive);
    for (const std::string unit : {"units", "metres"}) {
        const Result result = run_tool(folder_, "view", "placed --out placed.html");
        ASSERT_EQ(result.code, 0) << result;
        EXPECT_NE(contents(folder_ / "placed.html").find("\"unit\": \"" + unit + "\""),
                  std::string::npos)
            << unit;
        std::ofstream(folder_ / "placed/georeference.json") << "{}";
    }
}

TEST_F(ViewCommand, TwoRunsAreInOnePage) {
    fs::copy(folder_ / "run", folder_ / "other", fs::copy_options::recursive);
    const Result result = run_tool(folder_, "view", "run other --out two.html --max-splats 100");
    ASSERT_EQ(result.code, 0) << result;
    EXPECT_TRUE(result.says("the 100 largest of")) << result;
    EXPECT_FALSE(result.says("share no camera")) << result;
    std::string cameras = contents(folder_ / "other/cameras.json");
    for (std::size_t at = 0; (at = cameras.find(".png", at)) != std::string::npos;)
        cameras.replace(at, 4, ".jpg");
    std::ofstream(folder_ / "other/cameras.json") << cameras;
    const Result apart = run_tool(folder_, "view", "run other --out two.html");
    EXPECT_EQ(apart.code, 0) << apart;
    EXPECT_TRUE(apart.says("run and other share no camera")) << apart;
    const std::string page = contents(folder_ / "two.html");
    EXPECT_NE(page.find("id=\"splats1\""), std::string::npos);
    EXPECT_NE(page.find("<h1>run beside other</h1>"), std::string::npos);
}

TEST_F(ViewCommand, WhatARunHasBeenMeasuredAgainstIsFound) {
    fs::copy(folder_ / "run", folder_ / "later", fs::copy_options::recursive);
    std::string config = contents(folder_ / "later/config.json");
    const std::string gt = "\"gt\": \"scene/gt/points.ply\"";
    ASSERT_NE(config.find(gt), std::string::npos);
    std::ofstream(folder_ / "later/config.json")
        << config.replace(config.find(gt), gt.size(), "\"gt\": \"\"");
    const auto page_of_later = [&] {
        const Result result = run_tool(folder_, "view", "later --out later.html");
        EXPECT_EQ(result.code, 0) << result;
        return contents(folder_ / "later.html");
    };
    EXPECT_EQ(page_of_later().find("id=\"errors0\""), std::string::npos);
    const Result measured = run_tool(
        folder_, "eval",
        "geometry --pred later/point_cloud/iteration_40/point_cloud.ply --gt scene/gt/points.ply "
        "--tau 0.25,0.5 "
        "--out later/eval/geometry_centres.json");
    ASSERT_EQ(measured.code, 0) << measured;
    const std::string page = page_of_later();
    EXPECT_NE(page.find("id=\"errors0\""), std::string::npos);
    EXPECT_NE(page.find("1 and more"), std::string::npos)
        << "twice the threshold of the evaluation";
}

TEST_F(ViewCommand, ARunThatHasLostItsSceneDoesWithoutPhotographs) {
    fs::rename(folder_ / "scene", folder_ / "moved");
    const Result lost = run_tool(folder_, "view", "run --out lost.html"),
                 found = run_tool(folder_, "view", "run --out found.html --scene moved");
    fs::rename(folder_ / "moved", folder_ / "scene");
    EXPECT_EQ(lost.code, 0) << lost;
    EXPECT_TRUE(lost.says("photographs")) << lost;
    EXPECT_EQ(count_of(contents(folder_ / "lost.html"), "<img id=\"photo"), 0u);
    EXPECT_EQ(found.code, 0) << found;
    EXPECT_EQ(count_of(contents(folder_ / "found.html"), "<img id=\"photo"), 4u);
}

TEST_F(ViewCommand, AFileOfSplatsHasAPage) {
    const std::string splats = "run/point_cloud/iteration_40/point_cloud.ply";
    ASSERT_EQ(run_tool(folder_, "export", splats + " bare.SPZ").code, 0);
    for (const std::string& file : {splats, std::string("bare.SPZ")}) {
        const Result result = run_tool(folder_, "view", file + " --out bare.html");
        ASSERT_EQ(result.code, 0) << result;
        const std::string page = contents(folder_ / "bare.html");
        EXPECT_NE(page.find("id=\"splats0\""), std::string::npos);
        EXPECT_EQ(count_of(page, "data-camera=\"0\""), 1u);
        EXPECT_NE(page.find(file == splats ? "\"discs\": 1" : "\"discs\": 0"), std::string::npos);
    }
    expect_refused(splats, 2, "give --out FILE.html");
    expect_refused(splats + " run --out page.html", 2, "two folders");
}

TEST_F(ViewCommand, SwappedTruthIsSaid) {
    const std::string splats = "run/point_cloud/iteration_40/point_cloud.ply",
                      truth = "scene/gt/points.ply";
    const auto eval = [&](const std::string& pred, const std::string& gt) {
        return run_tool(folder_, "eval", "geometry --tau 1 --pred " + pred + " --gt " + gt);
    };
    EXPECT_TRUE(eval(truth, splats).says("were --pred and --gt swapped?"));
    EXPECT_FALSE(eval(splats, truth).says("swapped"));
}

TEST_F(ViewCommand, WhatIsWrongIsSaid) {
    expect_refused("scene --out page.html", 3, "no run here yet");
    expect_refused("run run run --out page.html", 2, "expected one or two");
    expect_refused("run --out page.txt", 2, ".html");
    expect_refused("run page.html", 2, "give --out page.html");
    expect_refused("run --out page.html --gt nothing.ply", 3, "nothing.ply");
    expect_refused("run --out page.html --crop box.json", 2, "--gt");
    std::ofstream(folder_ / "mine.html") << "mine";
    expect_refused("run --out mine.html", 2, "mine.html");
    EXPECT_EQ(contents(folder_ / "mine.html"), "mine");
    fs::copy(folder_ / "run", folder_ / "broken", fs::copy_options::recursive);
    std::ofstream(folder_ / "broken/cameras.json")
        << "[{\"img_name\": \"a\", \"position\": [0, 0]}]";
    expect_refused("broken --out page2.html", 3, "cameras.json: a camera lacks numbers");
    std::ofstream(folder_ / "broken/cameras.json")
        << "[{\"img_name\": \"a\", \"position\": [0, 0, 0], \"width\": 1e300}]";
    expect_refused("broken --out page2.html", 3, "expected 1 to 65535");
    std::ofstream(folder_ / "broken/cameras.json") << "[]";
    expect_refused("broken --out page2.html", 3, "no cameras");
}

}  // namespace
}  // namespace tvsgs
