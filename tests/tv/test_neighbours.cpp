// Tests exact neighbours against brute force, for each device.
#include "core/error.h"
#include "tv/internal/neighbours.h"
#include "tv/internal/voting_impl.h"
#include "tv/tv_support.h"

#if defined(TVSGS_WITH_CUDA)
namespace tvsgs {
extern template void find_neighbours(const NeighbourQuery&,
                                     NeighbourScratch<Cuda>&,
                                     Neighbours<Cuda>&,
                                     const StageDone&);  // kernels are in voting.cu
}  // namespace tvsgs
#endif

namespace tvsgs::test {
namespace {

TEST(BitonicSort, AnyCount) {
    Random random(1);
    for (int count = 0; count < 140; ++count) {
        std::vector<std::uint32_t> keys(std::size_t(count) + 1);
        for (auto& key : keys) key = static_cast<std::uint32_t>(random.uniform(0, 50));
        keys.back() = 12345;  // must stay
        auto expected = keys;
        std::sort(expected.begin(), expected.end() - 1);
        bitonic_sort(SerialWarp{}, keys.data(), count);
        EXPECT_EQ(keys, expected);
    }
}

TEST(MortonCode, InterleavesTheBits) {
    EXPECT_EQ(spread_bits(0b1011), 0b1000001001u);
    EXPECT_EQ(spread_bits(0x1fffff), 0x1249249249249249ull);
    const MortonCode low = morton_code({0, 0, 0}, {0, 0, 0}, 1),
                     high = morton_code({5, 5, 5}, {0, 0, 0}, 1);
    EXPECT_EQ(low.high | low.low, 0u);
    EXPECT_EQ(high.high & high.low, 0x7fffffffffffffffull);  // clamped
    EXPECT_EQ(morton_code({0, 0.5f, 0}, {0, 0, 0}, 1).high, 2ull << 60);
}

/// Clouds that often break neighbour searches.
Cloud make_cloud(const std::string& kind, int count, unsigned seed) {
    Random random(seed);
    Cloud cloud;
    for (int i = 0; i < count; ++i) {
        Vec3f p = random.normal3();
        float size = 0.05f;
        if (kind == "coincident") p = {1, 2, 3};
        if (kind == "half coincident" && i % 2 == 0) p = {0.1f, 0, 0};
        if (kind == "line") p = {0, random.uniform(), 0};
        if (kind == "grid") p = {float(i % 10), float(i / 10 % 10), float(i / 100)};
        if (kind == "plane") p.z = 0;
        if (kind == "far clusters") p = p + Vec3f{i % 2 == 0 ? 0 : 1e6f, 0, 0};
        if (kind == "outlier" && i == 5) p = {1e12f, -1e12f, 0};
        if (kind == "extreme outlier" && i == 5) p = {3e38f, -3e38f, 0};
        if (kind == "density" && i % 3 == 0) p = 1e-4f * p, size = 1e-5f;
        if (kind == "not finite" && i % 7 == 0) p.x = i % 2 == 0 ? std::nanf("") : HUGE_VALF;
        cloud.add(p, random.flat_scales(size), random.quat());
    }
    return cloud;
}

double mean_trace(const Cloud& cloud, const std::vector<bool>& usable) {
    double sum = 0, count = 0;
    for (int i = 0; i < cloud.size(); ++i)
        if (usable[i]) sum += double(dot(cloud.scales[i], cloud.scales[i])), count += 1;
    return sum / std::max(count, 1.0);
}

template <class Device>
class NeighbourTwins : public ::testing::Test {};
TYPED_TEST_SUITE(NeighbourTwins, Devices);

template <class Device>
void expect_exact(const std::string& kind, int count, int k) {
    SCOPED_TRACE(str(kind, ", ", count, " splats, k = ", k));
    const Cloud cloud = make_cloud(kind, count, static_cast<unsigned>(count));
    std::vector<bool> usable;
    for (const Vec3f p : cloud.means) usable.push_back(is_finite(p));
    const int usable_count = static_cast<int>(std::count(usable.begin(), usable.end(), true));
    const double noise = kWhitenNoise * mean_trace(cloud, usable);

    const Gaussians<Device> g = to_gaussians<Device>(cloud);
    const auto noise_there = to_device<Device>(std::vector<double>{noise});
    NeighbourScratch<Device> scratch;
    Neighbours<Device> found;
    find_neighbours({splat_spans(g), {}, k, {}, noise_there.data()}, scratch, found);
    ASSERT_EQ(found.usable, usable_count);
    if (usable_count < 2) {
        EXPECT_EQ(found.k, 0);
        return;
    }
    const int wanted = std::min(2 * k, usable_count - 1);
    ASSERT_EQ(found.k, std::min(k, wanted));
    const VotingDetails lists = detail::lists_by_splat(found, count);
    const auto& receivers = lists.receivers;

    // Ties are ordered by rank.
    const auto points = to_host(found.points);
    std::vector<std::uint32_t> rank_of(count);
    for (std::uint32_t rank = 0; rank < points.size(); ++rank) rank_of[points[rank].index] = rank;
    const auto splat = [&](std::uint64_t key) { return points[key_rank(key)].index; };

    std::vector<std::vector<std::uint32_t>> voters_of(count);
    for (int i = 0; i < count; ++i) {
        if (!usable[i]) continue;
        std::vector<std::uint64_t> keys;
        for (int j = 0; j < count; ++j) {
            const Vec3f d = cloud.means[j] - cloud.means[i];
            if (j != i && usable[j]) keys.push_back(distance_key(dot(d, d), rank_of[j]));
        }
        std::sort(keys.begin(), keys.end());
        const auto euclidean = [&](std::uint32_t j) {
            return double(
                norm(vec_cast<double>(cloud.means[j]) - vec_cast<double>(cloud.means[i])));
        };
        const double reach = euclidean(splat(keys[wanted - 1]));
        keys.resize(wanted);
        const auto W =
            whitened_from_world(whitening(quat_cast<double>(cloud.quats[i]),
                                          vec_cast<double>(cloud.scales[i]), WhitenRule{}, noise));
        const auto whitened = [&](std::uint32_t j) {
            return norm(W * (vec_cast<double>(cloud.means[j]) - vec_cast<double>(cloud.means[i])));
        };
        for (auto& key : keys) {
            const double distance = whitened(splat(key));
            key = distance_key(float(distance * distance), key_rank(key));
        }
        std::sort(keys.begin(), keys.end());
        const double farthest = whitened(splat(keys[found.k - 1]));

        std::vector<std::uint32_t> expected, differ;
        for (int r = 0; r < found.k; ++r) expected.push_back(splat(keys[r]));
        std::sort(expected.begin(), expected.end());
        const auto row = sorted_row(receivers, found.k, i);
        EXPECT_EQ(std::adjacent_find(row.begin(), row.end()), row.end()) << "listed twice by " << i;
        std::set_symmetric_difference(row.begin(), row.end(), expected.begin(), expected.end(),
                                      std::back_inserter(differ));
        for (const auto j : differ) {
            ASSERT_LT(j, std::uint32_t(count));
            // Rounding of distances in float may swap neighbours that are this close, on either
            // boundary. Exactly equal distances have one answer: the smaller rank.
            const bool tie = std::abs(euclidean(j) / reach - 1) < 1e-6 ||
                             std::abs(whitened(j) / farthest - 1) < 1e-5;
            EXPECT_TRUE(tie && kind != "coincident") << "splat " << i << ", neighbour " << j;
        }
        for (const auto j : row) voters_of[j].push_back(static_cast<std::uint32_t>(i));
    }
    // The reverse lists hold the same edges, ordered by voter.
    const auto& begin = lists.begin;
    const auto& voters = lists.voters;
    ASSERT_EQ(begin.back(), std::int64_t(usable_count) * found.k);
    for (int i = 0; i < count; ++i)
        EXPECT_EQ(
            std::vector<std::uint32_t>(voters.begin() + begin[i], voters.begin() + begin[i + 1]),
            voters_of[i]);
}

TYPED_TEST(NeighbourTwins, AllSizes) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    for (const int count : {0, 1, 2, 3, 31, 32, 33, 257, 1100})
        expect_exact<TypeParam>("normal", count, 10);
    expect_exact<TypeParam>("normal", 700, 100);
    expect_exact<TypeParam>("normal", 150, 100);  // fewer than 2k + 1
    expect_exact<TypeParam>("normal", 60, 100);
    expect_exact<TypeParam>("normal", 1200, 512);
    expect_exact<TypeParam>("normal", 500, 1);
}

TYPED_TEST(NeighbourTwins, HardClouds) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    for (const char* kind : {"coincident", "half coincident", "line", "grid", "plane",
                             "far clusters", "outlier", "extreme outlier", "density", "not finite"})
        expect_exact<TypeParam>(kind, 900, 12);
    expect_exact<TypeParam>("not finite", 1, 12);
}

