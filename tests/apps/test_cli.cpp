// The commands from end to end: scene, training, mesh and scores; and input that they refuse.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "core/version.h"
#include "io/images/image_file.h"
#include "support/command.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr int kIterations = 80;

class Cli : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_cli_" + std::to_string(::getpid()));
        fs::create_directories(folder_);
        const Result synth = call("synth", "--out scene --views 12 --width 64 --height 48");
        ASSERT_EQ(synth.code, 0) << synth;
        const Result train =
            call("train",
                 "--scene scene --split train_3 --config " TVSGS_SOURCE_DIR
                 "/configs/pgsr_sparse.json --set loss.normal.start=20 --set tv.k=20 --device cpu "
                 "--report-every 20 --progress json --out run --iterations " +
                     std::to_string(kIterations));
        ASSERT_EQ(train.code, 0) << train;
        EXPECT_TRUE(train.says("tvsgs-extract-mesh run")) << train;
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    /// Lines of standard error of a run whose progress `flags` select.
    static std::vector<std::string> messages(const std::string& flags) {
        const Result r = call(
            "train",
            "--scene scene --split train_3 --device cpu --iterations 3 --config " TVSGS_SOURCE_DIR
            "/configs/pgsr_sparse.json --overwrite --out told " +
                flags);
        EXPECT_EQ(r.code, 0) << r;
        EXPECT_EQ(r.out, "") << "standard output holds what was asked for";
        std::vector<std::string> lines;
        std::istringstream text(r.err);
        for (std::string line; std::getline(text, line);) lines.push_back(line);
        return lines;
    }

    /// Runs tvsgs-<tool> in the folder of the test.
    static Result call(const std::string& tool, const std::string& arguments) {
        return run_tool(folder_, tool, arguments);
    }

    /// Runs a script in the test's folder.
    static Result shell(const std::string& script) { return run_script(folder_, script); }

    /// A copy of the scene that `spoil` changes.
    static void spoiled_scene(const std::string& name,
                              const std::function<void(const fs::path&)>& spoil) {
        fs::copy(folder_ / "scene", folder_ / name, fs::copy_options::recursive);
        spoil(folder_ / name);
    }

    /// Training must fail with `code`, print `expected`, and leave no run folder.
    static void expect_refused(const std::string& arguments,
                               int code,
                               const std::string& expected) {
        const Result r = call("train", arguments + " --device cpu --out refused --iterations 1");
        EXPECT_EQ(r.code, code) << arguments << ": " << r;
        EXPECT_TRUE(r.says(expected)) << "'" << expected << "' is not in: " << r;
        EXPECT_FALSE(fs::exists(folder_ / "refused")) << arguments;
        fs::remove_all(folder_ / "refused");
    }

    static std::string splats(const std::string& run) {
        return contents(folder_ / run / "point_cloud" /
                        ("iteration_" + std::to_string(kIterations)) / "point_cloud.ply");
    }

    static inline fs::path folder_;
};

TEST_F(Cli, ProgressIsWhatWasAskedFor) {
    EXPECT_TRUE(messages("--quiet").empty());
    EXPECT_TRUE(messages("--quiet --progress json").empty());
    int reports = 0;
    for (const std::string& line : messages("--progress json --report-every 1")) {
        // Messages contain no " %  ", but each line of a progress bar does.
        EXPECT_EQ(line.find(" %  "), std::string::npos) << line;
        EXPECT_EQ(line.find('\r'), std::string::npos) << line;
        if (!line.starts_with("{")) continue;
        EXPECT_TRUE(json::parse(line, nullptr, false).contains("iteration")) << line;
        ++reports;
    }
    EXPECT_EQ(reports, 3);
    const auto plain = messages("--progress plain");
    const auto bars = std::count_if(plain.begin(), plain.end(), [](const std::string& line) {
        EXPECT_EQ(line.find('\r'), std::string::npos) << "no line in place where nobody looks";
        return line.find("100 %  3/3  0:0") != std::string::npos;
    });
    EXPECT_EQ(bars, 1);
    EXPECT_NE(plain.back().find("tvsgs-extract-mesh told"), std::string::npos) << plain.back();
    EXPECT_LE(plain.size(), 8u) << "one screen";
}

