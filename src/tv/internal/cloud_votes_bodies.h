// Bodies of the votes between the points of a cloud: search, tensors, moves, outliers. Points are
// numbered by rank: their place in Morton order. [docs/guide/vote.md#formulas]
#pragma once

#include <cmath>

#include "core/device/parallel.h"
#include "core/math/eigen.h"
#include "tv/cloud_votes.h"
#include "tv/internal/morton_tree.h"
#include "tv/internal/warp.h"
#include "tv/vote_math.h"

namespace tvsgs {
namespace detail {

inline constexpr float kWideScale = 1.5f;  // scale of voting, in distances to the median neighbour
// Noise is the relative point saliency of balls that a quarter of the points stay below. Moves
// before the votes that give normals: without noise, and with kMuchNoise or more.
inline constexpr int kQuietRounds = 2, kNoisyRounds = 5, kStickRounds = 3;
inline constexpr float kMuchNoise = 0.07f;
// Sticks count cos^p of the angle between the normals of both points: p falls from kAgreement
// without noise to 0 at kNoAgreement. Balls beside them count 1 - p / kAgreement.
inline constexpr float kAgreement = 12, kNoAgreement = 0.25f;
inline constexpr float kOffPlane = 3;  // decay across a neighbour's plane, more than along it
// A point whose support is below the first number is an outlier; up to the second its votes fade.
inline constexpr int kOutlierHops = 2;
inline constexpr float kOutlierSupport = 0.15f, kFullSupport = 0.5f;

/// Finds the nearest points of a block, nearest first; missing ones are kNoPoint.
struct CloudSearchBody {
    MortonTree tree;
    int k, capacity, first;
    float limit2;              // squared distance
    Span<std::uint32_t> rows;  // [block, k]

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int row, void* scratch) const {
        auto* keys = static_cast<std::uint64_t*>(scratch);
        const int rank = first + row;
        NearestSearch<Warp> search(warp, tree, keys, capacity, k);
        const Vec3f position = tree.points[rank].position;
        const int found = search.run(position, rank, rank);
        bitonic_sort(warp, keys, found);
        for (int r = warp.lane(); r < k; r += Warp::kLanes) {
            std::uint32_t other = kNoPoint;
            if (r < found) {
                const std::uint32_t near = key_rank(keys[r]);
                const Vec3f d = tree.points[near].position - position;
                if (dot(d, d) <= limit2) other = near;
            }
            rows[std::size_t(row) * k + r] = other;
        }
    }
};

/// The neighbours of a block of points.
struct CloudLists {
    int k, first;
    Span<const std::uint32_t> rows;

    TVSGS_HD const std::uint32_t* of(int rank) const {
        return rows.data + std::size_t(rank - first) * k;
    }
    TVSGS_HD int count(int rank) const {
        const std::uint32_t* list = of(rank);
        int n = 0;
        while (n < k && list[n] != kNoPoint) ++n;
        return n;
    }
};

/// The scale of voting, kWideScale distances to the median neighbour, and the spacing, the distance
/// to the median of the nearest six; both 0 without neighbours.
struct CloudScaleBody {
    CloudLists lists;
    Span<const Vec3f> places;
    Span<float> scales, spacings;
    Span<std::uint32_t> nearest;  // [N, kGraphNeighbours]

    TVSGS_HD void operator()(int row) const {
        const int i = lists.first + row, n = lists.count(i);
        const std::uint32_t* list = lists.of(i);
        scales[i] = n == 0 ? 0 : kWideScale * norm(places[list[n / 2]] - places[i]);
        spacings[i] = n == 0 ? 0 : norm(places[list[n < 6 ? n / 2 : 3]] - places[i]);
        for (int r = 0; r < kGraphNeighbours; ++r)
            nearest[std::size_t(i) * kGraphNeighbours + r] = r < n ? list[r] : kNoPoint;
    }
};

/// Points as voters. Strengths of 0 are silent.
struct CloudVoters {
    CloudLists lists;
    Span<const Vec3f> places, normals;
    Span<const float> scales, balls, sticks;
    float agreement = 0;  // exponent of stick(), as kAgreement

    TVSGS_HD float scale(int i, std::uint32_t j) const {
        return scales[i] < scales[j] ? scales[i] : scales[j];
    }
    /// Strength of the stick j at point i: points beyond an edge count less.
    TVSGS_HD float stick(int i, std::uint32_t j) const {
        const Vec3f n = normals[i];
        const bool agree = agreement > 0 && dot(n, n) > 0;
        return sticks[j] * (agree ? std::pow(std::abs(dot(n, normals[j])), agreement) : 1.0f);
    }

    /// Adds `share` of the votes that point i receives, from balls or from sticks.
    template <bool kBalls>
    TVSGS_HD void add_votes(int i, float share, Sym3f& T) const {
        const std::uint32_t* list = lists.of(i);
        for (int r = 0; r < lists.k && list[r] != kNoPoint; ++r) {
            const std::uint32_t j = list[r];
            const float tau = scale(i, j);
            const Vec3f d = places[i] - places[j];
            VoterRecord<float> voter;
            voter.inverse_tau2 = inverse_square_or_zero(tau);
            // Noise turns the direction to a near point most, so a vote counts by the distance.
            const float strength =
                share * (kBalls ? balls[j] : stick(i, j)) * voter.inverse_tau2 * dot(d, d);
            Vote<float> vote;
            if (kBalls) {
                vote = ball_vote<ExactMath>(voter, d, d, {});
            } else {
                const Vec3f n = normals[j];
                const float u = dot(d, n);
                voter.normal_world = n;
                voter.curvature = curvature_factor(true, tau, 1.0f);
                vote = plate_vote<ExactMath>(voter, d, {norm(d - u * n), 0, u}, {});
            }
            if (vote.cast && strength * 0 == 0) add_outer(T, strength * vote.decay, vote.v);
        }
    }
};

/// Tensors of a block from the votes of balls, or of balls and sticks.
template <bool kSticks>
struct CloudTensorBody {
    CloudVoters voters;
    Span<const Vec3f> given;  // normals of the input; may be empty
    Span<Vec3f> eigenvalues, normals;

