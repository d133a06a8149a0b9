// Evaluations during training and reports of runs, up to the page in a browser.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "core/grouped.h"
#include "io/files/json_value.h"
#include "io/scene/scene_reader.h"
#include "pipeline/run/train_evaluation.h"
#include "report/page_data.h"
#include "report/plot.h"
#include "report/report.h"
#include "report/view_page.h"
#include "support/browser.h"
#include "support/count_of.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using test::count_of;

TEST(JsonValues, ReadBackAsWritten) {
    const std::string text =
        R"({"a": [1, -0.25, 1e+300, null, true], "b": {"c": "q\"\\ \u00e9"}, "d": []})";
    const JsonValue value = parse_json_value(text, "here");
    EXPECT_EQ(value["a"].items[1].number, -0.25);
    EXPECT_EQ(value["b"]["c"].text, "q\"\\ \xc3\xa9");
    EXPECT_FALSE(value["b"]["nothing"]["at all"]);
    EXPECT_EQ(json_text(parse_json_value(json_text(value), "again")), json_text(value));
    EXPECT_FALSE(JsonValue(std::nan("")));
    EXPECT_EQ(json_text(JsonValue(std::string("\xff"))), "\"\xef\xbf\xbd\"");
    EXPECT_EQ(json_text(JsonValue(std::string("a\n\x01\"b\\\xc3\xa9 \xc3"))),
              "\"a\\n\\u0001\\\"b\\\\\xc3\xa9 \xef\xbf\xbd\"");
    EXPECT_THROW(parse_json_value("{\"a\": ", "half.json"), Error);
    EXPECT_THROW(parse_json_value(std::string(100, '[') + std::string(100, ']'), "deep"), Error);
}

TEST(EvaluationSchedules, SecondsAndIterations) {
    EvaluationOptions options;
    options.at = "5,10,20,...";
    EvaluationSchedule seconds(options);
    EXPECT_FALSE(seconds.due(1, 4.9));
    EXPECT_TRUE(seconds.due(2, 5));
    EXPECT_FALSE(seconds.due(3, 9.9));
    EXPECT_TRUE(seconds.due(4, 25)) << "10 and 20 in one";
    EXPECT_FALSE(seconds.due(5, 39.9));
    EXPECT_TRUE(seconds.due(6, 40)) << "repeats the last ratio";
    EXPECT_TRUE(seconds.due(7, 80));
    EvaluationSchedule resumed(options, 12);
    EXPECT_FALSE(resumed.due(8, 13)) << "5 and 10 were before";
    EXPECT_TRUE(resumed.due(9, 20));
    options.at = "";
    options.every = 3;
    EvaluationSchedule iterations(options);
    EXPECT_TRUE(iterations.due(1, 100)) << "the start";
    EXPECT_FALSE(iterations.due(2, 100));
    EXPECT_TRUE(iterations.due(3, 100));
    for (const char* wrong : {"5,4", "0", "5,...", "five", "5,,6", "..."}) {
        options.at = wrong;
        EXPECT_THROW(EvaluationSchedule{options}, Error) << wrong;
    }
}

TEST(CentreScores, CountTheCropAndTheCurve) {
    Truth truth;
    std::vector<Vec3f> line;
    for (int i = 0; i < 10; ++i) line.push_back({static_cast<float>(i), 0, 0});
    truth.surface = measured_points(line, {}, {});
    truth.taus = {0.5, 2};
    truth.crop.kind = Crop::Kind::box;
    truth.crop.min = {-1, -1, -1}, truth.crop.max = {10, 10, 10};
    // Two points in the crop, at distances 0 and 1; two points that do not count.
    const std::vector<Vec3f> centres{{0, 0, 0}, {1, 1, 0}, {50, 0, 0}, {NAN, 0, 0}};
    const PointScores scores = score_points(centres, truth, true);
    const JsonValue& json = scores.json;
    EXPECT_EQ(json["points"]["pred"].number, 2);
    EXPECT_DOUBLE_EQ(json["accuracy"].number, 0.5);
    EXPECT_EQ(json["thresholds"].items.size(), 2u);
    EXPECT_DOUBLE_EQ(json["thresholds"].items[0]["precision"].number, 0.5);
    EXPECT_EQ(json["curve"]["tau"].items.size(), 41u);
    EXPECT_EQ(json["curve"]["tau"].items.back().number, 4) << "twice the largest threshold";
    EXPECT_EQ(json["curve"]["precision"].items.back().number, 1);
    EXPECT_TRUE(score_points({{50, 0, 0}}, truth, false).json["error"]);
}

