// The commands tvsgs-eval run, nvs and table --matrix on a small scene: flags without effect,
// invalid matrices, messages.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>

#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

class EvalRun : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_eval_run_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(call("synth", "--out scene --views 6 --width 32 --height 24 --quiet").code, 0);
        const Result trained =
            call("train", std::string("--out 'run é 3' ") + kTrain + " --scene scene");
        ASSERT_EQ(trained.code, 0) << trained;
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static Result call(const std::string& tool, const std::string& arguments) {
        return run_tool(folder_, tool, arguments, 1);
    }
    static void expect_refused(int code, const std::string& why, const std::string& arguments) {
        const Result result = call("eval", arguments);
        EXPECT_EQ(result.code, code) << arguments << ": " << result;
        EXPECT_TRUE(result.says(why)) << why << " of " << arguments << ": " << result;
        EXPECT_EQ(result.out, "") << "nothing is measured: " << arguments;
    }

    static constexpr const char* kTrain =
        "--eval --iterations 2 --device cpu --quiet --set tv.enabled=false";
    static constexpr const char* kRun = "run --device cpu --model 'run é 3' ";
    static inline fs::path folder_;
};

TEST_F(EvalRun, WhatItSaysToTypeIsQuoted) {
    const Result result = call("eval", kRun);
    ASSERT_EQ(result.code, 0) << result;
    EXPECT_TRUE(result.says("\n    tvsgs-extract-mesh 'run é 3'\n")) << result;
    EXPECT_TRUE(call("eval", "table --runs 'not there'").says("report --run 'not there'"));
}

TEST_F(EvalRun, FlagsOfWhatIsNotMeasuredAreRefused) {
    for (const auto& [flags, owner] : std::initializer_list<std::pair<const char*, const char*>>{
             {"--tau 1", "--gt FILE"},
             {"--crop scene/gt/info.json", "--gt FILE"},
             {"--visible-gt scene/gt/mesh.ply", "--gt FILE"},
             {"--max-distance 3", "--gt FILE"},
             {"--traj scene/sparse/0", "--scene-dir DIR"},
             {"--tnt-tau 1", "--scene-dir DIR"},
             {"--cull all", "--dtu DIR"},
             {"--dtu scene --scan 1 --cull all", "--cull-masks DIR"},
             {"--dtu scene --scan 1 --cull-dilate 3", "--cull-masks DIR"}})
        expect_refused(2, std::string("needs ") + owner, std::string(kRun) + flags);
    const Result measured =
        call("eval", std::string(kRun) + "--tau 1 --max-distance 3 --gt scene/gt/mesh.ply");
    ASSERT_EQ(measured.code, 0) << measured;
    EXPECT_NE(measured.out.find("\"tau\": 1"), std::string::npos) << measured.out;

    const std::string nvs = "nvs --device cpu --model 'run é 3' ";
    expect_refused(2, "--masks scene/masks: needs --masked", nvs + "--masks scene/masks");
    expect_refused(2, "--lpips-range -11: needs --lpips-weights", nvs + "--lpips-range=-11");
}

TEST_F(EvalRun, MatricesThatWouldBeAnotherTable) {
    const auto refused = [&](const std::string& matrix, const std::string& why) {
        std::ofstream(folder_ / "wrong.json") << matrix;
        expect_refused(3, "wrong.json: " + why, "table --dry-run --matrix wrong.json");
    };
    const auto with = [](const std::string& scenes, const std::string& configurations,
                         const std::string& more = "") {
        return "{\"out\": \"runs\", \"scenes\": {" + scenes + "}, \"configurations\": {" +
               configurations + "}" + more + "}";
    };
    const std::string a = R"("a": {})", b = R"("b": [])";
    refused(with(a, b, R"(, "seeds": [0, 1, 0])"), "\"seeds\" holds 0 twice");
    for (const char* name : {"../a", "/a", "a/b", "..", ".", ""}) {
        refused(with("\"" + std::string(name) + "\": {}", b), std::string("scene '") + name + "'");
        refused(with(a, "\"" + std::string(name) + "\": []"),
                std::string("configuration '") + name + "'");
    }
    refused(with(R"("${n}": {"for_each": {"n": ["x", "../x"]}})", b), "scene '../x'");
    refused(with(R"("a${n}": {"for_each": {"n": ["1", "2", "1"]}})", b),
            "\"for_each\" of a${n} holds '1' twice");
    refused(with(R"("a${n}": {"for_each": {"n": []}})", b), "\"for_each\" of a${n} is empty");
    refused(with(R"("a": {"for_each": {"n": ["1", "2"]}})", b), "two scenes are named 'a'");
    refused(with(R"("a1": {}, "a${n}": {"for_each": {"n": ["1"]}})", b),
            "two scenes are named 'a1'");
    refused(with(a, R"("k=16": [])"), "configuration 'k=16'");
    std::ofstream(folder_ / "right.json")
        << with(R"("a${n}": {"for_each": {"n": ["1", "2"]}})", b, R"(, "seeds": [0, 1])");
    const Result right = call("eval", "table --dry-run --matrix right.json");
    EXPECT_EQ(right.code, 0) << right;
    EXPECT_EQ(std::count(right.out.begin(), right.out.end(), '\n'), 2 * 2 * 3);
}

TEST_F(EvalRun, AQuietMatrixIsQuietThroughout) {
    std::ofstream(folder_ / "matrix.json")
        << R"({"out": "runs", "scenes": {"s": {"train": ["--scene", "scene", "--eval",
            "--iterations", "2", "--device", "cpu", "--set", "tv.enabled=false"], "mesh":
            ["--device", "cpu", "--quiet", "--set", "mesh.resolution=32"], "eval":
            ["--device", "cpu"]}}, "configurations": {"c": []}})";
    const Result quiet = call("eval", "table --matrix matrix.json --quiet --out quiet.md");
    ASSERT_EQ(quiet.code, 0) << quiet;
    EXPECT_NE(contents(folder_ / "quiet.md").find("| c |"), std::string::npos);
    for (const char* text : {"start points. ", "Mesh: ", "Renders, ", "Wrote ", "Next,", "To make"})
        EXPECT_FALSE(quiet.says(text)) << text << ": " << quiet;
    const Result loud = call("eval", "table --matrix matrix.json --out loud.md");
    ASSERT_EQ(loud.code, 0) << loud;
    EXPECT_TRUE(loud.says("tvsgs-eval run --model")) << "finished as it was: " << loud;
    EXPECT_FALSE(loud.says("tvsgs-train")) << "finished as it was: " << loud;
}

}  // namespace
}  // namespace tvsgs
