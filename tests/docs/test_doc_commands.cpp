// What the pages tell a reader to type: every command of the guide and of the README runs, on a
// tiny made scene, and every flag and key on the other pages is one that the program has.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <map>
#include <set>
#include <sstream>

#include "support/console_quote.h"
#include "support/source_text.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct DocCommand {
    std::string line;  // without the remark behind it
    bool synopsis;     // of what may be given, with brackets: not to be run
};

/// Up to " #", or two spaces: what stands behind is a remark.
std::string without_remark(const std::string& line) {
    const std::size_t mark = std::min(line.find(" #"), line.find("  "));
    return line.substr(0, std::min(mark, line.size()));
}

bool is_synopsis(const std::string& line) {
    return line.find_first_of("[{") != std::string::npos || line.find("...") != std::string::npos ||
           line.find('|') != std::string::npos;
}

/// Of a page's indented code. A line goes on after a backslash, and a synopsis on lines that are
/// indented deeper.
std::vector<DocCommand> commands_of(const std::string& page) {
    static const std::regex kOurs(R"(^ {4,8}(\w+=\S+ )*tvsgs[\w-]* .*)");
    std::vector<DocCommand> commands;
    std::istringstream in(page);
    bool open = false, deeper = false;
    for (std::string line; std::getline(in, line);) {
        const std::size_t begin = line.find_first_not_of(' ');
        const bool goes_on = open || (deeper && begin != std::string::npos && begin > 8);
        if (!goes_on && !std::regex_match(line, kOurs)) {
            deeper = false;
            continue;
        }
        const std::string text = begin == std::string::npos ? "" : line.substr(begin);
        if (!goes_on) commands.push_back({});
        std::string& all = commands.back().line;
        all += (all.empty() ? "" : " ") + without_remark(text);
        open = all.ends_with('\\');
        if (open) all.pop_back();
        deeper = !open;
        commands.back().synopsis = is_synopsis(all);
    }
    return commands;
}

/// And what its prose says in `tvsgs-...`.
std::vector<std::string> spans_of(const std::string& page) {
    static const std::regex kSpan(R"(`(tvsgs[\w-]* [^`]+)`)");
    std::vector<std::string> spans;
    for (const auto& m : matches(page, kSpan)) {
        std::string text = m.str(1);
        std::replace(text.begin(), text.end(), '\n', ' ');
        spans.push_back(text);
    }
    return spans;
}

/// In a folder that goes with the suite.
class DocCommands : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_docs_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    /// One thread, few iterations, no stereo: what is asked is whether the command does what is
    /// typed, not how well.
    static Result run(const fs::path& folder, const std::string& line) {
        return run_script(folder, "export PATH=" TVSGS_BIN_DIR
                                  ":$PATH OMP_NUM_THREADS=1 "
                                  "TVSGS_ITERATIONS=6 TVSGS_INIT__MIN_POINTS=0 && { " +
                                      line + "; } >out.txt 2>err.txt </dev/null");
    }
    static const std::string& output_of(const std::string& line) {
        static std::map<std::string, std::string> known;
        const auto [at, is_new] = known.try_emplace(line);
        if (is_new) at->second = run(folder_, line).out;
        return at->second;
    }
    static bool is_built(const std::string& tool) { return fs::exists(TVSGS_BIN_DIR "/" + tool); }

    /// The flags and keys of a line that its commands do not have.
    static std::vector<std::string> unknown_in(const std::string& line) {
        static const std::regex kCommand(
            R"(\btvsgs[- ]([a-z-]+)( [a-z]+\b)?([^;&>]*?)(?=tvsgs[- ]|[;&>]|$))");
        static const std::regex kFlag(R"((?:^|[ \[{(|])(--?[A-Za-z][\w-]*))");
        static const std::regex kKey(R"(--set[ =]'?([a-z][a-z0-9_.]*)=)");
        std::vector<std::string> unknown;
        for (const auto& m : matches(line, kCommand)) {
            std::string tool = "tvsgs-" + m.str(1);
            if (tool == "tvsgs-help" || !(is_built(tool) || m.str().starts_with("tvsgs-")))
                continue;
            if (!is_built(tool)) {
                unknown.push_back(tool);
                continue;
            }
            std::string help = output_of(tool + " --help-all");
            if (help.find("SUBCOMMAND") != std::string::npos && m[2].length() > 0)
                help = output_of(tool + m.str(2) + " --help-all");
            const std::string rest = m.str(2) + m.str(3);
            for (const auto& flag : matches(rest, kFlag)) {
                std::string name = flag.str(1);
                std::replace(name.begin() + 2, name.end(), '_', '-');
                const std::regex has("(^|[ ,])" + name + R"(($|[ ,={:\[]))", std::regex::multiline);
                if (!std::regex_search(help, has)) unknown.push_back(tool + " " + name);
            }
            for (const auto& key : matches(rest, kKey))
                if (output_of("tvsgs-train --list-keys").find("  " + key.str(1) + " ") ==
                    std::string::npos)
                    unknown.push_back("--set " + key.str(1));
        }
        return unknown;
    }

    static inline fs::path folder_;
};