TEST(ReportPictures, Base64OfRfc4648) {
    const std::pair<const char*, const char*> cases[] = {{"", ""},
                                                         {"f", "Zg=="},
                                                         {"fo", "Zm8="},
                                                         {"foo", "Zm9v"},
                                                         {"foob", "Zm9vYg=="},
                                                         {"fooba", "Zm9vYmE="},
                                                         {"foobar", "Zm9vYmFy"}};
    for (const auto& [plain, coded] : cases) EXPECT_EQ(base64(plain), coded);
    EXPECT_EQ(base64("\xff\xfe\xfd"), "//79");
}

TEST(ReportPlots, LeaveOutWhatHasNoPlace) {
    const double nan = std::nan("");
    const Plot plot{"T",
                    "x",
                    "y",
                    true,
                    true,
                    false,
                    {{"a<b", {0, 1, 10, 100}, {1, nan, 0, 5}, {}, {}, true},
                     {"c", {1, 10}, {2, 3}, {1, 2}, {3, 4}, false}},
                    ""};
    const std::string svg = plot_svg(plot, "p1");
    EXPECT_EQ(svg.find("nan"), std::string::npos);
    EXPECT_EQ(svg.find("inf"), std::string::npos);
    EXPECT_NE(svg.find("a&lt;b"), std::string::npos);
    EXPECT_EQ(count_of(svg, "class=\"band\""), 1u);
    EXPECT_NE(svg.find("aria-labelledby=\"p1-t p1-d\""), std::string::npos);
    for (const Plot& odd :
         {Plot{}, Plot{"e", "", "", true, true, false, {{"", {}, {}, {}, {}}}, ""},
          Plot{"c", "", "", false, false, true, {{"", {1, 2}, {0, 0}, {}, {}}}, ""},
          Plot{"n", "", "", true, true, false, {{"", {1, 2}, {-1, -1}, {}, {}}}, ""},
          Plot{"h", "", "", false, false, false, {{"", {1, 2}, {1e300, -1e300}, {}, {}}}, ""}}) {
        const std::string text = plot_svg(odd, "p");
        EXPECT_EQ(text.find("nan"), std::string::npos) << odd.title;
        EXPECT_NE(text.find("</svg>"), std::string::npos);
    }
    EXPECT_EQ(escaped("<a href='x'>&\"\x1b"), "&lt;a href=&#39;x&#39;&gt;&amp;&quot;\xef\xbf\xbd");
}

TEST(ReportPages, NamesAreTextOnly) {
    const std::string bad = "</script><script>alert(1)</script>\"'><img src=x onerror=alert(1)>";
    JsonValue report = JsonValue::object(), view = JsonValue::object(), run = JsonValue::object(),
              picture = JsonValue::object();
    picture.set("src", "https://example.org/x.png");
    view.set("name", bad);
    view.set("psnr", 20);
    view.set("render", picture);
    JsonValue views = JsonValue::list();
    views.items = {view};
    run.set("name", bad), run.set("command_line", bad), run.set("scene", bad);
    JsonValue config = JsonValue::object();
    config.set(bad, bad);
    for (const auto& [key, value] : {std::pair("run", &run),
                                     {"config", &config},
                                     {"views", &views},
                                     {"pictures", &views},
                                     {"plan", &views},
                                     {"missing", &views}})
        report.set(key, *value);
    ViewPage shown;
    shown.html = bad, shown.poster = "data:,", shown.notes = {bad};
    const std::string page = report_html(report, shown);
    EXPECT_EQ(count_of(page, "<img"), 1u) << "neither from a name nor from elsewhere";
    EXPECT_EQ(count_of(page, "<script"), 2u) << "the view, and what opens it";
    EXPECT_EQ(count_of(page, "</script"), 2u);
    EXPECT_GE(count_of(page, "&lt;img"), 4u);
    EXPECT_NE(report_html(JsonValue()).find("</html>"), std::string::npos) << "of nothing";
}

