// From training to the table in the layouts of both benchmarks, with small images and few
// iterations; and evaluations of a run: masked views, LPIPS, the mesh within a memory limit.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>

#include "core/error.h"
#include "eval/image_metrics.h"
#include "io/files/json_value.h"
#include "support/command.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

const fs::path kData = fs::path(TVSGS_SHARED_DIR) / "data";

/// 100x75 photographs, a thinned cloud, 30 iterations; evaluated during training, with the mesh.
std::string train_flags(const std::string& scene, const std::string& more = "") {
    const std::string data = (kData / scene).string();
    return "--scene " + data + " --split train_3 --init-ply " + data +
           "/init/train_3.ply -r 8 --iterations 30 --config " TVSGS_SOURCE_DIR
           "/configs/pgsr_sparse.json --set init.max_points=6000 --set tv.k=16 --set "
           "densify.until=0 --set mesh.resolution=150 --set mesh.masks=false "
           "--device cpu --quiet --eval-every 15 --eval-mesh --gt " +
           data + "/gt/points.ply --crop " + data + "/gt/info.json --tau 5,10 " + more;
}

/// Of the mesh, whose noise of 30 iterations would cost most of the time of measurements.
const char* const kBox = "--set mesh.box=-110,-95,-20,160,70,250";

/// Random AlexNet weights in a safetensors file.
void write_alex(const fs::path& path) {
    std::string header = "{", data;
    const auto add = [&](const std::string& name, std::initializer_list<int> shape, float mean,
                         float spread) {
        std::size_t count = 1;
        std::string text;
        for (const int n : shape)
            count *= static_cast<std::size_t>(n), text += (text.empty() ? "" : ",") + str(n);
        header +=
            str(header == "{" ? "" : ",", "\"", name, "\":{\"dtype\":\"F32\",\"shape\":[", text,
                "],\"data_offsets\":[", data.size(), ",", data.size() + 4 * count, "]}");
        for (std::size_t i = 0; i < count; ++i) {
            const float value = mean + spread * std::sin(0.7f * static_cast<float>(i % 1009));
            data.append(reinterpret_cast<const char*>(&value), 4);
        }
    };
    int tap = 0;
    for (const LpipsLayer& l : lpips_layers(LpipsNet::alex)) {
        const float spread = 2 / std::sqrt(static_cast<float>(l.in * l.kernel * l.kernel));
        add(str("features.", l.index, ".weight"), {l.out, l.in, l.kernel, l.kernel}, 0, spread);
        add(str("features.", l.index, ".bias"), {l.out}, 0, 0.01f);
        add(str("lin", tap++, ".model.1.weight"), {1, l.out, 1, 1}, 0.1f, 0.05f);
    }
    header += "}";
    const std::uint64_t length = header.size();
    std::ofstream out(path, std::ios::binary);
    out.write(reinterpret_cast<const char*>(&length), 8) << header << data;
}

class EvalRuns : public testing::Test {
protected:
    static void SetUpTestSuite() {
        if (!fs::exists(kData)) return;
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_runs_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        trained_ = call("train", "--out table " + train_flags("ycb_table", kBox));
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }
    void SetUp() override {
        if (!fs::exists(kData)) GTEST_SKIP() << kData << " is absent";
        ASSERT_EQ(trained_.code, 0) << trained_;
    }

    static Result call(const std::string& tool, const std::string& arguments) {
        return run_tool(folder_, tool, arguments);
    }
    static void expect_done(const std::string& tool, const std::string& arguments) {
        const Result result = call(tool, arguments);
        ASSERT_EQ(result.code, 0) << tool << " " << arguments << ": " << result;
    }
    static JsonValue json(const std::string& file) {
        return parse_json_value(contents(folder_ / file), file);
    }

    static inline fs::path folder_;
    static inline Result trained_{0, "", ""};
};

TEST_F(EvalRuns, TheMeshIsMeasuredOverTime) {
    const JsonValue report = json("table/report.json");
    ASSERT_EQ(report["evaluations"].items.size(), 3u);  // after 1, 15, and at the end
    for (const JsonValue& evaluation : report["evaluations"].items) {
        EXPECT_GT(evaluation["mesh"]["chamfer"].number, 0) << json_text(evaluation);
        EXPECT_EQ(evaluation["mesh"]["thresholds"].items.size(), 2u);
    }
    EXPECT_EQ(report["mesh_curve"]["tau"].items.size(), 41u);
    EXPECT_GT(fs::file_size(folder_ / "table/mesh/mesh.ply"), 10000u);
    const std::string page = contents(folder_ / "table/report.html");
    for (const char* title : {"F1 of the mesh", "Distance of the mesh",
                              "Precision and recall of the mesh", "Chamfer, mesh", " triangles"})
        EXPECT_NE(page.find(title), std::string::npos) << title;
    // The final mesh equals that of the command.
    expect_done("extract-mesh", "--model table --device cpu --out again.ply --no-preview --quiet");
    EXPECT_TRUE(contents(folder_ / "again.ply") == contents(folder_ / "table/mesh/mesh.ply"));
    const Result refused = call("train", "--scene nowhere --eval-mesh");
    EXPECT_EQ(refused.code, 2);
    EXPECT_TRUE(refused.says("--gt")) << refused;
}