TEST_F(Cli, RunFolderIsComplete) {
    const fs::path run = folder_ / "run";
    const json config = json::parse(contents(run / "config.json"));
    EXPECT_EQ(config.at("iterations"), kIterations);
    EXPECT_EQ(config.at("backbone"), "ewa");
    EXPECT_EQ(config.at("loss").at("normal").at("start"), 20);
    EXPECT_EQ(config.at("scene").at("split"), "train_3");
    EXPECT_TRUE(config.at("info").contains("version"));

    std::istringstream log(contents(run / "log.jsonl"));
    std::vector<json> lines;
    for (std::string line; std::getline(log, line);) lines.push_back(json::parse(line));
    ASSERT_EQ(lines.size(), 6u) << "iterations 1, 20, 40, 60, 80 and the summary";
    EXPECT_EQ(lines[0].at("iteration"), 1);
    EXPECT_EQ(lines[4].at("iteration"), kIterations);
    EXPECT_EQ(lines[5].at("event"), "done");
    EXPECT_GT(lines[5].at("psnr").get<double>(), 10);

    const json cameras = json::parse(contents(run / "cameras.json"));
    const json scores = json::parse(contents(run / "eval" / "nvs.json"));
    const auto tested = scores.at("views").get<std::size_t>();
    EXPECT_EQ(cameras.size(), 3 + tested);
    EXPECT_EQ(scores.at("per_view").size(), tested);
    std::size_t pictures = 0;
    for (const auto& file : fs::directory_iterator(run / "test"))
        pictures += read_image(file.path()).width == 64;
    EXPECT_EQ(pictures, 3 * tested) << "render, normals and depth";
    EXPECT_TRUE(splats("run").starts_with("ply\n"));
}

TEST_F(Cli, ItsConfigurationRepeatsTheRun) {
    const Result again = call("train", "--config run/config.json --device cpu --quiet --out again");
    ASSERT_EQ(again.code, 0) << again;
    EXPECT_EQ(again.err, "") << "--quiet";
    ASSERT_GT(splats("run").size(), 10000u);
    EXPECT_TRUE(splats("again") == splats("run"));
}

TEST_F(Cli, MeshAndScores) {
    const Result mesh =
        call("extract-mesh", "-m run --mesh-resolution 48 --clusters 1 --device cpu");
    ASSERT_EQ(mesh.code, 0) << mesh;
    EXPECT_TRUE(fs::exists(folder_ / "run/mesh/mesh.png"));
    const std::string geometry =
        "geometry --pred run/mesh/mesh.glb --gt scene/gt/mesh.ply --point-samples 5000 --tau 0.05 ";
    const Result eval = call("eval", geometry + "--out geometry.json --require 'chamfer<=1'");
    ASSERT_EQ(eval.code, 0) << eval;
    EXPECT_GT(json::parse(contents(folder_ / "geometry.json")).at("chamfer").get<double>(), 0);
    EXPECT_EQ(call("eval", geometry + "--require 'chamfer<=1e-9'").code, 8);
    // Bounds that no result can answer are refused before anything is measured.
    for (const char* const bound : {"f1>=0.5", "f1@0.1>=0.5", "chamfer<=nan"}) {
        const Result wrong = call("eval", geometry + "--require '" + bound + "'");
        EXPECT_EQ(wrong.code, 2) << wrong;
        EXPECT_FALSE(wrong.says("samples")) << wrong;
    }
    EXPECT_EQ(call("eval", geometry + "--require 'f1@0.050<=1'").code, 0);

    fs::remove(folder_ / "run/eval/nvs.json");
    const Result nvs = call("eval", "nvs -m run --device cpu --require 'psnr>=5'");
    ASSERT_EQ(nvs.code, 0) << nvs;
    EXPECT_TRUE(json::parse(contents(folder_ / "run/eval/nvs.json")).contains("ssim"));
    EXPECT_EQ(call("eval", "nvs -m run --device cpu --require 'psnr>=99'").code, 8);
}

TEST_F(Cli, AStoppedRunHasNoSplatsYet) {
    fs::create_directories(folder_ / "young");
    fs::copy(folder_ / "run/config.json", folder_ / "young/config.json");
    const Result r = call("extract-mesh", "-m young --device cpu");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("young: no splats yet; continue the stopped training with")) << r;
}