/// Lines of the guide that are not run, and why. Their flags are looked up all the same.
const std::vector<std::pair<std::string, std::string>> kNotRun = {
    {"tvsgs-prepare ", "needs COLMAP, and minutes"},
    {"tvsgs-reconstruct ", "needs COLMAP, and minutes; test_reconstruct types the same"},
    {"tvsgs-blocks ", "trains five times; test_blocks_command types the same"},
    {"tvsgs-view RUN", "serves a browser until it is ended"},  // without --out; see below
    {"ycb_table", "needs a scene that a clone does not hold"},
    {"stone_bust", "needs a scene that a clone does not hold"},
};

bool is_not_run(const std::string& line) {
    return std::any_of(kNotRun.begin(), kNotRun.end(), [&](const auto& exception) {
        return line.find(exception.first) != std::string::npos &&
               !(line.starts_with("tvsgs-view") && line.find("--out") != std::string::npos);
    });
}

std::vector<fs::path> guide() {
    std::vector<fs::path> pages{kSource / "README.md"};
    for (const auto& entry : fs::directory_iterator(kSource / "docs/guide"))
        pages.push_back(entry.path());
    std::sort(pages.begin() + 1, pages.end());
    return pages;
}

/// Leaves every 20th point of a binary cloud, so that commands that read it take less time.
void thin_cloud(const fs::path& path) {
    const std::string all = contents(path), end = "end_header\n";
    const std::size_t body = all.find(end) + end.size();
    std::smatch count;
    std::string header = all.substr(0, body), points;
    ASSERT_TRUE(std::regex_search(header, count, std::regex(R"(element vertex (\d+))")));
    const std::size_t number = std::stoul(count.str(1)), size = (all.size() - body) / number;
    for (std::size_t i = 0; i < number / 20; ++i) points += all.substr(body + 20 * i * size, size);
    header.replace(std::size_t(count.position(1)), std::size_t(count.length(1)),
                   std::to_string(number / 20));
    std::ofstream(path, std::ios::binary) << header << points;
}

