// A scene in UTM coordinates, millions of units from zero: what is trained, meshed and measured is
// that of the scene at zero, and every file has the coordinates that the scene came in.
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/scene/scene.h"
#include "io/files/read_file.h"
#include "io/mesh/mesh_files.h"
#include "io/scene/georeference.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

// Easting and northing in metres, as of a place in Europe.
constexpr Vec3d kAway{691200, 5337600, 512};

TEST(LocalOrigin, IsZeroWhereFloatHasDigits) {
    const auto is_zero = [](Vec3d v) { return v.x == 0 && v.y == 0 && v.z == 0; };
    EXPECT_TRUE(is_zero(local_origin({{3, 0, 0}, {-3, 1, 0}, {0, 0, 4}})));
    EXPECT_TRUE(is_zero(local_origin({{90, 0, 0}, {92, 0, 0}})));  // 91 radii
    EXPECT_FALSE(is_zero(local_origin({{300, 0, 0}, {302, 0, 0}})));
    EXPECT_TRUE(is_zero(local_origin({{5, 0, 0}})));  // one place: as one of radius 1
    const Vec3d o = local_origin({kAway + Vec3d{3, 0, 0}, kAway - Vec3d{3, 0.1, 0}});
    EXPECT_LE(norm(o - kAway), 3);
    EXPECT_EQ(o.x, std::nearbyint(o.x));
}

class FarScene : public testing::Test {
protected:
    static void SetUpTestSuite() {
        folder_ = fs::temp_directory_path() / ("tvsgs_far_" + std::to_string(getpid()));
        fs::remove_all(folder_);
        fs::create_directories(folder_);
        ASSERT_EQ(call("synth", "--out near --views 6 --width 80 --height 60 --quiet"), 0);
        fs::copy(folder_ / "near", folder_ / "far", fs::copy_options::recursive);
        move_model(folder_ / "far/sparse/0");
        write_georeference((folder_ / "far").string(), {"EPSG:32632", kAway});
        for (const std::string name : {"near", "far"})
            ASSERT_EQ(call("train", "--scene " + name + " --out run_" + name +
                                        " --device cpu --iterations 60 --config " +
                                        TVSGS_SOURCE_DIR "/configs/pgsr_sparse.json --eval"),
                      0)
                << name;
    }
    static void TearDownTestSuite() { fs::remove_all(folder_); }

    static int call(const std::string& tool, const std::string& arguments) {
        const int status =
            std::system(("cd '" + folder_.string() + "' && OMP_NUM_THREADS=2 " +
                         TVSGS_BIN_DIR "/tvsgs-" + tool + " " + arguments + " >>out.txt 2>&1")
                            .c_str());
        return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    }

    /// x_camera = R (X - away) + t.
    static void move_model(const fs::path& model) {
        const auto rewrite = [](const fs::path& file, const auto& change) {
            std::ifstream in(file);
            std::ostringstream out;
            out.precision(17);
            bool record = true;
            for (std::string line; std::getline(in, line);) {
                if (line.empty() || line[0] == '#')
                    out << line << '\n';
                else
                    record = change(line, out, record);
            }
            in.close();
            std::ofstream(file) << out.str();
        };
        rewrite(model / "images.txt", [](const std::string& line, std::ostream& out, bool record) {
            if (!record) {
                out << "\n";  // observations, which tracks tell as well
                return true;
            }
            std::istringstream words(line);
            int id = 0;
            Quat<double> q;
            Vec3d t;
            words >> id >> q.w >> q.x >> q.y >> q.z >> t.x >> t.y >> t.z;
            t = t - rotation(normalize(q)) * kAway;
            out << id << ' ' << q.w << ' ' << q.x << ' ' << q.y << ' ' << q.z << ' ' << t.x << ' '
                << t.y << ' ' << t.z << words.rdbuf() << '\n';
            return false;
        });
        rewrite(model / "points3D.txt", [](const std::string& line, std::ostream& out, bool) {
            std::istringstream words(line);
            int id = 0;
            Vec3d p;
            words >> id >> p.x >> p.y >> p.z;
            p += kAway;
            out << id << ' ' << p.x << ' ' << p.y << ' ' << p.z << words.rdbuf() << '\n';
            return true;
        });
    }

    static double psnr(const std::string& run) {
        std::ifstream log(folder_ / run / "log.jsonl");
        json last;
        for (std::string line; std::getline(log, line);) last = json::parse(line);
        return last.at("psnr");
    }
    static std::vector<Vec3d> positions(const std::string& file) {
        return read_mesh_geometry((folder_ / file).string()).positions;
    }
    static Vec3d mean_of(const std::vector<Vec3d>& points) {
        Vec3d mean;
        for (const Vec3d p : points) mean += p / static_cast<double>(points.size());
        return mean;
    }

    static inline fs::path folder_;
};

TEST_F(FarScene, IsTrainedAsTheSceneAtZero) {
    // Roundings differ where the frames do; they grow little in 60 iterations.
    EXPECT_NEAR(psnr("run_far"), psnr("run_near"), 0.3);
    EXPECT_GT(psnr("run_far"), 10);
    const std::string splats = "/point_cloud/iteration_60/point_cloud.ply";
    const auto near = positions("run_near" + splats), far = positions("run_far" + splats);
    ASSERT_EQ(near.size(), far.size());
    for (std::size_t i = 0; i < near.size(); ++i)
        ASSERT_LT(norm(far[i] - kAway - near[i]), 0.05) << i;  // a hundredth of the scene
}