TEST_F(Cli, ALimitBelowTheStartPointsIsSaid) {
    const auto lines = messages("--progress plain --max-gaussians 10");
    EXPECT_TRUE(std::any_of(lines.begin(), lines.end(), [](const std::string& line) {
        return line.find("are more than 10 splats (--max-gaussians)") != std::string::npos;
    }));
}

TEST_F(Cli, VoxelsThatNoPixelFills) {
    const Result r = call("extract-mesh", "-m run --voxel-size 1e-6 --device cpu -o no/mesh.ply");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("apart on the surface")) << r;
    EXPECT_FALSE(fs::exists(folder_ / "no"));
}

TEST_F(Cli, UsageErrorsNameTheNearest) {
    expect_refused("--scene scene --iteratoins 3", 2, "--iterations");
    expect_refused("--scene scene --set loss.flaten.weight=3", 2, "loss.flatten.weight");
    expect_refused("--scene scene --set tv.k=0", 2, "tv.k");
    std::ofstream(folder_ / "bad.json") << R"({"tv": {"vote_evry": 3}})";
    expect_refused("--scene scene --config bad.json", 2, "tv.vote_every");
    expect_refused("--scene scene --set backbone=ewas", 2, "ewa");
    expect_refused("", 2, "--scene");
    expect_refused("scene", 2, "did you mean --scene scene?");
    const Result help = call("train", "--help"), version = call("train", "-V");
    EXPECT_EQ(help.code, 0);
    EXPECT_NE(help.out.find("--seed INT=0 "), std::string::npos) << help.out;
    EXPECT_NE(help.out.find("[the plan decides"), std::string::npos) << help.out;
    EXPECT_NE(call("train", "--help-all").out.find("--test-list"), std::string::npos);
    EXPECT_EQ(version.code, 0);
    EXPECT_TRUE(version.out.starts_with(std::string(kVersion) + "\nbuild: ")) << version.out;
    const Result keys = call("train", "--list-keys");
    EXPECT_EQ(keys.code, 0);
    EXPECT_NE(keys.out.find("tv.vote_every"), std::string::npos);
}

TEST_F(Cli, ScenesThatCannotBeRead) {
    expect_refused("--scene nowhere", 3, "nowhere");
    fs::create_directories(folder_ / "empty");
    expect_refused("--scene empty", 3, "empty");
    expect_refused("--scene scene --num-views 1", 3, "");
    expect_refused("--scene scene --split train_99", 3, "train_9");

    spoiled_scene("no_image",
                  [](const fs::path& scene) { fs::remove(scene / "images" / "0003.png"); });
    expect_refused("--scene no_image --split train_all", 3, "0003.png");
    fs::remove_all(folder_ / "no_image" / "images");
    expect_refused("--scene no_image", 3, "images");
    spoiled_scene("no_points", [](const fs::path& scene) {
        std::ofstream(scene / "sparse/0/points3D.txt") << "# none\n";
    });
    expect_refused("--scene no_points --set init.min_points=0", 3, "0 start points");
    spoiled_scene("nan_pose", [](const fs::path& scene) {
        std::string text = contents(scene / "sparse/0/images.txt");
        std::size_t at = text.find("\n1 ") + 1;  // ID QW QX QY QZ TX ...
        for (int field = 0; field < 5; ++field) at = text.find(' ', at) + 1;
        text.replace(at, text.find(' ', at) - at, "nan");
        std::ofstream(scene / "sparse/0/images.txt") << text;
    });
    expect_refused("--scene nan_pose", 3, "images.txt");
    spoiled_scene("cut_short", [](const fs::path& scene) {
        for (const char* name : {"cameras", "images", "points3D"}) {
            std::ofstream file(scene / "sparse/0" / (name + std::string(".bin")), std::ios::binary);
            file.write("\x01\0\0\0\0\0\0\0\x01\0\0", 11);  // one entry, then the end
        }
    });
    expect_refused("--scene cut_short", 3, ".bin");
}

