// Tests prior files of every format (tests/data/priors, written byte by byte by a script):
// assignment to views, placement of pixels, and refused files.
#include <cmath>
#include <cstring>

#include "io/io_test.h"
#include "io/priors/prior_placement.h"
#include "io/priors/prior_sources.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
constexpr auto kDepth = PriorQuantity::depth, kAnything = PriorQuantity::unknown;
constexpr auto kZ = PriorGeometry::z, kAny = PriorGeometry::unknown;

const fs::path kPriors = test_data("priors");
const std::vector<std::string> kViews{"0001.png", "0002.png"};

PriorSources find_in(const std::string& program) {
    return find_priors({(kPriors / program).string(), "", kViews});
}
double number(int view, int x, int y) {
    return 100 * view + 10 * y + x + 1;  // make_priors.py
}

struct FormatRow {
    const char* program;
    const char* what;
    PriorQuantity quantity;
    PriorGeometry geometry;
    PriorAlignment alignment;
    bool zero_is_none;
    double scale[2] = {1, 1}, shift[2] = {0, 0};  // of the numbers of each view
    double offset[2] = {0, 0};                    // the format's numbers are smaller by it
    int side = 0;                                 // of square maps

    friend void PrintTo(const FormatRow& row, std::ostream* out) { *out << row.program; }
};

class PriorFormats : public testing::TestWithParam<FormatRow> {};

TEST_P(PriorFormats, AreReadAsTheyAre) {
    const FormatRow& row = GetParam();
    const DepthSource depth = find_in(row.program).depth;
    EXPECT_EQ(depth.what, row.what);
    ASSERT_EQ(depth.files.size(), 2u);
    EXPECT_EQ(depth.convention.quantity, row.quantity);
    EXPECT_EQ(depth.convention.geometry, row.geometry);
    EXPECT_EQ(depth.convention.alignment, row.alignment);
    EXPECT_EQ(depth.convention.declared_by, "");
    EXPECT_EQ(depth.invalid, row.zero_is_none ? std::vector<double>{0} : std::vector<double>{});
    EXPECT_EQ(depth.centre_crop, row.side > 0);
    for (int v = 0; v < 2; ++v) {
        const PriorFile& file = depth.files.at(kViews[static_cast<std::size_t>(v)]);
        const ImageF map = read_prior_map(file.path, 1, depth.layout);
        ASSERT_EQ(map.width, row.side > 0 ? row.side : 8);
        ASSERT_EQ(map.height, 6);
        for (int y = 0; y < map.height; ++y)
            for (int x = 0; x < map.width; ++x) {
                const double expected =
                    row.scale[v] * (number(v + 1, x, y) - row.offset[v]) + row.shift[v];
                EXPECT_NEAR(file.scale * static_cast<double>(map.at(x, y)) + file.shift, expected,
                            1e-6 * std::abs(expected));
            }
        EXPECT_FALSE(file.unreliable);
        EXPECT_FALSE(file.window);
    }
}

constexpr auto kMetric = PriorAlignment::metric, kScale = PriorAlignment::scale,
               kAffine = PriorAlignment::affine;
INSTANTIATE_TEST_SUITE_P(
    All,
    PriorFormats,
    testing::Values(
        FormatRow{"vggt", "depth_vggt/*_pred.npy", kDepth, kAny, kScale, true},
        FormatRow{"marigold", "depth_npy/*_pred.npy", kAnything, kAny, kAffine, false},
        FormatRow{"marigold_png", "depth_bw/*_depth.png", kAnything, kAny, kAffine, false},
        FormatRow{"depth_anything",
                  "vis_depth/*.png",
                  kAnything,
                  kAny,
                  kAffine,
                  false,
                  {1, 1},
                  {0, 0},
                  {100, 200}},
        FormatRow{"depth_anything_npy", "depth_npy/*.npy", kAnything, kAny, kAffine, false},
        FormatRow{"3dgs",
                  "depths/*.png",
                  PriorQuantity::inverse_depth,
                  kZ,
                  kMetric,
                  false,
                  {2. / 65536, 3. / 65536},
                  {0.25, -0.5}},
        FormatRow{"nerfstudio",
                  "transforms.json depth_file_path",
                  kDepth,
                  kAny,
                  kMetric,
                  true,
                  {1e-3, 1e-3}},
        FormatRow{"colmap", "depth_maps/*.geometric.bin", kDepth, kZ, kMetric, true},
        FormatRow{"pgsr", "renders_depth/*.npy", kDepth, kZ, kMetric, true},
        FormatRow{"mvsnet", "depth_est/*.pfm", kDepth, kAny, kMetric, true},
        FormatRow{"midas", "midas/*-dpt_large_384.pfm", kAnything, kAny, kAffine, false},
        FormatRow{"metric3d", "metric3d/*.png", kDepth, kAny, kScale, true},
        FormatRow{"acmm", "ACMM/*/depths_geom.dmb", kDepth, kZ, kMetric, true},
        FormatRow{
            "omnidata", "*_depth.npy", kAnything, kAny, kAffine, false, {1, 1}, {0, 0}, {0, 0}, 6}),
    [](const auto& row) {
        const std::string name = row.param.program;
        return name == "3dgs" ? std::string("threedgs") : name;
    });

