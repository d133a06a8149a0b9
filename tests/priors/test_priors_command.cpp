// tvsgs-priors as a user runs it, with small networks over photographs that hold what the networks
// are to say; and the readers of priors, which have to understand what it wrote.
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "apps/priors/priors_folder.h"
#include "apps/priors_test.h"
#include "io/image_file.h"
#include "priors/onnx_writer.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using test::convolution;
using test::Ints;

class PriorsCommand : public Priors {
protected:
    static void SetUpTestSuite() {
        Priors::SetUpTestSuite();
        for (std::size_t v = 0; v < scene_.train.size(); ++v) {
            write_png(folder_ / "scene/images_depth" / scene_.train[v].name,
                      inverse_depth_picture(truth_[v]));
            write_png(folder_ / "scene/images_normal" / scene_.train[v].name,
                      normal_picture(truth_[v]));
        }
        // Inverse depth is 0.2 G + 0.8 B of these pictures; the rest of the colours misleads.
        write("depth.onnx", convolution({1, 3, -1, -1}, 1, {0, 0.2f, 0.8f}, {0}));
        const std::vector<float> identity{1, 0, 0, 0, 1, 0, 0, 0, 1};
        write("normal.onnx", convolution({1, 3, 240, 240}, 3, identity, {0, 0, 0}));
        std::vector<float> sums(6 * 3 * 4 * 4);
        for (std::size_t i = 0; i < sums.size(); ++i) sums[i] = static_cast<float>(i % 7) - 3;
        write("features.onnx",
              convolution({1, 3, -1, -1}, 6, sums, std::vector<float>(6, 0.1f), 4));
    }
    static void write(const std::string& name, const std::string& bytes) {
        std::ofstream(folder_ / name, std::ios::binary) << bytes;
    }
    /// B and G are inverse depth, 250 at the nearest; R is something else; 0 where there is none.
    static ImageU8 inverse_depth_picture(const MeshRender& truth) {
        ImageU8 picture(truth.depth.width, truth.depth.height, 3);
        float nearest = 1e9f;
        for (const float z : truth.depth.pixels)
            if (z > 0) nearest = std::min(nearest, z);
        for (int y = 0; y < picture.height; ++y)
            for (int x = 0; x < picture.width; ++x) {
                const float z = truth.depth.at(x, y);
                const auto code =
                    static_cast<std::uint8_t>(z > 0 ? std::lround(250 * nearest / z) : 0);
                picture.at(x, y, 0) = static_cast<std::uint8_t>((37 * x + 11 * y) % 256);
                picture.at(x, y, 1) = picture.at(x, y, 2) = code;
            }
        return picture;
    }
    /// (n + 1) / 2 of normals that face the camera.
    static ImageU8 normal_picture(const MeshRender& truth) {
        ImageU8 picture(truth.normal.width, truth.normal.height, 3);
        for (std::size_t i = 0; i < picture.pixels.size(); i += 3) {
            const float* const n = &truth.normal.pixels[i];
            const float sign = n[2] > 0 ? -1.f : 1.f;
            for (std::size_t c = 0; c < 3; ++c)
                picture.pixels[i + c] =
                    static_cast<std::uint8_t>(std::lround(127.5f * (sign * n[c] + 1)));
        }
        return picture;
    }

    static Result call(const std::string& arguments) {
        return run_tool(folder_, "priors", "--scene scene " + arguments);
    }
    /// Into scene/OUT, which the readers get as --priors OUT.
    static Result make(const std::string& kind, const std::string& arguments) {
        return call("--images images_" + kind + " --kind " + kind + " --model " + kind + ".onnx " +
                    arguments);
    }
    static nlohmann::json json(const std::string& out) {
        return nlohmann::json::parse(contents(folder_ / out / "priors.json"));
    }
    static void expect_refused(const std::string& arguments, int code, const std::string& text) {
        const Result result = call(arguments);
        EXPECT_EQ(result.code, code) << arguments << ": " << result;
        EXPECT_TRUE(result.says(text)) << "'" << text << "' not in " << result;
    }
};

