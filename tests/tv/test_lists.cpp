// Tests how warps build and read the lists, with CPU threads as lanes.
#include <barrier>
#include <cstring>
#include <numeric>
#include <thread>

#include "tv/internal/neighbour_lists_impl.h"
#include "tv/tv_support.h"

namespace tvsgs::test {
namespace {

TEST(PlaceOfBit, EverySetBit) {
    Random random(3);
    for (int trial = 0; trial < 200; ++trial) {
        std::uint32_t mask = trial == 0 ? ~0u : 0;
        for (int i = 0; i < 32; ++i)
            if (random.uniform() < 0.005f * static_cast<float>(trial)) mask |= 1u << i;
        int n = 0;
        for (int i = 0; i < 32; ++i)
            if ((mask >> i & 1) != 0) {
                EXPECT_EQ(place_of_bit(mask, n++), i) << mask;
            }
    }
}

/// A warp of 32 CPU threads, which tests the code for warps without a GPU.
class ThreadWarp {
public:
    static constexpr int kLanes = 32;
    struct Shared {
        std::barrier<> barrier{kLanes};
        std::uint32_t words[kLanes] = {};
    };
    ThreadWarp(Shared& shared, int lane) : shared_(shared), lane_(lane) {}

    int lane() const { return lane_; }
    void sync() const { shared_.barrier.arrive_and_wait(); }
    template <class T>
    T from_lane(T x, int lane) const {
        return combine(x, [&] { return static_cast<T>(shared_.words[lane]); });
    }
    int sum_before(int x) const { return sum_of(x, lane_); }
    int sum(int x) const { return sum_of(x, kLanes); }
    template <class Value>
    std::uint32_t smallest32(const Value& value) const {
        return combine(value(lane_), [&] { return *std::min_element(begin(), begin() + kLanes); });
    }
    template <class Predicate>
    std::uint32_t ballot32(const Predicate& predicate) const {
        return combine(predicate(lane_) ? 1 : 0, [&] {
            std::uint32_t mask = 0;
            for (int i = 0; i < kLanes; ++i) mask |= shared_.words[i] << i;
            return mask;
        });
    }
    template <class Action>
    void for_lanes(const Action& action) const {
        action(lane_);
    }
    static int lowest_bit(std::uint32_t mask) { return std::countr_zero(mask); }

private:
    const std::uint32_t* begin() const { return shared_.words; }
    template <class T, class Result>
    auto combine(T mine, const Result& result) const {
        sync();  // all have read the previous values
        shared_.words[lane_] = static_cast<std::uint32_t>(mine);
        sync();
        return result();
    }
    int sum_of(int x, int lanes) const {
        return combine(
            x, [&] { return static_cast<int>(std::accumulate(begin(), begin() + lanes, 0u)); });
    }

