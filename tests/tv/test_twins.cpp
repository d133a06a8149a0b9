// Tests all computations of the votes against the CPU in double, on random well- and
// ill-conditioned clouds; prints the largest differences.
#include "tv/tv_support.h"

namespace tvsgs::test {
namespace {

Cloud random_cloud(int trial) {
    Random random(1000u + static_cast<unsigned>(trial));
    const int sizes[] = {2, 31, 257, 600, 1000};
    const int count = sizes[trial % 5], kind = trial / 5 % 5;
    const float spacing = 2 / std::cbrt(float(count));
    Cloud cloud;
    for (int i = 0; i < count; ++i) {
        Vec3f p{random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(-1, 1)},
            n = random.normal3();
        Vec3f s = random.flat_scales(spacing);
        if (kind == 0) p = normalize(n) + 0.01f * random.normal3();  // a sphere
        if (kind == 1) s = {s.x, 1e-3f * s.y, 1e-4f * s.z};          // needles and flakes
        if (kind == 2)
            p = Vec3f{float(i % 4), 0, 0} +
                (i % 4 == 0 ? 0.01f : 0.1f) * random.normal3();       // clusters
        if (kind == 3 && i % 20 == 0) p = 100.0f * random.normal3();  // outliers
        if (kind == 4 && i % 10 == 1) p = cloud.means.back();         // duplicates
        cloud.add(p, s, quat_from_z(normalize(n + 0.1f * random.normal3())));
    }
    return cloud;
}

/// The cloud with inputs changed by about a unit in the last place. The resulting change is the
/// unavoidable error of any computation in float.
Cloud perturbed(const Cloud& cloud, unsigned seed) {
    Random random(seed);
    const auto moved = [&](float x) { return x * (1 + 1.2e-7f * (random.uniform() - 0.5f)); };
    Cloud result = cloud;
    for (Vec3f& p : result.means) p = {moved(p.x), moved(p.y), moved(p.z)};
    for (Vec3f& s : result.scales) s = {moved(s.x), moved(s.y), moved(s.z)};
    for (Quatf& q : result.quats) q = {moved(q.w), moved(q.x), moved(q.y), moved(q.z)};
    return result;
}

struct Difference {
    double tensor = 0, normal = 0, tau = 0, strength = 0, target = 0;
    bool target_elsewhere = false, comparable = false;
};

std::vector<Difference> differences(const Cloud& cloud,
                                    const FieldOnHost& a,
                                    const FieldOnHost& b) {
    std::vector<double> sizes;
    for (const Sym3f& T : a.tensors) sizes.push_back(frobenius(T));
    const double typical = middle(sizes);
    std::vector<Difference> result(sizes.size());
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        // Below this, votes are close to the cut at 1e-12, and one side may have zero.
        if ((a.flags[i] & kHasTensor) == 0 || !(a.details.strength[i] > 1e-6f) ||
            !(b.details.strength[i] < HUGE_VALF) || !(a.details.strength[i] < HUGE_VALF))
            continue;
        Difference& d = result[i];
        d.comparable = true;
        d.tensor =
            frobenius(difference(a.tensors[i], b.tensors[i])) / std::max(sizes[i], 0.01 * typical);
        d.tau = std::abs(double(b.details.tau[i]) / a.details.tau[i] - 1);
        d.strength = std::abs(double(b.details.strength[i]) / a.details.strength[i] - 1);
        if (relative_gap(a.eigenvalues[i]) < kComparedGap) continue;
        d.normal = angle_deg(a.normals[i], b.normals[i]);
        const Vec3f s = cloud.scales[i];
        const double step = double(std::max({s.x, s.y, s.z})) / 5;
        d.target = norm(vec_cast<double>(a.targets[i]) - vec_cast<double>(b.targets[i])) / step;
        d.target_elsewhere = d.target > 0.5;
        if (d.target_elsewhere) d.target = 0;
    }
    return result;
}

/// The largest effect of rounding in four draws is still below the worst case.
constexpr double kSlack = 10;

/// [docs/method/voting.md#bounds-of-agreement]
bool within_plain_bounds(const Difference& d) {
    return d.tensor < 1e-4 && d.normal < 0.1;
}

/// The other combinations of a device and a precision.
template <class Device, VotePrecision kPrecision>
struct Way {
    using On = Device;
    static constexpr VotePrecision precision = kPrecision;
};
template <class>
class Twins : public ::testing::Test {};
constexpr auto kSingle = VotePrecision::single_precision, kDouble = VotePrecision::double_precision;
using Ways =
    std::conditional_t<kHasCuda,
                       ::testing::Types<Way<Cpu, kSingle>, Way<Cuda, kSingle>, Way<Cuda, kDouble>>,
                       ::testing::Types<Way<Cpu, kSingle>>>;
TYPED_TEST_SUITE(Twins, Ways);

TYPED_TEST(Twins, AgreeOnRandomClouds) {
    using Device = typename TypeParam::On;
    TVSGS_SKIP_WITHOUT_DEVICE(Device);
    constexpr bool kExact = TypeParam::precision == kDouble;
    Difference worst;
    int lists = 0, ties = 0, compared = 0, excused = 0, targets_elsewhere = 0, flags_differ = 0;
    for (int trial = 0; trial < (std::is_same_v<Device, Cpu> ? 50 : 100); ++trial) {
        SCOPED_TRACE(trial);
        const Cloud cloud = random_cloud(trial);
        TvOptions exact;
        exact.k = trial % 3 == 0 ? 100 : 20;
        exact.vote_map = trial % 2 == 0 ? VoteMap::covariant : VoteMap::unit;
        exact.precision = kDouble;
        TvOptions options = exact;
        options.precision = TypeParam::precision;
        const FieldOnHost reference = run_events<Cpu>(cloud, exact, 2);
        const FieldOnHost searched = run_events<Device>(cloud, options, 1);
        const int count = cloud.size(), k = reference.details.k;
        ASSERT_EQ(searched.details.k, k);
        for (int i = 0; i < count; ++i, ++lists)
            ties += sorted_row(reference.details.receivers, k, i) !=
                    sorted_row(searched.details.receivers, k, i);
        // Uses the same lists from here on, so that a tie does not spread.
        const auto& receivers = reference.details.receivers;
        const FieldOnHost other = run_events<Device>(cloud, options, 2, receivers);
        const auto found = differences(cloud, reference, other);
        const bool all_plain = std::all_of(found.begin(), found.end(), within_plain_bounds);
        std::vector<Difference> allowed(found.size());
        for (unsigned seed = 0; seed < (kExact || all_plain ? 0u : 4u); ++seed) {
            const auto moved = differences(
                cloud, reference, run_events<Cpu>(perturbed(cloud, seed), exact, 2, receivers));
            for (std::size_t i = 0; i < moved.size(); ++i) {
                allowed[i].tensor = std::max(allowed[i].tensor, moved[i].tensor);
                allowed[i].normal = std::max(allowed[i].normal, moved[i].normal);
            }
        }
        for (std::size_t i = 0; i < found.size(); ++i) {
            flags_differ += reference.flags[i] != other.flags[i];
            const Difference& d = found[i];
            if (!d.comparable) continue;
            ++compared;
            worst.tau = std::max(worst.tau, d.tau);
            // The bounds, or the effect of rounded inputs on this splat.
            if (within_plain_bounds(d)) {
                worst.tensor = std::max(worst.tensor, d.tensor);
                worst.normal = std::max(worst.normal, d.normal);
                worst.target = std::max(worst.target, d.target);
                targets_elsewhere += d.target_elsewhere;
                continue;
            }
            ++excused;
            // Where a unit in the last place changes the tensor by percents, the tensor consists of
            // noise: the strengths of voters whose own tensors have rank one.
            if (allowed[i].tensor > 1e-2) continue;
            EXPECT_LT(d.tensor, std::max(1e-4, kSlack * allowed[i].tensor)) << "splat " << i;
            EXPECT_LT(d.normal, std::max(0.1, kSlack * allowed[i].normal)) << "splat " << i;
        }
    }
    std::printf(
        "%d splats, %d over the plain bounds; of the others tensors %.2g  normals %.2g deg;  of "
        "all "
        "tau %.2g  targets %.2g steps; lists with ties %d of %d; targets elsewhere %d; flags "
        "differ %d\n",
        compared, excused, worst.tensor, worst.normal, worst.tau, worst.target, ties, lists,
        targets_elsewhere, flags_differ);
    // Needles, clusters much smaller than their splats and far outliers make up more than half of
    // the clouds; elsewhere float keeps the plain bounds.
    EXPECT_LE(excused, kExact ? 0 : 0.02 * compared);
    EXPECT_LT(worst.tau, 1e-5);
    EXPECT_LT(worst.target, 1e-2);
    EXPECT_LT(ties, 0.01 * lists + 5);
    // Saliencies within 1e-5 of each other, and values on a threshold, may go either way.
    EXPECT_LT(targets_elsewhere, 1e-3 * compared + 3);
    EXPECT_LT(flags_differ, 1e-3 * compared + 3);
}

}  // namespace
}  // namespace tvsgs::test