// Each page in a folder of its own, from top to bottom. The words that pages use are there: SCENE,
// with priors; RUN, OTHER, runs/mine and runs/tv, trained on it and meshed; splats.ply;
// CONFIG.json, which wants priors.
TEST_F(DocCommands, OfTheGuideRun) {
    const fs::path base = folder_ / "base";
    fs::create_directories(base);
    for (const std::string line :
         {"tvsgs-synth --out SCENE --views 7 --test-views 2 --width 64 --height 48 --points 3000 "
          "--priors json",
          "tvsgs-train --scene SCENE --split train_all --out RUN", "tvsgs-extract-mesh --model RUN",
          "cp RUN/point_cloud/*/point_cloud.ply splats.ply && cp -r SCENE/priors DIR && cp -r RUN "
          "OTHER && mkdir runs && cp -r RUN runs/mine && "
          "cp -r RUN runs/tv"}) {
        const Result result = run(base, line);
        ASSERT_EQ(result.code, 0) << line << result;
    }
    thin_cloud(base / "SCENE/gt/points.ply");
    fs::copy(kSource / "configs/vggs.json", base / "CONFIG.json");
    for (const char* name : {"configs", "matrices", "docs"})
        fs::create_directory_symlink(kSource / name, base / name);

    int ran = 0;
    std::set<std::string> left_out;
    for (const fs::path& page : guide()) {
        const fs::path here = folder_ / page.stem();
        fs::copy(base, here, fs::copy_options::recursive | fs::copy_options::copy_symlinks);
        for (const DocCommand& command : commands_of(contents(page))) {
            std::string line = command.line;
            if (command.synopsis) continue;
            if (is_not_run(line)) {
                left_out.insert(line);
                continue;
            }
            // Pages train into the same folder again and again; of a flag given twice the last
            // counts.
            if (line.starts_with("tvsgs-train"))
                line += line.find("--resume") == std::string::npos ? " --overwrite --iterations 6"
                                                                   : " --iterations 6";
            const Result result = run(here, line);
            EXPECT_EQ(result.code, 0) << page << ": " << line << '\n' << result;
            ++ran;
        }
    }
    EXPECT_GE(ran, 20);
    for (const auto& [text, reason] : kNotRun)
        EXPECT_TRUE(std::any_of(left_out.begin(), left_out.end(),
                                [&](const std::string& l) { return l.find(text) != l.npos; }))
            << "no line of the guide has '" << text << "' any more (" << reason << ")";
}

// The console output in start.md is the programs' own, but for numbers, and fits a terminal.
TEST_F(DocCommands, TheConsoleIsQuotedAsItIs) {
    const fs::path here = folder_ / "quoted";
    fs::create_directories(here);
    std::string output;
    int lines = 0;
    for (const DocCommand& command : commands_of(contents(kSource / "docs/guide/start.md"))) {
        const bool trains = command.line.starts_with("tvsgs-train");
        const Result result = run(here, command.line + (trains ? " --iterations 6" : ""));
        ASSERT_EQ(result.code, 0) << result;
        output += result.err;
        lines = std::max(lines, int(std::count(result.err.begin(), result.err.end(), '\n')));
        if (command.line.starts_with("tvsgs-extract-mesh")) break;
    }
    EXPECT_LE(lines, 24);
    for (const char* begin : {"SCENE: ", "Plan: ", "# %", "Test photographs: ", "Wrote ",
                              "Input: ", "Mesh: ", "Report: runs"})
        EXPECT_EQ(test::missing_quote(output, begin), "") << output;
}

TEST_F(DocCommands, HaveNoFlagOrKeyThatTheProgramsLack) {
    int looked_at = 0;
    std::vector<fs::path> pages = guide();
    for (const char* name : {"CONTRIBUTING.md", "docs/results.md"}) pages.push_back(kSource / name);
    for (const char* name : {"docs/develop", "docs/method", "docs/results"})
        for (const auto& entry : fs::directory_iterator(kSource / name))
            pages.push_back(entry.path());
    for (const fs::path& page : pages) {
        const std::string text = contents(page);
        std::vector<std::string> lines = spans_of(text);
        for (const DocCommand& command : commands_of(text)) lines.push_back(command.line);
        for (const std::string& line : lines) {
            const std::vector<std::string> unknown = unknown_in(line);
            EXPECT_TRUE(unknown.empty()) << page << ": " << unknown.front() << " in\n" << line;
            ++looked_at;
        }
    }
    EXPECT_GE(looked_at, 80);
}