TEST_F(FarScene, CamerasAreWrittenWhereTheyStand) {
    const auto camera = [](const std::string& run) {
        std::ifstream in(folder_ / run / "cameras.json");
        const json p = json::parse(in).at(0).at("position");
        return Vec3d{p.at(0), p.at(1), p.at(2)};
    };
    EXPECT_LT(norm(camera("run_far") - kAway - camera("run_near")), 1e-5);  // a float's, of 5 units
}

TEST_F(FarScene, MeshAndScoresAreThoseOfTheSceneAtZero) {
    for (const std::string name : {"near", "far"}) {
        ASSERT_EQ(call("extract-mesh",
                       "--model run_" + name + " --device cpu --mesh-resolution 96 --error 0"),
                  0);
        ASSERT_EQ(call("eval", "nvs --model run_" + name + " --device cpu"), 0);
    }
    const auto near = positions("run_near/mesh/mesh.glb"), far = positions("run_far/mesh/mesh.glb");
    ASSERT_GT(near.size(), 100u);
    EXPECT_NEAR(static_cast<double>(far.size()), static_cast<double>(near.size()),
                0.1 * static_cast<double>(near.size()));
    EXPECT_LT(norm(mean_of(far) - kAway - mean_of(near)), 0.1);
}

/// A scene with a projection passes it on, and its meshes stand upright by its z axis.
TEST_F(FarScene, FilesNameTheProjection) {
    EXPECT_EQ(projection_of((folder_ / "run_far").string()), "EPSG:32632");
    EXPECT_EQ(projection_of((folder_ / "run_near").string()), "");
    const auto json_in = [](const std::string& file) {
        const std::string bytes = read_bytes((folder_ / file).string());
        std::uint32_t length = 0;
        std::memcpy(&length, &bytes.at(12), 4);
        return json::parse(bytes.substr(20, length));
    };
    ASSERT_EQ(
        call("extract-mesh", "--model run_far --out mesh.glb --device cpu --mesh-resolution 48"),
        0);
    ASSERT_EQ(call("export", "run_far splats.glb --no-check --device cpu"), 0);
    for (const std::string file : {"mesh.glb", "splats.glb"}) {
        const json glb = json_in(file);
        EXPECT_EQ(glb["asset"]["extras"]["projection"], "EPSG:32632") << file;
        const json& matrix = glb["nodes"][0]["matrix"];  // by columns: z goes to y
        ASSERT_EQ(matrix.size(), 16u) << file;
        EXPECT_EQ(std::abs(matrix[9].get<double>()), 1) << file;
    }
    // Conversions keep it: to a file beside the splats, and to a comment.
    ASSERT_EQ(call("export", "run_far splats.spz --no-check --device cpu"), 0);
    EXPECT_EQ(json::parse(read_bytes((folder_ / "splats.spz.json").string()))["projection"],
              "EPSG:32632");
    for (const std::string from : {"splats.spz", "splats.glb"}) {
        ASSERT_EQ(call("export", from + " again.ply --no-check --device cpu"), 0);
        EXPECT_NE(read_bytes((folder_ / "again.ply").string())
                      .substr(0, 200)
                      .find("comment projection EPSG:32632\n"),
                  std::string::npos)
            << from;
        fs::remove(folder_ / "again.ply");
    }
    std::ofstream(folder_ / "far/georeference.json")
        << "{\"projection\": \"a\\nb\", \"origin\": [1, 2, 3]}";
    EXPECT_EQ(call("extract-mesh", "--model run_far --out no.glb --device cpu"), 3);
    fs::remove(folder_ / "far/georeference.json");
    write_georeference((folder_ / "far").string(), {"EPSG:32632", kAway});
}

TEST_F(FarScene, DistancesAreThoseAtZero) {
    // Near 5e6 floats are half a unit apart.
    PointCloud truth, prediction;
    for (int i = 0; i < 400; ++i) {
        const Vec3f p{static_cast<float>(i % 20), static_cast<float>(i / 20), 0};
        truth.positions.push_back(p);
        prediction.positions.push_back(p + Vec3f{0, 0, 0.015625f});
    }
    write_cloud_ply((folder_ / "truth.ply").string(), truth, kAway);
    write_cloud_ply((folder_ / "prediction.ply").string(), prediction, kAway);
    ASSERT_EQ(call("eval",
                   "geometry --pred prediction.ply --gt truth.ply --tau 0.016,0.015 --out "
                   "distances.json"),
              0);
    const json scores = json::parse(std::ifstream(folder_ / "distances.json"));
    EXPECT_NEAR(scores.at("chamfer").get<double>(), 0.015625, 2e-9);  // a double's at 5e6
    EXPECT_EQ(scores.at("thresholds").at(0).at("f1").get<double>(), 1);
    EXPECT_EQ(scores.at("thresholds").at(1).at("f1").get<double>(), 0);
}

TEST_F(FarScene, CloudsGoThereAndBack) {
    const Vec3d origin{kAway.x + 0.5, kAway.y, kAway.z};
    PointCloud cloud;
    cloud.positions = {{0.125f, -3, 0.001f}, {1, 2, 3}};
    const std::string file = (folder_ / "cloud.ply").string();
    write_cloud_ply(file, cloud, origin);
    const auto world = read_ply_geometry(file).positions;
    // A double has 2e-10 at 5e6.
    for (std::size_t i = 0; i < 2; ++i) {
        EXPECT_LT(norm(world[i] - origin - vec_cast<double>(cloud.positions[i])), 2e-9);
        EXPECT_LT(norm(read_ply(file, origin).points.positions[i] - cloud.positions[i]), 2e-9f);
    }
    ASSERT_EQ(
        call("train", "--scene far --out from_cloud --device cpu --iterations 1 --init-ply " +
                          (folder_ / "run_far/point_cloud/iteration_60/point_cloud.ply").string()),
        0);
}

}  // namespace
}  // namespace tvsgs