TEST_F(EvalRuns, TheSameMeshWithinTenTimesLessMemory) {
    const std::string extract =
        "--model table --device cpu --no-preview -v --set mesh.resolution=300 ";
    const Result whole = call("extract-mesh", extract + "--out whole.ply");
    ASSERT_EQ(whole.code, 0) << whole;
    const std::size_t at = whole.err.find(" blocks of 8^3");
    ASSERT_NE(at, std::string::npos) << whole;
    const double blocks = std::stod(whole.err.substr(whole.err.rfind(' ', at - 1)));
    const std::string memory = std::to_string(static_cast<long>(blocks * 16384 / 10));
    const Result parts = call("extract-mesh", extract + "--out parts/mesh.ply --memory " + memory);
    ASSERT_EQ(parts.code, 0) << parts;
    EXPECT_TRUE(parts.says("parts to stay within --memory")) << parts;
    EXPECT_TRUE(contents(folder_ / "whole.ply") == contents(folder_ / "parts/mesh.ply"));
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "parts"), {}), 1) << "the mesh alone";
    const Result tiny = call("extract-mesh", extract + "--out tiny/mesh.ply --memory 50K");
    EXPECT_EQ(tiny.code, 4) << tiny;
    EXPECT_TRUE(tiny.says("--memory")) << tiny;
    EXPECT_TRUE(fs::is_empty(folder_ / "tiny")) << "nothing is left after an error";
    EXPECT_EQ(call("extract-mesh", extract + "--memory lots").code, 2);
}

TEST_F(EvalRuns, NovelViewsMaskedAndByLpips) {
    expect_done("eval", "nvs --model table --device cpu --quiet");
    JsonValue scores = json("table/eval/nvs.json");
    EXPECT_FALSE(scores["lpips"]) << "null";
    EXPECT_EQ(scores["lpips_by"].text, "not computed: no weights given");
    EXPECT_FALSE(scores["psnr_masked"]);
    const double psnr = scores["psnr"].number;

    write_alex(folder_ / "alex.safetensors");
    expect_done("eval",
                "nvs --model table --device cpu --quiet --masked --lpips-weights alex.safetensors "
                "--require 'lpips<10' --require 'psnr_masked>1'");
    scores = json("table/eval/nvs.json");
    EXPECT_EQ(scores["psnr"].number, psnr);
    EXPECT_EQ(scores["lpips_by"].text, "AlexNet on values in [0, 1]");
    EXPECT_GT(scores["lpips"].number, 0);
    EXPECT_GT(scores["lpips_masked"].number, 0);
    // Outside of the object both are white there, so the difference is smaller.
    EXPECT_GT(scores["ssim_masked"].number, scores["ssim"].number);
    EXPECT_NE(scores["psnr_masked"].number, psnr);
    const double lpips = scores["lpips"].number;
    const JsonValue official = json("table/results.json");
    EXPECT_EQ(official["iteration_30"]["PSNR"].number, psnr);
    EXPECT_EQ(official["iteration_30"]["LPIPS"].number, lpips);
    EXPECT_EQ(json("table/per_view.json")["iteration_30"]["SSIM"].members.size(), 10u);

    expect_done("eval",
                "nvs --model table --device cpu --quiet --quantize trunc --lpips-weights "
                "alex.safetensors --lpips-range -11");
    scores = json("table/eval/nvs.json");
    EXPECT_NEAR(scores["psnr"].number, psnr, 0.05);  // half a step of 8 bits
    EXPECT_NE(scores["psnr"].number, psnr);
    EXPECT_NE(scores["lpips"].number, lpips);
    EXPECT_EQ(scores["lpips_by"].text, "AlexNet on values in [-1, 1]");

    std::string spoiled = contents(folder_ / "alex.safetensors");
    spoiled.replace(spoiled.find("lin3.model"), 4, "linX");
    std::ofstream(folder_ / "spoiled.safetensors", std::ios::binary) << spoiled;
    const Result bad = call("eval", "nvs --model table --lpips-weights spoiled.safetensors");
    EXPECT_EQ(bad.code, 3);
    EXPECT_TRUE(bad.says("lin3.model.1.weight is missing")) << bad;
}