TEST_F(Cli, ScenesThatLie) {
    expect_refused("--scene scene/splits.json", 3, "is a file");
    expect_refused("--scene nowhere", 3, "nowhere: not found");
    expect_refused("--scene scene --views 1", 3, "1 training views; expected at least 2");
    expect_refused("--scene scene --split train_3 --eval", 2, "exclude each other");

    spoiled_scene("half_model",
                  [](const fs::path& scene) { fs::remove(scene / "sparse/0/cameras.txt"); });
    expect_refused("--scene half_model", 3, "(no cameras.{bin,txt})");
    spoiled_scene("no_entry", [](const fs::path& scene) {
        std::ofstream(scene / "sparse/0/images.txt") << "# none\n";
    });
    expect_refused("--scene no_entry", 3, "images.txt: no images");
    spoiled_scene("far_pose", [](const fs::path& scene) {
        std::string text = contents(scene / "sparse/0/images.txt");
        std::size_t at = text.find("\n1 ") + 1;  // ID QW QX QY QZ TX ...
        for (int field = 0; field < 5; ++field) at = text.find(' ', at) + 1;
        text.replace(at, text.find(' ', at) - at, "1e300");
        std::ofstream(scene / "sparse/0/images.txt") << text;
    });
    expect_refused("--scene far_pose", 3, "translation (1e+300");
    spoiled_scene("cut_image", [](const fs::path& scene) {
        const std::string png = contents(scene / "images/0003.png");
        std::ofstream(scene / "images/0003.png", std::ios::binary) << png.substr(0, 300);
    });
    expect_refused("--scene cut_image", 3, "images/0003.png: the chunk at byte");
    spoiled_scene("odd_size", [](const fs::path& scene) {
        write_png(scene / "images/0003.png", ImageU8(48, 64, 3));
    });
    expect_refused("--scene odd_size", 3, "0003.png: 48x64 pixels; its camera has 64x48");
    spoiled_scene("odd_mask", [](const fs::path& scene) {
        write_png(scene / "masks/0003.png", ImageU8(5, 7, 1));
    });
    expect_refused("--scene odd_mask", 3, "masks/0003.png: 5x7 pixels; its image has 64x48");
    fs::remove(folder_ / "odd_mask/masks/0003.png");
    expect_refused("--scene odd_mask --masks masks", 3, "no mask for image '0003.png'");
    spoiled_scene("odd_split", [](const fs::path& scene) {
        std::ofstream(scene / "splits.json") << R"({"some": ["0001.png", "nope.png"]})";
    });
    expect_refused("--scene odd_split --split some", 3, "'nope.png' fits none of the 12 images");
}

TEST_F(Cli, CloudsAndSplatsThatLie) {
    const std::string ply = splats("run");
    const auto save = [](const std::string& name, const std::string& bytes) {
        std::ofstream(folder_ / name, std::ios::binary) << bytes;
    };
    const std::string header =
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\n"
        "property float y\nproperty float z\nend_header\n";
    save("short.ply", header + "1 2 3\n");
    expect_refused("--scene scene --init-ply short.ply", 3, "short.ply: byte");
    save("nan.ply", header + "nan 2 3\ninf 1 1\n");
    expect_refused("--scene scene --init-ply nan.ply", 3, "nan.ply: no usable point");
    Result r = call("eval", "geometry --gt scene/gt/mesh.ply --pred nan.ply");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("none of its 2 points is finite")) << r;
    save("long.ply", header + "1 2 3\n3 2 1\n4 5 6\n");
    r = call("eval", "geometry --gt scene/gt/mesh.ply --pred long.ply --point-samples 1000");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("are the counts in the header right?")) << r;

    const auto extract = [&](const std::string& name, const std::string& bytes) {
        save(name, bytes);
        const Result result =
            call("extract-mesh", "--device cpu --scene scene -o no/mesh.ply -m " + name);
        EXPECT_FALSE(fs::exists(folder_ / "no")) << name;
        EXPECT_EQ(result.code, 3) << name << result;
        return result;
    };
    EXPECT_TRUE(extract("cut.ply", ply.substr(0, ply.size() / 2)).says("the file is cut off"));
    const std::size_t at = ply.find("element vertex ") + 15, end = ply.find('\n', at);
    std::string none = ply.substr(0, ply.find("end_header\n") + 11);
    EXPECT_TRUE(extract("none.ply", none.replace(at, end - at, "0")).says("no usable splat"));
    // Non-text must not reach the terminal.
    const Result noise = extract("noise.ply", "ply\nformat ascii 1.0\n\x1b[2J\x07 1\nend_header\n");
    EXPECT_TRUE(noise.says("unknown keyword '?[2J?'")) << noise;
}

