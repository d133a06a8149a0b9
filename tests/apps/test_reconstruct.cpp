// tvsgs-reconstruct: with the real programs behind scripts that log their calls, and a script for
// tvsgs-prepare.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <csignal>
#include <cstdlib>
#include <sstream>

#include "apps/reconstruct/stages.h"
#include "core/progress.h"
#include "io/files/json_value.h"
#include "io/io_test.h"
#include "support/command.h"
#include "support/console_quote.h"

namespace tvsgs::reconstruct {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSettings =
    "OMP_NUM_THREADS=1 TVSGS_INIT__MIN_POINTS=0 TVSGS_ITERATIONS=${N:-40} ";

class Reconstruct : public IoTest {
protected:
    static void SetUpTestSuite() {
        scene_ = fs::path(testing::TempDir()) / str("tvsgs_reconstruct_", getpid());
        fs::create_directories(scene_);
        const Result made = run_script(
            scene_, TVSGS_BIN_DIR
            "/tvsgs-synth --out . --views 6 --width 48 --height 36 --points 1500 --quiet "
            ">/dev/null 2>&1");
        ASSERT_EQ(made.code, 0);
    }
    static void TearDownTestSuite() { fs::remove_all(scene_); }
    void SetUp() override {
        IoTest::SetUp();
        fs::create_directories(folder / "bin");
        fs::copy_file(TVSGS_BIN_DIR "/tvsgs-reconstruct", folder / "bin/tvsgs-reconstruct");
        for (const std::string name : {"train", "extract-mesh", "view"})
            program(name, "exec " TVSGS_BIN_DIR "/tvsgs-" + name + " \"$@\"");
        program("prepare",
                "cp -r '" + (folder / "scene").string() +
                    "' \"$2\" && echo '{\"photographs\": 9, \"georeference\": "
                    "{\"rmse_m\": 0.021, \"checkpoint_rmse_m\": 0.034}}' >\"$2/prepare.json\"");
        fs::copy(scene_, folder / "scene", fs::copy_options::recursive);
        for (const char* name : {"a.png", "b.png", "c.png"})
            write(std::string("photos/") + name, "not read by this command");
    }
    /// A program beside tvsgs-reconstruct. It runs the file before_NAME first, if there is one.
    void program(const std::string& name, const std::string& script) const {
        const std::string at = folder.string();
        write("bin/tvsgs-" + name, "#!/bin/sh\necho " + name + " \"$@\" >>'" + at +
                                       "/calls.txt'\n[ ! -e '" + at + "/before_" + name +
                                       "' ] || . '" + at + "/before_" + name + "'\n" + script +
                                       "\n");
        fs::permissions(folder / ("bin/tvsgs-" + name), fs::perms::owner_all);
    }
    Result run(const std::string& arguments, const std::string& settings = "") const {
        return run_script(folder, settings + " " + kSettings + "bin/tvsgs-reconstruct " +
                                      arguments + " >out.txt 2>err.txt");
    }
    pid_t start(const std::string& arguments) const {
        const pid_t child = fork();
        if (child != 0) return child;
        const std::string line = std::string("N=400; export N; exec env ") + kSettings +
                                 "bin/tvsgs-reconstruct " + arguments + " 2>err.txt";
        if (chdir(folder.c_str()) == 0) execl("/bin/sh", "sh", "-c", line.c_str(), nullptr);
        _exit(127);
    }
    static int wait_for(pid_t child) {
        int status = 0;
        waitpid(child, &status, 0);
        return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    template <class Condition>
    static bool until(const Condition& condition) {
        for (int i = 0; i < 1200 && !condition(); ++i) usleep(25000);
        return condition();
    }

    std::string text(const std::string& name) const { return contents(folder / name); }
    /// The names of the programs that were called.
    std::string calls() const {
        std::istringstream in(text("calls.txt"));
        std::string names;
        for (std::string line; std::getline(in, line);)
            names += line.substr(0, line.find(' ')) + " ";
        return names;
    }

    static inline fs::path scene_;
};

TEST_F(Reconstruct, PhotographsBecomeSplatsMeshAndPage) {
    Result r = run("photos 'my out'");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_EQ(calls(), "prepare train extract-mesh view ");
    EXPECT_NE(text("calls.txt").find(" --no-report"), std::string::npos) << "one report is enough";
    for (const char* file : {"scene/prepare.json", "run/report.html", "run/mesh/mesh.glb",
                             "view.html", "reconstruct.log", "reconstruct.json"})
        EXPECT_TRUE(fs::exists(folder / "my out" / file)) << file;
    for (const char* part :
         {"Cameras: done in 0:", "Reconstructed 6 photographs of 9: ", " splats, mesh of ", " x ",
          " units of the scene\n",
          "Place: known points are off by 0.021 m (RMS), checkpoints by 0.034 m\n",
          "Mesh: my out/run/mesh/mesh.glb\nPage: my out/view.html",
          "tvsgs-export 'my out/run' splats.spz"})
        EXPECT_TRUE(r.says(part)) << part << r;

    const std::string said = std::regex_replace(r.err + r.out, std::regex("my out"), "OUT");
    for (const char* begin :
         {"Cameras: ", "Training: ", "Reconstructed ", "Page: OUT", "Report: OUT"})
        EXPECT_EQ(test::missing_quote(said, begin), "") << "quoted in start.md; " << said;
    EXPECT_LE(std::count(said.begin(), said.end(), '\n'), 24);

    // The log has the output and the commands, ready for a shell.
    StageProgress progress(kTrain);
    std::istringstream log(text("my out/reconstruct.log"));
    std::string by_hand;
    for (std::string line; std::getline(log, line);) {
        progress.read(line, 0);
        if (line.find("/tvsgs-view ") != line.npos) by_hand = line;
    }
    EXPECT_EQ(progress.share(), 1);
    fs::remove(folder / "my out/view.html");
    EXPECT_EQ(run_script(folder, by_hand + " >out.txt 2>err.txt").code, 0) << by_hand;
    EXPECT_TRUE(fs::exists(folder / "my out/view.html"));

    // Called again: only missing results are made.
    fs::remove(folder / "calls.txt");
    write("bin/xdg-open", "#!/bin/sh\necho \"$1\" >opened.txt\n");
    fs::permissions(folder / "bin/xdg-open", fs::perms::owner_all);
    r = run("photos 'my out' --open", "PATH=$PWD/bin:$PATH");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_EQ(text("opened.txt"), (folder / "my out/view.html").string() + "\n");
    EXPECT_TRUE(r.says("Everything is done already") && r.says("Reconstructed 6 photographs")) << r;
    EXPECT_EQ(calls(), "");
    fs::remove(folder / "my out/view.html");
    EXPECT_EQ(run("photos 'my out' --device cpu --threads 1").code, 0);
    EXPECT_EQ(calls(), "view ");
    EXPECT_NE(text("calls.txt").find("--threads 1 "), std::string::npos) << text("calls.txt");

    // With other settings or photographs: refused.
    r = run("photos 'my out' -r 2");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("--resolution 2 --resume\n  --overwrite starts anew")) << r;
    write("photos/d.png", "");
    r = run("photos 'my out'");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("# 3 photographs, ") && r.says("# 4 photographs, ")) << r;
    fs::remove(folder / "photos/d.png");
    const std::string before = text("photos/a.png");
    write("photos/a.png", before + "taken again");
    r = run("photos 'my out'");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("# 3 photographs, 72 bytes\n") && r.says("# 3 photographs, 83 bytes\n"))
        << r;
    write("photos/a.png", before);
    fs::remove_all(folder / "my out/scene");
    r = run("photos 'my out'");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("its scene/ is missing")) << r;
    EXPECT_EQ(calls(), "view ");
}

