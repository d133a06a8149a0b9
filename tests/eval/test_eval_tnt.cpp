// The command tvsgs-eval tnt on the official layout: numbers of the oracle, errors.
#include <cmath>
#include <cstdio>
#include <sstream>

#include "eval/eval_test.h"

namespace tvsgs {
namespace {

/// Ten cameras on a circle, in the format of a .log file; `scale` and `shift` move their frame.
std::string circle_log(int count, double scale = 1, double shift = 0, int first = 0) {
    std::string text;
    for (int i = 0; i < count; ++i) {
        const double angle = 0.6 * (i + first);
        char pose[200];
        std::snprintf(pose, sizeof pose,
                      "%d %d 0\n1 0 0 %.12f\n0 1 0 %.12f\n0 0 1 %.12f\n0 0 0 1\n", i + first,
                      i + first, scale * 2 * std::cos(angle) + shift, scale * 2 * std::sin(angle),
                      scale * 0.1 * (i + first));
        text += pose;
    }
    return text;
}

class EvalTnt : public EvalTest {
protected:
    void SetUp() override {
        EvalTest::SetUp();
        copy(kOracle / "tnt_gt.ply", "Bump/Bump.ply");
        copy(kOracle / "tnt_crop.json", "Bump/Bump.json");
        copy(kOracle / "tnt_trans.txt", "Bump/Bump_trans.txt");
        write("Bump/Bump_COLMAP_SfM.log", circle_log(10));
        copy(kOracle / "tnt_pred_mesh.ply", "mesh.ply");
    }
    std::string arguments(const std::string& more, const std::string& pred = "mesh.ply") const {
        return "tnt --scene-dir " + path("Bump") + " --pred " + path(pred) + " " + more;
    }
};

TEST_F(EvalTnt, AgreesWithTheOracle) {  // RESULTS.txt
    struct Row {
        const char* flags;
        double pred_voxels, gt_voxels, precision, recall, f1;
    };
    for (const Row& row :
         {Row{"--tau 0.02 --points vertices", 1394, 2604, 0.7051649928263989, 0.5591397849462365,
              0.6237195482804274},
          Row{"--tau 0.02", 2995, 2604, 0.7071786310517529, 0.5591397849462365, 0.624505973678391},
          Row{"--tau 0.05 --points vertices", 975, 1275, 1.0, 0.8258823529411765,
              0.904639175257732}}) {
        ASSERT_EQ(eval(arguments(std::string("--no-icp ") + row.flags)), 0) << messages;
        EXPECT_EQ(value("pred_voxels"), row.pred_voxels) << row.flags;
        EXPECT_EQ(value("gt_voxels"), row.gt_voxels) << row.flags;
        EXPECT_DOUBLE_EQ(value("precision"), row.precision) << row.flags;
        EXPECT_DOUBLE_EQ(value("recall"), row.recall) << row.flags;
        EXPECT_DOUBLE_EQ(value("f1"), row.f1) << row.flags;
    }
    EXPECT_EQ(eval(arguments("--no-icp --tau 0.02 --require 'f1>=0.7'")), 8);
}

TEST_F(EvalTnt, CurvesAndClouds) {
    ASSERT_EQ(eval(arguments("--no-icp --tau 0.02 --points vertices --results " + path("res"))), 0)
        << messages;
    std::ifstream oracle(kOracle / "tnt_curve_tau0.02.txt");
    std::istringstream precision(read("res/Bump.precision.txt")),
        recall(read("res/Bump.recall.txt"));
    std::string header;
    std::getline(oracle, header);
    double edge = 0, p = 0, r = 0, found_p = 0, found_r = 0;
    int rows = 0;
    for (; oracle >> edge >> p >> r; ++rows) {
        ASSERT_TRUE(precision >> found_p && recall >> found_r);
        ASSERT_NEAR(found_p, p, 1e-9);  // the file has nine digits
        ASSERT_NEAR(found_r, r, 1e-9);
    }
    EXPECT_EQ(rows, 499);
    EXPECT_FALSE(precision >> found_p);
    for (const char* name : {"res/Bump.prf_tau_plotstr.txt", "res/PR_Bump_@d_th_0_0200.svg",
                             "res/Bump.precision.ply", "res/Bump.recall.ply"})
        EXPECT_FALSE(read(name).empty()) << name;
    // The written transform can be used as input.
    const double f1 = value("f1");
    ASSERT_EQ(
        eval(arguments("--tau 0.02 --points vertices --align-file " + path("res/alignment.txt"))),
        0)
        << messages;
    EXPECT_EQ(value("f1"), f1);
}

TEST_F(EvalTnt, FlagsWithoutEffectAreRefused) {
    const std::string file = "--tau 0.02 --align-file " + path("Bump/Bump_trans.txt");
    expect_error(2, "--traj and --align-file exclude each other",
                 arguments(file + " --traj " + path("Bump/Bump_COLMAP_SfM.log")));
    expect_error(2, "--icp-intended and --align-file exclude each other",
                 arguments(file + " --icp-intended"));
    expect_error(2, "--no-icp and --icp-intended exclude each other",
                 arguments("--tau 0.02 --no-icp --icp-intended"));
    expect_error(2, "--traj-threshold 0.3: needs --traj FILE",
                 arguments("--tau 0.02 --traj-threshold 0.3"));
    expect_error(2, "--palette safe: needs --results DIR", arguments("--tau 0.02 --palette safe"));
    EXPECT_EQ(eval(arguments(file + " --no-icp")), 0) << "as it is: " << messages;
    EXPECT_NE(output.find("\"traj\": \"\""), std::string::npos) << output;
}

TEST_F(EvalTnt, IcpAgreesWithTheOracle) {  // perturbed start
    const double c = 1.01 * std::cos(0.02), s = 1.01 * std::sin(0.02);
    // The perturbation times the true transform [0 -2 0 .5; 2 0 0 -.25; 0 0 2 1].
    std::ostringstream trans;
    trans.precision(17);
    trans << -2 * s << ' ' << -2 * c << " 0 " << c * 0.5 + s * 0.25 + 0.01 << '\n'
          << 2 * c << ' ' << -2 * s << " 0 " << s * 0.5 - c * 0.25 - 0.008 << '\n'
          << "0 0 2.02 " << 1.01 + 0.012 << "\n0 0 0 1\n";
    write("Bump/Bump_trans.txt", trans.str());
    ASSERT_EQ(eval(arguments("--tau 0.02 --points vertices")), 0) << messages;
    const std::size_t second = output.find("\"source\": 1438, \"target\": 2604");
    EXPECT_NE(output.find("\"source\": 1414, \"target\": 1888"), std::string::npos) << output;
    EXPECT_NE(second, std::string::npos) << output;
    EXPECT_NE(output.find("\"source\": 1438, \"target\": 2604", second + 1), std::string::npos);
    EXPECT_NEAR(value("rmse"), 0.012162, 1e-6);  // of the first stage, to the given digits
    EXPECT_NE(output.find("\"rmse\": 0.010555"), std::string::npos) << output;
    EXPECT_NEAR(value("precision"), 1, 1e-12);
    EXPECT_NEAR(value("recall"), 0.802995, 1e-6);
    EXPECT_NEAR(value("f1"), 0.890735, 1e-6);
    EXPECT_EQ(eval(arguments("--tau 0.02 --icp-intended")), 0) << messages;
}

TEST_F(EvalTnt, Trajectories) {
    const auto f1 = [&](const std::string& more) {
        EXPECT_EQ(eval(arguments("--no-icp --tau 0.02 --points vertices " + more)), 0) << messages;
        return value("f1");
    };
    const double expected = f1("");
    // The same frame from another file: the cameras give the transform of trans.txt.
    write("same.log", circle_log(10) + "\n");
    EXPECT_NEAR(f1("--traj " + path("same.log")), expected, 1e-9);
    EXPECT_NE(output.find("\"matched_by\": \"row\", \"pairs\": 10, \"inliers\": 10"),
              std::string::npos)
        << output;
    // A subset is matched by image index.
    write("some.log", circle_log(7, 1, 0, 2));
    EXPECT_NEAR(f1("--traj " + path("some.log")), expected, 1e-9);
    // Another length, with indices that do not fit.
    write("short.log", circle_log(5));
    expect_error(3, "E_TNT_TRAJ", arguments("--tau 0.02 --traj " + path("short.log")));
    write("foreign.log", circle_log(9, 1, 0, 100));
    expect_error(3, "0 match the 10", arguments("--tau 0.02 --traj " + path("foreign.log")));
    // Another reconstruction: the same number of cameras at other places.
    std::string other;
    for (int i = 0; i < 10; ++i)
        other += std::to_string(i) + " " + std::to_string(i) + " 0\n1 0 0 " +
                 std::to_string(i * i % 7) + "\n0 1 0 " + std::to_string(i * 3 % 5) + "\n0 0 1 " +
                 std::to_string(i * 5 % 8) + "\n0 0 0 1\n";
    write("other.log", other);
    expect_error(3, "E_TNT_TRAJ_RESIDUAL", arguments("--tau 0.02 --traj " + path("other.log")));
    EXPECT_NE(messages.find("median error"), std::string::npos) << messages;
    write("cut.log", circle_log(10).substr(0, 400));
    expect_error(3, "line ", arguments("--tau 0.02 --traj " + path("cut.log")));
    write("nan.log", "0 0 0\n1 0 0 nan\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    expect_error(3, "not finite", arguments("--tau 0.02 --traj " + path("nan.log")));
}

TEST_F(EvalTnt, BadInput) {
    EXPECT_EQ(eval(arguments("")), 2) << messages;  // no threshold is known for "Bump"
    EXPECT_NE(messages.find("--tau"), std::string::npos);
    EXPECT_EQ(eval(arguments("--tau 0")), 2);
    EXPECT_EQ(eval(arguments("--tau 0.02 --points some")), 2);
    write_ply("empty.ply", "");
    expect_error(3, "no vertices", arguments("--tau 0.02", "empty.ply"));
    write_ply("nan.ply", "nan 0 0\n", "");
    expect_error(3, "not finite", arguments("--tau 0.02", "nan.ply"));
    // Another frame, and a wrong unit: the error reports the offset.
    std::string shifted;
    for (int i = 0; i < 100; ++i)
        shifted += std::to_string(50 + i % 10 * 0.1) + " " + std::to_string(i / 10 * 0.1) + " 0\n";
    write_ply("shifted.ply", shifted);
    expect_error(3, "E_TNT_FRAME", arguments("--tau 0.02", "shifted.ply"));
    EXPECT_NE(messages.find("its centre is off by"), std::string::npos) << messages;
    EXPECT_EQ(eval(arguments("--tau 0.02 --no-icp --force", "shifted.ply")), 3);
    EXPECT_NE(messages.find("E_TNT_EMPTY"), std::string::npos) << messages;
    EXPECT_NE(output.find("\"f1\": null"), std::string::npos) << output;
    // An empty crop.
    std::string crop = read("Bump/Bump.json");
    const std::size_t at = crop.find("\"axis_min\": -0.1");
    ASSERT_NE(at, std::string::npos);
    crop.replace(at, 16, "\"axis_min\": 0.49");
    write("Bump/Bump.json", crop);
    expect_error(3, "E_CROP", arguments("--tau 0.02"));
}

TEST_F(EvalTnt, MissingFiles) {
    for (const char* name : {"Bump.ply", "Bump.json", "Bump_trans.txt"}) {
        fs::rename(folder / "Bump" / name, folder / "away");
        expect_error(3, std::string(name) + ": not found", arguments("--tau 0.02"));
        EXPECT_NE(messages.find("tanksandtemples.org"), std::string::npos) << messages;
        fs::rename(folder / "away", folder / "Bump" / name);
    }
    fs::remove(folder / "Bump/Bump_COLMAP_SfM.log");
    expect_error(3, "0 files *_COLMAP_SfM.log", arguments("--tau 0.02"));
    write("Bump/Bump_trans.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 1\n");
    write("Bump/Bump_COLMAP_SfM.log", circle_log(10));
    expect_error(3, "E_TNT_TRANS", arguments("--tau 0.02"));
}

TEST_F(EvalTnt, RenderedSceneByItsColmapModel) {
    const fs::path scene = kShared / "data/stone_bust";
    if (!fs::exists(scene)) GTEST_SKIP() << "absent: " << scene;
    // The truth itself, in the frame of the training cameras: all of it must agree.
    ASSERT_EQ(
        eval("tnt --no-icp --tau 1 --pred " + (scene / "gt/points.ply").string() + " --scene-dir " +
             (scene / "tnt_eval").string() + " --traj " + (scene / "sparse/0").string()),
        0)
        << messages;
    EXPECT_EQ(value("inliers"), 40);
    EXPECT_LT(value("median_residual"), 1e-6);  // mm; the log has twelve digits
    // Both are samples of the visible surface, one per 3 mm^2. Recall and precision count points
    // with a sample of the other within 1 mm, and are close, as both are equally dense.
    EXPECT_NEAR(value("precision"), value("recall"), 0.02);
    // In the log's own frame it is far off.
    expect_error(3, "E_TNT_FRAME",
                 "tnt --tau 1 --pred " + (scene / "gt/points.ply").string() + " --scene-dir " +
                     (scene / "tnt_eval").string());
}

}  // namespace
}  // namespace tvsgs