    Shared& shared_;
    int lane_;
};

/// Runs action(warp) on all lanes.
template <class Action>
void run_warp(const Action& action) {
    ThreadWarp::Shared shared;
    std::vector<std::thread> lanes;
    for (int lane = 0; lane < ThreadWarp::kLanes; ++lane)
        lanes.emplace_back([&, lane] { action(ThreadWarp(shared, lane)); });
    for (std::thread& lane : lanes) lane.join();
}

Neighbours<Cpu> stored(const std::vector<std::uint32_t>& receivers,
                       int count,
                       int k,
                       ListStorage storage) {
    Neighbours<Cpu> near;
    near.usable = near.voters_count = count, near.k = k, near.storage = storage;
    NeighbourScratch<Cpu> scratch;
    detail::store_lists(scratch, near, [&](int, int, auto& rows) { copy(receivers, rows); });
    return near;
}

TEST(CompactLists, LanesGetTheVotersThatFullListsGiveThem) {
    constexpr int kCount = 1500, k = 9;  // the list of rank 5 is in more than 32 tiles
    const Neighbours<Cpu> near = stored(made_up_lists(kCount, k), kCount, k, ListStorage::full);
    const Neighbours<Cpu> small = stored(made_up_lists(kCount, k), kCount, k, ListStorage::compact);
    const FullLists full = near.full_lists();
    const CompactLists compact = small.compact_lists();
    for (const int rank : {0, 5, 6, 100, 1499}) {
        std::vector<std::uint32_t> expected[2][32], found[2][32], list[2];
        run_warp([&](const ThreadWarp& warp) {
            const auto note = [&](auto& lists) {
                return [&](std::uint32_t voter) { lists[warp.lane()].push_back(voter); };
            };
            full.for_each_voter<32>(warp, rank, note(expected[0]));
            full.for_each_voter<16>(warp, rank, note(expected[1]));
            compact.for_each_voter<32>(warp, rank, note(found[0]));
            compact.for_each_voter<16>(warp, rank, note(found[1]));
        });
        for (int i = 0; i < 64; ++i)
            EXPECT_EQ(found[i / 32][i % 32], expected[i / 32][i % 32]) << "rank " << rank;
        std::vector<std::uint32_t> row(k), written(kCount);
        run_warp([&](const ThreadWarp& warp) {
            compact.receivers_of(warp, rank, row.data());
            compact.write_voters(warp, rank, written.data());
        });
        const auto receivers = full.receivers_of(SerialWarp{}, rank, nullptr);
        EXPECT_EQ(row, std::vector<std::uint32_t>(receivers, receivers + k));
        written.resize(std::size_t(near.begin[rank + 1] - near.begin[rank]));
        EXPECT_EQ(written, std::vector<std::uint32_t>(near.voters.data() + near.begin[rank],
                                                      near.voters.data() + near.begin[rank + 1]));
    }
}

TEST(EdgeTiles, WarpsMakeTheSame) {
    constexpr int kCount = 70, k = 9;  // the last of three blocks has 6 voters
    const std::vector<std::uint32_t> receivers = made_up_lists(kCount, k);
    const Neighbours<Cpu> near = stored(receivers, kCount, k, ListStorage::compact);
    const EdgeTiles<Cpu>& expected = near.tiles;
    std::vector<EdgeTile> tiles(expected.count);
    std::vector<std::uint32_t> blocks(expected.count);
    std::vector<std::int64_t> begin = to_host(expected.voter_begin), written = begin;
    std::vector<int> counts(3);
    detail::TileBody body{};
    body.voters = kCount, body.k = k;
    body.receivers = {receivers.data(), receivers.size()};
    for (const bool count : {true, false}) {
        body.counts = {counts.data(), count ? counts.size() : 0};
        body.begin = {begin.data(), begin.size()};
        body.tiles = {tiles.data(), tiles.size()};
        body.receiver_block = {blocks.data(), blocks.size()};
        body.voter_begin = written.data();
        for (int block = 0; block < 3; ++block) {
            std::vector<std::uint32_t> scratch(detail::TileBody::kScratch / sizeof(std::uint32_t));
            run_warp([&](const ThreadWarp& warp) { body(warp, block, scratch.data()); });
        }
    }
    for (int block = 0; block < 3; ++block)
        EXPECT_EQ(counts[block], begin[block + 1] - begin[block]);
    EXPECT_EQ(written, begin);
    EXPECT_EQ(blocks, to_host(expected.receiver_block));
    for (std::size_t t = 0; t < expected.count; ++t)
        EXPECT_EQ(std::memcmp(&tiles[t], &expected.tiles[t], sizeof(EdgeTile)), 0) << t;
}

TEST(EdgeTiles, ChunksMakeTheSame) {
    constexpr int kCount = 1003, k = 9;
    const std::vector<std::uint32_t> receivers = made_up_lists(kCount, k);
    const Neighbours<Cpu> full = stored(receivers, kCount, k, ListStorage::full);
    Neighbours<Cpu> near;
    near.usable = near.voters_count = kCount, near.k = k, near.storage = ListStorage::compact;
    NeighbourScratch<Cpu> scratch;
    for (const int chunk_edges : {1, 3 * 32 * k, 1 << 20}) {  // 32, 96 and all voters
        int chunks = 0;
        const auto search = [&](int first, int count, auto& rows) {
            const auto from = receivers.begin() + std::ptrdiff_t(first) * k;
            copy(std::vector<std::uint32_t>(from, from + std::ptrdiff_t(count) * k), rows);
            ++chunks;
        };
        detail::store_lists(scratch, near, search, ignore_stage, chunk_edges);
        EXPECT_EQ(chunks, chunk_edges == 1 ? 32 : chunk_edges == 1 << 20 ? 1 : 11);
        const detail::HostLists lists = detail::host_lists(near);
        EXPECT_EQ(lists.receivers, receivers);
        EXPECT_EQ(lists.begin, to_host(full.begin));
        EXPECT_EQ(lists.voters, to_host(full.voters));
    }
}

}  // namespace
}  // namespace tvsgs::test
