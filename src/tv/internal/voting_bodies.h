// Kernels of one voting event, for both devices.  [docs/method/voting.md#one-event]
#pragma once

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

}  // namespace tvsgs::detail
