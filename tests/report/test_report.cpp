// Evaluation while training, the report of a run and the tables of several, from the parts to the
// page in a browser.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>

#include "io/json_value.h"
#include "pipeline/train_evaluation.h"
#include "report/html.h"
#include "report/pictures.h"
#include "report/plot.h"
#include "report/table.h"
#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

std::size_t count_of(const std::string& text, const std::string& part) {
    std::size_t count = 0;
    for (std::size_t at = 0; (at = text.find(part, at)) != std::string::npos; ++at) ++count;
    return count;
}

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
    EXPECT_TRUE(seconds.due(6, 40)) << "goes on by the last ratio";
    EXPECT_TRUE(seconds.due(7, 80));
    EvaluationSchedule resumed(options, 12);
    EXPECT_FALSE(resumed.due(8, 13)) << "5 and 10 were before";
    EXPECT_TRUE(resumed.due(9, 20));
    options.at = "";
    options.every = 3;
    EvaluationSchedule iterations(options);
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
    // Two in the crop, at distances 0 and 1; two that do not count.
    const std::vector<Vec3f> centres{{0, 0, 0}, {1, 1, 0}, {50, 0, 0}, {NAN, 0, 0}};
    const PointScores scores = score_points(centres, truth, true);
    const JsonValue json = parse_json_value(scores.json.text(), "scores");
    EXPECT_EQ(json["points"]["pred"].number, 2);
    EXPECT_DOUBLE_EQ(json["accuracy"].number, 0.5);
    EXPECT_EQ(json["thresholds"].items.size(), 2u);
    EXPECT_DOUBLE_EQ(json["thresholds"].items[0]["precision"].number, 0.5);
    EXPECT_EQ(json["curve"]["tau"].items.size(), 41u);
    EXPECT_EQ(json["curve"]["tau"].items.back().number, 4) << "twice the largest threshold";
    EXPECT_EQ(json["curve"]["precision"].items.back().number, 1);
    const JsonValue none =
        parse_json_value(score_points({{50, 0, 0}}, truth, false).json.text(), "none");
    EXPECT_TRUE(none["error"]);
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

TEST(ReportPictures, TheViewpointIsUpright) {
    // A camera that looks along +y and down by 30 degrees in a world whose z is up.
    const double c = std::cos(M_PI / 6), s = std::sin(M_PI / 6);
    const JsonValue cameras = parse_json_value(
        str("[{\"rotation\": [[1, 0, 0], [0, ", -s, ", ", c, "], [0, ", -c, ", ", -s, "]]}]"),
        "cameras");
    const Viewpoint view = viewpoint_of(cameras);
    EXPECT_NEAR(view.axes[0][0], 1, 1e-6) << "right";  // float rounding
    // Up is that of the cameras, so the one camera is level in it.
    EXPECT_NEAR(view.axes[1][2], c, 1e-6);
    EXPECT_NEAR(view.pitch, 0, 1e-6);
    const Viewpoint unknown = viewpoint_of(JsonValue());
    EXPECT_EQ(unknown.axes[2][2], 1);
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

/// A report with only what the tables read.
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
    JsonValue config = JsonValue::object(), points = JsonValue::object();
    config.set(bad, bad);
    points.set("positions", bad);
    for (const auto& [key, value] : {std::pair("run", &run),
                                     {"config", &config},
                                     {"views", &views},
                                     {"pictures", &views},
                                     {"points", &points}})
        report.set(key, *value);
    const std::string page = report_html(report);
    EXPECT_EQ(page.find("<img"), std::string::npos) << "neither from a name nor from elsewhere";
    EXPECT_EQ(count_of(page, "<script"), 2u) << "the data and the viewer";
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
                                   "--crop scene/gt/info.json ") +
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
    ASSERT_EQ(evaluations.size(), 3u) << "10, 20, 30; the end has its own line";
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
    EXPECT_EQ(report["evaluations"].items.size(), 4u);
    EXPECT_EQ(report["reports"]["iteration"].items.size(), 5u) << "1, 10, 20, 30, 40";
    EXPECT_FALSE(report["stages"].members.empty());
    EXPECT_EQ(report["curve"]["tau"].items.size(), 41u);
    EXPECT_GT(report["points"]["shown"].number, 100);
    ASSERT_FALSE(report["pictures"].items.empty());
    for (const char* kind : {"photo", "render", "difference", "normal", "depth"})
        EXPECT_TRUE(report["pictures"].items[0][kind]) << kind;

    const std::string json = contents(folder_ / "run/report.json"),
                      page = contents(folder_ / "run/report.html");
    EXPECT_EQ(count_of(page, "<figure class=\"card\">"), count_of(page, "<svg "));
    EXPECT_EQ(count_of(page, "<svg "), count_of(page, "<details><summary>Table"));
    EXPECT_EQ(count_of(page, "<img "), count_of(page, " alt=\""));
    // Addresses: the name of the SVG language alone.
    EXPECT_EQ(count_of(page, "://"), count_of(page, "xmlns=\"http://www.w3.org/2000/svg\""));
    ASSERT_EQ(call("tvsgs-eval report --run run --quiet"), 0) << said();
    EXPECT_TRUE(contents(folder_ / "run/report.json") == json);
    EXPECT_TRUE(contents(folder_ / "run/report.html") == page);
}