TEST_F(EvalRuns, FromTrainingToTheTableInBothLayouts) {
    const std::string data = kData.string(), dtu = data + "/ycb_table/dtu_eval";
    const Result all =
        call("eval", "run --model table --device cpu --quiet --scan 901 --dtu " + dtu);
    ASSERT_EQ(all.code, 0) << all;
    EXPECT_EQ(std::count(all.out.begin(), all.out.end(), '\n'), 5) << "nvs, geometry, dtu";
    // Same numbers as each evaluation alone.
    expect_done("eval",
                "dtu --quiet --scan 901 --out alone.json --pred table/mesh/mesh.ply --dtu " + dtu);
    EXPECT_EQ(json("alone.json")["chamfer"].number, json("table/eval/dtu.json")["chamfer"].number);
    EXPECT_EQ(json("table/eval/geometry_centres.json")["chamfer"].number,
              json("table/eval/centres.json")["chamfer"].number)
        << "with the truth, crop and samples of training";
    EXPECT_EQ(call("eval", "run --model table --scan 901").code, 2) << "--dtu is missing";
    // Official folders: cameras next to the scene; masks cull the mesh but not the centres.
    const Result culled =
        call("eval", "run --model table --device cpu --quiet --scan 901 --dtu " + dtu +
                         " --cameras " + dtu + "/cameras_sphere.npz --cull-masks " + data +
                         "/ycb_table/masks --cull-dilate 3");
    ASSERT_EQ(culled.code, 0) << culled;
    EXPECT_EQ(json("table/eval/dtu.json")["protocol"]["cull"].text, "all");
    EXPECT_EQ(json("table/eval/dtu.json")["protocol"]["cull_dilate_px"].number, 3);
    EXPECT_GT(json("table/eval/dtu.json")["points"]["culled"].number, 100);
    EXPECT_EQ(json("table/eval/dtu.json")["inputs"]["cameras"].text, dtu + "/cameras_sphere.npz");
    EXPECT_EQ(json("table/eval/dtu_centres.json")["protocol"]["cull"].text, "none");
    const Result alone = call("eval", "run --model table --cull-masks " + data);
    EXPECT_EQ(alone.code, 2);
    EXPECT_TRUE(alone.says("needs --dtu")) << alone;

    // Tanks and Temples' layout by a matrix: the trained frame is that of sparse/0, not of the
    // official log.
    const auto list = [](std::string words) {
        for (std::size_t at = 0; (at = words.find(' ', at)) != std::string::npos; at += 4)
            words.replace(at, 1, "\", \"");
        return "[\"" + words + "\"]";
    };
    const std::string flags = train_flags("stone_bust", "--set eval.point_samples=20000");
    std::ofstream(folder_ / "matrix.json")
        << R"({"out": "runs", "seeds": [0], "scenes": {"bust": {"train": )" << list(flags)
        << R"(, "mesh": ["--quiet", "--device", "cpu"], "eval": )"
        << list("--quiet --device cpu --tnt-tau 10 --scene-dir " + data + "/stone_bust/tnt_eval")
        << R"(}}, "configurations": {"ours": [], "none": ["--set", "tv.vote_map=no_such_map"]}})";

    std::ofstream(folder_ / "published.json") << R"JS({"sources": {"Somebody": "a paper"},
        "sets": {"ours": ["ycb_table", "stone_bust"]}, "figures": [
        {"source": "Somebody", "method": "Theirs", "scenes": ["ycb_table"], "with": ", train_3",
         "metric": "chamfer (dtu)", "value": 1.25},
        {"source": "Somebody", "method": "Theirs", "set": "ours", "with": ", train_3",
         "metric": "psnr", "value": 33.5},
        {"source": "Somebody", "method": "Other views", "scenes": ["ycb_table"],
         "with": ", train_9", "metric": "psnr", "value": 35.5}]})JS";
    const Result first = call("eval", "table --matrix matrix.json --out bust.md");
    ASSERT_EQ(first.code, 0) << first;
    EXPECT_TRUE(first.says("none/seed_0: tvsgs-train ended with exit code 2")) << first;
    EXPECT_NE(contents(folder_ / "bust.md").find("(tnt\\_centres)"), std::string::npos);
    const fs::path splats =
        folder_ / "runs/bust/ours/seed_0/point_cloud/iteration_30/point_cloud.ply";
    const auto trained = fs::last_write_time(splats);
    expect_done("eval", "table --matrix matrix.json --out bust.md");
    EXPECT_EQ(fs::last_write_time(splats), trained) << "a finished run stays as it is";
    std::string other = contents(folder_ / "matrix.json");
    other.replace(other.find("tv.k=16"), 7, "tv.k=12");
    std::ofstream(folder_ / "other.json") << other;
    const Result refused = call("eval", "table --matrix other.json --out bust.md");
    EXPECT_EQ(refused.code, 2) << refused;
    EXPECT_TRUE(refused.says("trained with other flags")) << refused;
    // Placeholders: the folder of the file, the data, and one entry for several scenes.
    std::ofstream(folder_ / "many.json")
        << R"JS({"comment": "x", "out": "${here}/runs", "scenes": {"s${n}": {"for_each":
           {"n": ["1", "22"]}, "train": ["--scene", "${data}/s${n}"], "eval_if_there":
           ["--lpips-weights", "${data}/alex.safetensors"]}}, "configurations": {"a": []}})JS";
    const Result printed = call("eval", "table --matrix many.json --data . --dry-run --scenes s22");
    ASSERT_EQ(printed.code, 0) << printed;
    const std::string here = fs::canonical(folder_).string(), run = here + "/runs/s22/a/seed_0";
    EXPECT_EQ(printed.out, "tvsgs-train --scene " + here + "/s22 --seed 0 --out " + run +
                               "\ntvsgs-extract-mesh --model " + run + "\ntvsgs-eval run --model " +
                               run + " --lpips-weights " + here + "/alex.safetensors\n");
    EXPECT_EQ(call("eval",
                   "table --matrix ./many.json --data '' --data ./x/.. --dry-run "
                   "--scenes s22")
                  .out,
              printed.out)
        << "however the folders are spelled";
    fs::create_directory(folder_ / "my data");
    EXPECT_TRUE(call("eval", "table --matrix many.json --data 'my data' --dry-run --scenes s22")
                    .out.starts_with("tvsgs-train --scene '" + here + "/my data/s22' --seed"));
    const Result nowhere = call("eval", "table --matrix many.json --data nowhere --dry-run");
    EXPECT_EQ(std::count(nowhere.out.begin(), nowhere.out.end(), '\n'), 6) << "two scenes";
    EXPECT_EQ(nowhere.out.find("alex"), std::string::npos) << "there are no weights";
    EXPECT_TRUE(call("eval", "table --matrix many.json --dry-run").says("--data DIR"));
    const Result unknown = call("eval", "table --matrix many.json --data . --scenes s3");
    EXPECT_EQ(unknown.code, 2);
    EXPECT_TRUE(unknown.says("s1 s22")) << unknown;
    std::ofstream(folder_ / "no_matrix.json") << R"({"scenes": {"a": {"trian": []}}})";
    EXPECT_EQ(call("eval", "table --matrix no_matrix.json").code, 3);
    for (const char* wrong : {R"("seeds": ["1"])", R"("seeds": 1)", R"("seeds": [-1])",
                              R"("seeds": [0.5])", R"("out": 3)"}) {
        std::ofstream(folder_ / "wrong.json")
            << "{" << wrong << R"(, "scenes": {"a": {}}, "configurations": {"b": []}})";
        const Result result = call("eval", "table --matrix wrong.json");
        EXPECT_EQ(result.code, 3) << wrong;
        EXPECT_TRUE(result.says("wrong.json: \"")) << wrong << result;
    }
    expect_done("eval",
                "table --runs ours=table ours=runs/bust/ours/seed_0 --published published.json "
                "--out all.md --quiet");
    const std::string table = contents(folder_ / "all.md");
    for (const char* text :
         {"## Chamfer distance (dtu)", "## Chamfer distance (dtu\\_centres)", "threshold (tnt)",
          "threshold (tnt\\_centres)", "## Novel views", "## Run time and memory",
          "ycb\\_table, train\\_3", "| *Theirs (Somebody)* | 1.25 |", " 33.5 |",
          "Published, Somebody: a paper.", "all_stone_bust_train_3_f1_mesh_10.svg"})
        EXPECT_NE(table.find(text), std::string::npos) << text << "\n" << table;
    EXPECT_EQ(table.find("Other views"), std::string::npos);
    EXPECT_TRUE(fs::exists(folder_ / "all_ycb_table_train_3_chamfer_mesh.svg"));
    const Result bad = call("eval", "table --runs table --published all.csv");
    EXPECT_EQ(bad.code, 3) << bad;
}

}  // namespace
}  // namespace tvsgs
