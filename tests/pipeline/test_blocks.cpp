// Splitting scenes into blocks, and the files of a split.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "io/files/atomic_file.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "pipeline/blocks/blocks_folder.h"
#include "pipeline/blocks/blocks_geometry.h"
#include "pipeline/blocks/blocks_split.h"
#include "support/numeric.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using Places = std::vector<Vec2<double>>;

Places random_places(int count, unsigned seed) {
    test::Random random(seed);
    Places places;
    for (int i = 0; i < count; ++i)  // more on one side, and wider than deep
        places.push_back({6 * std::pow(random.uniform(0, 1), 2.0), random.uniform(-2, 2)});
    return places;
}

TEST(BlocksGeometry, EachPlaceHasOneCellAndCellsAreBalanced) {
    const Places places = random_places(4001, 3);
    test::Random random(4);
    std::vector<double> weights;
    double total = 0;
    for (std::size_t i = 0; i < places.size(); ++i)
        total += weights.emplace_back(random.uniform(0.5, 2));
    for (const int count : {1, 2, 3, 4, 7, 16}) {
        const auto cells = split_cells(places, weights, count, 0);
        ASSERT_EQ(static_cast<int>(cells.size()), count);
        std::vector<double> of(cells.size());
        const auto holders = [&](Vec2<double> p) {
            int n = 0;
            for (const GroundCell& cell : cells) n += cell.holds(p);
            return n;
        };
        for (std::size_t i = 0; i < places.size(); ++i) {
            ASSERT_EQ(holders(places[i]), 1) << i;
            of[static_cast<std::size_t>(cell_of(cells, places[i]))] += weights[i];
        }
        // Also beyond all points, and exactly on the cuts.
        for (const Vec2<double> far : {Vec2<double>{1e9, 1e9}, {-1e9, 3}, {0, -1e9}})
            EXPECT_EQ(holders(far), 1);
        for (const GroundCell& cell : cells)
            for (const double x : {cell.low[0], cell.high[0]})
                if (std::isfinite(x)) {
                    EXPECT_EQ(holders({x, 0.1}), 1);
                }
        const double power = std::exp2(std::ceil(std::log2(count)));
        for (const double weight : of) {
            EXPECT_LT(weight, 1.02 * 2 * total / power);
            EXPECT_GT(weight, 0.98 * total / power);
        }
    }
}

TEST(BlocksGeometry, CutsGoAcrossTheLongerSide) {
    const auto cells = split_cells(random_places(2000, 5), std::vector<double>(2000, 1), 2, 0);
    EXPECT_TRUE(std::isfinite(cells[0].high[0]));
    EXPECT_TRUE(std::isinf(cells[0].high[1]));
    EXPECT_EQ(cells[0].high[0], cells[1].low[0]);
    // The median of uniform numbers in a square.
    EXPECT_NEAR(cells[0].high[0], 6 * 0.25, 0.1);
}

TEST(BlocksGeometry, EqualCoordinatesAreCutBesideOrAcross) {
    Places line(100, {1, 0});
    for (int i = 0; i < 100; ++i) line[static_cast<std::size_t>(i)].y = i / 50;
    const auto cells = split_cells(line, std::vector<double>(100, 1), 2, 0);
    EXPECT_EQ(cells[0].high[1], 1);
    EXPECT_EQ(cell_of(cells, {1, 0}), 0);
    EXPECT_EQ(cell_of(cells, {1, 1}), 1);
    EXPECT_THROW(split_cells(line, std::vector<double>(100, 1), 3, 0), Error);
    EXPECT_THROW(split_cells({}, {}, 2, 0), Error);
}

TEST(BlocksGeometry, HeavyCellsAreCutUntilNoneIs) {
    const Places places = random_places(1000, 6);
    const std::vector<double> weights(1000, 1);
    const auto cells = split_cells(places, weights, 0, 130);
    EXPECT_GE(cells.size(), 8u);
    EXPECT_LE(cells.size(), 16u);
    std::vector<int> of(cells.size());
    for (const auto& p : places) ++of[static_cast<std::size_t>(cell_of(cells, p))];
    for (const int n : of) EXPECT_LE(n, 130);
}

