// Fixture of the tests of tvsgs-eval: a folder, small PLY files, and running the command.
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "support/test_data.h"

namespace tvsgs {

namespace fs = std::filesystem;

inline const fs::path kShared = TVSGS_SHARED_DIR;
inline const fs::path kOracle = test_data("geometry");

class EvalTest : public testing::Test {
protected:
    fs::path folder;
    std::string output, messages;

    void SetUp() override {
        const auto* info = testing::UnitTest::GetInstance()->current_test_info();
        folder = fs::temp_directory_path() / (std::string("tvsgs_") + info->test_suite_name() +
                                              info->name() + std::to_string(::getpid()));
        fs::remove_all(folder);
        fs::create_directories(folder);
    }
    void TearDown() override { fs::remove_all(folder); }

    std::string path(const std::string& name) const { return (folder / name).string(); }
    std::string write(const std::string& name, const std::string& text) const {
        fs::create_directories((folder / name).parent_path());
        std::ofstream(folder / name, std::ios::binary) << text;
        return path(name);
    }
    /// Writes vertices and faces as lines of an ASCII file.
    std::string write_ply(const std::string& name,
                          const std::string& vertices,
                          const std::string& faces = "") const {
        const auto lines = [](const std::string& text) {
            return std::to_string(std::count(text.begin(), text.end(), '\n'));
        };
        return write(name, "ply\nformat ascii 1.0\nelement vertex " + lines(vertices) +
                               "\nproperty double x\nproperty double y\nproperty double z\n"
                               "element face " +
                               lines(faces) +
                               "\nproperty list uchar int vertex_indices\nend_header\n" + vertices +
                               faces);
    }
    std::string read(const std::string& name) const {
        std::ifstream file(folder / name, std::ios::binary);
        return {std::istreambuf_iterator<char>(file), {}};
    }
    void copy(const fs::path& from, const std::string& to) const {
        fs::create_directories((folder / to).parent_path());
        fs::copy_file(from, folder / to, fs::copy_options::overwrite_existing);
        fs::permissions(folder / to, fs::perms::owner_all);
    }

    /// Returns the exit code; standard output goes to `output`, messages to `messages`.
    int eval(const std::string& arguments) {
        const std::string command = std::string(TVSGS_BIN_DIR) + "/tvsgs-eval " + arguments + " >" +
                                    path("out") + " 2>" + path("err");
        const int status = std::system(command.c_str());
        output = read("out"), messages = read("err");
        return WEXITSTATUS(status);
    }
    /// The first number under `key` in the output; NaN when there is none.
    double value(const std::string& key) const {
        const std::size_t at = output.find("\"" + key + "\": ");
        if (at == std::string::npos) return std::nan("");
        const std::string text = output.substr(at + key.size() + 4, 30);
        return text.starts_with("null") ? std::nan("") : std::strtod(text.c_str(), nullptr);
    }
    void expect_error(int code, const std::string& text, const std::string& arguments) {
        EXPECT_EQ(eval(arguments), code) << messages;
        EXPECT_NE(messages.find(text), std::string::npos) << messages;
    }
};

}  // namespace tvsgs