// Stretched to a square and back, the depth that the photographs hold is found at its place.
TEST_F(PriorsCommand, DepthNormalsAndFeaturesAreRead) {
    const Result depth =
        make("depth", "--size 128x128 --quantity inverse_depth --out scene/network");
    ASSERT_EQ(depth.code, 0) << depth;
    EXPECT_TRUE(depth.says("depth of depth.onnx: inverse depth, affine; 5 photographs")) << depth;
    EXPECT_TRUE(depth.says("info: scene/network: depth")) << depth;
    Scene scene = read_folder("network");
    expect_depth(scene, 5e-3, 0.9);
    EXPECT_TRUE(said("priors: 5 depth maps (depth/*.npy, tvsgs-priors depth.onnx, sha256 "))
        << said_;
    EXPECT_TRUE(said("relative inverse depth")) << said_;

    ASSERT_EQ(make("normal", "--range unit --out scene/network").code, 0);
    ASSERT_EQ(call("--model features.onnx --kind features --long-side 80 --multiple 4 "
                   "--out scene/network")
                  .code,
              0);
    scene = read_folder("network");
    expect_depth(scene, 5e-3, 0.9);
    expect_normals(scene, 0.98);
    EXPECT_TRUE(said("normals (normal/*.npy: camera_opencv")) << said_;
    EXPECT_TRUE(said("features (features/*.npy: 6 channels)")) << said_;

    const auto said_of = json("scene/network");
    EXPECT_EQ(said_of.at("version"), 1);
    for (const std::string kind : {"depth", "normal", "features"}) {
        const Result sum = run_script(folder_, "sha256sum " + kind + ".onnx >out.txt 2>err.txt");
        ASSERT_EQ(sum.code, 0);
        const std::string producer = said_of.at(kind).at("producer");
        EXPECT_NE(producer.find(kind + ".onnx, sha256 " + sum.out.substr(0, 64) +
                                ", output map, OpenCV "),
                  std::string::npos)
            << producer;
    }
    const std::string by = said_of.at("features").at("producer");
    EXPECT_NE(by.find("input 80 long, multiples of 4, rgb / 255, gives features"),
              std::string::npos)
        << by;
}

// The numbers themselves: half of green, less 10, blue first, at the photographs' own size.
TEST_F(PriorsCommand, NumbersAreThoseOfTheLinearMap) {
    write("plain.onnx", convolution({1, 3, 120, 160}, 1, {1, 10, 100}, {0.5f}));
    const Result result = call(
        "--images images_depth --model plain.onnx --kind depth --order bgr --scale 0.5 "
        "--mean 10,20,30 --std 1,2,4 --out scene/numbers --quiet");
    ASSERT_EQ(result.code, 0) << result;
    EXPECT_EQ(result.err, "");
    const std::string name = fs::path(scene_.train[1].name).stem().string();
    const NpyArray map = read_npy(folder_ / "scene/numbers/depth" / (name + ".npy"));
    ASSERT_EQ(map.shape, (Ints{120, 160}));
    const ImageU8 photo = read_image(folder_ / "scene/images_depth" / scene_.train[1].name, 3);
    for (std::size_t i = 0; i < map.numbers.size(); ++i) {
        const double r = photo.pixels[3 * i], g = photo.pixels[3 * i + 1],
                     b = photo.pixels[3 * i + 2];
        ASSERT_NEAR(map.numbers[i],
                    0.5 + (b / 2 - 10) + 10 * (g / 2 - 20) / 2 + 100 * (r / 2 - 30) / 4, 1e-3);
    }
}