class Report : public testing::Test {
protected:
    static constexpr const char* kFlags =
        "--scene scene --split train_3 --config " TVSGS_SOURCE_DIR
        "/configs/pgsr_sparse.json --set tv.k=20 --set densify.until=0 --device cpu "
        "--report-every 10 --iterations 40 --quiet --profile ";

    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_report_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        ASSERT_EQ(call("tvsgs-synth --out scene --views 10 --width 64 --height 48 --quiet"), 0);
        ASSERT_EQ(call(std::string("tvsgs-train --out run --eval-every 10 --gt scene/gt/mesh.ply "
                                   "--crop scene/gt/info.json --set eval.point_samples=50000 ") +
                       kFlags),
                  0)
            << contents(folder_ / "err.txt");
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static int shell(const std::string& script) { return run_script(folder_, script).code; }
    static int call(const std::string& command) {
        return shell("OMP_NUM_THREADS=2 " TVSGS_BIN_DIR "/" + command + " >out.txt 2>err.txt");
    }
    static std::string said() { return contents(folder_ / "err.txt"); }

    static inline fs::path folder_;
};

TEST_F(Report, EvaluationsAreLoggedAndChangeNothing) {
    std::istringstream log(contents(folder_ / "run/log.jsonl"));
    std::vector<JsonValue> evaluations;
    double before = 0;
    for (std::string line; std::getline(log, line);) {
        JsonValue value = parse_json_value(line, "log.jsonl");
        EXPECT_GE(value["seconds"].number, before) << "the clock runs on";
        before = value["seconds"].number;
        if (value["event"].text == "evaluation") evaluations.push_back(std::move(value));
    }
    ASSERT_EQ(evaluations.size(), 4u) << "1, 10, 20, 30; the end has its own line";
    for (const JsonValue& e : evaluations) {
        EXPECT_GT(e["psnr"].number, 5);
        EXPECT_GT(e["centres"]["chamfer"].number, 0);
        EXPECT_EQ(e["centres"]["thresholds"].items.size(), 3u) << "of the default thresholds";
    }
    ASSERT_EQ(call(std::string("tvsgs-train --out plain ") + kFlags), 0) << said();
    const char* splats = "point_cloud/iteration_40/point_cloud.ply";
    ASSERT_GT(contents(folder_ / "run" / splats).size(), 10000u);
    EXPECT_TRUE(contents(folder_ / "run" / splats) == contents(folder_ / "plain" / splats));
}

TEST_F(Report, HoldsWhatTheRunMeasured) {
    const JsonValue report = parse_json_value(contents(folder_ / "run/report.json"), "report");
    EXPECT_EQ(report["summary"]["event"].text, "done");
    EXPECT_EQ(report["evaluations"].items.size(), 5u);
    EXPECT_EQ(report["reports"]["iteration"].items.size(), 5u) << "1, 10, 20, 30, 40";
    EXPECT_FALSE(report["stages"].members.empty());
    EXPECT_EQ(report["curve"]["tau"].items.size(), 41u);
    EXPECT_EQ(report["training_views"].number, 3);
    EXPECT_EQ(report["coverage"]["views"].items.size(), 3u);
    EXPECT_EQ(report["coverage"]["test"].items.size(), report["views"].items.size());
    EXPECT_FALSE(report["missing"]);
    ASSERT_FALSE(report["pictures"].items.empty());
    for (const char* kind : {"photo", "render", "difference", "normal", "depth"})
        EXPECT_TRUE(report["pictures"].items[0][kind]) << kind;

    const std::string json = contents(folder_ / "run/report.json"),
                      page = contents(folder_ / "run/report.html");
    EXPECT_EQ(count_of(page, "<figure class=\"card\">"), count_of(page, "<svg "));
    EXPECT_EQ(count_of(page, "<svg "), count_of(page, "<details><summary>Table"));
    EXPECT_EQ(count_of(page, "<img "), count_of(page, " alt=\""));
    // The only address is the name of the SVG language.
    EXPECT_EQ(count_of(page, "://"), count_of(page, "http://www.w3.org/2000/svg"));
    ASSERT_EQ(call("tvsgs-eval report --run run --quiet"), 0) << said();
    EXPECT_TRUE(contents(folder_ / "run/report.json") == json);
    EXPECT_TRUE(contents(folder_ / "run/report.html") == page);
}