TEST(BlocksGeometry, UpIsWhereCamerasSpreadLeastAndAxesOfTheWorldAreKept) {
    test::Random random(8);
    std::vector<Vec3d> flight;
    for (int i = 0; i < 200; ++i)
        flight.push_back({random.uniform(-5, 5), 0.2 * random.normal(), random.uniform(-9, 9)});
    const Vec3d up = up_of(flight);
    EXPECT_GT(std::abs(up.y), 0.99);
    const GroundFrame frame = ground_frame(up);
    const Vec2<double> p = frame.on_ground({3, 100, 7});
    EXPECT_EQ(p.x, 3);
    EXPECT_EQ(p.y, 7);
    // A tilted frame is orthonormal, and its first axes are level.
    const GroundFrame tilted = ground_frame({1, 2, 2});
    const Mat3<double>& R = tilted.ground_from_world;
    const Mat3<double> identity = R * transpose(R);
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) EXPECT_NEAR(identity[r][c], r == c, 1e-15);
    const Vec2<double> top = tilted.on_ground({1, 2, 2});
    EXPECT_NEAR(std::hypot(top.x, top.y), 0, 1e-15);
    EXPECT_THROW(up_of({{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {5, 5, 5}}), Error);
    EXPECT_THROW(up_of({{0, 0, 0}, {1, 1, 2}}), Error);
}

TEST(BlocksGeometry, ViewsAreChosenByShareAndThenByNeed) {
    // Point 0 is seen by all; 1 by views 2, 3, 4; 2 by only two views, all that exist.
    std::vector<BlockView> views(6);
    views[0] = {0.5, {0}};
    views[1] = {0.09, {0}};
    views[2] = {0.08, {0, 1}};
    views[3] = {0.2, {0, 1}};
    views[4] = {0.02, {0, 1, 2}};
    views[5] = {0.01, {0, 2}};
    EXPECT_EQ(choose_block_views(views, 3, 0.1), (std::vector<int>{0, 1, 2, 3, 4}));
    for (BlockView& view : views) view.sees = {0};
    EXPECT_EQ(choose_block_views(views, 1, 0.1), (std::vector<int>{0, 1, 3}));
    for (BlockView& view : views) view.sees.clear();
    EXPECT_EQ(choose_block_views(views, 0, 0.1), (std::vector<int>{0, 3}));
}

TEST(BlocksGeometry, DistanceIsThatOfTheNearestEdge) {
    GroundCell cell;
    cell.low[0] = 0, cell.high[0] = 2, cell.low[1] = 1;
    EXPECT_EQ(cell.distance({1, 5}), 0);
    EXPECT_EQ(cell.distance({-3, 5}), 3);
    EXPECT_EQ(cell.distance({5, -3}), 5);
    EXPECT_TRUE(cell.holds({0, 1}));
    EXPECT_FALSE(cell.holds({2, 1}));
}

TEST(BlocksFolder, ListsOfBlocksAreAsBatchSystemsTakeThem) {
    EXPECT_EQ(block_list({}), "");
    EXPECT_EQ(block_list({3}), "3");
    EXPECT_EQ(block_list({3, 7, 8, 9, 11, 12}), "3,7-9,11-12");
}