TEST_F(Cli, OutputsThatCannotBeWritten) {
    Result full = call("extract-mesh", "-m run --mesh-resolution 48 --device cpu -o /dev/full");
    EXPECT_EQ(full.code, 6) << full;
    EXPECT_TRUE(fs::is_character_file("/dev/full"));
    EXPECT_EQ(call("train", "--scene scene --device cpu --out scene").code, 2);
    // --overwrite removes runs, not files of other programs.
    fs::create_directories(folder_ / "thesis/test");
    std::ofstream(folder_ / "thesis/config.json") << "{}";
    EXPECT_EQ(call("train", "--scene scene --device cpu --overwrite --out thesis").code, 2);
    EXPECT_TRUE(fs::exists(folder_ / "thesis/test"));
    const std::string before = contents(folder_ / "run/config.json");
    Result r = call("train", "--scene scene --device cpu --iterations 1 --out run");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("--overwrite")) << r;
    EXPECT_EQ(contents(folder_ / "run/config.json"), before);

    std::ofstream(folder_ / "file") << "precious";
    r = call("train", "--scene scene --device cpu --iterations 1 --out file");
    EXPECT_EQ(r.code, 6) << r;
    EXPECT_EQ(contents(folder_ / "file"), "precious");

    // Other work goes on while these are written.
    for (const char* part : {"test", "point_cloud"}) {
        const std::string without = std::string("without_") + part;
        fs::create_directories(folder_ / without);
        std::ofstream(folder_ / without / part).flush();  // where a folder has to be
        r = call("train", "--scene scene --device cpu --iterations 1 --eval --out " + without);
        EXPECT_EQ(r.code, 6) << part << ": " << r;
        EXPECT_TRUE(r.says(without + "/" + part + "/")) << r;
        EXPECT_EQ(contents(folder_ / without / "log.jsonl").find("\"done\""), std::string::npos);
    }
    EXPECT_TRUE(fs::exists(folder_ / "without_test/point_cloud/iteration_1/point_cloud.ply"));
}

TEST_F(Cli, ThreadsHaveALimit) {
    for (const char* tool : {"train", "extract-mesh", "eval", "eval geometry", "synth"})
        for (const char* count : {"0", "-1", "1025", "99999999999", "many"}) {
            const Result r = call(tool, std::string("--threads ") + count);
            EXPECT_EQ(r.code, 2) << tool << ": " << r;
            EXPECT_TRUE(r.says(std::string("--threads: expected 1 to 1024, found ") + count)) << r;
        }
    EXPECT_EQ(call("train", "--list-keys --threads 1024").code, 0);
}

TEST_F(Cli, SignalsEndTrainingWithItsSplatsSaved) {
    const std::pair<const char*, int> cases[] = {{"INT", 130}, {"TERM", 143}, {"HUP", 129}};
    for (const auto& [signal, code] : cases) {
        const std::string run = std::string("stopped_") + signal;
        // Sent when the log shows that training runs. The exit code is that of the tool.
        const Result r = shell("exec 2>err.txt; " TVSGS_BIN_DIR
                               "/tvsgs-train --scene scene --device cpu --iterations 1000000 "
                               "--report-every 1 --eval --out " +
                               run + " & p=$!; for i in $(seq 600); do sleep 0.05; test -s " + run +
                               "/log.jsonl && break; done; kill -" + signal + " $p; wait $p");
        EXPECT_EQ(r.code, code) << signal;
        EXPECT_TRUE(r.says("the splats are in")) << r;
        EXPECT_TRUE(r.says("stopped by signal")) << r;
        int saved = 0;
        for (const auto& file : fs::recursive_directory_iterator(folder_ / run / "point_cloud"))
            saved += file.path().filename() == "point_cloud.ply";
        EXPECT_EQ(saved, 1);
        EXPECT_FALSE(fs::exists(folder_ / run / "test")) << "test views are not evaluated";
    }
}

// A pipe in place of an output blocks the command until a reader opens it.

