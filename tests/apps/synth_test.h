// Fixture of the tests of tvsgs-synth.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>

#include "support/command.h"

namespace tvsgs {

/// A folder for the scenes of a test suite.
class SynthTest : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = std::filesystem::path(testing::TempDir()) /
                  ("tvsgs_synth_" + std::to_string(::getpid()));
        std::filesystem::create_directories(folder_);
    }
    static void TearDownTestSuite() { std::filesystem::remove_all(folder_); }

    /// Runs tvsgs-synth and returns its exit code.
    static int synth(const std::string& arguments) {
        return run_tool(folder_, "synth", arguments).code;
    }
    static std::string other(const std::string& name) { return folder_ / name; }

    static inline std::filesystem::path folder_;
};

}  // namespace tvsgs
