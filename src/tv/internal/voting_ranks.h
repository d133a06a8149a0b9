// Splats and fixed voters in the order of the lists; their records.
// [docs/method/voting.md#one-vote]
#pragma once

#include <cstring>

#include "tv/internal/neighbour_lists.h"
#include "tv/internal/neighbours.h"
#include "tv/internal/warp.h"
#include "tv/voting.h"

namespace tvsgs::detail {

struct NoiseTerm {  // trace of a usable splat's covariance, with thin scales raised
    SplatSpans splats;
    float flatness_limit;
    TVSGS_HD double operator()(int i) const {
        if (!splats.usable(i)) return 0;
        const Vec3<double> s = limit_flatness(splats.scales<double>(i), double(flatness_limit));
        return dot(s, s);
    }
};

struct UsableSplatTerm {
    SplatSpans splats;
    TVSGS_HD double operator()(int i) const { return splats.usable(i) ? 1 : 0; }
};

struct NoiseBody {
    const double* count;
    double* noise;
    TVSGS_HD void operator()(int) const {
        *noise = kWhitenNoise * *noise / (*count > 1 ? *count : 1);
    }
};

/// The current splats by their ranks in the last search, followed by the fixed voters.
struct Ranks {
    Span<const TreePoint> points;
    SplatSpans splats;
    FixedVoterSpans fixed;

    TVSGS_HD int usable() const { return points.size(); }
    TVSGS_HD int size() const { return points.size() + fixed.size(); }
    TVSGS_HD int splat(int rank) const { return int(points[rank].index); }
    /// Splats change between searches, so a splat may have become non-finite.
    TVSGS_HD bool usable(int voter) const {
        return voter >= usable() || splats.usable(splat(voter));
    }
    TVSGS_HD Vec3f mean(int voter) const {
        return voter < usable() ? splats.means[splat(voter)] : fixed.means[voter - usable()];
    }
    template <class Real>
    TVSGS_HD Whitening<Real> whitening(int voter,
                                       const WhitenRule& rule,
                                       const double* noise) const {
        return voter < usable() ? splats.whitening<Real>(splat(voter), rule, *noise)
                                : fixed.whitening<Real>(voter - usable());
    }
};

/// Vectors by rank: neighbours in space are neighbours in memory. Each is one 16-byte load.
struct alignas(16) RankVector {
    Vec3f v;
};
struct MeanBody {
    Ranks ranks;
    Span<RankVector> means;
    TVSGS_HD void operator()(int rank) const { means[rank].v = ranks.mean(rank); }
};

#if defined(__CUDACC__)
template <class Real>
struct RecordWords {
    static constexpr int kCount = sizeof(VoterRecord<Real>) / sizeof(uint4);
    uint4 w[kCount];
};
#endif

/// Whole records by the widest instructions: entries one by one cost four times the traffic.
template <class Real>
TVSGS_HD VoterRecord<Real> load(const VoterRecord<Real>& from) {
#if defined(__CUDA_ARCH__)
    RecordWords<Real> words;
#pragma unroll
    for (int i = 0; i < RecordWords<Real>::kCount; ++i)
        words.w[i] = __ldg(reinterpret_cast<const uint4*>(&from) + i);
    return __builtin_bit_cast(VoterRecord<Real>, words);
#else
    return from;
#endif
}
template <class Real>
TVSGS_HD void store(const VoterRecord<Real>& record, VoterRecord<Real>& to) {
#if defined(__CUDA_ARCH__)
    const auto words = __builtin_bit_cast(RecordWords<Real>, record);
#pragma unroll
    for (int i = 0; i < RecordWords<Real>::kCount; ++i)
        reinterpret_cast<uint4*>(&to)[i] = words.w[i];
#else
    to = record;
#endif
}

/// Fills what TauBody reads: mean, W, and inverse_tau2 (0 if the voter cannot vote).
template <class Real>
struct WhiteningBody {
    Ranks ranks;
    WhitenRule rule;
    const double* noise;
    Span<VoterRecord<Real>> records;

    TVSGS_HD void operator()(int voter) const {
        VoterRecord<Real> record{};
        if (ranks.usable(voter)) {
            record.mean = vec_cast<Real>(ranks.mean(voter));
            record.W = whitened_from_world(ranks.whitening<Real>(voter, rule, noise));
            record.inverse_tau2 = 1;
        }
        store(record, records[voter]);
    }
};

/// Computes the scales of voting from the current splats.
template <class Real, class Lists>
struct TauBody {
    static constexpr int kMinBlocks = sizeof(Real) == sizeof(float) ? 3 : 1;

    float tau_per_median;
    int k;
    Lists lists;
    Span<const RankVector> means;
    Span<const VoterRecord<Real>> records;
    Span<float> tau;

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int voter, void* scratch) const {
        const VoterRecord<Real> record = load(records[voter]);
        float scale = 0;
        if (can_vote(record)) {  // equal in all lanes
            auto* values = static_cast<float*>(scratch);
            const auto* list = lists.receivers_of(warp, voter, values + Warp::median_scratch(k));
            scale = tau_per_median * warp.median(k, values, [&](int r) {
                const Vec3<Real> at = vec_cast<Real>(means[list[r]].v);
                return float(norm(record.W * (at - record.mean)));
            });
        }
        if (warp.lane() == 0) tau[voter] = scale;
    }
};

