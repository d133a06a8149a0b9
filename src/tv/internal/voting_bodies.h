// Kernels of one voting event, for both devices.  [docs/method/voting.md#one-event]
#pragma once

#include "core/math/abreast.h"
#include "core/math/eigen.h"
#include "tv/internal/voting_ranks.h"

namespace tvsgs::detail {

/// Sums the votes that one receiver gets at its centre, from balls or from plates.
template <class Real, class Lists>
struct CentreRoundBody {
    static constexpr int kMinBlocks = sizeof(Real) == sizeof(float) ? 3 : 1;
    static constexpr bool kPacks = true;

    ReceivedVotes<Real, Lists> received;
    bool ball_round;  // only splats without a tensor vote and receive
    Ranks ranks;
    Span<const std::uint8_t> flags;
    Span<Sym3f> sums;  // these three by rank
    Span<float> strengths, strong_votes;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int rank, void*) const {
        if (ball_round && (flags[ranks.splat(rank)] & kHasTensor) != 0) return;
        using Lane = typename Warp::template Lane<Real>;
        const Vec3<Lane> mean = vec_cast<Lane>(received.means[rank].v);
        VoteSums<Lane> s;
        received.template for_each_voter<Warp::kLanes>(
            warp, rank, [&](const VoterRecord<Lane>& voter) {
                const Vec3<Lane> d = mean - voter.mean, dw = voter.W * d;
                add_vote(s, voter.strength,
                         ball_round ? ball_vote<ExactMath>(voter, d, dw, received.rule)
                                    : plate_vote<ExactMath>(voter, d, dw, received.rule));
            });
        const Sym3<Real> T{warp.sum(s.tensor.xx), warp.sum(s.tensor.xy), warp.sum(s.tensor.xz),
                           warp.sum(s.tensor.yy), warp.sum(s.tensor.yz), warp.sum(s.tensor.zz)};
        const Real squares = warp.sum(s.squares), votes = warp.sum(s.votes);
        const Real strong = warp.sum(s.strong);
        if (warp.lane() != 0) return;
        sums[rank] = {float(T.xx), float(T.xy), float(T.xz), float(T.yy), float(T.yz), float(T.zz)};
        strengths[rank] = float(std::sqrt(squares / (votes > 1 ? votes : Real(1))));
        strong_votes[rank] = float(strong);
    }
};

// This round has reached the splat; cleared at the end of the event.
inline constexpr std::uint8_t kValidNow = 128;

/// Turns valid sums into tensors. The other splats keep theirs and take no part in the losses.
struct EigenBody {
    bool ball_round;
    Ranks ranks;
    Span<const Sym3f> sums;
    Span<Sym3f> tensors;
    Span<Vec3f> eigenvalues, normals;
    Span<std::uint8_t> flags;
    Span<RankVector> rank_normals;  // zero if this round gave no unambiguous normal

    TVSGS_HD void operator()(int rank) const {
        const int i = ranks.splat(rank);
        if (ball_round && (flags[i] & kHasTensor) != 0) return;
        const Sym3f T = sums[rank];
        const VotedTensor voted = voted_tensor(T);
        if (voted.valid) tensors[i] = T, eigenvalues[i] = voted.values, normals[i] = voted.normal;
        const int flag = !voted.valid
                             ? flags[i] & kHasTensor
                             : kHasTensor | kValidNow | (voted.has_normal ? kNormalValid : 0);
        flags[i] = std::uint8_t(flag);
        rank_normals[rank].v = voted.has_normal ? voted.normal : Vec3f{};
    }
};

/// Root mean square angle between a splat's normal and its receivers', without ambiguous ones. For
/// an ambiguous own normal variability and strength become infinite: sorted last.
template <class Lists>
struct VariabilityBody {
    int k;
    Lists lists;
    Ranks ranks;
    Span<const RankVector> rank_normals;
    Span<const std::uint8_t> flags;
    Span<float> variability, strengths;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int rank, void* scratch) const {
        constexpr float kInvalid = std::numeric_limits<float>::infinity();
        if ((flags[ranks.splat(rank)] & kNormalValid) == 0) {
            if (warp.lane() == 0) variability[rank] = kInvalid, strengths[rank] = kInvalid;
            return;
        }
        const Vec3f n = rank_normals[rank].v;
        const std::uint32_t* list = lists.receivers_of(warp, rank, scratch);
        float sum = 0, count = 0;
        for (int r = warp.lane(); r < k; r += Warp::kLanes) {
            const Vec3f m = rank_normals[list[r]].v;
            // Angle from sine and cosine, because arccos loses small angles in float.
            const float angle = angle_of(norm(cross(n, m)), std::abs(dot(n, m)));
            const bool counts = dot(m, m) > 0;
            sum += counts ? angle * angle : 0;
            count += counts ? 1.0f : 0.0f;
        }
        sum = warp.sum(sum), count = warp.sum(count);
        if (warp.lane() == 0) variability[rank] = std::sqrt(sum / (count > 1 ? count : 1));
    }
};

/// 95th percentile of the first `count` sorted values, by linear interpolation.
TVSGS_HD inline float percentile95(Span<const float> sorted, double count) {
    const double position = 0.95 * (count - 1);
    const auto low = int(position), high = low + 1 < count ? low + 1 : low;
    return float(sorted[low] + (double(sorted[high]) - double(sorted[low])) * (position - low));
}

/// Selects the splats that take part in the position loss.
struct MaskBody {
    Ranks ranks;
    float min_votes;
    const double* valid_count;
    Span<const float> variability, strengths, sorted_variability, sorted_strengths, strong_votes;
    Span<std::uint8_t> flags, left_out;  // left_out: by rank

    TVSGS_HD void operator()(int rank) const {
        const int i = ranks.splat(rank);
        const std::uint8_t flag = flags[i];
        left_out[rank] = 0;
        if ((flag & kNormalValid) == 0) return;
        left_out[rank] = variability[rank] > percentile95(sorted_variability, *valid_count) &&
                                 strengths[rank] > percentile95(sorted_strengths, *valid_count)
                             ? 1
                             : 0;
        if (left_out[rank] == 0 && strong_votes[rank] >= min_votes)
            flags[i] = flag | kPositionValid;
    }
};

/// Begins an event: no splat is valid, and each target is the centre.
struct BeginBody {
    Span<const Vec3f> means;
    Span<std::uint8_t> flags;
    Span<Vec3f> targets;
    TVSGS_HD void operator()(int i) const {
        flags[i] &= kHasTensor;
        targets[i] = means[i];
    }
};

/// Copies the entries of new splats from their parents; zero if the parent is negative.
template <class T>
struct InheritBody {
    Span<const int> parents;
    Span<const T> from;
    Span<T> to;
    TVSGS_HD void operator()(int i) const { to[i] = parents[i] < 0 ? T{} : from[parents[i]]; }
};

/// Clears the other flags; kPositionValid after an event without targets, and after
/// structure_changed(), because children may have moved.
struct KeepFlagsBody {
    int kept;
    Span<std::uint8_t> flags;
    TVSGS_HD void operator()(int i) const { flags[i] &= std::uint8_t(kept); }
};

/// Votes at virtual receivers: finds the most salient point along each splat's normal. Sets the
/// targets: the centre or the virtual receiver with the largest surface saliency.
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