TEST_F(Reconstruct, ASceneMadeByHandBelongsToItsPhotographs) {
    write("before_prepare", "exit 7");
    ASSERT_EQ(run("photos out").code, 7);
    fs::remove(folder / "before_prepare");
    ASSERT_EQ(run_script(folder, "bin/tvsgs-prepare photos out/scene").code, 0);
    fs::remove(folder / "out/scene/.tvsgs-files");  // of tvsgs-synth; tvsgs-prepare writes none
    write("photos/d.png", "");
    for (const char* flags : {"", " --overwrite"}) {
        const Result r = run(std::string("photos out") + flags);
        EXPECT_EQ(r.code, 2) << r;
        EXPECT_TRUE(r.says(*flags ? "made by hand from other photographs" : "# 4 photographs, "))
            << r;
    }
    EXPECT_EQ(calls(), "prepare prepare ");
    fs::remove(folder / "photos/d.png");
    const Result r = run("photos out --gps");
    EXPECT_EQ(r.code, 0) << "made after a failure, with other flags" << r;
    EXPECT_TRUE(r.says("--gps has no effect: ")) << r;
    EXPECT_EQ(calls(), "prepare prepare train extract-mesh view ");
}

TEST_F(Reconstruct, OverwriteRemovesOnlyItsOwnFiles) {
    ASSERT_EQ(run("photos out").code, 0);
    write("out/notes.txt", "mine"), write("out/run/notes.txt", "mine");
    write("before_train", "echo 'error: no luck'; echo '  while training'; exit 7");
    write("out/scene/masks/a.png", "mine");
    const Result refused = run("photos out --quality draft --overwrite");
    EXPECT_EQ(refused.code, 2) << refused;
    EXPECT_TRUE(refused.says("scene/masks/a.png: is not a file of ours; move it away")) << refused;
    EXPECT_TRUE(fs::exists(folder / "out/run/config.json"));
    fs::remove_all(folder / "out/scene/masks");
    const Result r = run("photos out --quality draft --overwrite");
    EXPECT_EQ(r.code, 7) << r;
    EXPECT_TRUE(
        r.says("error: Training: tvsgs-train failed, exit code 7: error: no luck\n  while "
               "training\n  All messages: out/reconstruct.log"))
        << r;
    for (const char* gone : {"run/point_cloud", "run/config.json", "run/mesh", "view.html"})
        EXPECT_FALSE(fs::exists(folder / "out" / gone)) << gone;
    EXPECT_EQ(text("out/notes.txt") + text("out/run/notes.txt"), "minemine");
    EXPECT_EQ(text("out/reconstruct.log").find("extract-mesh"), std::string::npos);
    EXPECT_EQ(calls(), "prepare train extract-mesh view prepare train ");
    const Record record(folder / "out");
    EXPECT_TRUE(record.is_done("prepare"));
    EXPECT_FALSE(record.is_done("train") || record.find("mesh"));
}