// That what is looked for would be found.
TEST_F(DocCommands, AWrongOneIsFound) {
    EXPECT_TRUE(unknown_in("tvsgs-train --scene SCENE -r 2 --set tv.k=8").empty());
    using Unknown = std::vector<std::string>;
    EXPECT_EQ(unknown_in("tvsgs-train --scen SCENE"), Unknown{"tvsgs-train --scen"});
    EXPECT_EQ(unknown_in("tvsgs train --scen SCENE"), Unknown{"tvsgs-train --scen"});
    EXPECT_EQ(unknown_in("tvsgs-train --set tv.kk=8"), Unknown{"--set tv.kk"});
    EXPECT_EQ(unknown_in("tvsgs-eval nvs --model RUN [--maskd]"), Unknown{"tvsgs-eval --maskd"});
    EXPECT_EQ(unknown_in("tvsgs-trains --scene S"), Unknown{"tvsgs-trains"});

    const std::string page =
        "Text.\n\n    tvsgs-train --scene S    a remark\n    tvsgs-eval nvs \\\n        --model R  "
        "# r\n"
        "    X=1 tvsgs-init --out C.ply\n    tvsgs-view RUN [--port N]\n                [--quiet]\n"
        "    ls tvsgs-train\n";
    const std::vector<DocCommand> commands = commands_of(page);
    ASSERT_EQ(commands.size(), 4u);
    EXPECT_EQ(commands[0].line, "tvsgs-train --scene S");
    EXPECT_EQ(commands[1].line, "tvsgs-eval nvs  --model R");
    EXPECT_FALSE(commands[1].synopsis);
    EXPECT_EQ(commands[2].line, "X=1 tvsgs-init --out C.ply");
    EXPECT_EQ(commands[3].line, "tvsgs-view RUN [--port N] [--quiet]");
    EXPECT_TRUE(commands[3].synopsis);
}

// scripts/results.sh: trains, measures, and puts a row for each scene and split into a page.
TEST_F(DocCommands, ResultsAreMadeOfRuns) {
    const fs::path here = folder_ / "results";
    fs::create_directories(here / "data");
    std::ofstream(here / "matrix.json") << R"({"out": "runs", "seeds": [0, 1], "scenes": {"a": {
        "train": ["--scene", "${data}/a", "--split", "train_3", "--iterations", "6"],
        "mesh": ["--no-masks"],
        "eval": ["--gt", "${data}/a/gt/points.ply", "--crop", "${data}/a/gt/info.json", "--tau", "0.1,0.05"]}},
        "configurations": {"plan": []}})";
    std::ofstream(here / "page.md") << "# P\n\n<!-- tables -->\nold\n<!-- end of tables -->\nend\n";
    const std::string script =
        "BIN=" TVSGS_BIN_DIR " bash '" TVSGS_SOURCE_DIR "/scripts/results.sh' ";
    for (const std::string& line :
         {std::string("tvsgs-synth --out data/a --views 6 --width 48 --height 36 --points 2000"),
          script + "--train data out --matrix matrix.json", script + "out/runs page.md"}) {
        const Result result = run(here, line);
        ASSERT_EQ(result.code, 0) << line << result;
    }
    const std::string page = contents(here / "page.md");
    static const std::regex kRow(
        R"(\n\| a, train_3 \| 2 \| 0\.\d{3} ± 0\.\d{3}, 0\.\d{3} ± 0\.\d{3} \| 0\.\d{3} ± .* \|\n)");
    EXPECT_TRUE(std::regex_search(page, kRow)) << page;
    EXPECT_EQ(page.find("old"), std::string::npos);
    EXPECT_TRUE(page.ends_with("\n<!-- end of tables -->\nend\n")) << page;
    EXPECT_NE(contents(here / "out/results.md").find("| a, train_3 | 2 | "), std::string::npos);
    EXPECT_EQ(run(here, script + "data page.md").code, 2) << "no run there";
    std::ofstream(here / "page.md") << "no marks\n";
    EXPECT_EQ(run(here, script + "out/runs page.md").code, 2);
    EXPECT_EQ(contents(here / "page.md"), "no marks\n");
}

}  // namespace
}  // namespace tvsgs