TEST_F(Report, TheVerdictsFiguresAreThoseOfTheLog) {
    const JsonValue report = parse_json_value(contents(folder_ / "run/report.json"), "report");
    std::istringstream log(contents(folder_ / "run/log.jsonl"));
    JsonValue done;
    for (std::string line; std::getline(log, line);) done = parse_json_value(line, "log.jsonl");
    ASSERT_EQ(done["event"].text, "done");
    const RunVerdict verdict = verdict_of(report);
    const auto says = [](const std::string& text, const std::string& part) {
        EXPECT_NE(text.find(part), std::string::npos) << part << " is not in\n" << text;
    };
    says(verdict.what, "3 training views became ");
    says(verdict.what, grouped(static_cast<std::size_t>(done["gaussians"].number)) + " splats");
    says(verdict.what, "in 40 iterations and " + short_number(done["seconds"].number, 3) + " s");
    says(verdict.what, "on cpu");
    const std::string psnr = short_number(done["psnr"].number, 3);
    says(verdict.quality, "PSNR " + psnr + " dB");
    says(verdict.quality, "SSIM " + short_number(done["ssim"].number, 3));
    const JsonValue& middle = done["centres"]["thresholds"].items[1];
    says(verdict.quality, "F1 of the splats' centres " + short_number(middle["f1"].number, 3) +
                              " at " + short_number(middle["tau"].number, 3));
    EXPECT_TRUE(verdict.left_out.empty()) << "a configuration was given: there is no plan";
    const std::string page = contents(folder_ / "run/report.html");
    EXPECT_LT(page.find("id=\"verdict\""), page.find("id=\"overview\"")) << "first";
    says(page, escaped(verdict.what));
    says(page, escaped(verdict.quality));
}

TEST_F(Report, OfRunsThatLackSomething) {
    fs::copy(folder_ / "run", folder_ / "moved", fs::copy_options::recursive);
    std::string log = contents(folder_ / "run/log.jsonl");
    log.resize(log.size() - 50);  // the last line is cut, as in a killed run
    std::ofstream(folder_ / "moved/log.jsonl") << log;
    fs::remove_all(folder_ / "moved/point_cloud");
    ASSERT_EQ(call("tvsgs-eval report --run moved --scene nowhere"), 0) << said();
    EXPECT_NE(said().find("missing from the report: photographs"), std::string::npos) << said();
    EXPECT_NE(contents(folder_ / "moved/report.html").find("has not finished"), std::string::npos);
    EXPECT_EQ(call("tvsgs-eval table --runs moved"), 3);
    EXPECT_EQ(call("tvsgs-eval table --runs nowhere"), 3);
    EXPECT_NE(said().find("nowhere/report.json"), std::string::npos) << said();
    EXPECT_EQ(call("tvsgs-eval report --run nowhere"), 3);
    ASSERT_EQ(call("tvsgs-eval table --runs run ours=run --out table.md"), 0) << said();
    EXPECT_NE(contents(folder_ / "table.md").find("| ours |"), std::string::npos);
    EXPECT_TRUE(fs::exists(folder_ / "table.csv"));
    EXPECT_TRUE(fs::exists(folder_ / "table_scene_train_3_psnr.svg"));
}

TEST_F(Report, TablesOfTheSameRunTwice) {
    fs::create_directory_symlink("run", folder_ / "link");
    for (const char* runs :
         {"run run", "on=run on=./run/", "on=run on=link", "a=run b=run b=run"}) {
        EXPECT_EQ(call(str("tvsgs-eval table --out twice.md --runs ", runs)), 2) << runs;
        EXPECT_NE(said().find("the same run"), std::string::npos) << said();
    }
    EXPECT_FALSE(fs::exists(folder_ / "twice.md"));
    // A second run with the same seed shows no spread of seeds.
    fs::copy(folder_ / "run", folder_ / "again", fs::copy_options::recursive);
    ASSERT_EQ(call("tvsgs-eval table --out twice.md --runs on=run on=again"), 0) << said();
    EXPECT_NE(said().find("run, again: all have seed 0, in row 'on'"), std::string::npos) << said();
    // A run on other images is a separate row.
    std::string report = contents(folder_ / "again/report.json");
    const std::string key = "\"resolution\": -1,";
    ASSERT_NE(report.find(key), std::string::npos);
    report.replace(report.find(key), key.size(), "\"resolution\": 2,");
    std::ofstream(folder_ / "again/report.json") << report;
    ASSERT_EQ(call("tvsgs-eval table --out twice.md --runs on=run on=again"), 0) << said();
    EXPECT_EQ(said().find("all have seed"), std::string::npos) << said();
    const std::string table = contents(folder_ / "twice.md");
    EXPECT_NE(table.find("| on, scene.resolution=2 |"), std::string::npos) << table;
    EXPECT_NE(table.find("| on, scene.resolution=-1 |"), std::string::npos) << table;
}

