// Votes at virtual receivers: finds the most salient point along each splat's normal.
// [docs/method/voting.md#one-event]
#pragma once

#include "core/math/abreast.h"
#include "core/math/eigen.h"
#include "tv/internal/voting_bodies.h"

namespace tvsgs::detail {

/// Sets the targets: the centre or the virtual receiver with the largest surface saliency.
template <class Real, class Lists, bool kUnitVotes>
struct VirtualBody {
    static constexpr int kMinBlocks = sizeof(Real) == sizeof(float) ? 3 : 1;
    static constexpr bool kPacks = true;

    ReceivedVotes<Real, Lists> received;
    bool centre_known;  // the centre's tensor comes from the same voters and needs no new votes
    float range;        // reach, in largest scales
    float margin;       // share of lambda_1 by which a receiver must exceed the centre
    Ranks ranks;
    Span<const Vec3f> eigenvalues, normals;
    Span<Vec3f> targets;
    Span<std::uint8_t> flags;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int rank, void*) const {
        const int i = ranks.splat(rank);
        const std::uint8_t flag = flags[i];
        warp.sync();  // all lanes read the flag before it changes
        if (warp.lane() == 0) flags[i] = flag & (kHasTensor | kNormalValid | kPositionValid);
        if ((flag & kValidNow) == 0) return;
        const Vec3<Real> mean = vec_cast<Real>(received.means[rank].v);
        const Vec3f s = ranks.splats.scales<float>(i);
        const float largest = s.x > s.y ? (s.x > s.z ? s.x : s.z) : (s.y > s.z ? s.y : s.z);
        const Vec3<Real> step = Real(range) * Real(largest) / kSide * vec_cast<Real>(normals[i]);
        const Vec3<Real> l =
            centre_known ? vec_cast<Real>(eigenvalues[i]) : centre_eigenvalues(warp, rank, mean);
        // A receiver must win by more than rounding. Of a tie the nearer wins, then the negative.
        const Real rounding = Real(kRoundingMargin) * l.x;
        Best best{l.y - l.z + Real(margin) * l.x - rounding, rounding, 0};
        if constexpr (Warp::kLanes == 1) {
            using Lane = typename Warp::template Lane<Real>;
            Lane T[6][2 * kSide] = {};
            add_votes<1>(warp, rank, mean, step, T);
            using Few = Abreast<Lane, 2>;  // several positions at once
            for (int first = 0; first < 2 * kSide; first += Few::kSize) {
                const int count = std::min<int>(Few::kSize, 2 * kSide - first);
                Few entries[6];
                for (int c = 0; c < 6; ++c)
                    for (int at = 0; at < count; ++at)
                        entries[c].set(at, warp.sum(T[c][first + at]));
                const Few saliency = surface_saliency(entries);
                for (int at = 0; at < count; ++at)
                    keep_best(saliency[at], position<2 * kSide>(first + at), best);
            }
        } else {  // half a warp for the negative positions, half for the positive ones
            constexpr int kHalf = 16;
            const int half = warp.lane() / kHalf, lane = warp.lane() % kHalf;
            Real T[6][kSide] = {};
            add_votes<kHalf>(warp, rank, mean, half == 0 ? -step : step, T);
            Real values[32] = {}, sums[2];
            for (int t = 0; t < kSide; ++t)
                for (int c = 0; c < 6; ++c) values[6 * t + c] = T[c][t];
            warp.sums_to_half_lanes(values, sums);
            Real entries[6];  // lane t of each half decomposes tensor t
            for (int c = 0; c < 6; ++c)
                entries[c] = warp.from_lane(sums[c % 2], half * kHalf + (3 * lane + c / 2) % kHalf);
            const Real saliency = surface_saliency(entries);
            for (int t = 0; t < kSide; ++t) {
                keep_best(warp.from_lane(saliency, t), -t - 1, best);
                keep_best(warp.from_lane(saliency, kHalf + t), t + 1, best);
            }
        }
        if (warp.lane() == 0 && best.m != 0)
            targets[i] = vec_cast<float>(mean + Real(best.m) * step);
    }

private:
    static constexpr int kSide = 5;  // positions on each side of the centre
    struct Best {
        Real saliency, rounding;
        int m;
    };