// Channel c is 2^c times the photograph's.
TEST_F(PriorsCommand, FeaturesAreWrittenChannelsFirst) {
    write("planes.onnx", convolution({1, 3, 30, 40}, 3, {1, 0, 0, 0, 2, 0, 0, 0, 4}, {0, 0, 0}));
    ASSERT_EQ(call("--model planes.onnx --kind features --scale 1 --out scene/planes").code, 0);
    const std::string name = fs::path(scene_.train[0].name).stem().string();
    const NpyArray map = read_npy(folder_ / "scene/planes/features" / (name + ".npy"));
    ASSERT_EQ(map.shape, (Ints{3, 30, 40}));
    const ImageU8 photo =
        resize_bicubic(read_image(folder_ / "scene/images" / scene_.train[0].name, 3), 40, 30);
    for (std::size_t i = 0; i < 1200; ++i)
        for (std::size_t c = 0; c < 3; ++c)
            ASSERT_EQ(map.numbers[1200 * c + i], (1 << c) * photo.pixels[3 * i + c]) << i;
}

TEST_F(PriorsCommand, GoesOnWhereItStopped) {
    const std::string arguments = "--long-side 64 --out scene/stopped";
    ASSERT_EQ(make("depth", arguments + " --views 0,1,2").code, 0);
    const fs::path first =
        folder_ / "scene/stopped/depth" / fs::path(scene_.train[0].name).replace_extension(".npy");
    const auto when = fs::last_write_time(first);
    const Result again = make("depth", arguments);
    ASSERT_EQ(again.code, 0) << again;
    EXPECT_TRUE(again.says("2 photographs on the CPU, 3 maps of an earlier run are kept")) << again;
    EXPECT_EQ(fs::last_write_time(first), when);
    ASSERT_EQ(make("depth", arguments + " --overwrite").code, 0);
    EXPECT_NE(fs::last_write_time(first), when);
}

// Maps of two networks are not mixed, and a network that fails takes nothing away.
TEST_F(PriorsCommand, MapsOfAnotherNetworkStay) {
    ASSERT_EQ(make("depth", "--long-side 64 --out scene/kept").code, 0);
    const std::string before = contents(folder_ / "scene/kept/priors.json");
    write("other.onnx", convolution({1, 3, -1, -1}, 1, {0, 1, 0}, {0}));
    const std::string other =
        "--model other.onnx --kind depth --long-side 64 --views 0,1 --out scene/kept";
    expect_refused(other, 2, "has depth of 'tvsgs-priors depth.onnx");
    expect_refused(other, 2, "--overwrite replaces these maps");
    write("broken.onnx", convolution({1, 3, -1, -1}, 1, {3e38f, 3e38f, 3e38f}, {3e38f}));
    expect_refused(
        "--model broken.onnx --kind depth --long-side 64 --scale 100 --out scene/kept --overwrite",
        7, "gives NaN or infinity");
    EXPECT_EQ(contents(folder_ / "scene/kept/priors.json"), before);
    const auto maps = [] {
        return std::distance(fs::directory_iterator(folder_ / "scene/kept/depth"), {});
    };
    EXPECT_EQ(maps(), 5);
    const Result replaced = call(other + " --overwrite");
    ASSERT_EQ(replaced.code, 0) << replaced;
    EXPECT_EQ(maps(), 2);
    const std::string by = json("scene/kept").at("depth").at("producer");
    EXPECT_EQ(by.find("tvsgs-priors other.onnx"), 0u) << by;
}

// Of the numbers of a file of maps only the network's range tells one from the other.
TEST_F(PriorsCommand, MapsReadInAnotherRangeAreNotKept) {
    ASSERT_EQ(make("normal", "--range unit --views 0,1 --out scene/range").code, 0);
    EXPECT_EQ(make("normal", "--range unit --out scene/range").code, 0);
    const Result other = make("normal", "--range signed --out scene/range");
    EXPECT_EQ(other.code, 2) << other;
    EXPECT_TRUE(other.says("--overwrite replaces these maps")) << other;
}

