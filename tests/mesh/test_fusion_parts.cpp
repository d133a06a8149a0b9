// Fusion within a memory limit gives the same mesh, byte for byte, for any limit.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <set>

#include "core/device/cuda_device.h"
#include "core/error.h"
#include "mesh/fuse/fusion.h"
#include "mesh/fuse/pixel_trust.h"
#include "mesh/sphere_views.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

class FusionParts : public testing::Test {
protected:
    const fs::path folder_ =
        fs::temp_directory_path() / ("tvsgs_parts_" + std::to_string(::getpid()));

    void SetUp() override { fs::create_directories(folder_); }
    void TearDown() override {
        EXPECT_TRUE(fs::is_empty(folder_)) << "the spilled data must leave nothing behind";
        fs::remove_all(folder_);
    }

    /// Cases of fusing the sphere: 9 blocks across, or 3 in front of a dome.
    struct Case {
        const char* name;
        TsdfOptions options{0.03f, 0.09f, 0};
        bool weighted = false, trust = false;
        double dome = 0;
        std::vector<int> shares{2, 10};  // divisors of the memory it needs; 1: no limit
    };
    static std::vector<Case> cases() {
        Case unbounded{"unbounded", {0.08f, 0.24f, 0}};
        unbounded.options.contraction = {{0.1f, 0, -0.2f}, 1.5f};
        unbounded.dome = 8;
        unbounded.shares = {1, 3};
        Case all = unbounded;
        all.name = "unbounded, weighted, carved", all.weighted = true, all.options.carve = true;
        Case trust = unbounded;
        trust.name = "unbounded, trust", trust.trust = trust.options.trust = true;
        return {{"as it is"}, unbounded, all, trust};
    }

    /// The sphere from 6 sides.
    template <class Device>
    TriangleMesh fuse(const Case& how,
                      std::int64_t max_bytes,
                      FusionReport& report,
                      int fail_at = -1) const {
        Buffer<float, Device> depth, weight;
        Buffer<Vec3f, Device> color;
        const auto source = [&](int i) -> DepthView<Device> {
            if (i == fail_at) throw Error(ExitCode::input, "this view is bad");
            test::DepthMap map = test::sphere_view(i, 6, 96, how.dome);
            // A surface in front of the sphere that the other views look through.
            if (how.trust && i == 0)
                for (std::size_t p = 0; p < map.depth.size(); ++p)
                    if (p / 96 > 30 && p / 96 < 60 && p % 96 > 30 && p % 96 < 60)
                        map.depth[p] = 1.2f;
            copy(map.depth, depth), copy(map.color, color);
            std::vector<float> weights;
            if (how.weighted)
                for (const float d : map.depth) weights.push_back(1 / (d * d));
            if (how.trust)  // in stripes, which make holes
                for (std::size_t p = 0; p < map.depth.size(); ++p)
                    weights.push_back(p % 96 / 8 % 3 == 0 ? kDoubtedWeight : kTrustedWeight);
            copy(weights, weight);
            return {map.camera, std::as_const(depth).span(), std::as_const(color).span(),
                    std::as_const(weight).span()};
        };
        TsdfOptions options = how.options;
        options.max_bytes = max_bytes;
        return fuse_views<Device>(6, source, options, how.weighted ? 0 : 1, folder_.string(),
                                  report);
    }

    template <class Device>
    void expect_same_for_all_budgets(const Case& how) const {
        SCOPED_TRACE(how.name);
        FusionReport whole;
        const TriangleMesh expected = fuse<Cpu>(how, 0, whole);
        EXPECT_EQ(whole.parts, 1);
        EXPECT_EQ(whole.spilled_bytes, 0);
        ASSERT_GT(expected.faces.size(), 4000u);
        const std::int64_t needed = whole.blocks * VoxelBlocks<Device>::kWorkingBytesPerBlock;
        for (const int share : how.shares) {
            const std::int64_t budget = share == 1 ? 0 : needed / share;
            FusionReport report;
            const TriangleMesh mesh = fuse<Device>(how, budget, report);
            EXPECT_EQ(report.blocks, whole.blocks);
            EXPECT_EQ(report.parts == 1, share == 1);
            if (share > 1) {
                EXPECT_GT(report.parts, needed / budget);
                // 16 bytes per pixel and the lists of blocks.
                EXPECT_GT(report.spilled_bytes,
                          6 * 96 * 96 * (how.weighted || how.trust ? 20 : 16));
            }
            expect_same(mesh.vertices, expected.vertices, budget);
            expect_same(mesh.colors, expected.colors, budget);
            expect_same(mesh.faces, expected.faces, budget);
        }
    }

    template <class T>
    static void expect_same(const std::vector<T>& a, const std::vector<T>& b, std::int64_t budget) {
        ASSERT_EQ(a.size(), b.size()) << budget;
        EXPECT_EQ(std::memcmp(a.data(), b.data(), a.size() * sizeof(T)), 0) << budget;
    }
};

