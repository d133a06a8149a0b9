// The command tvsgs-eval dtu on the official layout: numbers of the oracle, errors.
#include "core/scene/image.h"
#include "eval/eval_test.h"
#include "io/images/image_file.h"
#include "io/scene/scene_layout.h"
#include "io/splats/ply.h"

namespace tvsgs {
namespace {

class EvalDtu : public EvalTest {
protected:
    void SetUp() override {
        EvalTest::SetUp();
        copy(kOracle / "dtu_gt.ply", "dtu/Points/stl/stl001_total.ply");
        copy(kOracle / "dtu_obsmask.mat", "dtu/ObsMask/ObsMask1_10.mat");
        copy(kOracle / "dtu_plane.mat", "dtu/ObsMask/Plane1.mat");
        copy(kOracle / "dtu_pred_mesh.ply", "mesh.ply");
    }
    std::string arguments(const std::string& pred, const std::string& more = "") const {
        return "dtu --scan 1 --dtu " + path("dtu") + " --pred " + path(pred) + " " + more;
    }
    /// Compares numbers of the output to 1e-9.
    void expect_values(std::initializer_list<std::pair<const char*, double>> expected) const {
        for (const auto& [key, number] : expected)
            EXPECT_NEAR(value(key), number, 1e-9 * number) << key;
    }
};

TEST_F(EvalDtu, AgreesWithTheOracle) {  // RESULTS.txt
    ASSERT_EQ(eval(arguments("mesh.ply", "--order given --require 'chamfer<=0.16' --out " +
                                             path("result.json"))),
              0)
        << messages;
    EXPECT_EQ(read("result.json"), output);
    expect_values({{"accuracy", 0.19220965293032716},
                   {"completeness", 0.12557268994551368},
                   {"chamfer", 0.15889117143792042},
                   {"median_accuracy", 0.17862040167952592},
                   {"median_completeness", 0.12246521149733028},
                   {"sampled", 6402},
                   {"thinned", 4460},
                   {"in_box", 4451},
                   {"observed", 4449},
                   {"gt_above_plane", 2529},
                   {"accuracy_outliers", 1},
                   {"completeness_outliers", 50}});

    ASSERT_EQ(eval(arguments("mesh.ply", "--order given --mode points")), 0) << messages;
    expect_values({{"chamfer", 0.34137980967239967}});
    EXPECT_EQ(value("observed"), 267);

    // Another order of thinning changes 1 % on this small case.
    ASSERT_EQ(eval(arguments("mesh.ply")), 0) << messages;
    EXPECT_NEAR(value("chamfer"), 0.158, 0.0016);
    EXPECT_EQ(eval(arguments("mesh.ply", "--require 'chamfer<=0.1'")), 8);
}

TEST_F(EvalDtu, ErrorClouds) {
    ASSERT_EQ(eval(arguments("mesh.ply", "--clouds " + path("clouds"))), 0) << messages;
    EXPECT_NE(read("clouds/accuracy.ply").find("property uchar red"), std::string::npos);
    EXPECT_NE(read("clouds/completeness.ply").find("element vertex 3450\n"), std::string::npos);
    const std::string official = read("clouds/accuracy.ply");
    ASSERT_EQ(eval(arguments("mesh.ply", "--palette safe --clouds " + path("clouds"))), 0);
    EXPECT_NE(read("clouds/accuracy.ply"), official);
}

TEST_F(EvalDtu, FlagsWithoutEffectAreRefused) {
    for (const auto& [flags, owner] : std::initializer_list<std::pair<const char*, const char*>>{
             {"--cull all", "--cull-masks DIR"},
             {"--cull first:3", "--cull-masks DIR"},
             {"--cull-dilate 24", "--cull-masks DIR"},
             {"--order given --seed 3", "--order seeded"},
             {"--palette safe", "--clouds DIR"}})
        expect_error(2, std::string(": needs ") + owner, arguments("mesh.ply", flags));
    EXPECT_EQ(eval(arguments("mesh.ply", "--cull none")), 0) << "as it is: " << messages;
    EXPECT_EQ(eval(arguments("mesh.ply", "--order seeded --seed 3")), 0) << messages;
}

TEST_F(EvalDtu, MissingFilesAreNamed) {
    fs::remove(folder / "dtu/ObsMask/Plane1.mat");
    expect_error(3, "dtu/ObsMask/Plane1.mat: not found", arguments("mesh.ply"));
    EXPECT_NE(messages.find("SampleSet.zip"), std::string::npos) << messages;
    expect_error(3, "stl002_total.ply: not found",
                 "dtu --scan 2 --dtu " + path("dtu") + " --pred " + path("mesh.ply"));
    EXPECT_NE(messages.find("DIR/ObsMask/Plane2.mat"), std::string::npos) << messages;
    // The layout as unpacked from SampleSet.zip.
    fs::create_directories(folder / "other/SampleSet");
    copy(kOracle / "dtu_plane.mat", "dtu/ObsMask/Plane1.mat");
    expect_error(3, "nothing.ply", arguments("nothing.ply"));
    fs::rename(folder / "dtu", folder / "other/SampleSet/MVS Data");
    EXPECT_EQ(eval("dtu --scan 1 --dtu " + path("other") + " --pred " + path("mesh.ply")), 0)
        << messages;
}

TEST_F(EvalDtu, DamagedMaskFiles) {
    const std::string whole = read("dtu/ObsMask/ObsMask1_10.mat");
    for (std::size_t size = 0; size < whole.size(); size += 41) {
        write("dtu/ObsMask/ObsMask1_10.mat", whole.substr(0, size));
        EXPECT_EQ(eval(arguments("mesh.ply")), 3) << size << ": " << messages;
        EXPECT_NE(messages.find("E_MAT"), std::string::npos) << messages;
    }
    copy(kOracle / "dtu_plane.mat", "dtu/ObsMask/ObsMask1_10.mat");
    expect_error(3, "no variable 'ObsMask'", arguments("mesh.ply"));
    write("dtu/ObsMask/ObsMask1_10.mat", "\x89HDF\r\n" + whole);
    expect_error(3, "E_MAT_V73", arguments("mesh.ply"));
}

TEST_F(EvalDtu, BadMeshes) {
    write_ply("empty.ply", "");
    expect_error(3, "no vertices", arguments("empty.ply"));
    write_ply("nan.ply", "nan 0 0\n0 nan 0\n0 0 inf\n", "3 0 1 2\n");
    expect_error(3, "3 not finite", arguments("nan.ply"));
    // A bad vertex removes its face; the rest is measured.
    write_ply("some.ply", "0 0 5\n1 0 5\n0 1 5\nnan 0 0\n", "3 0 1 2\n3 0 1 3\n");
    EXPECT_EQ(eval(arguments("some.ply", "--force")), 0) << messages;
    EXPECT_EQ(value("dropped_not_finite"), 1);
    // Faces without area: only the vertices remain.
    write_ply("flat.ply", "0 0 5\n4 0 4\n-4 0 4\n0 4 -4\n", "3 0 0 1\n3 1 1 1\n");
    EXPECT_EQ(eval(arguments("flat.ply")), 0) << messages;
    EXPECT_EQ(value("sampled"), 4);
    // No face at all in mode mesh.
    write_ply("points.ply", "0 0 5\n4 0 4\n-4 0 4\n0 4 -4\n");
    EXPECT_EQ(eval(arguments("points.ply", "--mode mesh")), 0) << messages;
    EXPECT_NE(messages.find("no faces"), std::string::npos) << messages;
    // Billions of samples.
    write_ply("huge.ply", "0 0 5\n4 0 4\n-4 0 4\n0 9e5 0\n9e5 0 0\n0 0 1\n", "3 3 4 5\n");
    expect_error(3, "E_DTU_SAMPLES", arguments("huge.ply", "--force"));
}

TEST_F(EvalDtu, AnotherFrame) {
    std::string shifted, normalised;
    for (int i = 0; i < 200; ++i) {
        const double x = 5 * std::cos(i), y = 5 * std::sin(i);
        shifted += std::to_string(x + 700) + " " + std::to_string(y) + " 0\n";
        normalised += std::to_string(x / 200) + " " + std::to_string(y / 200) + " 0\n";
    }
    write_ply("shifted.ply", shifted);
    expect_error(3, "E_DTU_FRAME", arguments("shifted.ply"));
    EXPECT_NE(messages.find("off by (699.8"), std::string::npos) << messages;
    write_ply("normalised.ply", normalised);
    expect_error(3, "scale_mat", arguments("normalised.ply"));
    // With --force it is measured: no point is in the box, so there is no metric.
    EXPECT_EQ(eval(arguments("shifted.ply", "--force")), 3);
    EXPECT_NE(messages.find("E_DTU_EMPTY"), std::string::npos) << messages;
    EXPECT_NE(output.find("\"chamfer\": null"), std::string::npos) << output;
    EXPECT_EQ(eval(arguments("mesh.ply", "--mesh-units normalised")), 2) << messages;
}

/// The rendered scene with its masks and cameras, in DTU's layout.
class EvalDtuScene : public EvalTest {
protected:
    fs::path scene = kShared / "data/ycb_table";
    void SetUp() override {
        EvalTest::SetUp();
        if (!fs::exists(scene)) GTEST_SKIP() << "absent: " << scene;
    }
    std::string arguments(const std::string& more) const {
        return "dtu --scan 901 --spacing 2 --dtu " + (scene / "dtu_eval").string() + " --pred " +
               (scene / "gt/mesh.ply").string() + " " + more;
    }
    std::string masks() const {
        return "--cull-masks " + (scene / "masks").string() + " --cameras " +
               (scene / "dtu_eval/cameras_sphere.npz").string() + " ";
    }
};

TEST_F(EvalDtuScene, CullingIsAnOption) {
    ASSERT_EQ(eval(arguments("")), 0) << messages;
    EXPECT_EQ(value("culled"), 0);
    const double all_vertices = value("vertices");
    ASSERT_EQ(eval(arguments(masks())), 0) << messages;
    const double by_all = value("culled");
    ASSERT_EQ(eval(arguments(masks() + "--cull first:3")), 0) << messages;
    const double by_three = value("culled");
    ASSERT_EQ(eval(arguments(masks() + "--cull 0,1,2")), 0) << messages;
    EXPECT_EQ(value("culled"), by_three);
    ASSERT_EQ(eval(arguments(masks() + "--cull-dilate 0")), 0) << messages;
    EXPECT_GT(value("culled"), by_all);
    EXPECT_GT(by_all, by_three);
    EXPECT_LT(by_all, 0.5 * all_vertices);  // the objects remain
    ASSERT_EQ(eval(arguments(masks() + "--cull none")), 0) << messages;
    EXPECT_EQ(value("culled"), 0);
    EXPECT_EQ(eval(arguments(masks() + "--cull first:50")), 2);
    EXPECT_EQ(eval(arguments(masks() + "--cull 0,49")), 2);
    EXPECT_EQ(eval(arguments(masks() + "--cull some")), 2);
}

TEST_F(EvalDtuScene, NormalisedSplatCentres) {
    // Points of the truth as splats in the normalised frame; every second one is nearly
    // transparent.
    const NpzCameras cameras = read_npz_cameras((scene / "dtu_eval/cameras_sphere.npz").string());
    const auto truth = read_ply((scene / "gt/points_train_3.ply").string()).points.positions;
    std::vector<Vec3f> means, log_scales, sh;
    std::vector<Quatf> quats;
    std::vector<float> logits;
    for (std::size_t i = 0; i < truth.size(); i += 20) {
        means.push_back(
            vec_cast<float>((vec_cast<double>(truth[i]) - cameras.offset) / cameras.scale));
        log_scales.push_back({-5, -5, -9}), quats.push_back({}), sh.push_back({});
        logits.push_back(i % 40 == 0 ? 3.0f : -6.0f);
    }
    Gaussians<Cpu> splats;
    splats.sh_degree = 0;
    tvsgs::copy(means, splats.means), tvsgs::copy(log_scales, splats.log_scales);
    tvsgs::copy(quats, splats.quats), tvsgs::copy(logits, splats.opacity_logits);
    tvsgs::copy(sh, splats.sh);
    write_splat_ply(path("splats.ply"), splats);
    const std::string command =
        "dtu --scan 901 --dtu " + (scene / "dtu_eval").string() + " --pred " + path("splats.ply");
    ASSERT_EQ(eval(command + " --cameras " + (scene / "dtu_eval/cameras_sphere.npz").string()), 0)
        << messages;
    EXPECT_NE(output.find("\"units\": \"normalised"), std::string::npos) << output;
    EXPECT_NE(output.find("\"measured\": \"splat centres\""), std::string::npos) << output;
    // The truth is another sample of the same surface, a point per 1 mm^2: half a spacing off.
    EXPECT_LT(value("accuracy"), 1);
    EXPECT_EQ(value("sampled"), static_cast<double>(means.size()));
    ASSERT_EQ(eval(command + " --min-opacity 0.5 --cameras " +
                   (scene / "dtu_eval/cameras_sphere.npz").string()),
              0)
        << messages;
    EXPECT_NEAR(value("sampled"), 0.5 * static_cast<double>(means.size()), 1);
    // Without the scale matrix they are in another frame.
    expect_error(3, "E_DTU_FRAME", command);
    expect_error(
        3, "E_DTU_FRAME",
        command + " --mesh-units mm --cameras " + (scene / "dtu_eval/cameras_sphere.npz").string());
}

TEST_F(EvalDtuScene, WrongMasks) {
    fs::create_directories(folder / "masks");
    expect_error(3, "no cameras.npz", arguments("--cull-masks " + path("masks")));
    copy(scene / "dtu_eval/cameras_sphere.npz", "cameras_sphere.npz");
    expect_error(3, "E_MASK_COUNT", arguments("--cull-masks " + path("masks")));
    for (int i = 0; i < 49; ++i)
        write_png(path("masks/" + std::to_string(1000 + i) + ".png"), ImageU8(800, 600, 1));
    expect_error(3, "E_CULL_ALL", arguments("--cull-masks " + path("masks")));
    fs::remove(path("masks/1000.png"));
    write_png(path("masks/1000.png"), ImageU8(80, 60, 1));
    expect_error(3, "E_MASK_SIZE", arguments("--cull-masks " + path("masks")));
    const std::string npz = read("cameras_sphere.npz");
    write("cameras_sphere.npz", npz.substr(0, npz.size() / 2));
    expect_error(3, "cameras_sphere.npz", arguments("--cull-masks " + path("masks")));
}

}  // namespace
}  // namespace tvsgs