TYPED_TEST(NeighbourTwins, MassiveCoincidenceTakesNoQuadraticTime) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    constexpr int kCount = 20000, k = 10;
    const auto g = to_gaussians<TypeParam>(make_cloud("coincident", kCount, 1));
    const auto noise = to_device<TypeParam>(std::vector<double>{1e-6});
    NeighbourScratch<TypeParam> scratch;
    Neighbours<TypeParam> found;
    find_neighbours({splat_spans(g), {}, k, {}, noise.data()}, scratch, found);
    // All distances are equal, and ranks keep the order of equal points: the smallest indices win.
    const VotingDetails lists = detail::lists_by_splat(found, kCount);
    const auto& receivers = lists.receivers;
    for (int i = 0; i < kCount; ++i) {
        std::vector<std::uint32_t> expected;
        for (std::uint32_t j = 0; expected.size() < k; ++j)
            if (j != std::uint32_t(i)) expected.push_back(j);
        ASSERT_EQ(sorted_row(receivers, k, i), expected) << "splat " << i;
    }
    // A few receivers then have nearly all voters.
    const auto begin = to_host(found.begin);
    const auto voters = to_host(found.voters);
    for (int rank = 0; rank < kCount; ++rank) {
        ASSERT_EQ(begin[rank + 1] - begin[rank], rank < k ? kCount - 1 : rank == k ? k : 0);
        for (auto e = begin[rank]; e < begin[rank + 1]; ++e) {
            const auto position = static_cast<int>(e - begin[rank]);
            ASSERT_EQ(voters[e],
                      static_cast<std::uint32_t>(position + (position >= rank && rank < k)));
        }
    }
}

}  // namespace
}  // namespace tvsgs::test
