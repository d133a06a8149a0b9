// Tables and plots of several runs: which runs share a row, and the messages.
#include <gtest/gtest.h>

#include "core/error.h"
#include "report/table.h"
#include "support/count_of.h"

namespace tvsgs {
namespace {

using test::count_of;

/// A report with only the parts that tables read.
TableRun made_up_run(const std::string& scene, bool voting, double seed, double psnr) {
    TableRun run{scene, "", seed, {}};
    run.report = parse_json_value(
        str("{\"config\": {\"seed\": ", seed, ", \"scene\": {\"path\": \"", scene,
            "\"}, \"tv\": {\"enabled\": ", voting ? "true" : "false",
            "}}, \"summary\": {\"event\": \"done\", \"psnr\": ", psnr,
            ", \"seconds\": 10}, \"evaluations\": [{\"seconds\": 1, \"psnr\": ", psnr - 5,
            "}, {\"seconds\": 10, \"psnr\": ", psnr, "}]}"),
        "made up");
    return run;
}

TEST(Tables, MeansSpreadAndNames) {
    std::vector<TableRun> runs{made_up_run("a", true, 0, 20), made_up_run("a", true, 1, 22),
                               made_up_run("a", false, 0, 19), made_up_run("b", true, 0, 30),
                               made_up_run("b", false, 0, 31)};
    name_configurations(runs);
    EXPECT_EQ(runs[0].configuration, "tv.enabled=true");
    EXPECT_EQ(runs[1].configuration, runs[0].configuration) << "seeds do not count";
    EXPECT_EQ(runs[2].configuration, "tv.enabled=false");
    const std::string text = tables_markdown(runs);
    // sqrt(((20 - 21)^2 + (22 - 21)^2) / 1) = 1.41; the mean over the scenes is (21 + 30) / 2.
    EXPECT_NE(text.find("| tv.enabled=true | **21 \u00b1 1.4** | 30 | **25.5** |"),
              std::string::npos)
        << text;
    EXPECT_NE(text.find("| tv.enabled=false | 19 | **31** | 25 |"), std::string::npos) << text;
    EXPECT_EQ(text.find("Chamfer"), std::string::npos) << "no run has it";
    EXPECT_EQ(count_of(tables_csv(runs), "\n"), 1u + 5 * 2);
    const std::vector<OverlayPlot> plots = overlay_plots(runs);
    ASSERT_EQ(plots.size(), 2u) << "PSNR of two scenes";
    EXPECT_EQ(plots[0].name, "a_psnr");
    EXPECT_EQ(count_of(plots[0].svg, "class=\"band\""), 1u) << "of the two seeds";
    EXPECT_EQ(count_of(plots[1].svg, "class=\"band\""), 0u);
    EXPECT_EQ(cell_of({}).count, 0);
}

/// A run of the scene "a" with this configuration.
TableRun configured_run(const std::string& label, double seed, const std::string& config) {
    TableRun run{"a", label, seed, {}, str("run_", seed)};
    run.report =
        parse_json_value(str("{\"config\": {\"seed\": ", seed, config.empty() ? "" : ", ", config,
                             "}, \"summary\": {\"event\": \"done\", \"psnr\": ", 20 + seed, "}}"),
                         "made up");
    return run;
}

TEST(Tables, RunsOfOneRowDifferInTheirSeedOnly) {
    const auto names = [](const std::string& label, const std::string& a, const std::string& b) {
        std::vector<TableRun> runs{configured_run(label, 0, a), configured_run(label, 1, b)};
        name_configurations(runs);
        const bool averaged = tables_markdown(runs).find("\u00b1") != std::string::npos;
        EXPECT_EQ(averaged, runs[0].configuration == runs[1].configuration) << a << " / " << b;
        return std::pair(runs[0].configuration, runs[1].configuration);
    };
    // Settings of training or scoring make separate rows.
    for (const auto& [a, b] : std::initializer_list<std::pair<const char*, const char*>>{
             {R"("scene": {"resolution": 2})", R"("scene": {"resolution": 4})"},
             {R"("scene": {"eval": true, "test_every": 8})",
              R"("scene": {"eval": true, "test_every": 4})"},
             {R"("scene": {"eval": true})", R"("scene": {"eval": false})"},
             {R"("scene": {"path": "s", "train_list": "s/a.txt"})",
              R"("scene": {"path": "s", "train_list": "s/b.txt"})"},
             {R"("scene": {"test_list": "a.txt"})", R"("scene": {"test_list": "b.txt"})"},
             {R"("scene": {"masks": ""})", R"("scene": {"masks": "other"})"},
             {R"("scene": {"images": "images"})", R"("scene": {"images": "images_4"})"},
             {R"("scene": {"path": "s", "init_ply": "s/init/a.ply"})",
              R"("scene": {"path": "s", "init_ply": "t/init/a.ply"})"},
             {R"("iterations": 30)", R"("iterations": 60)"},
             {R"("loss": {"normal": {"weight": 0}})", R"("loss": {"normal": {"weight": 1}})"},
             {R"("eval": {"gt": "a.ply"})", R"("eval": {"gt": "b.ply"})"},
             {R"("eval": {"gt": "a.ply", "max_distance": 0})",
              R"("eval": {"gt": "a.ply", "max_distance": 2})"}})
        for (const char* label : {"", "on"}) {
            const auto [first, second] = names(label, a, b);
            EXPECT_NE(first, second) << a << " / " << b;
            EXPECT_TRUE(first.starts_with(*label ? "on, " : "")) << first;
        }
    EXPECT_EQ(
        names("on", R"("scene": {"resolution": 2})", R"("scene": {"resolution": 4})"),
        std::pair(std::string("on, scene.resolution=2"), std::string("on, scene.resolution=4")));
    const auto [many, more] =
        names("on", R"("a": 1, "b": 1, "c": 1, "iterations": 30, "scene": {"resolution": 2})",
              R"("a": 2, "b": 2, "c": 2, "iterations": 60, "scene": {"resolution": 4})");
    EXPECT_EQ(many, "on, iterations=30, scene.resolution=2, a=1, and 2 more keys, #1");
    EXPECT_EQ(more, "on, iterations=60, scene.resolution=4, a=2, and 2 more keys, #2");
    // Paths, reporting options and unused keys do not.
    for (
        const auto& [a, b] : std::initializer_list<std::pair<const char*, const char*>>{
            {R"("scene": {"path": "s", "init_ply": "s/init/a.ply", "masks": "m"})",
             R"("scene": {"path": "/moved/./s/", "init_ply": "/moved//s/init/a.ply", "masks": "m"})"},
            {R"("scene": {"photos": "auto"})", R"("scene": {"photos": "file"})"},
            {R"("scene": {"photo_folder": ""})", R"("scene": {"photo_folder": "/scratch"})"},
            {R"("scene": {"eval": false, "test_every": 8})",
             R"("scene": {"eval": false, "test_every": 4})"},
            {R"("scene": {"path": "s"}, "eval": {"gt": "a.ply", "at": "5,10", "every": 0, "mesh": false})",
             R"("scene": {"path": "s"}, "eval": {"gt": "./a.ply", "at": "", "every": 100, "mesh": true})"},
            {R"("eval": {"gt": "", "max_distance": 0})",
             R"("eval": {"gt": "", "max_distance": 2})"},
            {R"("iterations": 30)", R"("iterations": 30, "a_new_key": true)"}})
        for (const char* label : {"", "on"}) {
            const auto [first, second] = names(label, a, b);
            EXPECT_EQ(first, second) << a << " / " << b;
        }
    EXPECT_EQ(names("on", R"("tv": {"lists": "full"})", R"("tv": {"lists": "compact"})").second,
              "on");
    // A decision of the plan in all runs makes no difference; the same setting by the user does.
    const auto planned = [](TableRun run, const std::string& settings) {
        run.report.set("plan", parse_json_value("[{\"settings\": {" + settings + "}}]", "plan"));
        return run;
    };
    for (const char* label : {"", "on"}) {
        std::vector<TableRun> by_plan{
            planned(configured_run(label, 0, R"("tv": {"k": 20})"), R"("tv.k": "20")"),
            planned(configured_run(label, 1, R"("tv": {"k": 30})"), R"("tv.k": "30")")};
        std::vector<TableRun> mixed{by_plan[0], configured_run(label, 1, R"("tv": {"k": 30})")};
        name_configurations(by_plan), name_configurations(mixed);
        EXPECT_EQ(by_plan[0].configuration, by_plan[1].configuration);
        EXPECT_NE(mixed[0].configuration, mixed[1].configuration);
    }
    // Keys of a scene do not make rows beside other scenes; rows are the same in all scenes.
    std::vector<TableRun> runs{configured_run("on", 0, R"("scene": {"resolution": 2})"),
                               configured_run("on", 1, R"("scene": {"resolution": 4})")};
    runs[1].scene = "b";
    name_configurations(runs);
    EXPECT_EQ(runs[0].configuration, "on");
    EXPECT_EQ(runs[1].configuration, "on");
    runs.push_back(configured_run("on", 2, R"("scene": {"resolution": 4})"));
    name_configurations(runs);
    EXPECT_EQ(runs[0].configuration, "on, scene.resolution=2");
    EXPECT_EQ(runs[1].configuration, runs[2].configuration);
}

TEST(Tables, EqualSeedsAreSaid) {
    std::vector<TableRun> runs{configured_run("on", 0, ""), configured_run("on", 1, ""),
                               configured_run("off", 0, ""), configured_run("on", 0, "")};
    runs[3].folder = "again";
    const std::vector<std::string> sentences = equal_seeds(runs);
    ASSERT_EQ(sentences.size(), 1u);
    EXPECT_TRUE(sentences[0].starts_with("run_0, again: all have seed 0, in row 'on' of a"))
        << sentences[0];
    runs[3].scene = "b";
    EXPECT_TRUE(equal_seeds(runs).empty());
}

}  // namespace
}  // namespace tvsgs