TEST(PriorSources, HaveNormalsAndConfidences) {
    for (const char* program : {"vggt", "colmap", "acmm"}) {
        const NormalSource normal = find_in(program).normal;
        ASSERT_EQ(normal.files.size(), 2u) << program;
        EXPECT_EQ(normal.convention.frame,
                  std::string(program) == "acmm" ? NormalFrame::world : NormalFrame::camera_opencv);
        const ImageF map = read_prior_map(normal.files.at("0002.png").path, 3, normal.layout);
        EXPECT_EQ(map.at(7, 5, 0), 0.6f);
        EXPECT_EQ(map.at(7, 5, 1), 0.f);
        EXPECT_EQ(map.at(7, 5, 2), -0.8f);
    }
    const NormalSource omnidata = find_in("omnidata").normal;
    EXPECT_TRUE(omnidata.centre_crop);
    const ImageF map = read_prior_map(omnidata.files.at("0001.png").path, 3, omnidata.layout);
    EXPECT_EQ(map.at(2, 3, 0), 0.8f);
    EXPECT_EQ(map.at(2, 3, 2), 0.1f);

    const ConfidenceSource vggt = find_in("vggt").confidence, mvsnet = find_in("mvsnet").confidence;
    EXPECT_TRUE(vggt.from_one);
    EXPECT_EQ(read_prior_map(vggt.files.at("0001.png").path).at(3, 3), 4.f);
    EXPECT_FALSE(mvsnet.from_one);
    EXPECT_EQ(read_prior_map(mvsnet.files.at("0002.png").path).at(3, 3), 0.75f);
    EXPECT_TRUE(find_in("marigold").confidence.empty());
}

TEST(PriorSources, NeutralFolder) {
    const PriorSources found = find_in("neutral");
    EXPECT_EQ(found.depth.what, "z/*.pfm, by hand");
    const DepthConvention& c = found.depth.convention;
    EXPECT_EQ(c.quantity, PriorQuantity::log_depth);
    EXPECT_EQ(c.geometry, PriorGeometry::ray);
    EXPECT_EQ(c.alignment, kScale);
    EXPECT_NE(c.declared_by.find("priors.json"), std::string::npos);
    EXPECT_EQ(found.depth.invalid, std::vector<double>{111});
    const PriorFile &one = found.depth.files.at("0001.png"),
                    &two = found.depth.files.at("0002.png");
    EXPECT_EQ(one.scale, 0.5);
    EXPECT_EQ(one.shift, 0);
    EXPECT_FALSE(one.window);
    EXPECT_EQ(two.scale, 1.5);
    EXPECT_EQ(two.shift, -1);
    EXPECT_EQ(two.window, (PhotoWindow{2, 0, 4, 3}));
    EXPECT_EQ(read_prior_map(two.path).at(3, 2), static_cast<float>(number(2, 3, 2)));

    EXPECT_EQ(found.normal.convention.frame, NormalFrame::camera_opengl);
    EXPECT_TRUE(found.normal.convention.facing_away);
    EXPECT_EQ(found.normal.range, NumberRange::unit);
    EXPECT_EQ(read_prior_map(found.normal.files.at("0001.png").path, 3).at(0, 0, 1), 128.f);
    EXPECT_EQ(found.confidence.files.size(), 2u);
    EXPECT_FALSE(found.confidence.from_one);
    EXPECT_EQ(read_prior_map(found.sky.files.at("0001.png").path).at(4, 0), 255.f);
    const ImageF features =
        read_prior_map(found.features.files.at("0002.png").path, 0, found.features.layout);
    EXPECT_EQ(features.channels, 2);
    EXPECT_EQ(features.width, 4);
    EXPECT_EQ(features.at(3, 1, 1), 113.f);
}