TEST_F(PriorsCommand, ConfidencesGoWithTheirDepth) {
    ASSERT_EQ(make("depth", "--long-side 64 --out scene/sure").code, 0);
    auto root = json("scene/sure");
    root["confidence"] = {{"dir", "confidence"}};
    root["sky"] = {{"dir", "sky"}};
    write("scene/sure/priors.json", root.dump());
    ASSERT_EQ(make("normal", "--range unit --out scene/sure").code, 0);
    EXPECT_TRUE(json("scene/sure").contains("confidence"));
    const Result other = make("depth", "--long-side 32 --out scene/sure --overwrite");
    ASSERT_EQ(other.code, 0) << other;
    EXPECT_TRUE(other.says("no longer has a confidence")) << other;
    EXPECT_FALSE(json("scene/sure").contains("confidence"));
    EXPECT_TRUE(json("scene/sure").contains("sky"));
    EXPECT_TRUE(json("scene/sure").contains("normal"));
}

// Neither with --overwrite: what tvsgs has not written stays as it is.
TEST_F(PriorsCommand, FilesOfTheUserAreNeverReplaced) {
    fs::create_directories(folder_ / "scene/mine/depth");
    const std::string mine = R"({"version": 1, "depth": {"dir": "depth"}})";
    write("scene/mine/priors.json", mine);
    for (const std::string kind : {"depth", "normal"})
        for (const std::string overwrite : {"", " --overwrite"}) {
            expect_refused("--model depth.onnx --kind " + kind +
                               " --long-side 64 --out scene/mine" + overwrite,
                           2, "priors.json: is there, and not written by tvsgs");
            EXPECT_EQ(contents(folder_ / "scene/mine/priors.json"), mine);
        }
    fs::remove(folder_ / "scene/mine/priors.json");
    write("scene/mine/depth/0000.npy", "mine");
    expect_refused("--model depth.onnx --kind depth --long-side 64 --out scene/mine --overwrite", 2,
                   "holds maps that are found by their names");
    // Another kind, whose priors.json would hide them.
    expect_refused("--model depth.onnx --kind features --long-side 64 --out scene/mine", 2,
                   "0000.npy; the priors.json of this command would hide them");
    EXPECT_EQ(contents(folder_ / "scene/mine/depth/0000.npy"), "mine");
    fs::rename(folder_ / "scene/mine/depth", folder_ / "scene/mine/normal");
    fs::rename(folder_ / "scene/mine/normal/0000.npy", folder_ / "scene/mine/normal/notes.txt");
    expect_refused("--model depth.onnx --kind normal --long-side 64 --out scene/mine", 2,
                   "notes.txt: is there, and not written by tvsgs");
}

TEST_F(PriorsCommand, WrongUseIsRefusedBeforeAnyWork) {
    const std::string net = "--model depth.onnx --kind depth ";
    expect_refused("--kind depth", 2, "no network given; expected --model FILE.onnx");
    expect_refused("--model depth.onnx", 2, "expected --kind depth, normal or features");
    expect_refused("--model depth.onnx --preset midass", 2, "did you mean midas?");
    expect_refused("--model depth.onnx --preset midas --kind normal", 2,
                   "--preset midas gives depth, --kind asks for normal");
    expect_refused(net + "--range unit", 2, "--range is for --kind normal, not for depth");
    expect_refused(net + "--patch 14", 2, "--patch is for --kind features");
    expect_refused("--model depth.onnx --kind normal --quantity depth", 2, "--quantity is for");
    expect_refused("--model depth.onnx --kind normal --facing away", 2, "--facing needs a --frame");
    expect_refused(net + "--size 64", 2, "--size 64: expected WIDTHxHEIGHT");
    expect_refused(net + "--size 0x64", 2, "--size 0x64: expected WIDTHxHEIGHT");
    expect_refused(net + "--size 64x48 --long-side 64", 2, "expected one of --size, --long-side");
    expect_refused(net + "--size 64x48 --multiple 32", 2, "--multiple goes with");
    expect_refused(net + "--long-side 64 --std 1,0,1", 2, "--std");
    expect_refused(net + "--long-side 64 --mean 1,2", 2, "--mean");
    expect_refused(net + "--long-side 64 --device cuda", 2, "networks run on the CPU only");
    expect_refused(net, 2, "leaves the size of its input open");
    EXPECT_FALSE(fs::exists(folder_ / "scene/priors"));
    const Result absent = run_tool(folder_, "priors", "--scene absent " + net);
    EXPECT_EQ(absent.code, 3) << absent;
    EXPECT_TRUE(absent.says("absent")) << absent;
}