TEST_F(Reconstruct, QualityChoosesSizeAndIterations) {
    std::string images;
    for (int i = 1; i <= 40; ++i) images += str(i, " 1 0 0 0 0 0 ", i, " 1 ", i, ".png\n\n");
    write("large/sparse/0/cameras.txt", "1 PINHOLE 4000 3000 4000 4000 2000 1500\n");
    write("large/sparse/0/images.txt", images);
    write("before_train", "exit 9");
    const auto flags = [&](const std::string& quality, const std::string& more = "") {
        fs::remove_all(folder / quality), fs::remove(folder / "calls.txt");
        EXPECT_EQ(run("large " + quality + " --quality " + quality + more).code, 9);
        const std::string call = text("calls.txt"), before = "/" + quality + "/run ";
        const std::size_t at = call.find(before);
        return at == call.npos ? call : call.substr(at + before.size());
    };
    EXPECT_EQ(flags("draft"), "--resolution 800 --iterations 800 --resume\n");
    EXPECT_EQ(flags("normal"), "--resume\n");
    EXPECT_EQ(flags("best"), "--resolution 3200 --resume\n");
    EXPECT_EQ(flags("best", " -r 4"), "--resolution 4 --resume\n");
    EXPECT_EQ(flags("draft", " -r 300 --time-budget 90.5"),
              "--resolution 300 --iterations 800 --time-budget 90.5 --resume\n");
}

TEST_F(Reconstruct, ControlPointsGoToTheSearchForCameras) {
    write("before_prepare", "exit 9");
    EXPECT_EQ(run("photos out --gcp list.txt --checkpoints a,b").code, 9);
    EXPECT_TRUE(text("calls.txt")
                    .ends_with("out/scene --gcp " + (folder / "list.txt").string() +
                               " --checkpoints a,b\n"))
        << text("calls.txt");
    fs::remove(folder / "calls.txt");
    EXPECT_EQ(run("photos out --gps").code, 9);
    EXPECT_TRUE(text("calls.txt").ends_with("out/scene --gps\n")) << text("calls.txt");
}

TEST_F(Reconstruct, AStoppedTrainingContinues) {
    const pid_t first = start("scene out");
    EXPECT_TRUE(until([&] {
        return text("out/run/log.jsonl").find("{\"iteration\": 50,") != std::string::npos;
    }));
    kill(first, SIGTERM);
    EXPECT_EQ(wait_for(first), 143);
    EXPECT_NE(text("err.txt").find("Stopped; the same command continues"), std::string::npos);
    EXPECT_FALSE(Record(folder / "out").is_done("train"));
    const Result r = run("scene out", "N=400; export N;");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_EQ(calls(), "train train extract-mesh view ");
    const JsonValue info = parse_json_value(text("out/run/config.json"), "config.json")["info"];
    EXPECT_GE(info["resumed_from"].number, 50);
}

TEST_F(Reconstruct, AStageThatEndsWhileStoppingIsKept) {
    write("before_prepare", "kill -TERM $PPID; sleep 5; exit 1");
    const Result lost = run("photos out");
    EXPECT_EQ(lost.code, 143);
    EXPECT_TRUE(lost.says("the same command searches the cameras anew")) << lost;
    write("before_prepare", "trap '' TERM; kill -TERM $PPID; sleep 0.5");
    const Result kept = run("photos out");
    EXPECT_EQ(kept.code, 143);
    EXPECT_TRUE(kept.says("the same command continues")) << kept;
    EXPECT_EQ(calls(), "prepare prepare ");
    // Killed, it ends its programs.
    write("before_train",
          "trap 'touch ended; exit 143' TERM; touch begun; while :; do sleep 0.02; done");
    const pid_t second = start("photos out");
    EXPECT_TRUE(until([&] { return fs::exists(folder / "begun"); }));
    // Another one does not start beside it.
    const Result r = run("photos out");
    EXPECT_EQ(r.code, 2) << r;
    EXPECT_TRUE(r.says("another tvsgs-reconstruct works there")) << r;
    kill(second, SIGKILL);
    EXPECT_EQ(wait_for(second), 137);
    EXPECT_TRUE(until([&] { return fs::exists(folder / "ended"); }));
    fs::remove(folder / "before_train");
    EXPECT_EQ(run("photos out").code, 0);
    EXPECT_EQ(calls(), "prepare prepare train train extract-mesh view ");
}