/// Sum of the saliencies of splats with a tensor. Their mean scales literal strengths.
struct SaliencyTerm {
    Span<const Vec3f> eigenvalues;
    Span<const std::uint8_t> flags;
    TVSGS_HD double operator()(int i) const {
        return (flags[i] & kHasTensor) != 0 ? double(eigenvalues[i].y) - double(eigenvalues[i].z)
                                            : 0;
    }
};
struct RankTensorTerm {
    Ranks ranks;
    Span<const std::uint8_t> flags;
    TVSGS_HD double operator()(int rank) const {
        return (flags[ranks.splat(rank)] & kHasTensor) != 0 ? 1 : 0;
    }
};
struct FlagTerm {
    std::uint8_t flag;
    Span<const std::uint8_t> flags;
    TVSGS_HD double operator()(int i) const { return (flags[i] & flag) != 0 ? 1 : 0; }
};

/// Normal and strength of each voter: a splat with a tensor votes as its plate, another as a ball
/// (strength 1, normal 0). A splat whose normal comes from rounding errors is silent.
struct OrientationBody {
    Ranks ranks;
    bool literal;
    const double* saliency_sum;  // followed by the number of terms
    Span<const Vec3f> eigenvalues, normals;
    Span<const std::uint8_t> flags;
    Span<Vec3f> voter_normals;
    Span<float> voter_strengths;

    TVSGS_HD void operator()(int voter) const {
        if (voter >= ranks.usable()) {
            voter_normals[voter] = ranks.fixed.normals[voter - ranks.usable()];
            voter_strengths[voter] = ranks.fixed.weights[voter - ranks.usable()];
            return;
        }
        const int i = ranks.splat(voter);
        const bool has_tensor = (flags[i] & kHasTensor) != 0;
        voter_normals[voter] = has_tensor ? normals[i] : Vec3f{};
        voter_strengths[voter] = 1;
        if (!has_tensor) return;
        const Vec3<double> l = vec_cast<double>(eigenvalues[i]);
        const double saliency = l.y - l.z;
        const double unit =
            literal ? saliency_sum[0] / (saliency_sum[1] > 1 ? saliency_sum[1] : 1) : l.x;
        voter_strengths[voter] =
            unit > 0 && saliency >= kMinVotingGap * l.x ? float(saliency / unit) : 0.0f;
    }
};

/// Computes the records in double: a thin splat magnifies the rounding of its axes. Plates are
/// silent in a ball round and balls in a plate round.
template <class Real>
struct RecordBody {
    bool ball_round;
    Ranks ranks;
    WhitenRule rule;
    const double* noise;
    bool scale_free;
    double tau_per_median;
    Span<const float> tau;
    Span<const Vec3f> voter_normals;
    Span<const float> voter_strengths;
    Span<VoterRecord<Real>> records;

    TVSGS_HD void operator()(int voter) const {
        const Vec3f normal = voter_normals[voter];
        const bool is_plate = dot(normal, normal) > 0;
        if (!ranks.usable(voter) || is_plate == ball_round) {
            records[voter].inverse_tau2 = 0;
            return;
        }
        store(record_cast<Real>(voter_record<double>(
                  vec_cast<double>(ranks.mean(voter)), ranks.whitening<double>(voter, rule, noise),
                  tau[voter], vec_cast<double>(normal), voter_strengths[voter],
                  curvature_factor<double>(scale_free, tau[voter], tau_per_median))),
              records[voter]);
    }
};

/// The votes that each splat receives.
template <class Real, class Lists>
struct ReceivedVotes {
    Span<const VoterRecord<Real>> records;
    Span<const RankVector> means;
    Lists lists;
    VoteRule rule;

    /// Calls action(record) for each voter of the splat at `rank`; voter number e in lanes e, e +
    /// kStride, ... A CPU thread gets a Pack of records at a time; silent voters fill up the last
    /// one.
    template <int kStride, class Warp, class Action>
    TVSGS_HD void for_each_voter(const Warp& warp, int rank, const Action& action) const {
        if constexpr (Warp::kLanes == 1) {
            using Lane = typename Warp::template Lane<Real>;
            VoterRecord<Lane> pack{};
            int filled = 0;
            lists.template for_each_voter<1>(warp, rank, [&](std::uint32_t voter) {
                set_lane(pack, filled, records[voter]);
                if (++filled < Lane::kSize) return;
                action(pack);
                pack = {}, filled = 0;
            });
            if (filled > 0) action(pack);
        } else {
            lists.template for_each_voter<kStride>(
                warp, rank, [&](std::uint32_t voter) { action(load(records[voter])); });
        }
    }

private:
    template <class Lane>
    static void set_lane(VoterRecord<Lane>& pack, int lane, const VoterRecord<Real>& record) {
        constexpr int kEntries = sizeof(VoterRecord<Lane>) / sizeof(Lane);
        Real entries[kEntries];  // a record is an array of numbers
        std::memcpy(entries, &record, sizeof entries);
        auto* const lanes = reinterpret_cast<Lane*>(&pack);
        for (int i = 0; i < kEntries; ++i) lanes[i].set(lane, entries[i]);
    }
};

}  // namespace tvsgs::detail
