// A checkpoint of several processes: the file that one process writes, gathered or as it comes.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <numeric>

#include "io/read_file.h"
#include "pipeline/checkpoints.h"
#include "support/thread_ranks.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr int kSplats = 5000, kPlanes = 3, kDone = 7;

/// Three planes of what the owners of the splats keep, and a number that all know.
State state_of(Communicator* peers) {
    int count = kSplats, number = 4711;
    const Part own = own_part(peers, kSplats);
    Buffer<int, Cpu> kept(static_cast<std::size_t>(kPlanes * own.size()));
    for (int p = 0; p < kPlanes; ++p)
        std::iota(kept.data() + p * own.size(), kept.data() + (p + 1) * own.size(),
                  p * kSplats + own.begin);
    State state;
    StateVisitor<Cpu> visitor(state, state_parts(peers));
    visitor.part("kept", kept, count, kPlanes);
    visitor.value("number", number);
    return state;
}

Scene scene() {
    Scene scene;
    scene.points.positions.assign(10, {1, 2, 3});
    return scene;
}

/// The file that so many processes leave in a folder of their own, and its name.
std::string written(int ranks, bool gathers, std::int64_t host_limit = 0) {
    const fs::path run = fs::path(testing::TempDir()) / ("checkpoints_" + std::to_string(getpid()));
    fs::create_directories(run);
    const Scene of = scene();
    std::string file;
    test::on_ranks(ranks, [&](test::ThreadRank* peers) {
        const auto state = std::make_shared<const State>(state_of(peers));
        if (peers != nullptr) peers->wait_for_all("states");  // the limit is not for them
        if (rank_of(peers) != 0) return send_checkpoint(*peers, *state);
        CheckpointWriter writer(run, "{}", of, peers, gathers);
        if (host_limit > 0) set_memory_limit(Cpu{}, memory_use(Cpu{}).current_bytes + host_limit);
        writer.save(kDone, 1.5, state);
        file = writer.finish().value_or("not written: " + writer.failure());
        if (host_limit > 0) set_memory_limit(Cpu{}, 0);
    });
    EXPECT_TRUE(file.ends_with("checkpoints/iteration_7.ckpt")) << file;
    std::string bytes = read_bytes(file);
    fs::remove_all(run);
    return bytes;
}

TEST(CheckpointsOfSeveral, AreThoseOfOne) {
    const std::string one = written(1, false);
    ASSERT_GT(one.size(), kPlanes * kSplats * sizeof(int));
    for (const int ranks : {2, 3})
        for (const bool gathers : {false, true})
            EXPECT_TRUE(written(ranks, gathers) == one) << ranks << (gathers ? " gathered" : "");
}

TEST(CheckpointsOfSeveral, AreWrittenAsTheyComeWithoutRoom) {
    // Less than the whole, more than what is on its way of a plane.
    EXPECT_TRUE(written(2, true, 2 * kSplats * sizeof(int) + 4096) == written(1, false));
}

}  // namespace
}  // namespace tvsgs
