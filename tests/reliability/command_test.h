// Commands as a user runs them, in a folder of the test that holds a small made-up scene.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "support/command.h"

namespace tvsgs {

namespace fs = std::filesystem;
using nlohmann::json;

/// `scene`: 8 views of 48x36 pixels around a bust, as tvsgs-synth makes them.
class CommandTest : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_reliability_" + std::to_string(getpid()));
        fs::create_directories(folder_);
        const Result synth = call("synth", "--out scene --views 8 --width 48 --height 36");
        ASSERT_EQ(synth.code, 0) << synth;
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static Result shell(const std::string& script) { return run_script(folder_, script); }
    static Result call(const std::string& tool, const std::string& arguments) {
        return run_tool(folder_, tool, arguments, 1);
    }
    /// A short run on the CPU that starts from the points of the model.
    static Result train(const std::string& arguments) {
        return call("train", "--device cpu --iterations 6 --set init.min_points=0 " + arguments);
    }

    static std::string read(const std::string& name) { return contents(folder_ / name); }
    static void write(const std::string& name, const std::string& bytes) {
        fs::create_directories((folder_ / name).parent_path());
        std::ofstream(folder_ / name, std::ios::binary) << bytes;
    }
    static std::string splats(const std::string& run, int iterations = 6) {
        return read(run + "/point_cloud/iteration_" + std::to_string(iterations) +
                    "/point_cloud.ply");
    }
    static json last_line(const std::string& run) {
        std::istringstream log(read(run + "/log.jsonl"));
        std::string line, last;
        while (std::getline(log, line)) last = line;
        return json::parse(last);
    }
    /// A copy of the scene for the test to spoil.
    static void copy_scene(const std::string& name) {
        fs::copy(folder_ / "scene", folder_ / name, fs::copy_options::recursive);
    }
    /// Refused with that exit code and a message that says `expected`; no run folder is left.
    static void expect_refused(const std::string& arguments,
                               int code,
                               const std::string& expected) {
        const Result r = train(arguments + " --out refused");
        EXPECT_EQ(r.code, code) << arguments << ": " << r;
        EXPECT_TRUE(r.says(expected)) << "'" << expected << "' is not in: " << r;
        EXPECT_FALSE(fs::exists(folder_ / "refused")) << arguments;
        fs::remove_all(folder_ / "refused");
    }
    /// Trains to the end with finite scores; what it said.
    static Result expect_trained(const std::string& arguments,
                                 const std::string& run,
                                 int iterations = 6) {
        Result r = train(arguments + " --out " + run);
        EXPECT_EQ(r.code, 0) << arguments << ": " << r;
        EXPECT_FALSE(splats(run, iterations).empty()) << arguments;
        return r;
    }

    static inline fs::path folder_;
};

}  // namespace tvsgs
