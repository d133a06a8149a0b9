// The order of the modules (docs/design.md), read off the #include lines of src/.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>

namespace {

namespace fs = std::filesystem;

const std::map<std::string, std::set<std::string>> kMayUse{
    {"core", {}},
    {"io", {"core"}},
    {"tv", {"core"}},
    {"render", {"core"}},
    {"mvs", {"core"}},
    {"optim", {"core", "tv", "render"}},
    {"mesh", {"core", "tv", "render"}},
    {"eval", {"core", "io", "render"}},
    {"pipeline", {"core", "io", "tv", "render", "mvs", "optim", "mesh", "eval"}},
    {"report", {"core", "io", "tv", "render", "mvs", "optim", "mesh", "eval", "pipeline"}},
};

TEST(Dependencies, ModulesIncludeOnlyWhatTheyMay) {
    const std::regex include("^\\s*#\\s*include\\s*\"([^\"]+)\"");
    int checked = 0;
    for (const auto& entry : fs::recursive_directory_iterator(TVSGS_SOURCE_DIR "/src")) {
        const std::string suffix = entry.path().extension();
        if (suffix != ".h" && suffix != ".cpp" && suffix != ".cu") continue;
        const std::string file = fs::relative(entry.path(), TVSGS_SOURCE_DIR "/src");
        const std::string module = file.substr(0, file.find('/'));
        ASSERT_TRUE(kMayUse.contains(module)) << file << ": unknown module '" << module << "'";

        std::ifstream in(entry.path());
        int number = 0;
        for (std::string line; std::getline(in, line);) {
            ++number;
            std::smatch match;
            if (!std::regex_search(line, match, include)) continue;
            const std::string target = match[1];
            const std::string used = target.substr(0, target.find('/'));
            EXPECT_TRUE(target.find('/') != std::string::npos && kMayUse.contains(used))
                << file << ':' << number << ": \"" << target << "\" is not a path below src/";
            EXPECT_TRUE(used == module || kMayUse.at(module).contains(used) ||
                        !kMayUse.contains(used))
                << file << ':' << number << ": " << module << " must not use " << used;
            EXPECT_TRUE(used == module || target.find("/internal/") == std::string::npos)
                << file << ':' << number << ": " << target << " is internal to " << used;
            ++checked;
        }
    }
    EXPECT_GT(checked, 20) << "the scan found hardly any includes; is the pattern still right?";
}

// Eigen, OpenCV and JSON do not pass nvcc, or slow it down: they stay out of CUDA sources.
TEST(Dependencies, CudaSourcesStayClean) {
    const std::regex heavy("^\\s*#\\s*include\\s*[<\"](Eigen|opencv2|nlohmann|spdlog)/");
    for (const auto& entry : fs::recursive_directory_iterator(TVSGS_SOURCE_DIR "/src")) {
        if (entry.path().extension() != ".cu") continue;
        std::ifstream in(entry.path());
        for (std::string line; std::getline(in, line);)
            EXPECT_FALSE(std::regex_search(line, heavy)) << entry.path() << ": " << line;
    }
}

}  // namespace