TEST_F(Report, PhotographsOnTheirSideAreShownUpright) {
    ViewInput input;
    input.runs = {(folder_ / "sideways").string()}, input.scene = (folder_ / "scene").string();
    fs::copy(folder_ / "run", folder_ / "sideways", fs::copy_options::recursive);
    const ViewSubject stored = read_view_subject(input);
    ASSERT_EQ(stored.cameras.front().photo.width, 64);
    std::string cameras = contents(folder_ / "sideways/cameras.json");
    const std::string key = "\"upright_turns\": ";
    const std::size_t at = cameras.find(key);
    ASSERT_NE(at, std::string::npos) << cameras;
    ASSERT_EQ(cameras[at + key.size()], '0');
    cameras[at + key.size()] = '1';
    std::ofstream(folder_ / "sideways/cameras.json") << cameras;
    const ViewCamera turned = read_view_subject(input).cameras.front();
    EXPECT_EQ(turned.camera.width_px, 48);
    EXPECT_EQ(turned.photo.height, 64);
    for (int c = 0; c < 3; ++c)
        EXPECT_EQ(turned.photo.at(47, 0, c), stored.cameras.front().photo.at(0, 0, c));
    // Pictures of test views.
    SceneOptions options;
    options.path = input.scene, options.split = "train_3";
    Scene scene = read_scene(options);
    for (View& view : scene.test) view.upright_turns = 1;
    const auto filled = [](int width, int height, Vec3i color) {
        ImageU8 image(width, height, 3);
        for (std::size_t i = 0; i < image.pixels.size(); ++i)
            image.pixels[i] = static_cast<std::uint8_t>(color[int(i % 3)]);
        return image;
    };
    for (const auto& entry : fs::recursive_directory_iterator(folder_ / "sideways"))
        if (entry.path().filename().string().ends_with("_normal.png"))
            write_png(entry.path().string(), filled(64, 48, {200, 100, 50}));
    write_report(input.runs[0], scene, {});
    const JsonValue report =
        parse_json_value(contents(folder_ / "sideways/report.json"), "report.json");
    ASSERT_FALSE(report["pictures"].items.empty());
    for (const char* kind : {"photo", "render", "difference", "normal", "depth"})
        EXPECT_EQ(report["pictures"].items[0][kind]["width"].number, 48) << kind;
    // Right was 200 and up 100; the turned picture has up as its right, and left as its up.
    EXPECT_EQ(report["pictures"].items[0]["normal"]["src"].text,
              picture_json(filled(48, 64, {100, 55, 50}), 400)["src"].text);
    cameras[at + key.size()] = '7';
    std::ofstream(folder_ / "sideways/cameras.json") << cameras;
    EXPECT_THROW(read_view_subject(input), Error);
}

TEST_F(Report, SaysWhatItLacks) {
    const fs::path run = folder_ / "hostile";
    const auto report = [&] {
        EXPECT_EQ(call("tvsgs-eval report --run hostile"), 0) << said();
        return contents(run / "report.html");
    };
    const auto lacks = [&](const std::string& page, const std::string& what) {
        const std::size_t at = page.find("Missing from this report");
        EXPECT_NE(at, std::string::npos) << what;
        EXPECT_NE(page.find(what, at), std::string::npos) << what;
    };
    fs::copy(folder_ / "run", run, fs::copy_options::recursive);
    EXPECT_EQ(report().find("Missing from this report"), std::string::npos);
    std::ofstream(run / "plan.json") << "{\"decisions\": [1, \"off\", {}, {\"choice\": \"off\"}]}";
    std::ofstream(run / "memory.json") << "[[]";
    std::string log = contents(run / "log.jsonl");
    std::ofstream(run / "log.jsonl") << "{\"iteration\": }\n" << log;
    std::ofstream(run / "cameras.json") << "[{\"id\": 0}]";
    std::string page = report();
    lacks(page, "memory.json");
    lacks(page, "log.jsonl: line 1");
    lacks(page, "a camera");
    std::ofstream(run / "plan.json") << "[1, 2]";
    lacks(report(), "plan.json: no decisions");
    EXPECT_EQ(page.find("has not finished"), std::string::npos) << "the other lines count";
    for (const char* file : {"plan.json", "memory.json", "log.jsonl", "cameras.json"})
        fs::remove_all(run / file);
    fs::remove_all(run / "point_cloud");
    page = report();
    for (const char* file : {"memory.json", "log.jsonl", "cameras.json"}) lacks(page, file);
    EXPECT_NE(page.find("</html>"), std::string::npos);
}