TEST_F(FusionParts, SameMeshForAllBudgets) {
    for (const Case& how : cases()) expect_same_for_all_budgets<Cpu>(how);
}

TEST_F(FusionParts, SameMeshForAllBudgetsOnTheGpu) {
    if constexpr (kHasCuda) {
        if (cuda_device_count() == 0) GTEST_SKIP() << "no GPU";
        for (const Case& how : cases()) expect_same_for_all_budgets<Cuda>(how);
    } else {
        GTEST_SKIP() << "build without CUDA";
    }
}

TEST_F(FusionParts, BuffersStayWithinTheBudget) {
    FusionReport whole, parts;
    fuse<Cpu>({"as it is"}, 0, whole);
    const std::int64_t budget = whole.blocks * VoxelBlocks<Cpu>::kWorkingBytesPerBlock / 10;
    // The peak counts the whole process. The increase at a tenth of the limit must fit below the
    // peak of the whole volume, so the buffers are counted while the parts are fused.
    std::int64_t most = 0;
    Buffer<float, Cpu> depth;
    Buffer<Vec3f, Cpu> color;
    TsdfVolume<Cpu> volume({0.03f, 0.09f, budget});
    std::vector<std::uint64_t> keys;
    {
        const test::DepthMap map = test::sphere_view(0, 6, 96);
        keys = volume.touched_blocks(map.view());
        ASSERT_FALSE(volume.integrate(map.view()));
    }
    const std::int64_t before = memory_use(Cpu{}).current_bytes;
    PartPlanner planner(keys, volume.part_capacity());
    for (BlockPart part; planner.next(part);) {
        volume.start_part(part.keys);
        marching_cubes_part(volume.blocks(), 1, part.first, part.count);
        most = std::max(most, memory_use(Cpu{}).current_bytes - before);
    }
    EXPECT_GT(most, budget / 4);
    EXPECT_LE(most, budget);
}

TEST_F(FusionParts, ErrorsLeaveNothing) {
    FusionReport report;
    const std::int64_t block = VoxelBlocks<Cpu>::kWorkingBytesPerBlock;
    EXPECT_THROW(fuse<Cpu>({"as it is"}, 100 * block, report, 4), Error);
    try {
        fuse<Cpu>({"as it is"}, 5 * block,
                  report);  // a block of a surface has about twenty neighbours
        ADD_FAILURE() << "no error";
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::memory);
        EXPECT_NE(std::string(error.what()).find("--memory"), std::string::npos);
    }
}

TEST(PartPlanning, EveryBlockOnceWithAllItsNeighbours) {
    std::vector<std::uint64_t> keys;
    for (int z = -3; z < 4; ++z)
        for (int y = 0; y < 5; ++y)
            for (int x = -2; x < 6; ++x)
                if ((x + 2 * y + 3 * z) % 5 != 0) keys.push_back(block_key({x, y, z}));
    keys.push_back(block_key({kBlockReach - 1, 0, kBlockReach - 1}));
    std::sort(keys.begin(), keys.end());
    const std::set<std::uint64_t> all(keys.begin(), keys.end());
    PartPlanner planner(keys, 60);
    std::vector<std::uint64_t> owned;
    for (BlockPart part; planner.next(part);) {
        EXPECT_LE(part.keys.size(), 60u);
        const std::set<std::uint64_t> there(part.keys.begin(), part.keys.end());
        for (int i = part.first; i < part.first + part.count; ++i) {
            owned.push_back(part.keys[i]);
            const Vec3i p = block_of_key(part.keys[i]);
            for (int n = 0; n < 27; ++n) {
                const Vec3i q = p + Vec3i{n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1};
                const bool inside = q.x < kBlockReach && q.z < kBlockReach;
                EXPECT_TRUE(!inside || !all.count(block_key(q)) || there.count(block_key(q)));
            }
        }
    }
    EXPECT_EQ(owned, keys);
}

TEST(SpillFiles, ReadBackAndErrors) {
    const fs::path folder = fs::temp_directory_path() / ("tvsgs_spill_" + std::to_string(getpid()));
    {
        detail::SpillFile file((folder / "deep").string());
        const std::vector<int> a{1, 2, 3}, b{4};
        const auto place_a = file.append(a.data(), 3), place_b = file.append(b.data(), 1);
        std::vector<int> back;
        file.read(place_b, back);
        EXPECT_EQ(back, b);
        file.read(place_a, back);
        EXPECT_EQ(back, a);
        EXPECT_EQ(file.bytes(), 16);
        EXPECT_TRUE(fs::is_empty(folder / "deep"));
        EXPECT_THROW(file.read({12, 2}, back), Error) << "beyond the end";
    }
    fs::remove_all(folder);
    EXPECT_THROW(detail::SpillFile("/proc/nowhere"), Error);
}

}  // namespace
}  // namespace tvsgs