class BlocksFiles : public testing::Test {
protected:
    void SetUp() override {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_blocks_" + std::to_string(::getpid()));
        fs::remove_all(folder_);
        fs::create_directories(folder_);
        start_manifest(folder_);
        manifest_.folder = folder_;
        manifest_.scene = "/a scene's \"place\"";
        manifest_.scene_crc = 0xdeadbeef;
        manifest_.seed = 7, manifest_.iterations = 300;
        manifest_.origin = {500000.125, 4649776.25, 310.1};
        manifest_.frame = ground_frame({1, 2, 2});
        manifest_.voxel_size = 0.1, manifest_.margin = 1.0 / 3;
        manifest_.near = {{-10, -10, -10}, {10, 10, 10}};
        manifest_.cells = split_cells(random_places(500, 9), std::vector<double>(500, 1), 3, 0);
        manifest_.split = split_of(manifest_);
        for (int block = 1; block <= 3; ++block) {
            const std::string of = manifest_.block_folder(block);
            write_text_file(of + "/views.txt", "a.png\nb.png\n");
            write_block_inputs(
                manifest_, {block, manifest_.split, 2, 10, 20, 0, {record_of(of, "views.txt")}});
            manifest_.files.push_back(
                record_of(folder_, manifest_.block_name(block) + "/block.json"));
        }
        write_manifest(manifest_);
    }
    void TearDown() override { fs::remove_all(folder_); }

    void finish(int block) {
        const std::string of = manifest_.block_folder(block);
        write_text_file(of + "/run/splats.ply", "splats");
        BlockResult result;
        result.block = block, result.split = manifest_.split, result.program = "1.0";
        result.splats = 6, result.seconds = 2.5;
        result.files = {record_of(of, "run/splats.ply")};
        write_block_result(manifest_, result);
    }
    template <class Action>
    static std::string message(const Action& action) {
        try {
            action();
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::input);
            return error.what();
        }
        return "no error";
    }
    static void replace(const std::string& file, const std::string& what, const std::string& by) {
        std::string text = read_bytes(file);
        ASSERT_NE(text.find(what), std::string::npos) << file << " " << what;
        text.replace(text.find(what), what.size(), by);
        std::ofstream(file, std::ios::binary) << text;
    }

    fs::path folder_;
    BlocksManifest manifest_;
};

TEST_F(BlocksFiles, AreReadAsWritten) {
    const BlocksManifest read = read_manifest(folder_);
    EXPECT_EQ(read.split, manifest_.split);
    EXPECT_EQ(read.scene, manifest_.scene);
    EXPECT_EQ(read.scene_crc, manifest_.scene_crc);
    EXPECT_EQ(read.iterations, 300);
    EXPECT_EQ(read.margin, manifest_.margin);
    EXPECT_EQ(read.origin.y, manifest_.origin.y);
    ASSERT_EQ(read.count(), 3);
    for (std::size_t i = 0; i < 3; ++i)
        for (int axis = 0; axis < 2; ++axis) {
            EXPECT_EQ(read.cells[i].low[axis], manifest_.cells[i].low[axis]);
            EXPECT_EQ(read.cells[i].high[axis], manifest_.cells[i].high[axis]);
        }
    test::Random random(10);
    for (int i = 0; i < 300; ++i) {
        const Vec3d p = 8.0 * random.normal3();
        EXPECT_EQ(read.block_of(p), manifest_.block_of(p));
    }
    EXPECT_EQ(read.block_of({1e6, 0, 0}), 0);

    EXPECT_EQ(read_block_inputs(read, 2).points, 10);
    EXPECT_FALSE(read_block_result(read, 2));
    finish(2);
    const auto result = read_block_result(read, 2);
    ASSERT_TRUE(result);
    EXPECT_EQ(result->splats, 6);
    EXPECT_EQ(result->seconds, 2.5);
}

