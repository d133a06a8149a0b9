// The configurations in configs/, which the program embeds.
#include <gtest/gtest.h>

#include <filesystem>
#include <map>

#include "io/config/config.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {
namespace {

/// Returns the keys that `read` sets.
template <class Read>
std::map<std::string, std::string> keys_of(const Read& read) {
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    read(table);
    std::map<std::string, std::string> keys;
    for (const Option& option : table.options())
        if (!option.source.empty()) keys[option.key] = option.get();
    return keys;
}

TEST(Configs, EachFileCanBeExtendedByName) {
    std::vector<std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator(TVSGS_SOURCE_DIR "/configs")) {
        files.push_back(entry.path().stem());
        const auto of_file =
            keys_of([&](OptionTable& table) { table.read_file(entry.path().string()); });
        const auto by_name = keys_of([&](OptionTable& table) {
            table.read_text("mine.json", R"({"extends": ")" + files.back() + R"("})");
        });
        EXPECT_EQ(of_file, by_name) << entry.path();
        EXPECT_FALSE(of_file.empty()) << entry.path();
    }
    std::sort(files.begin(), files.end());
    EXPECT_EQ(built_in_configs(), files);
}

// PGSR's losses, the paper's votes, and own keys.
TEST(Configs, DerivedOnesHaveWhatTheyExtend) {
    const auto keys = keys_of([](OptionTable& table) {
        table.read_file(TVSGS_SOURCE_DIR "/configs/tv_sgs_p_dense.json");
    });
    for (const auto& [key, value] : {std::pair{"loss.multi_view_ncc.weight", "0.15"},
                                     {"loss.tv_reduction", "mean"},
                                     {"tv.enabled", "true"},
                                     {"tv.whiten", "true"},
                                     {"tv.start", "20000"},
                                     {"loss.tv_position.start", "25000"},
                                     {"iterations", "30000"}})
        EXPECT_EQ(keys.at(key), value) << key;
}

}  // namespace
}  // namespace tvsgs
