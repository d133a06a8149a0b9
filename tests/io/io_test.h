// Helpers of the tests of readers and writers: a temporary folder, and checks of thrown errors.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "core/error.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "support/test_data.h"

namespace tvsgs {

inline const std::filesystem::path kShared = TVSGS_SHARED_DIR;
inline const std::filesystem::path kExample = test_data("geometry/formats");

/// A folder for each test, removed at the end.
class IoTest : public testing::Test {
protected:
    std::filesystem::path folder;

    void SetUp() override {
        const auto* info = testing::UnitTest::GetInstance()->current_test_info();
        folder = std::filesystem::temp_directory_path() /
                 str("tvsgs_", info->test_suite_name(), "_", info->name(), "_", getpid());
        std::filesystem::remove_all(folder);
        std::filesystem::create_directories(folder);
    }
    void TearDown() override {
        std::error_code no_matter;
        std::filesystem::permissions(folder, std::filesystem::perms::owner_all, no_matter);
        std::filesystem::remove_all(folder, no_matter);
    }
    std::string write(const std::string& name, const std::string& bytes) const {
        std::filesystem::create_directories((folder / name).parent_path());
        std::ofstream(folder / name, std::ios::binary) << bytes;
        return (folder / name).string();
    }
};

/// write_png() does not replace images of other programs.
inline void replace_png(const std::string& path, const ImageU8& image) {
    std::filesystem::remove(path);
    write_png(path, image);
}

/// Runs `action`, which must throw an Error with this code and a message that contains `text`.
template <class Action>
void expect_error(ExitCode code, const std::string& text, const Action& action) {
    try {
        action();
        ADD_FAILURE() << "no error; expected one with '" << text << "'";
    } catch (const Error& error) {
        EXPECT_EQ(static_cast<int>(error.code()), static_cast<int>(code)) << error.what();
        EXPECT_NE(std::string(error.what()).find(text), std::string::npos)
            << "expected '" << text << "' in: " << error.what();
    }
}

}  // namespace tvsgs