class PriorFolder : public IoTest {
protected:
    PriorSources find(const std::vector<std::string>& views = kViews) const {
        return find_priors({folder.string(), "", views});
    }
    void expect_refused(const std::string& text, const std::vector<std::string>& views = kViews) {
        expect_error(ExitCode::input, text, [&] { find(views); });
    }
    void copy(const std::string& from, const std::string& to) const {
        fs::create_directories((folder / to).parent_path());
        fs::copy_file(kPriors / from, folder / to, fs::copy_options::overwrite_existing);
    }
};

TEST_F(PriorFolder, TheFirstOfSeveralFormatsIsTaken) {
    copy("pgsr/renders_depth/0001.npy", "renders_depth/0001.npy");
    EXPECT_EQ(find().depth.what, "renders_depth/*.npy");
    copy("mvsnet/depth_est/00000001.pfm", "depth_est/00000001.pfm");
    EXPECT_EQ(find().depth.what, "depth_est/*.pfm");
    copy("colmap/stereo/depth_maps/0001.png.photometric.bin",
         "stereo/depth_maps/0001.png.photometric.bin");
    EXPECT_EQ(find().depth.what, "depth_maps/*.photometric.bin");
    copy("colmap/stereo/depth_maps/0001.png.geometric.bin",
         "stereo/depth_maps/0001.png.geometric.bin");
    EXPECT_EQ(find().depth.what, "depth_maps/*.geometric.bin");
    copy("nerfstudio/transforms.json", "transforms.json");
    EXPECT_EQ(find().depth.what, "depth_maps/*.geometric.bin");  // its files are missing
    copy("nerfstudio/d/one.png", "d/one.png");
    EXPECT_EQ(find().depth.what, "transforms.json depth_file_path");
    copy("3dgs/depths/0001.png", "depths/0001.png");
    copy("3dgs/sparse/0/depth_params.json", "sparse/0/depth_params.json");
    EXPECT_EQ(find().depth.what, "depths/*.png");
    copy("marigold/depth_npy/0001_pred.npy", "depth_npy/0001_pred.npy");
    EXPECT_EQ(find().depth.what, "depth_npy/*_pred.npy");
    copy("vggt/depth_vggt/0001_pred.npy", "depth_vggt/0001_pred.npy");
    EXPECT_EQ(find().depth.what, "depth_vggt/*_pred.npy");
    // Files in priors/ have priority.
    copy("marigold/depth_npy/0001_pred.npy", "priors/depth_npy/0001_pred.npy");
    EXPECT_EQ(find().depth.what, "depth_npy/*_pred.npy");
    EXPECT_EQ(find().depth.files.size(), 1u);
}

TEST_F(PriorFolder, FilesFindTheirViews) {
    const std::string bytes = "x";
    for (const char* file : {"a/0001.npy", "b/0001.npy", "7.npy", "c_rgb.npy", "d.npy", "0009.npy",
                             "e/0009.npy", "long.name.png.bin"})
        write(std::string("f/") + file, bytes);
    const auto matched = [&](const std::vector<std::string>& views) {
        std::map<std::string, std::string> names;
        for (const auto& [view, file] : match_priors(folder / "f", {".npy"}, views).files)
            names[view] = fs::path(file.path).lexically_relative(folder / "f").string();
        return names;
    };
    using Names = std::map<std::string, std::string>;
    EXPECT_EQ(matched({"a/0001.png", "b/0001.png"}),
              (Names{{"a/0001.png", "a/0001.npy"}, {"b/0001.png", "b/0001.npy"}}));
    EXPECT_EQ(matched({"0001.jpg"}), Names{});  // ambiguous
    EXPECT_EQ(matched({"00007.jpg", "d_rgb.png"}),
              (Names{{"00007.jpg", "7.npy"}, {"d_rgb.png", "d.npy"}}));
    EXPECT_EQ(matched({"x/7.jpg", "y/7.jpg"}), Names{});  // ambiguous
    EXPECT_EQ(matched({"0009.jpg"}), (Names{{"0009.jpg", "0009.npy"}}));
    EXPECT_EQ(match_priors(folder / "f", {".bin"}, {"long.name.png"}, true).files.size(), 1u);
    EXPECT_TRUE(match_priors(folder / "f", {".bin"}, {"long.name.png"}).empty());
    EXPECT_TRUE(match_priors(folder / "nowhere", {".npy"}, {"d.png"}).empty());
    EXPECT_EQ(match_priors(folder / "f", {".pfm", ".npy", ".bin"}, {"d.png"}).what, "f/*.npy");
}