TEST_F(Report, RefusesWhatCannotBeEvaluated) {
    const std::string train = std::string("tvsgs-train --out refused ") + kFlags;
    EXPECT_EQ(call(train + "--eval-at 5,4"), 2);
    EXPECT_EQ(call(train + "--eval-at 5 --eval-every 10"), 2);
    EXPECT_NE(said().find("exclude each other"), std::string::npos) << said();
    EXPECT_EQ(call(train + "--crop scene/gt/info.json"), 2);
    EXPECT_NE(said().find("--gt"), std::string::npos) << said();
    EXPECT_EQ(call(train + "--gt nowhere.ply"), 3);
    EXPECT_FALSE(fs::exists(folder_ / "refused"));
}

/// Runs headless and prints the page after its scripts; a resolver without hosts stops the
/// browser's own requests.
constexpr const char* kChromium =
    "timeout 100 chromium --headless --no-sandbox --disable-gpu --disable-dev-shm-usage "
    "--user-data-dir=\"$PWD/profile\" --no-first-run --disable-background-networking "
    "--disable-component-update --host-resolver-rules='MAP * ~NOTFOUND' --window-size=390,844 "
    "--enable-logging=stderr --log-net-log=\"$PWD/net.json\" --dump-dom ";

TEST_F(Report, OpensInABrowser) {
    if (shell("command -v chromium >/dev/null") != 0)
        GTEST_SKIP() << "no chromium; Debian's package of this name has it";
    // Requested by a page that came from a file.
    const std::string asked = "\"initiator\":\"null\"";
    const auto open = [&](const std::string& page) {
        fs::remove(folder_ / "net.json");
        return shell(str(kChromium, "\"file://$PWD/", page, "\" >dom.html 2>err.txt"));
    };
    const int code = open("run/report.html");
    const std::string dom = contents(folder_ / "dom.html");
    if (code != 0 && dom.empty()) GTEST_SKIP() << "chromium does not start here: " << said();
    EXPECT_EQ(said().find("CONSOLE"), std::string::npos) << said();
    EXPECT_EQ(count_of(contents(folder_ / "net.json"), asked), 0u);

    // A page with an external request is detected.
    std::ofstream(folder_ / "bad.html")
        << "<img src='http://192.0.2.1/x.png'><script>missing()</script>";
    open("bad.html");
    EXPECT_NE(said().find("CONSOLE"), std::string::npos) << said();
    EXPECT_GT(count_of(contents(folder_ / "net.json"), asked), 0u);
}

TEST_F(Report, OpensTheViewInIt) {
    if (chromium().empty()) GTEST_SKIP() << "no chromium that starts here";
    const std::string script = R"JS(<script>
addEventListener('load', () => {
  document.getElementById('open-view').click();
  const frame = document.querySelector('iframe');
  const out = document.createElement('pre');
  out.id = 'seen';
  const look = setInterval(() => {
    const page = frame.contentDocument, status = page && page.getElementById('status');
    if (!status || page.getElementById('canvas').hidden) return;
    clearInterval(look);
    out.textContent = [document.activeElement === frame, document.querySelectorAll('.viewer img').length,
                       page.querySelectorAll('.cameras button').length].join();
    document.body.append(out);
  }, 50);
});
</script>)JS";
    std::string page = contents(folder_ / "run/report.html");
    std::ofstream(folder_ / "run/driven.html") << page.insert(page.find("</head>"), script);
    // On a busy machine the browser's virtual time may end before the view is drawn.
    std::string html;
    for (int tries = 0; tries < 3 && text_of(html, "seen").empty(); ++tries)
        html = page_in_browser(folder_ / "run/driven.html", "", "--window-size=500,900");
    EXPECT_EQ(text_of(html, "seen"), "true,0,4") << "focus, picture, cameras";
    EXPECT_EQ(contents(folder_ / "run/err.txt").find("CONSOLE"), std::string::npos)
        << contents(folder_ / "run/err.txt");
}

}  // namespace
}  // namespace tvsgs