    /// Position t in steps from the centre. One side: 1, 2, ...; both sides: -1, 1, -2, 2, ...
    template <int kCount>
    TVSGS_HD static constexpr int position(int t) {
        return kCount <= kSide ? t + 1 : t % 2 == 0 ? -t / 2 - 1 : t / 2 + 1;
    }

    /// Adds the votes at mean + position(t) * step to the six entries of each position's tensor.
    template <int kStride, class Warp, class Lane, int kCount>
    TVSGS_HD void add_votes(
        const Warp& warp, int rank, Vec3<Real> mean, Vec3<Real> step, Lane (&T)[6][kCount]) const {
        VoteRule rule = received.rule;
        rule.unit_length = kUnitVotes;  // compile-time constant
        // On a CPU two packs side by side, which do not wait for each other.
        using Few = std::conditional_t<kCount % 2 == 0, Abreast<Lane, 2>, Lane>;
        constexpr int kFew = sizeof(Few) / sizeof(Lane);
        const Vec3<Lane> from = vec_cast<Lane>(mean), by = vec_cast<Lane>(step);
        received.template for_each_voter<kStride>(warp, rank, [&](const VoterRecord<Lane>& voter) {
            const Vec3<Lane> d = from - voter.mean, dw = voter.W * d, by_w = voter.W * by;
            decltype(auto) caster = pairwise<Few>(voter);
            const auto at = [](const Vec3<Lane>& v) { return vec_cast<Few>(v); };
            for_constants<kCount / kFew>([&](int pair) {
                Few m{};
                for (int i = 0; i < kFew; ++i)
                    part_of<Lane>(m, i) = static_cast<Lane>(position<kCount>(kFew * pair + i));
                const Vote<Few> vote =
                    plate_vote<FastMath>(caster, at(d) + m * at(by), at(dw) + m * at(by_w), rule);
                const Vec3<Few> v = vote.v,
                                wv = caster.strength * vote.decay * vote.inverse_length2 * v;
                Few sums[6] = {wv.x * v.x, wv.x * v.y, wv.x * v.z,
                               wv.y * v.y, wv.y * v.z, wv.z * v.z};
                for (int i = 0; i < kFew; ++i)
                    for (int c = 0; c < 6; ++c) T[c][kFew * pair + i] += part_of<Lane>(sums[c], i);
            });
        });
    }

    /// Pack i of a Few.
    template <class Lane, class Few>
    TVSGS_HD static Lane& part_of(Few& few, [[maybe_unused]] int i) {
        if constexpr (std::is_same_v<Few, Lane>)
            return few;
        else
            return few.v[i];
    }

    /// The entries of a record that a vote needs besides d and dw.
    template <class Few, class Lane>
    TVSGS_HD static decltype(auto) pairwise(const VoterRecord<Lane>& voter) {
        if constexpr (std::is_same_v<Few, Lane>)
            return (voter);
        else
            return VoterRecord<Few>{{},
                                    Few(voter.inverse_tau2),
                                    {},
                                    vec_cast<Few>(voter.normal_world),
                                    Few(voter.strength),
                                    Few(voter.curvature)};
    }

    template <class Warp>
    TVSGS_HD Vec3<Real> centre_eigenvalues(const Warp& warp, int rank, Vec3<Real> mean) const {
        typename Warp::template Lane<Real> T[6][1] = {};
        add_votes<Warp::kLanes>(warp, rank, mean, {}, T);
        Real entries[6];
        for (int c = 0; c < 6; ++c) entries[c] = warp.sum(T[c][0]);
        return eigenvalues_of(entries);
    }
    template <class Few>
    TVSGS_HD static Vec3<Few> eigenvalues_of(const Few (&T)[6]) {
        return sym_eigenvalues<FastMath>(Sym3<Few>{T[0], T[1], T[2], T[3], T[4], T[5]});
    }
    template <class Few>
    TVSGS_HD static Few surface_saliency(const Few (&T)[6]) {
        const Vec3<Few> values = eigenvalues_of(T);
        return values.y - values.z;
    }
    TVSGS_HD static void keep_best(Real saliency, int m, Best& best) {
        if (saliency > best.saliency + best.rounding)  // NaN never wins
            best.saliency = saliency, best.m = m;
    }
};

}  // namespace tvsgs::detail