TEST_F(PriorFolder, ParamsOfAnUnlikelyScaleAreNotUsed) {
    for (const char* name : {"0001", "0002", "0003"})
        copy("3dgs/depths/0001.png", std::string("depths/") + name + ".png");
    const std::vector<std::string> views{"0001.png", "0002.png", "0003.png"};
    write("sparse/0/depth_params.json",
          R"({"0001": {"scale": 1, "offset": 2}, "0002": {"scale": 1.5, "offset": 0},
              "0003": {"scale": 8, "offset": 3}})");
    const DepthSource depth = find(views).depth;
    EXPECT_FALSE(depth.files.at("0001.png").unreliable);
    EXPECT_TRUE(depth.files.at("0003.png").unreliable);  // more than 5 times the median
    EXPECT_EQ(depth.files.at("0003.png").scale, 1. / 65536);
    EXPECT_EQ(depth.files.at("0003.png").shift, 0);
    write("sparse/0/depth_params.json",
          R"({"0001": {"scale": 0, "offset": 0}, "0002": {"scale": 1}, "0003": {"scale": 0.1}})");
    for (const char* view : {"0001.png", "0003.png"})
        EXPECT_TRUE(find(views).depth.files.at(view).unreliable) << view;
    write("sparse/0/depth_params.json", R"({"0001": {"scale": 1, "offset": 2}})");
    expect_refused("no entry for image '0002.png'", views);
    write("sparse/0/depth_params.json", R"({"0001": {"scale": "x"}, "0002": {}})");
    expect_refused("scale is not a number");
}

TEST_F(PriorFolder, JsonThatIsWrongIsRefused) {
    copy("neutral/priors/z/0001.pfm", "priors/depth/0001.pfm");
    const auto says = [&](const std::string& depth, const std::string& more = "") {
        write("priors/priors.json", R"({"depth": {"encoding": "pfm")" + depth + "}" + more + "}");
    };
    says("");
    EXPECT_EQ(find().depth.convention.declared_by, "");
    EXPECT_EQ(find().depth.invalid, std::vector<double>{0});
    says(R"(, "quantity": "disparity")");
    expect_refused("quantity is 'disparity'; expected depth, inverse_depth, log_depth");
    says(R"(, "quantity": 3)");
    expect_refused("expected depth, inverse_depth");
    says(R"(, "qantity": "depth")");
    expect_refused("unknown key 'qantity'");
    says("", R"(, "depths": {})");
    expect_refused("unknown key 'depths'");
    says("", R"(, "version": 2)");
    expect_refused("version is 2; expected 1");
    says(R"(, "dir": "../x")");
    expect_refused("expected a relative path without '..'");
    says(R"(, "dir": "/tmp")");
    expect_refused("expected a relative path");
    says(R"(, "dir": "empty")");
    expect_refused("has no file of that encoding for the 2 views");
    says(R"(, "invalid": 0)");
    expect_refused("invalid is not a list of numbers");
    says(R"(, "png_scale": null)");
    EXPECT_EQ(find().depth.files.size(), 1u);
    says(R"(, "per_image": {"0001": {"crop": [0, 0, 5]}})");
    expect_refused("crop is not [x, y, width, height]");
    says(R"(, "per_image": {"0001": {"shfit": 1}})");
    expect_refused("unknown key 'shfit'");
    write("priors/priors.json", R"({"depth": {"encoding": "exr"}})");
    expect_refused("exr is unknown");
    write("priors/priors.json", R"({"depth": 7})");
    expect_refused("not a JSON object");
    write("priors/priors.json", "[]");
    expect_refused("not a JSON object");
    expect_error(ExitCode::input, "folder not found", [&] {
        find_priors({folder.string(), "elsewhere", kViews});
    });
}

// Files

TEST_F(PriorFolder, DamagedFilesAreRefused) {
    for (const char* file :
         {"mvsnet/depth_est/00000001.pfm", "acmm/ACMM/2333_00000001/depths_geom.dmb",
          "colmap/stereo/depth_maps/0001.png.geometric.bin", "vggt/depth_vggt/0001_pred.npy",
          "3dgs/depths/0001.png"}) {
        const std::string whole = read_bytes((kPriors / file).string());
        const std::string name = "x" + fs::path(file).extension().string();
        write(name, whole);
        EXPECT_NO_THROW(read_prior_map(folder / name));
        for (std::size_t size = 0; size + 12 < whole.size(); size += size < 40 ? 1 : 13) {
            write(name, whole.substr(0, size));
            expect_error(ExitCode::input, name, [&] { read_prior_map(folder / name); });
        }
        if (name == "x.png") continue;  // bytes after an image do no harm
        write(name, whole + "1234");
        expect_error(ExitCode::input, name, [&] { read_prior_map(folder / name); });
    }
}