TEST_F(Report, OfRunsThatLackSomething) {
    fs::copy(folder_ / "run", folder_ / "moved", fs::copy_options::recursive);
    std::string log = contents(folder_ / "run/log.jsonl");
    log.resize(log.size() - 50);  // the last line is cut: a run that was killed
    std::ofstream(folder_ / "moved/log.jsonl") << log;
    fs::remove_all(folder_ / "moved/point_cloud");
    ASSERT_EQ(call("tvsgs-eval report --run moved --scene nowhere"), 0) << said();
    EXPECT_NE(said().find("does without photographs"), std::string::npos) << said();
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

TEST_F(Report, RefusesWhatCannotBeEvaluated) {
    const std::string train = std::string("tvsgs-train --out refused ") + kFlags;
    EXPECT_EQ(call(train + "--eval-at 5,4"), 2);
    EXPECT_EQ(call(train + "--crop scene/gt/info.json"), 2);
    EXPECT_NE(said().find("--gt"), std::string::npos) << said();
    EXPECT_EQ(call(train + "--gt nowhere.ply"), 3);
    EXPECT_FALSE(fs::exists(folder_ / "refused"));
}

/// Headless, printing the page as its scripts leave it; the browser's own errands end at a resolver
/// that knows nobody.
constexpr const char* kChromium =
    "timeout 100 chromium --headless --no-sandbox --disable-gpu --disable-dev-shm-usage "
    "--user-data-dir=\"$PWD/profile\" --no-first-run --disable-background-networking "
    "--disable-component-update --host-resolver-rules='MAP * ~NOTFOUND' --window-size=390,844 "
    "--enable-logging=stderr --log-net-log=\"$PWD/net.json\" --dump-dom ";

TEST_F(Report, OpensInABrowser) {
    if (shell("command -v chromium >/dev/null") != 0)
        GTEST_SKIP() << "no chromium; Debian's package of this name has it";
    const std::string asked = "\"initiator\":\"null\"";  // by a page that came from a file
    const auto open = [&](const std::string& page) {
        fs::remove(folder_ / "net.json");
        return shell(str(kChromium, "\"file://$PWD/", page, "\" >dom.html 2>err.txt"));
    };
    const int code = open("run/report.html");
    const std::string dom = contents(folder_ / "dom.html");
    if (code != 0 && dom.empty()) GTEST_SKIP() << "chromium does not start here: " << said();
    EXPECT_EQ(said().find("CONSOLE"), std::string::npos) << said();
    EXPECT_NE(dom.find("<canvas tabindex=\"0\""), std::string::npos) << "the script ran";
    EXPECT_NE(dom.find("style=\"display: none;\""), std::string::npos) << "instead of the picture";
    EXPECT_EQ(count_of(contents(folder_ / "net.json"), asked), 0u);

    // A page that does ask is noticed.
    std::ofstream(folder_ / "bad.html")
        << "<img src='http://192.0.2.1/x.png'><script>missing()</script>";
    open("bad.html");
    EXPECT_NE(said().find("CONSOLE"), std::string::npos) << said();
    EXPECT_GT(count_of(contents(folder_ / "net.json"), asked), 0u);
}

TEST_F(Report, TheViewerTurnsZoomsAndChangesColours) {
    if (shell("command -v chromium >/dev/null") != 0)
        GTEST_SKIP() << "no chromium; Debian's package of this name has it";
    // Does one thing after the other and notes what the canvas then shows. Without a screen the
    // browser seldom asks for frames, so they are drawn at once.
    const std::string script = R"JS(<script>
window.requestAnimationFrame = draw => setTimeout(draw, 0);
addEventListener('load', async () => {
  const canvas = document.querySelector('.viewer canvas'), seen = [];
  const wait = () => new Promise(done => setTimeout(done, 100));
  const look = async name => {
    await wait();
    let h = 0;
    for (const c of canvas.toDataURL()) h = (h * 31 + c.charCodeAt(0)) | 0;
    seen.push(name + '=' + h);
  };
  const key = k => canvas.dispatchEvent(new KeyboardEvent('keydown', {key: k, cancelable: true}));
  const click = act => document.querySelector('button[data-act=' + act + ']').click();
  const point = (type, x, id) => canvas.dispatchEvent(
      new PointerEvent(type, {pointerId: id, clientX: x, clientY: 50}));
  canvas.setPointerCapture = () => {};  // there is no such pointer
  await look('start');
  key('ArrowRight'); await look('turned');
  key('0'); await look('reset');
  click('near'); await look('near');
  click('far'); await look('far');
  key('Home'); point('pointerdown', 50, 7); point('pointermove', 90, 7); point('pointerup', 90, 7);
  await look('dragged');
  point('pointermove', 150, 7); await look('released');
  key('0'); document.querySelector('button[data-colors]').click(); await look('own');
  document.body.dataset.seen = seen.join(' ');
  document.body.dataset.scale = document.querySelector('.scale').hidden;
});
</script>)JS";
    std::string page = contents(folder_ / "run/report.html");
    std::ofstream(folder_ / "run/driven.html") << page.insert(page.find("</head>"), script);
    const int code = shell(str(kChromium,
                               "--virtual-time-budget=10000 \"file://$PWD/run/driven.html\" "
                               ">dom.html 2>err.txt"));
    const std::string dom = contents(folder_ / "dom.html");
    if (code != 0 && dom.empty()) GTEST_SKIP() << "chromium does not start here: " << said();
    EXPECT_EQ(said().find("CONSOLE"), std::string::npos) << said();
    const std::size_t at = dom.find("data-seen=\"");
    ASSERT_NE(at, std::string::npos) << dom.substr(0, 500);
    std::istringstream seen(dom.substr(at + 11, dom.find('"', at + 11) - at - 11));
    std::map<std::string, std::string> state;
    for (std::string word; seen >> word;)
        state[word.substr(0, word.find('='))] = word.substr(word.find('='));
    EXPECT_NE(state["turned"], state["start"]);
    EXPECT_EQ(state["reset"], state["start"]);
    EXPECT_NE(state["near"], state["start"]);
    EXPECT_EQ(state["far"], state["start"]);
    EXPECT_NE(state["dragged"], state["start"]);
    EXPECT_EQ(state["released"], state["dragged"]) << "the pointer is up";
    EXPECT_NE(state["own"], state["start"]);
    EXPECT_NE(dom.find("data-scale=\"true\""), std::string::npos) << "no errors, so no scale";
}

}  // namespace
}  // namespace tvsgs