TEST_F(BlocksFiles, DamageIsSaidWithBlockFileAndRemedy) {
    const std::string block = manifest_.block_folder(2);
    finish(2);
    const auto result = [&] { return message([&] { read_block_result(manifest_, 2); }); };
    const auto inputs = [&] { return message([&] { read_block_inputs(manifest_, 2); }); };
    EXPECT_EQ(result(), "no error");

    const auto expect_all = [](const std::string& text, std::initializer_list<const char*> parts) {
        for (const char* part : parts)
            EXPECT_NE(text.find(part), std::string::npos) << text << "\nlacks " << part;
    };
    replace(block + "/run/splats.ply", "splats", "spLats");
    expect_all(result(), {"block 2", "run/splats.ply", "damaged: CRC-32", "--again"});
    replace(block + "/run/splats.ply", "spLats", "spl");
    expect_all(result(), {"block 2", "3 bytes, expected 6", "--block 2 --again"});
    fs::remove(block + "/run/splats.ply");
    expect_all(result(), {"block 2", "run/splats.ply is missing"});

    finish(2);
    replace(block + "/done.json", "\"version\": 2", "\"version\": 3");
    expect_all(result(), {"done.json", "has version 3", "expected 2", "--again"});
    replace(block + "/done.json", "\"version\": 3", "\"vision\": 3");
    expect_all(result(), {"done.json", "has no version"});
    finish(2);
    fs::copy_file(block + "/done.json", manifest_.block_folder(3) + "/done.json");
    expect_all(message([&] { read_block_result(manifest_, 3); }), {"for block 2", "block 3"});
    fs::remove(manifest_.block_folder(3) + "/done.json");
    BlocksManifest other = manifest_;
    other.split = manifest_.split + 1;
    expect_all(message([&] { read_block_result(other, 2); }), {"of split", "--again"});
    std::ofstream(block + "/done.json") << "{\"version\": 2, ";
    expect_all(result(), {"done.json", "not valid JSON", "--again"});
    finish(2);
    replace(block + "/done.json", "run/splats.ply", "../../../etc/x");
    expect_all(result(), {"done.json", "outside its folder"});

    replace(block + "/views.txt", "a.png", "c.png");
    expect_all(inputs(), {"block 2", "views.txt", "is damaged", "split again"});
    fs::remove(block + "/views.txt");
    expect_all(inputs(), {"views.txt is missing"});
    replace(block + "/block.json", "\"points\": 10", "\"points\": 11");
    expect_all(inputs(), {"block.json", "is damaged"});
    manifest_.files.clear();
    expect_all(inputs(), {"block 2", "manifest.json lists no block_002/block.json"});
}

TEST(BlocksGeometry, SharesSumToOneAndHalveAtCuts) {
    const Places places = random_places(2000, 5);
    const auto cells = split_cells(places, std::vector<double>(places.size(), 1), 7, 0);
    const Vec2<double> reach{0.05, 0.11};
    int between = 0;
    for (const Vec2<double> p : places) {
        double sum = 0;
        for (const GroundCell& cell : cells) {
            const double share = cell.share(p, reach);
            sum += share;
            between += share > 0 && share < 1;
            EXPECT_EQ(cell.share(p, {0, 0}), cell.holds(p) ? 1 : 0);
            if (cell.distance(p) > std::hypot(reach.x, reach.y)) {
                EXPECT_EQ(share, 0);
            }
        }
        EXPECT_NEAR(sum, 1, 1e-12) << p.x << ", " << p.y;
    }
    EXPECT_GT(between, 400);
    GroundCell half;
    half.high[0] = 2;
    EXPECT_DOUBLE_EQ(half.share({2, 9}, reach), 0.5);
    EXPECT_NEAR(half.share({2 - 0.025, 9}, reach), 0.75, 1e-12);
}

TEST_F(BlocksFiles, ManifestsThatAreNoneAreRefused) {
    const auto text = [&] { return message([&] { read_manifest(folder_); }); };
    const std::string file = (folder_ / "manifest.json").string();
    replace(file, "\"iterations\": 300", "\"iterations\": 301");
    EXPECT_NE(text().find("damaged"), std::string::npos) << text();
    replace(file, "\"iterations\": 301", "\"iterations\": 300");
    EXPECT_EQ(text(), "no error");
    replace(file, "\"version\": 2", "\"version\": 9");
    EXPECT_NE(text().find("version 9"), std::string::npos) << text();
    for (const char* bad : {"", "[]", "{\"version\": 2}", "nonsense"}) {
        std::ofstream(file) << bad;
        EXPECT_NE(text().find("manifest.json"), std::string::npos) << bad << ": " << text();
    }
    fs::remove(file);
    EXPECT_NE(text().find("no manifest.json"), std::string::npos) << text();
}

}  // namespace
}  // namespace tvsgs