    TVSGS_HD void operator()(int row) const {
        const int i = voters.lists.first + row;
        const Vec3f input = given.empty() ? Vec3f{} : given[i];
        if (!kSticks && dot(input, input) > 0) {
            eigenvalues[i] = {1, 1, 0}, normals[i] = input;
            return;
        }
        Sym3f T;
        const float balls = kSticks ? 1 - voters.agreement / kAgreement : 1.0f;
        if (balls > 0) voters.add_votes<true>(i, balls, T);
        if (kSticks) voters.add_votes<false>(i, 1, T);
        const VotedTensor voted = voted_tensor(T);
        const Vec3f values = voted.values, normal = voted.has_normal ? voted.normal : Vec3f{};
        eigenvalues[i] = {values.x, values.y, values.z > 0 ? values.z : 0};
        normals[i] = dot(normal, input) < 0 ? -normal : normal;
    }
};

/// Strengths of the next votes: the input's confidence, of a stick times (l2 - l3) / l1; less for a
/// point of low support, if `support` is not empty. A point with an input normal is no ball.
struct CloudStrengthBody {
    Span<const float> confidences, support;
    Span<const Vec3f> given, eigenvalues, normals;
    Span<float> balls, sticks;

    TVSGS_HD void operator()(int i) const {
        float strength = confidences[i];
        if (!support.empty()) {
            const float x = (support[i] - kOutlierSupport) / (kFullSupport - kOutlierSupport);
            strength *= x > 0 ? (x < 1 ? x : 1) : 0;
        }
        const Vec3f l = eigenvalues[i];
        balls[i] = !given.empty() && dot(given[i], given[i]) > 0 ? 0 : strength;
        sticks[i] = dot(normals[i], normals[i]) > 0 ? strength * (l.y - l.z) / l.x : 0;
    }
};

/// Moves points along their normals to the mean of the places that their neighbours give them, at
/// most one spacing: where an arc meets both normals. So curved surfaces do not shrink.
struct CloudPlaceBody {
    CloudVoters voters;
    Span<const float> spacings;
    Span<Vec3f> moved;

    TVSGS_HD void operator()(int row) const {
        const int i = voters.lists.first + row;
        const Vec3f place = voters.places[i], n = voters.normals[i];
        const std::uint32_t* list = voters.lists.of(i);
        float sum = 0, weights = voters.sticks[i];
        for (int r = 0; r < voters.lists.k && list[r] != kNoPoint; ++r) {
            const std::uint32_t j = list[r];
            const Vec3f d = voters.places[j] - place, m = voters.normals[j];
            const float off = dot(d, m);
            const float reach =
                inverse_square_or_zero(voters.scale(i, j)) * (dot(d, d) + kOffPlane * off * off);
            const float w = voters.stick(i, j) * std::exp(-reach);
            if (!(w > 0)) continue;
            sum += w * (dot(d, n) + (dot(m, n) < 0 ? -off : off)) / 2, weights += w;
        }
        const float height = weights > 0 ? sum / weights : 0, limit = spacings[i];
        moved[i] = place + (height < -limit ? -limit : height < limit ? height : limit) * n;
    }
};

/// Surface saliency around each point, per area: far outliers support each other on a larger area.
struct CloudReferenceBody {
    CloudLists lists;
    Span<const float> scales;
    Span<const Vec3f> eigenvalues;
    Span<float> references;

    TVSGS_HD void operator()(int row) const {
        const int i = lists.first + row;
        const std::uint32_t* list = lists.of(i);
        const float own = saliency_at(i, i);
        float sum = own, squares = own * own;
        for (int r = 0; r < lists.k && list[r] != kNoPoint; ++r) {
            const float s = saliency_at(i, list[r]);
            if (s * s * 0 == 0) sum += s, squares += s * s;
        }
        references[i] = squares / sum / (scales[i] * scales[i]);
    }

private:
    /// Relative to the scale at point i, so that squares stay in range.
    TVSGS_HD float saliency_at(int i, std::uint32_t j) const {
        const float ratio = scales[i] / scales[j];
        return (eigenvalues[j].y - eigenvalues[j].z) * ratio * ratio;
    }
};

/// The largest reference among the neighbours.
struct CloudSpreadBody {
    CloudLists lists;
    Span<const float> references;
    Span<float> spread;

    TVSGS_HD void operator()(int row) const {
        const int i = lists.first + row;
        const std::uint32_t* list = lists.of(i);
        float largest = references[i];
        for (int r = 0; r < lists.k && list[r] != kNoPoint; ++r)
            if (references[list[r]] > largest) largest = references[list[r]];
        spread[i] = largest;
    }
};

/// Surface saliency per area as a share of the reference, at most 1.
struct CloudSupportBody {
    Span<const float> scales, references;
    Span<const Vec3f> eigenvalues;
    Span<float> support;

    TVSGS_HD void operator()(int i) const {
        const float own = (eigenvalues[i].y - eigenvalues[i].z) / (scales[i] * scales[i]);
        const float share = own / references[i];
        support[i] = share > 0 ? (share < 1 ? share : 1) : 0;  // NaN becomes 0
    }
};

}  // namespace detail
}  // namespace tvsgs