TEST_F(Cli, SignalsStopTheEvaluation) {
    const fs::path run = folder_ / "unscored";
    fs::create_directories(run / "test");
    for (const char* picture : {"test/0000.png", "test/0000_normal.png"})
        ASSERT_EQ(::mkfifo((run / picture).c_str(), 0600), 0);
    const Result r = shell(
        "exec 2>err.txt; " TVSGS_BIN_DIR
        "/tvsgs-train --scene scene --device cpu --iterations 1 --eval --out unscored & p=$!; "
        "cd unscored/test; exec 3<0000.png; kill -INT $p; cat <&3 >../picture.png; "
        "cat 0000_normal.png >/dev/null; wait $p");
    EXPECT_EQ(r.code, 130) << r;
    EXPECT_TRUE(r.says("stopped by signal 2")) << r;
    EXPECT_EQ(read_image_size(run / "picture.png").width, 64) << "the view in hand is finished";
    EXPECT_TRUE(fs::exists(run / "point_cloud/iteration_1/point_cloud.ply"));
    EXPECT_FALSE(fs::exists(run / "eval/nvs.json")) << "scores of some views are no scores";
}

TEST_F(Cli, SignalsEndOtherCommandsAtOnce) {
    ASSERT_EQ(::mkfifo((folder_ / "pipe").c_str(), 0600), 0);
    for (const char* command : {"extract-mesh -m run --mesh-resolution 48 --device cpu --out pipe",
                                "eval geometry --pred scene/gt/mesh.ply --gt scene/gt/mesh.ply "
                                "--point-samples 99 --out pipe",
                                "synth --out endless --views 9999"}) {
        const Result r = shell(std::string("exec >out.txt 2>err.txt; " TVSGS_BIN_DIR "/tvsgs-") +
                               command + " & p=$!; sleep 0.5; kill -INT $p; wait $p");
        EXPECT_EQ(r.code, 130) << command << ": " << r;
    }
    EXPECT_FALSE(fs::exists(folder_ / "endless"));
}

TEST_F(Cli, NamesWithSpacesAndBeyondAscii) {
    fs::copy(folder_ / "scene", folder_ / "sc\u00e8ne \u5199\u771f", fs::copy_options::recursive);
    Result r =
        call("train", "--scene 'sc\u00e8ne \u5199\u771f/' --eval --device cpu --iterations 1");
    EXPECT_EQ(r.code, 0) << r;
    r = call("eval", "nvs -m 'runs/sc\u00e8ne \u5199\u771f' --device cpu");
    EXPECT_EQ(r.code, 0) << r;

    // JSON cannot hold this name.
    fs::copy(folder_ / "scene", folder_ / "sc\xe8ne", fs::copy_options::recursive);
    r = call("train", "--scene 'sc\xe8ne' --eval --device cpu --iterations 1 --out latin");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_TRUE(r.says("is not UTF-8")) << r;
    r = call("eval", "nvs -m latin --device cpu --scene 'sc\xe8ne'");
    EXPECT_EQ(r.code, 0) << r;
}

TEST_F(Cli, TheLastOfAFlagCounts) {
    const Result r =
        call("train", "--scene scene --device cpu --out twice --iterations 9 --iterations 1");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_TRUE(fs::exists(folder_ / "twice/point_cloud/iteration_1"));
    expect_refused("--scene scene --quiet --verbose", 2, "--quiet");
}

TEST_F(Cli, NoGpu) {
    if (test::no_cuda().empty()) GTEST_SKIP() << "there is a GPU";
    const Result r = call("train", "--scene scene --device cuda --iterations 1 --out refused");
    EXPECT_EQ(r.code, 5) << r;
    EXPECT_FALSE(fs::exists(folder_ / "refused"));
    EXPECT_EQ(call("train", "--scene scene --device tpu --out refused").code, 2);
}

TEST_F(Cli, ReadersOfARunNameWhatIsMissing) {
    EXPECT_EQ(call("extract-mesh", "-m empty_run --device cpu").code, 3);
    EXPECT_EQ(call("eval", "nvs -m empty_run --device cpu").code, 3);
    EXPECT_EQ(call("eval", "geometry --pred nothing.ply --gt scene/gt/mesh.ply").code, 3);
    EXPECT_EQ(call("eval", "").code, 2);
}

// Last in the file, so that it checks all tests above.
TEST_F(Cli, NothingHalfWrittenIsLeft) {
    for (const auto& file : fs::recursive_directory_iterator(folder_))
        for (const char* mark : {".tmp-", ".partial-"})
            EXPECT_EQ(file.path().string().find(mark), std::string::npos) << file.path();
}

}  // namespace
}  // namespace tvsgs