TEST_F(Reconstruct, BadInputIsRefusedBeforeAnythingRuns) {
    write("notes.txt", "text"), write("foreign/mine.txt", "mine"), write("one/a.png", "");
    const auto refused = [&](const std::string& arguments, int code, const std::string& part) {
        const Result r = run(arguments);
        EXPECT_EQ(r.code, code) << arguments << r;
        EXPECT_TRUE(r.says(part)) << arguments << r;
        EXPECT_EQ(calls(), "") << arguments;
        EXPECT_FALSE(fs::exists(folder / "out")) << arguments;
    };
    refused("nowhere out", 3, "no such folder or video");
    refused("notes.txt out", 3, "expected a folder or a video");
    refused("one out", 3, "1 photographs");
    refused("photos photos/out", 2, "lies inside photos");
    refused("scene scene", 2, "lies inside scene");
    refused("scene/images out", 2, "give the folder of that scene");
    refused("photos notes.txt", 2, "is a file");
    refused("photos foreign", 2, "has other files");
    refused("photos foreign --overwrite", 2, "has other files");
    refused("photos out --device gpu", 2, "expected auto, cpu, cuda or cuda:N");
    refused("photos out -r 0", 2, "expected -1, 1, 2, 4, 8 or a width in pixels");
    refused("photos out --time-budget -1", 2, "--time-budget");
    refused("photos out --quality high", 2, "expected one of draft,normal,best");
    refused("scene out --gcp list.txt", 2, "scene: has cameras already, --gcp");
    refused("photos", 2, "expected tvsgs-reconstruct PHOTOS OUT");
    EXPECT_EQ(text("foreign/mine.txt"), "mine");
    EXPECT_FALSE(fs::exists(folder / "photos/out"));
    fs::remove(folder / "bin/tvsgs-prepare");
    refused("photos out", 2, "tvsgs-prepare: not installed; install the package tvsgs-prepare");
    write("foreign/reconstruct.json", R"({"version": "other 1", "stages": []})");
    refused("scene foreign", 3, "not a file of tvsgs-reconstruct");
}

TEST(StageProgress, ReadsTheLinesOfThePrograms) {
    StageProgress mesh(kMesh);
    mesh.read("Input: 40 splats of RUN", 1);
    EXPECT_EQ(mesh.share(), 0);
    EXPECT_TRUE(std::isnan(mesh.left(1)));
    mesh.read(progress_text("depth maps", 62, 0.4, 3723, true), 10);
    EXPECT_DOUBLE_EQ(mesh.share(), 0.5 * 0.4);
    EXPECT_EQ(mesh.work(), "depth maps");
    EXPECT_DOUBLE_EQ(mesh.left(20), 3713);
    EXPECT_TRUE(std::isnan(mesh.left(3800)));
    mesh.read(progress_text("texture", 5, 0.5, NAN), 20);
    EXPECT_DOUBLE_EQ(mesh.share(), 0.85);
    EXPECT_TRUE(std::isnan(mesh.left(20)));
    mesh.read(progress_text("depth maps", 1, 0.1, 4), 30);
    EXPECT_DOUBLE_EQ(mesh.share(), 0.85);

    StageProgress training(kTrain);
    training.read(progress_text("stereo of 5 views", 12, 0.5, 12), 10);
    EXPECT_DOUBLE_EQ(training.share(), 0.15);
    training.read(" 33 %  100/300  0:11, about 0:24 left", 40);
    EXPECT_DOUBLE_EQ(training.share(), 0.3 + 0.7 * 0.33);
    EXPECT_EQ(training.work(), "");
    EXPECT_DOUBLE_EQ(training.left(44), 20);
    EXPECT_EQ(whole_text({&kPrepare, &kTrain, &kMesh, &kView}, kTrain, training, 100, 44),
              "Training, 2 of 4 1:40 [############........] 61 %  about 0:20 left in this step");
    EXPECT_EQ(whole_text({&kTrain, &kMesh, &kView}, kMesh, mesh, 100, 44),
              "Mesh, 2 of 3, depth maps 1:40 [##################..] 93 %");
}

}  // namespace
}  // namespace tvsgs::reconstruct