TEST_F(PriorsCommand, NetworksThatDoNotServeAreRefused) {
    write("frob.onnx", test::onnx_file(test::node("Frobnicate", {"image"}, {"map"}) +
                                       test::value_info(11, "image", {1, 3, 8, 8}) +
                                       test::value_info(12, "map", {1, 1, 8, 8})));
    expect_refused("--model frob.onnx --kind depth --out scene/none", 3,
                   "operator Frobnicate is not in the DNN module of OpenCV");
    write("page.onnx", "<!DOCTYPE html>");
    expect_refused("--model page.onnx --kind depth --out scene/none", 3, "is no ONNX file");
    expect_refused("--model absent.onnx --kind depth --out scene/none", 3, "absent.onnx");
    EXPECT_FALSE(fs::exists(folder_ / "scene/none"));
    expect_refused("--model normal.onnx --kind depth --out scene/none", 3,
                   "gives an output of shape (1, 3, 240, 240)");
}

// A size of a preset gives way to the one that the file fixes; a name in a sub-folder is kept, and
// "_rgb" taken off as readers do.
TEST_F(PriorsCommand, PhotographsThatWouldShareAMapAreRefused) {
    EXPECT_NO_THROW(priors::PriorsFolder(folder_ / "x", priors::MapKind::depth, {}, false, "",
                                         {"a.png", "b/a.png"}));
    try {
        priors::PriorsFolder(folder_ / "x", priors::MapKind::depth, {}, false, "",
                             {"a.png", "b.png", "a_rgb.jpg"});
        ADD_FAILURE();
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        EXPECT_NE(std::string(error.what()).find("a.png and a_rgb.jpg"), std::string::npos);
    }
}

TEST_F(PriorsCommand, PresetsAndNamesInFolders) {
    fs::create_directories(folder_ / "named/sparse/0");
    for (const auto& file : fs::directory_iterator(folder_ / "scene/sparse/0"))
        fs::copy(file.path(), folder_ / "named/sparse/0");
    const fs::path images = folder_ / "named/sparse/0/images.txt";
    std::string text = contents(images);
    for (const View& view : scene_.train) {
        const std::string name = "left/" + fs::path(view.name).stem().string() + "_rgb.png";
        text.replace(text.find(view.name), view.name.size(), name);
        fs::create_directories(folder_ / "named/images/left");
        fs::copy(folder_ / "scene/images_depth" / view.name, folder_ / "named/images" / name);
    }
    std::ofstream(images) << text;
    write("midas.onnx", convolution({1, 3, 64, 64}, 1, {0, 0.2f, 0.8f}, {0}));
    const Result result =
        run_tool(folder_, "priors", "--scene named --preset midas --model midas.onnx");
    ASSERT_EQ(result.code, 0) << result;
    EXPECT_EQ(json("named/priors").at("depth").at("quantity"), "inverse_depth");
    const std::string by = json("named/priors").at("depth").at("producer");
    EXPECT_NE(by.find("input 64x64, rgb / 255"), std::string::npos) << by;

    SceneOptions options;
    options.path = folder_ / "named";
    Scene scene = read_scene(options);
    read_priors({}, kAllPriors, options, scene);
    for (const View& view : scene.train) EXPECT_NE(find(view, prior_map::kDepth), nullptr);
}

TEST_F(PriorsCommand, TellsThePresets) {
    const Result result = run_tool(folder_, "priors", "--list-presets");
    EXPECT_EQ(result.code, 0) << result;
    EXPECT_NE(result.out.find("| `midas` | MiDaS v2.1 |"), std::string::npos) << result.out;
}

}  // namespace
}  // namespace tvsgs
