// Tests the order of the modules (docs/develop/design.md#modules) from the #include lines of src/,
// that no two headers define the same type, the size of folders, and the length of the tour.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "core/error.h"
#include "support/source_text.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

const std::map<std::string, std::set<std::string>> kMayUse{
    {"core", {}},
    {"io", {"core"}},
    {"tv", {"core"}},
    {"votes", {"core", "tv"}},
    {"render", {"core"}},
    {"mvs", {"core"}},
    {"optim", {"core", "tv", "render"}},
    {"mesh", {"core", "tv", "render"}},
    {"plan", {"core", "io", "tv", "render", "optim", "mesh"}},
    {"eval", {"core", "io", "render", "mesh"}},
    {"pipeline", {"core", "io", "tv", "render", "mvs", "optim", "mesh", "plan", "eval"}},
    {"report", {"core", "io", "tv", "render", "mvs", "optim", "mesh", "plan", "eval", "pipeline"}},
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

// nvcc cannot compile Eigen, OpenCV and JSON, or compiles them slowly, so CUDA sources must not
// include them.
TEST(Dependencies, CudaSourcesStayClean) {
    const std::regex heavy("^\\s*#\\s*include\\s*[<\"](Eigen|opencv2|nlohmann|spdlog)/");
    for (const auto& entry : fs::recursive_directory_iterator(TVSGS_SOURCE_DIR "/src")) {
        if (entry.path().extension() != ".cu") continue;
        std::ifstream in(entry.path());
        for (std::string line; std::getline(in, line);)
            EXPECT_FALSE(std::regex_search(line, heavy)) << entry.path() << ": " << line;
    }
}

/// Types that a header defines outside of functions and other types, as "namespace::name". In our
/// style they begin a line. Ignores specialisations, forward declarations, anonymous namespaces and
/// namespaces `detail`.
std::vector<std::string> types_in(const fs::path& header) {
    static const std::regex kOpens(R"(^namespace ([\w:]+)? ?\{)");
    static const std::regex kCloses(R"(^\}\s*// namespace)");
    static const std::regex kDefines(
        R"(^(?:struct|class|enum class|enum|union) (?:alignas\([^)]*\) )?(\w+)(?: final)?(?: ?:[^:;].*|\s*\{.*|\s*)$)");
    std::vector<std::string> types, namespaces;
    std::ifstream in(header);
    std::smatch match;
    for (std::string line; std::getline(in, line);) {
        if (std::regex_search(line, match, kOpens)) {
            namespaces.push_back(match.str(1));
        } else if (std::regex_search(line, kCloses) && !namespaces.empty()) {
            namespaces.pop_back();
        } else if (std::regex_match(line, match, kDefines) && line.back() != ';') {
            std::string name;
            bool own = false;
            for (const std::string& space : namespaces) {
                own |= space.empty() || space.ends_with("detail");
                name += space + "::";
            }
            if (!own) types.push_back(name + match.str(1));
        }
    }
    return types;
}

// Two different definitions of one name break a program silently when both are linked.
TEST(Dependencies, NoTypeIsDefinedTwice) {
    std::map<std::string, std::string> home;
    for (const auto& entry : fs::recursive_directory_iterator(TVSGS_SOURCE_DIR "/src")) {
        if (entry.path().extension() != ".h") continue;
        const std::string file = fs::relative(entry.path(), TVSGS_SOURCE_DIR "/src");
        for (const std::string& type : types_in(entry.path())) {
            const auto [known, is_new] = home.emplace(type, file);
            EXPECT_TRUE(is_new) << type << " is defined in " << known->second << " and in " << file;
        }
    }
    EXPECT_GT(home.size(), 200u) << "the scan found hardly any types; is the pattern still right?";
}

constexpr int kMostFilesInFolder = 40, kMostLinesInTour = 3600;

/// "FOLDER: N files" for `root` and each folder below it that holds more than `most` files itself.
std::vector<std::string> crowded_folders(const fs::path& root, int most) {
    std::map<std::string, int> files;
    for (const auto& entry : fs::recursive_directory_iterator(root))
        if (entry.is_regular_file()) ++files[entry.path().parent_path()];
    std::vector<std::string> crowded;
    for (const auto& [folder, count] : files)
        if (count > most) crowded.push_back(str(folder, ": ", count, " files"));
    return crowded;
}

TEST(Dependencies, FoldersOfSourcesAreSmall) {
    EXPECT_EQ(crowded_folders(kSource / "src", kMostFilesInFolder), std::vector<std::string>{});
}

TEST(Dependencies, ACrowdedFolderIsFound) {
    const fs::path root = fs::path(testing::TempDir()) / "crowded_folders";
    fs::remove_all(root);
    fs::create_directories(root / "many/below");
    for (const char* file : {"a.h", "many/a.h", "many/b.h", "many/c.h", "many/below/a.h"})
        std::ofstream(root / file) << '\n';
    const std::string found = str((root / "many").string(), ": 3 files");
    EXPECT_EQ(crowded_folders(root, 2), std::vector<std::string>{found});
    EXPECT_TRUE(crowded_folders(root, 3).empty());
    fs::remove_all(root);
}

/// Source files that a page names, as `src/a.h`, each once, in the order of names.
std::set<std::string> files_named_in(const std::string& page) {
    static const std::regex kFile(R"(`((?:src|apps)/[\w/.-]+\.(?:h|cpp|cu))`)");
    std::set<std::string> files;
    for (const auto& m : matches(page, kFile)) files.insert(m.str(1));
    return files;
}

std::size_t lines_of(const std::string& text) {
    return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

TEST(Dependencies, TheTourFitsIntoAnAfternoon) {
    const std::set<std::string> files = files_named_in(contents(kSource / "docs/develop/tour.md"));
    EXPECT_GE(files.size(), 12u);
    std::size_t lines = 0;
    std::string list;
    for (const std::string& file : files) {
        ASSERT_TRUE(fs::exists(kSource / file)) << file;
        const std::size_t of_file = lines_of(contents(kSource / file));
        lines += of_file;
        list += str(of_file, "  ", file, '\n');
    }
    EXPECT_LE(lines, kMostLinesInTour) << list;
}

TEST(Dependencies, TheTourCountsEachFileOnce) {
    EXPECT_EQ(files_named_in("`src/a/b.h`, again `src/a/b.h`; `apps/c.cpp`, `d.h`, src/e.h"),
              (std::set<std::string>{"src/a/b.h", "apps/c.cpp"}));
    EXPECT_EQ(lines_of("one\ntwo\n"), 2u);
}

}  // namespace
}  // namespace tvsgs
