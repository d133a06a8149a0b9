// docs/develop/reliability.md names tests: each must be there, in the folder of its program.
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <regex>
#include <set>
#include <sstream>

#include "support/source_text.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// "Suite.Test" of every test in a folder.
std::set<std::string> tests_in(const fs::path& folder) {
    static const std::regex kTest(R"((?:TEST|TEST_F|TEST_P)\(\s*(\w+),\s*(\w+)\))");
    std::set<std::string> names;
    for (const auto& file : fs::directory_iterator(folder)) {
        const std::string extension = file.path().extension();
        if (extension != ".cpp" && extension != ".cu" && extension != ".h") continue;
        const std::string text = contents(file.path());
        for (const auto& m : matches(text, kTest)) names.insert(m.str(1) + "." + m.str(2));
    }
    return names;
}

/// The folder below tests/ whose CMakeLists.txt makes the program.
std::map<std::string, fs::path> programs() {
    static const std::regex kProgram(R"(\btest_\w+)");
    std::map<std::string, fs::path> folders;
    for (const auto& entry : fs::directory_iterator(kSource / "tests")) {
        const std::string text = contents(entry.path() / "CMakeLists.txt");
        for (const auto& m : matches(text, kProgram)) folders.emplace(m.str(), entry.path());
    }
    return folders;
}

TEST(ReliabilityTable, EveryTestThatItNamesExists) {
    static const std::regex kNamed(R"(`(?:(test_\w+): )?(\w+)\.(\w+|\*)`)");
    const auto folders = programs();
    std::map<fs::path, std::set<std::string>> known;
    std::istringstream lines(contents(kSource / "docs/develop/reliability.md"));
    int rows = 0, named = 0;
    bool cases = false;  // in their section: other tables name no tests
    for (std::string line; std::getline(lines, line);) {
        if (line.starts_with("## ")) cases = line == "## Cases";
        if (!cases || !line.starts_with("| ") || line.starts_with("| case |") ||
            line.starts_with("| ---") || line.starts_with("| **"))
            continue;
        ++rows;
        // The last column; programs hold until another one is named.
        const std::string cell = line.substr(line.rfind('|', line.size() - 2));
        std::string program;
        const auto tests = matches(cell, kNamed);
        EXPECT_FALSE(tests.empty()) << "names no test: " << line;
        for (const auto& m : tests) {
            if (m[1].matched) program = m.str(1);
            ASSERT_TRUE(folders.contains(program)) << "no program '" << program << "': " << line;
            const fs::path folder = folders.at(program);
            if (!known.contains(folder)) known[folder] = tests_in(folder);
            const std::string suite = m.str(2) + ".", test = suite + m.str(3);
            const auto& all = known[folder];
            const bool found = m.str(3) == "*" ? all.lower_bound(suite) != all.end() &&
                                                     all.lower_bound(suite)->starts_with(suite)
                                               : all.contains(test);
            EXPECT_TRUE(found) << program << " has no " << test << ": " << line;
            ++named;
        }
    }
    EXPECT_GE(rows, 40);
    EXPECT_GE(named, 40);
}

}  // namespace
}  // namespace tvsgs
