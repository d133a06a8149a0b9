// CPU (double) against CUDA (float) on random clouds; prints the largest differences seen.
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

TEST(Twins, AgreeOnRandomClouds) {
    if constexpr (!kHasCuda) {
        GTEST_SKIP() << "a build without CUDA";
    } else {
        TVSGS_SKIP_WITHOUT_DEVICE(Cuda);
        struct Worst {
            double tensor = 0, normal = 0, tau = 0, target = 0, variability = 0, strength = 0;
        };
        Worst worst;
        int lists = 0, ties = 0, splats = 0, targets_elsewhere = 0, flags_differ = 0;
        for (int trial = 0; trial < 100; ++trial) {
            SCOPED_TRACE(trial);
            const Cloud cloud = random_cloud(trial);
            TvOptions options;
            options.k = trial % 3 == 0 ? 100 : 20;
            options.vote_map = trial % 2 == 0 ? VoteMap::covariant : VoteMap::unit;
            const FieldOnHost searched = run_events<Cuda>(cloud, options, 1);
            FieldOnHost cpu = run_events<Cpu>(cloud, options, 2);
            const int count = cloud.size(), k = cpu.details.k;
            ASSERT_EQ(searched.details.k, k);
            for (int i = 0; i < count; ++i) {
                ++lists;
                const auto a = sorted_row(cpu.details.receivers, k, i),
                           b = sorted_row(searched.details.receivers, k, i);
                if (a == b) continue;
                ++ties;
                // What one twin lists in place of the other must be as near, in the world (2k) or
                // whitened (k).
                std::vector<std::uint32_t> only_a, only_b;
                std::set_difference(a.begin(), a.end(), b.begin(), b.end(),
                                    std::back_inserter(only_a));
                std::set_difference(b.begin(), b.end(), a.begin(), a.end(),
                                    std::back_inserter(only_b));
                EXPECT_LE(only_a.size(), 2u) << "splat " << i;
                EXPECT_EQ(only_a.size(), only_b.size());
            }
            // From here on with the same lists, so that a tie does not spread.
            const FieldOnHost gpu = run_events<Cuda>(cloud, options, 2, cpu.details.receivers);
            std::vector<double> sizes;
            for (const Sym3f& T : cpu.tensors) sizes.push_back(frobenius(T));
            std::nth_element(sizes.begin(), sizes.begin() + count / 2, sizes.end());
            const double typical = sizes[std::size_t(count) / 2];
            for (int i = 0; i < count; ++i) {
                ++splats;
                flags_differ += cpu.flags[i] != gpu.flags[i];
                // Below this votes are close to the cut at 1e-12, and one of them may be zero on
                // one side.
                if ((cpu.flags[i] & kHasTensor) == 0 || !(cpu.details.strength[i] > 1e-6f) ||
                    !(gpu.details.strength[i] < HUGE_VALF) ||
                    !(cpu.details.strength[i] < HUGE_VALF))
                    continue;
                worst.tensor =
                    std::max(worst.tensor, frobenius(difference(cpu.tensors[i], gpu.tensors[i])) /
                                               std::max(frobenius(cpu.tensors[i]), 0.01 * typical));
                worst.tau = std::max(worst.tau,
                                     std::abs(double(gpu.details.tau[i]) / cpu.details.tau[i] - 1));
                worst.strength = std::max(
                    worst.strength,
                    std::abs(double(gpu.details.strength[i]) / cpu.details.strength[i] - 1));
                if (relative_gap(cpu.eigenvalues[i]) < 1e-2) continue;
                worst.normal = std::max(worst.normal, angle_deg(cpu.normals[i], gpu.normals[i]));
                const Vec3f s = cloud.scales[i];
                const double step = double(std::max({s.x, s.y, s.z})) / 5;
                const double off =
                    norm(vec_cast<double>(cpu.targets[i]) - vec_cast<double>(gpu.targets[i])) /
                    step;
                if (off > 0.5)
                    ++targets_elsewhere;
                else
                    worst.target = std::max(worst.target, off);
            }
        }
        std::printf(
            "%d splats: tensors %.2g  normals %.2g deg  tau %.2g  strength %.2g  targets %.2g "
            "steps; lists with "
            "ties %d of %d; targets elsewhere %d; flags differ %d\n",
            splats, worst.tensor, worst.normal, worst.tau, worst.strength, worst.target, ties,
            lists, targets_elsewhere, flags_differ);
        EXPECT_LT(worst.tensor, 1e-4);
        EXPECT_LT(worst.normal, 0.1);
        EXPECT_LT(worst.tau, 1e-5);
        EXPECT_LT(worst.target, 1e-2);
        EXPECT_LT(ties, 0.01 * lists + 5);
        // Saliencies within 1e-5 of each other, and values on a threshold, may fall either way.
        EXPECT_LT(targets_elsewhere, 1e-3 * splats + 3);
        EXPECT_LT(flags_differ, 1e-3 * splats + 3);
    }
}

}  // namespace
}  // namespace tvsgs::test
