// Scenes that are odd but right, and scenes that are wrong: what training makes of them.
#include <cmath>
#include <sstream>

#include "command_test.h"
#include "io/images/image_file.h"

namespace tvsgs {
namespace {

class OddScenes : public CommandTest {
protected:
    /// The points of the model, seen by views 0, 1 and 2 (images 1, 2, 3 of the model).
    static void write_points(const std::string& scene, const std::vector<std::string>& positions) {
        std::string text;
        for (std::size_t i = 0; i < positions.size(); ++i)
            text += std::to_string(i + 1) + " " + positions[i] + " 90 80 70 0.5 1 0 2 0 3 0\n";
        write(scene + "/sparse/0/points3D.txt", text);
        // Without the observations, which contradict the new positions.
        std::istringstream in(read(model_file(scene, "images")));
        std::string images;
        int record = 0;
        for (std::string l; std::getline(in, l);)
            images += l.starts_with('#') ? "" : record++ % 2 == 0 ? l + "\n" : "\n";
        write(model_file(scene, "images"), images);
    }
    /// The same scene in another unit of length.
    static void scale_model(const std::string& scene, double factor) {
        const auto rewrite = [&](const char* name, int first, int every) {
            std::istringstream in(read(model_file(scene, name)));
            std::string text;
            int record = 0;
            for (std::string line; std::getline(in, line);) {
                if (line.starts_with('#') || record++ % every != 0) {
                    text += line + "\n";
                    continue;
                }
                std::istringstream words(line);
                std::string word;
                for (int i = 0; words >> word; ++i)
                    text += (i >= first && i < first + 3
                                 ? nlohmann::json(factor * std::stod(word)).dump()
                                 : word) +
                            " ";
                text += "\n";
            }
            write(model_file(scene, name), text);
        };
        rewrite("images", 5, 2);
        rewrite("points3D", 1, 1);
    }
    static std::string model_file(const std::string& scene, const char* name) {
        return scene + "/sparse/0/" + name + ".txt";
    }
    static constexpr const char* kSparseConfig =
        " --config " TVSGS_SOURCE_DIR "/configs/pgsr_sparse.json ";
    static constexpr const char* kSparse =
        " --config " TVSGS_SOURCE_DIR "/configs/pgsr_sparse.json --views 0,1,2 ";
};

TEST_F(OddScenes, FilesThatNoViewNamesAreLeftAlone) {
    expect_trained("--scene scene --views 0,1,2", "plain");
    copy_scene("extra");
    fs::copy(folder_ / "scene/images/0000.png", folder_ / "extra/images/another.png");
    write("extra/images/notes.txt", "not an image");
    write("extra/images/.hidden.png", "not an image either");
    expect_trained("--scene extra --views 0,1,2", "with_extra");
    EXPECT_TRUE(splats("with_extra") == splats("plain"));
}

TEST_F(OddScenes, AnyUnitOfLength) {
    const auto trained = [](const std::string& scene, const std::string& run) {
        const Result r = expect_trained("--eval --scene " + scene + kSparseConfig, run);
        return std::pair{last_line(run).at("psnr").get<double>(), r};
    };
    const double usual = trained("scene", "metres").first;
    const auto near = [](const std::string& run) {
        return json::parse(read(run + "/config.json")).at("render").at("near").get<double>();
    };
    EXPECT_FLOAT_EQ(static_cast<float>(near("metres")), 0.2f);
    for (const double factor : {1e-3, 1e3}) {
        const std::string name = factor < 1 ? "kilometres" : "millimetres";
        copy_scene(name);
        scale_model(name, factor);
        const auto [psnr, said] = trained(name, "of_" + name);
        // The same numbers but for their roundings.
        EXPECT_NEAR(psnr, usual, 0.1) << name;
        EXPECT_EQ(said.says("render.near to"), factor < 1) << said;
    }
    EXPECT_LT(near("of_kilometres"), 0.002);
    EXPECT_GT(near("of_kilometres"), 1e-5);
    // A limit that is given is kept, and hides the scene.
    const Result r = train("--eval --scene kilometres --out hidden --set render.near=0.1");
    EXPECT_EQ(r.code, 0) << r;
    EXPECT_FALSE(r.says("render.near to")) << r;
    EXPECT_LT(last_line("hidden").at("psnr").get<double>(), usual);
}

TEST_F(OddScenes, MarksAndCarriageReturnsOfEditors) {
    expect_trained("--scene scene --views 0,1,2", "unedited");
    copy_scene("edited");
    for (const char* name : {"cameras", "images", "points3D"}) {
        std::string text = "\xEF\xBB\xBF";
        for (const char c : read(model_file("scene", name)))
            text += c == '\n' ? std::string("\r\n") : std::string(1, c);
        write(model_file("edited", name), text);
    }
    expect_trained("--scene edited --views 0,1,2", "of_edited");
    EXPECT_TRUE(splats("of_edited") == splats("unedited"));
    // Lists and configurations come from the same editors.
    write("list.txt",
          "\xEF\xBB\xBF"
          "0000.png\r\n0001.png\r\n0002.png\r\n");
    write("config.json",
          "\xEF\xBB\xBF{\"plan\": {\"enabled\": true}, \"scene\": {\"path\": \"scene\"}}\r\n");
    expect_trained("--config config.json --train-list list.txt", "of_list");
    EXPECT_TRUE(splats("of_list") == splats("unedited"));
}

TEST_F(OddScenes, ALocaleThatWritesCommas) {
    // Debian has the definitions, compiled or not; where neither is there, nothing can be shown.
    const Result made = shell(
        "mkdir -p locales && localedef -i de_DE -f UTF-8 locales/de_DE.UTF-8"
        " >out.txt 2>err.txt; test -d locales/de_DE.UTF-8");
    const std::string locale = "LOCPATH=$PWD/locales LC_ALL=de_DE.UTF-8 ";
    // env: the shell's own printf knows no locale.
    const Result comma = shell(locale + "env printf %.1f 1,5 >out.txt 2>err.txt");
    if (made.code != 0 || comma.out != "1,5") GTEST_SKIP() << "no German locale on this machine";
    const std::string arguments =
        " --device cpu --iterations 6 --set init.min_points=0 --scene "
        "scene --views 0,1,2 --set lr.scale=0.0025 --quiet --out ";
    const std::string tool = "OMP_NUM_THREADS=1 " TVSGS_BIN_DIR "/tvsgs-train";
    ASSERT_EQ(shell(tool + arguments + "english >out.txt 2>err.txt").code, 0);
    const Result r = shell(locale + tool + arguments + "german >out.txt 2>err.txt");
    ASSERT_EQ(r.code, 0) << r;
    EXPECT_TRUE(splats("german") == splats("english"));
    EXPECT_EQ(json::parse(read("german/config.json")).at("lr").at("scale").get<float>(), 0.0025f);
}

TEST_F(OddScenes, FewPointsAndPointsInOnePlace) {
    copy_scene("points");
    const auto with = [&](const std::vector<std::string>& positions, const std::string& run) {
        write_points("points", positions);
        return expect_trained("--scene points" + std::string(kSparse) +
                                  "--force --set init.min_points=0 --set tv.start=1",
                              run);
    };
    EXPECT_TRUE(with({"0.1 0.1 0.1"}, "one").says("tensor voting is off: 1 of 1 splats"));
    with({"0.1 0.1 0.1", "0.2 0.1 0.1"}, "two");
    const std::vector<std::string> same(50, "0.1 0.1 0.1");
    EXPECT_TRUE(with(same, "identical").says("dropped 49 points: repeated positions"));
    std::vector<std::string> line;
    for (int i = 0; i < 50; ++i) line.push_back("0." + std::to_string(100 + i) + " 0.1 0.1");
    with(line, "collinear");
    // More neighbours are asked for than there are splats.
    const Result few = expect_trained(
        "--scene points" + std::string(kSparse) + "--force --set init.min_points=0 --set tv.k=512",
        "fewer_than_k");
    EXPECT_FALSE(few.says("tensor voting is off")) << few;

    expect_refused("--scene points --views 0,1,2", 3, "50 start points on ");
    expect_trained("--scene points --views 0,1,2 --force", "forced");
    write_points("points", {"nan 0 0", "0 inf 0", "1e10 0 0"});
    for (const char* force : {"", " --force"})
        expect_refused("--scene points --views 0,1,2" + std::string(force), 3, "E_FEW_POINTS");
    // Stereo finds no surface in pictures this small.
    const Result coarse = call("train",
                               "--device cpu --iterations 6 --scene points --views 0,1,2 --out "
                               "coarse");
    EXPECT_EQ(coarse.code, 0) << coarse;
    EXPECT_TRUE(coarse.says("dropped 3 points: positions not finite")) << coarse;
    EXPECT_TRUE(coarse.says("stereo found no surface")) << coarse;
    EXPECT_TRUE(coarse.says("rough points (a coarse sweep of the views)")) << coarse;
}

TEST_F(OddScenes, ViewsThatDoNotOverlap) {
    // Opposite sides of the object.
    expect_trained("--scene scene --views 0,4 --config " TVSGS_SOURCE_DIR
                   "/configs/pgsr_sparse.json",
                   "apart");
    const Result r = expect_trained("--scene scene --views 0,4 --config " TVSGS_SOURCE_DIR
                                    "/configs/pgsr_dense.json --set "
                                    "loss.multi_view_ncc.start=1 --set "
                                    "loss.multi_view_geometry.start=1",
                                    "no_neighbour");
    EXPECT_TRUE(r.says("Multi-view losses are off for 2 of 2 training views")) << r;
    EXPECT_TRUE(r.says("depths and")) << "how far the nearest are: " << r;
    // Every third view sees what no other sees.
    expect_trained("--scene scene --views 0,3,6", "three_apart");
    expect_refused("--scene scene --views 4", 3, "1 training views; expected at least 2");
}

TEST_F(OddScenes, MasksThatHideEverything) {
    copy_scene("dark");
    for (const auto& mask : fs::directory_iterator(folder_ / "dark/masks"))
        write_png(mask.path().string(), ImageU8(48, 36, 1));
    expect_refused("--scene dark --views 0,1,2", 3, "E_MASKS: all 3 masks are empty");
    const Result r = expect_trained("--scene dark --views 0,1,2 --mask-use none", "of_dark");
    EXPECT_TRUE(r.says("3 of 3 masks are empty")) << r;
    const Result mesh = call("extract-mesh", "--model of_dark --device cpu --voxel-size 0.05");
    EXPECT_EQ(mesh.code, 7) << mesh;
    EXPECT_TRUE(mesh.says("outside of the masks")) << mesh;
    EXPECT_FALSE(fs::exists(folder_ / "of_dark/mesh/mesh.glb"));
    // 0 and 1 where 255 is meant:
    ImageU8 small(48, 36, 1);
    small.pixels.assign(small.pixels.size(), 1);
    write_png((folder_ / "dark/masks/0001.png").string(), small);
    EXPECT_TRUE(call("train", "--scene dark --views 1,2 --iterations 1 --device cpu --out ones")
                    .says("0001.png: its largest value is 1, and the object needs 128"));
    EXPECT_EQ(
        call("extract-mesh", "--model of_dark --device cpu --voxel-size 0.05 --no-masks").code, 0);
}

TEST_F(OddScenes, NamesInSubfoldersAndBeyondAscii) {
    copy_scene("names");
    const std::vector<std::string> names = {"left camera/\u5199\u771f.png",
                                            "right/\u5199\u771f.png", "right/a.b.png"};
    std::string text = read(model_file("scene", "images"));
    for (std::size_t i = 0; i < names.size(); ++i) {
        const std::string old = "000" + std::to_string(i) + ".png";
        text.replace(text.find(" " + old) + 1, old.size(), names[i]);
        fs::create_directories((folder_ / "names/images" / names[i]).parent_path());
        fs::rename(folder_ / "names/images" / old, folder_ / "names/images" / names[i]);
    }
    write(model_file("names", "images"), text);
    fs::remove_all(folder_ / "names/masks");
    write("names/splits.json",
          "{\"some\": [\"left camera/\u5199\u771f.png\", \"right/\u5199\u771f\", \"a.b.png\"], "
          "\"test\": [\"0003.png\"]}");
    expect_trained("--scene names --split some", "of_names");
    const json cameras = json::parse(read("of_names/cameras.json"));
    ASSERT_EQ(cameras.size(), 4u);
    EXPECT_EQ(cameras[0].at("img_name"), names[0]);
    // The stem alone says not which of the two.
    write("list.txt", "\u5199\u771f\n0004\n");
    expect_refused("--scene names --train-list list.txt", 3, "fits several images");
}

TEST_F(OddScenes, EveryDistortionThatIsUndone) {
    const struct {
        const char *name, *params, *zeros;
        bool fisheye;  // even without coefficients
    } models[] = {{"SIMPLE_PINHOLE", "57 24 18", "", false},
                  {"PINHOLE", "57 57 24 18", "", false},
                  {"SIMPLE_RADIAL", "57 24 18 ", "0", false},
                  {"RADIAL", "57 24 18 ", "0 0", false},
                  {"OPENCV", "57 57 24 18 ", "0 0 0 0", false},
                  {"FULL_OPENCV", "57 57 24 18 ", "0 0 0 0 0 0 0 0", false},
                  {"OPENCV_FISHEYE", "57 57 24 18 ", "0 0 0 0", true},
                  {"SIMPLE_RADIAL_FISHEYE", "57 24 18 ", "0", true},
                  {"RADIAL_FISHEYE", "57 24 18 ", "0 0", true},
                  {"THIN_PRISM_FISHEYE", "57 57 24 18 ", "0 0 0 0 0 0 0 0", true},
                  {"FOV", "57 57 24 18 ", "0", false},
                  {"SIMPLE_FISHEYE", "57 24 18", "", true},
                  {"FISHEYE", "57 57 24 18", "", true}};
    copy_scene("lens");
    std::string pinhole;
    for (const auto& model : models)
        for (const bool bent : {false, true}) {
            if (bent && *model.zeros == 0) continue;
            std::string last = model.zeros;
            if (bent) last.replace(0, 1, "0.01");
            write(model_file("lens", "cameras"),
                  "1 " + std::string(model.name) + " 48 36 " + model.params + last + "\n");
            const std::string what = std::string(model.name) + (bent ? "_bent" : "");
            const Result r = expect_trained("--scene lens --views 0,1 --iterations 1 ", what, 1);
            EXPECT_EQ(r.says("Undistorted lens " + std::string(model.name) + ": "),
                      model.fisheye || bent)
                << r;
            const std::string result = splats(what, 1);
            if (pinhole.empty()) pinhole = result;
            if (!model.fisheye && !bent) {
                EXPECT_TRUE(result == pinhole) << what << ": coefficients of 0 bend nothing";
            }
        }
    write(model_file("lens", "cameras"),
          "1 RAD_TAN_THIN_PRISM_FISHEYE 48 36 57 57 24 18 0 0 0 0 0 0 0 0 0 0 0 0\n");
    expect_refused("--scene lens --views 0,1", 3, "camera 1 uses RAD_TAN_THIN_PRISM_FISHEYE");
}

TEST_F(OddScenes, MeasuredPointsThatAreNotFinite) {
    // The priors that training takes are points with normals and weights.
    const std::string header =
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
        "property float z\nproperty float weight\nend_header\n";
    const std::string arguments =
        "--scene scene" + std::string(kSparse) + "--fixed-points voters.ply";
    write("voters.ply", header + "0 0 0 1\n0.1 0 0 1\n0 0.1 0 1\nnan 0 0 1\n");
    Result r = train(arguments + " --out three_voters");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("expected at least 20")) << r;
    expect_trained(arguments + " --set tv.fixed_check=false", "three_voters");
    write("voters.ply", header + "0 0 0 1\n0.1 0 0 1\nnan 0.1 0 1\nnan 0 0 1\n");
    r = train(arguments + " --out few_voters");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("voters.ply: 2 usable points; measured points that vote need at least 3"))
        << r;
    write("voters.ply", header + "0 0 0 1\n0.1 0 0 nan\n0 0.1 0 1\n1 0 0 1\n");
    r = train(arguments + " --out nan_weight");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("weight nan of point 1")) << r;
    write("voters.ply", header + "0 0 0 1\n");
    r = train(arguments + " --out cut_voters");
    EXPECT_EQ(r.code, 3) << r;
    EXPECT_TRUE(r.says("voters.ply: byte")) << r;
}

}  // namespace
}  // namespace tvsgs