TEST_F(PriorFolder, ClaimsBeyondTheFileAreRefused) {
    const auto refused = [&](const std::string& name, const std::string& bytes,
                             const std::string& text) {
        write(name, bytes);
        expect_error(ExitCode::input, text, [&] { read_prior_map(folder / name); });
    };
    refused("a.pfm", "Pf\n60000 60000\n-1\nabcd", "claims 60000x60000");
    refused("a.pfm", "Pf\n30000 3000\n-1\nabcd", "need 360000000 bytes");
    refused("a.pfm", "Pf\n-1 1\n-1\nabcd", "claims -1x1");
    refused("a.pfm", "Pf\n1 1\n0\nabcd", "a scale that is not 0");
    refused("a.pfm", "Pf\n1 1\nnan\nabcd", "a scale that is not 0");
    refused("a.pfm", "P6\n1 1\n255\nabc", "expected Pf or PF");
    refused("a.pfm", "PF\n1 1\n-1\n0123456789ab", "3 channels; expected 1");
    const auto ints = [](std::initializer_list<std::int32_t> values) {
        std::string bytes;
        for (const std::int32_t v : values)
            bytes.append(reinterpret_cast<const char*>(&v), sizeof v);
        return bytes;
    };
    refused("a.dmb", ints({1, 0x7fffffff, 0x7fffffff, 1}), "claims 2147483647x2147483647");
    refused("a.dmb", ints({1, -1, -1, 1, 0}), "claims -1x-1");
    refused("a.dmb", ints({2, 1, 1, 1, 0}), "begins with type 2");
    refused("a.bin", "99999&99999&1&abcd", "claims 99999x99999");
    refused("a.bin", "1&1&5000&abcd", "5000 channels");
    refused("a.bin", "1&x&1&abcd", "expected width&height&channels&");
    refused("a.bin", "1111111111111&1&1&abcd", "expected width&height&channels&");
    refused("a.exr", "abcd", "expected .npy, .png, .pfm, .dmb or .bin");
}

TEST_F(PriorFolder, ArraysOfOtherShapesAreRefused) {
    const auto array = [&](const std::string& shape, std::size_t numbers) {
        std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': " + shape + ", }";
        header.resize(117, ' '), header += '\n';
        write("a.npy",
              std::string("\x93NUMPY\1\0\x76\0", 10) + header + std::string(4 * numbers, '\0'));
        return (folder / "a.npy").string();
    };
    EXPECT_EQ(read_npy_map(array("(1, 4, 5, 1)", 20)).width, 5);
    EXPECT_EQ(read_npy_map(array("(1, 5)", 5)).height, 1);
    EXPECT_EQ(read_npy_map(array("(4, 5, 3)", 60), 3).width, 5);
    EXPECT_EQ(read_npy_map(array("(3, 4, 5)", 60), 3).width, 5);
    EXPECT_EQ(read_npy_map(array("(3, 5, 3)", 45), 3, MapLayout::chw).width, 3);
    EXPECT_EQ(read_npy_map(array("(3, 5, 3)", 45), 3).width, 5);
    EXPECT_EQ(read_npy_map(array("(7, 4, 5)", 140), 0).channels, 7);
    EXPECT_EQ(read_npy_map(array("(7, 4, 5)", 140), 0, MapLayout::hwc).channels, 5);
    for (const auto& [shape, numbers, channels] : {std::tuple{"(20,)", 20, 1},
                                                   {"(4, 5, 3)", 60, 1},
                                                   {"(4, 5)", 20, 3},
                                                   {"(2, 4, 5)", 40, 3},
                                                   {"()", 1, 1},
                                                   {"(2, 2, 2, 2)", 16, 1},
                                                   {"(0, 5)", 0, 1}}) {
        const std::string path = array(shape, static_cast<std::size_t>(numbers));
        expect_error(ExitCode::input, "E_PRIOR_FILE", [&] { read_npy_map(path, channels); });
    }
}

TEST_F(PriorFolder, ColouredPicturesAreNoNumbers) {
    ImageU8 image(4, 3, 3, 90);
    replace_png(folder / "a.png", image);
    EXPECT_EQ(read_prior_map(folder / "a.png").at(2, 2), 90.f);
    image.at(1, 1, 2) = 91;
    replace_png(folder / "a.png", image);
    expect_error(ExitCode::input, "a coloured picture", [&] { read_prior_map(folder / "a.png"); });
    replace_png(folder / "a.png", ImageU8(4, 3, 1, 90));
    expect_error(ExitCode::input, "a grey picture", [&] { read_prior_map(folder / "a.png", 3); });
}

}  // namespace
}  // namespace tvsgs
