// The matrices of the paper's tables name existing files and valid flags, and the configurations
// have the paper's settings.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <sstream>

#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "pipeline/run/run_options.h"
#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

class PaperTables : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_tables_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(
            run_tool(folder_, "synth", "--out scene --views 6 --width 32 --height 24 --quiet").code,
            0);
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static std::vector<std::string> lines_of(const std::string& text) {
        std::vector<std::string> lines;
        std::istringstream in(text);
        for (std::string line; std::getline(in, line);) lines.push_back(line);
        return lines;
    }
    /// The resolved configuration, by the program itself.
    static JsonValue resolved(const std::string& configs) {
        const Result result = run_tool(
            folder_, "train",
            "--scene scene --iterations 0 --device cpu --quiet --overwrite --out run " + configs);
        EXPECT_EQ(result.code, 0) << result;
        const std::string path = (folder_ / "run/config.json").string();
        return parse_json_value(read_bytes(path), path);
    }

    static inline fs::path folder_;
};

TEST_F(PaperTables, EveryMatrixPrintsCommandsThatOurProgramsTake) {
    int matrices = 0;
    for (const auto& entry : fs::directory_iterator(TVSGS_SOURCE_DIR "/matrices")) {
        SCOPED_TRACE(entry.path());
        ++matrices;
        const std::string matrix = "table --matrix '" + entry.path().string() + "'";
        EXPECT_EQ(run_tool(folder_, "eval", matrix + " --dry-run").code, 2) << "needs --data";
        const Result printed =
            run_tool(folder_, "eval", matrix + " --data /data --dry-run --quiet");
        ASSERT_EQ(printed.code, 0) << printed;
        const std::vector<std::string> lines = lines_of(printed.out);
        ASSERT_GE(lines.size(), 3u * 4 * 3);
        std::vector<std::string> seen;
        for (const std::string& line : lines) {
            std::istringstream in(line);
            std::string tool, word, flags, configs;
            in >> tool;
            while (in >> word) {
                if (word == "--config") {
                    in >> word;
                    EXPECT_TRUE(fs::is_regular_file(word)) << word;
                    configs += " --config '" + word + "'";
                } else if (word.starts_with("--set")) {
                    in >> word;
                    configs += " --set " + word;
                }
            }
            // Each set of keys once, by the program that would use them.
            const std::string key = tool + configs;
            if (std::find(seen.begin(), seen.end(), key) != seen.end()) continue;
            seen.push_back(key);
            if (tool == "tvsgs-train") resolved(configs);
        }
        // /data is empty: each command gets past its flags and then fails there.
        for (const char* tool : {"train", "extract-mesh"}) {
            const auto line = std::find_if(lines.begin(), lines.end(), [&](const std::string& l) {
                return l.starts_with("tvsgs-" + std::string(tool));
            });
            ASSERT_NE(line, lines.end());
            const Result result = run_tool(folder_, tool, line->substr(line->find(' ')));
            EXPECT_EQ(result.code, 3) << *line << result;
        }
        const auto measure = std::find_if(lines.begin(), lines.end(), [](const std::string& l) {
            return l.starts_with("tvsgs-eval");
        });
        EXPECT_EQ(run_tool(folder_, "eval", measure->substr(measure->find(' '))).code, 3);
    }
    EXPECT_EQ(matrices, 9);
}

TEST_F(PaperTables, TheConfigurationsAreThePapers) {
    const std::string configs = TVSGS_SOURCE_DIR "/configs/";
    for (const std::string on : {"p", "r"})  // the rasteriser's letter
        for (const bool dense : {false, true}) {
            // Without --iterations, which would scale the schedule.
            const std::string path = configs + "tv_sgs_" + on + (dense ? "_dense.json" : ".json");
            RunOptions options;
            OptionTable table;
            options.add_to(table);
            table.read_file(path);
            const auto text = [&table](const char* key) { return table.option(key).get(); };
            const auto number = [&text](const char* key) { return std::stof(text(key)); };
            EXPECT_EQ(number("iterations"), dense ? 30000 : 15000);
            EXPECT_EQ(number("loss.tv_normal.start"), dense ? 20000 : 1);
            EXPECT_EQ(number("loss.tv_position.start"), dense ? 25000 : 1);
            EXPECT_EQ(number("tv.refresh_every"), dense ? 500 : 100);
            EXPECT_EQ(number("tv.vote_every"), 10);
            if (on == "p") {
                EXPECT_EQ(number("loss.multi_view_ncc.start"), 7001);
                EXPECT_EQ(number("loss.multi_view_geometry.start"), 7001);
            } else {
                EXPECT_EQ(number("loss.normal_consistency.start"), dense ? 15000 : 7001);
                EXPECT_EQ(number("loss.normal_consistency.weight"), 0.05f);
                EXPECT_EQ(number("loss.normal_consistency.expected"), 0.4f);
                EXPECT_EQ(text("densify.rule"), "quantile");
            }
            EXPECT_EQ(number("loss.tv_normal.weight"), 0.5f);
            EXPECT_EQ(number("loss.tv_position.weight"), 1);
            EXPECT_EQ(text("tv.vote_map"), "covariant");
            EXPECT_EQ(text("tv.curvature"), "literal");
            EXPECT_EQ(number("tv.flatness_limit"), 0);
            EXPECT_EQ(number("tv.flatness_limit_position"), 0);
            const JsonValue run = resolved("--config '" + path + "'");
            EXPECT_EQ(run["tv"]["vote_map"].text, "covariant") << "the program takes the file";
        }
}

}  // namespace
}  // namespace tvsgs
