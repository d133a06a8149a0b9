// Votes between the points of a cloud, for both devices. Points are numbered by rank: their place
// in Morton order. [docs/guide/vote.md#formulas]
#pragma once

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/device/morton.h"
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

/// The scale of voting, from the distance to the median neighbour, and the distance and to the
/// median of the nearest six (the spacing); 0 without neighbours.
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
    float agreement = 0;  // exponent

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

template <class Device>
class CloudVoting {
public:
    CloudVoting(const PointCloud& cloud,
                const CloudVoteOptions& options,
                const CloudProgress& progress)
        : options_(options), progress_(progress), count_(int(cloud.positions.size())) {
        Buffer<Vec3f, Device> given;
        copy(cloud.positions, given);
        Buffer<int, Device> order;
        morton_order(given.span(), order);
        order_ = to_host(order);
        in_order(cloud.positions, places_);
        in_order(cloud.normals, given_);
        std::vector<float> confidences(cloud.positions.size(), 1.0f);
        for (std::size_t i = 0; i < cloud.confidences.size(); ++i) {
            const float c = cloud.confidences[i];
            confidences[i] = c > 0 ? std::min(c, 1.0f) : 0;  // NaN becomes 0
        }
        in_order(confidences, confidences_);
        k_ = std::max(1, std::min(options.k, count_ - 1));
        make_tree();
        scales_.resize(count_), spacings_.resize(count_),
            nearest_.resize(std::size_t(count_) * kGraphNeighbours);
        eigenvalues_.resize(count_), normals_.resize(count_), balls_.resize(count_);
        sticks_.resize(count_), support_.resize(count_);
        eigenvalues_.fill_zero(), normals_.fill_zero();
        set_strengths(false);
        blocks([&](const CloudLists& lists) {
            return CloudScaleBody{lists, places_.span(), scales_.span(), spacings_.span(),
                                  nearest_.span()};
        });
    }

    /// Indices of the input that are no outliers, ascending.
    std::vector<std::size_t> surface_points() {
        vote_as_balls();
        vote_as_sticks();
        find_support(kOutlierHops);
        set_strengths(true);
        vote_as_sticks();
        find_support(kOutlierHops);
        const std::vector<float> support = to_host(support_);
        std::vector<std::size_t> kept;
        for (std::size_t rank = 0; rank < support.size(); ++rank)
            if (support[rank] > kOutlierSupport) kept.push_back(std::size_t(order_[rank]));
        std::sort(kept.begin(), kept.end());
        return kept;
    }

    CloudVotes run() {
        std::vector<Vec3f> positions = to_host(places_);
        vote_as_balls();
        const float noise = find_noise();
        agreement_ = kAgreement * std::max(0.0f, 1 - noise / kNoAgreement);
        const int rounds =
            std::max(options_.refine, kQuietRounds + int(std::min(1.0f, noise / kMuchNoise) *
                                                         float(kNoisyRounds - kQuietRounds)));
        for (int round = 1; round <= rounds; ++round) {
            move();
            if (round == options_.refine) positions = to_host(places_);
            vote_as_balls();
        }
        for (int round = rounds; round < kNoisyRounds && progress_; ++round)
            progress_(2 * count_);  // of cloud_vote_steps(), but not needed
        for (int round = 0; round < kStickRounds; ++round) vote_as_sticks();
        agreement_ = 0;
        vote<true>();  // saliencies; the normals stay
        find_support(0);
        return results(positions);
    }

private:
    template <class T>
    void in_order(const std::vector<T>& values, Buffer<T, Device>& out) const {
        std::vector<T> sorted(values.size());
        for (std::size_t rank = 0; rank < values.size(); ++rank)
            sorted[rank] = values[std::size_t(order_[rank])];
        copy(sorted, out);
    }

    void make_tree() {
        std::vector<TreePoint> points(count_);
        const std::vector<Vec3f> places = to_host(places_);
        for (std::size_t rank = 0; rank < points.size(); ++rank)
            points[rank] = {places[rank], std::uint32_t(rank)};
        copy(points, points_);
        nodes_.resize(std::size_t(set_tree_shape(tree_, count_)));
        tree_.points = points_.span(), tree_.nodes = nodes_.span();
        for (int level = 0; level < tree_.levels; ++level)
            parallel_for(Device{}, tree_.level_size[level], TreeNodeBody{tree_, level});
    }

    /// Runs body_of(lists) on the points of each block.
    template <class BodyOf>
    void blocks(const BodyOf& body_of) {
        const bool keep =
            std::size_t(count_) * std::size_t(k_) * sizeof(std::uint32_t) <= options_.list_bytes;
        if (keep) rows_.resize(std::size_t(count_) * k_);
        for (int first = 0; first < count_; first += options_.block) {
            const int size = std::min(options_.block, count_ - first);
            if (!keep) rows_.resize(std::size_t(size) * k_);
            const Span<std::uint32_t> rows =
                keep ? rows_.span().sub(std::size_t(first) * k_, std::size_t(size) * k_)
                     : rows_.span();
            if (!keep || !listed_) search(first, size, rows);
            parallel_for(Device{}, size, body_of(CloudLists{k_, first, rows}));
            if (progress_) synchronize(Device{}), progress_(size);
        }
        listed_ = true;
    }

    void search(int first, int size, Span<std::uint32_t> rows) {
        const float limit = options_.radius > 0 ? options_.radius * options_.radius
                                                : std::numeric_limits<float>::infinity();
        const int capacity = search_capacity(k_);
        for_each_warp(Device{}, size, capacity * sizeof(std::uint64_t),
                      CloudSearchBody{tree_, k_, capacity, first, limit, rows});
    }

    CloudVoters voters(const CloudLists& lists) const {
        return {lists,         places_.span(), normals_.span(), scales_.span(),
                balls_.span(), sticks_.span(), agreement_};
    }
    void set_strengths(bool by_support) {
        const Span<const float> support = by_support ? support_.span() : Span<float>{};
        parallel_for(
            Device{}, count_,
            CloudStrengthBody{confidences_.span(), support, given_.span(), eigenvalues_.span(),
                              normals_.span(), balls_.span(), sticks_.span()});
    }
    /// New eigenvalues, and new normals in new_vectors_.
    template <bool kSticks>
    void vote() {
        new_vectors_.resize(count_);
        blocks([&](const CloudLists& lists) {
            return CloudTensorBody<kSticks>{voters(lists), given_.span(), eigenvalues_.span(),
                                            new_vectors_.span()};
        });
    }
    /// Sets the strengths of the sticks from votes of balls.
    void vote_as_balls() {
        vote<false>();
        normals_.swap(new_vectors_);
        set_strengths(false);
    }
    void vote_as_sticks() {
        vote<true>();
        normals_.swap(new_vectors_);
    }
    /// The relative point saliency that a quarter of the points stay below.
    float find_noise() const {
        std::vector<float> shares;
        for (const Vec3f l : to_host(eigenvalues_))
            if (l.x > 0) shares.push_back(l.z / l.x);
        if (shares.empty()) return 0;
        const auto quarter = shares.begin() + std::ptrdiff_t(shares.size() / 4);
        std::nth_element(shares.begin(), quarter, shares.end());
        return *quarter;
    }
    void move() {
        new_vectors_.resize(count_);
        blocks([&](const CloudLists& lists) {
            return CloudPlaceBody{voters(lists), spacings_.span(), new_vectors_.span()};
        });
        places_.swap(new_vectors_);
    }
    /// Compares with salient points up to `hops` + 1 neighbourhoods away.
    void find_support(int hops) {
        references_.resize(count_);
        blocks([&](const CloudLists& lists) {
            return CloudReferenceBody{lists, scales_.span(), eigenvalues_.span(),
                                      references_.span()};
        });
        for (int hop = 0; hop < hops; ++hop) {
            spread_.resize(count_);
            blocks([&](const CloudLists& lists) {
                return CloudSpreadBody{lists, references_.span(), spread_.span()};
            });
            references_.swap(spread_);
        }
        parallel_for(Device{}, count_,
                     CloudSupportBody{scales_.span(), references_.span(), eigenvalues_.span(),
                                      support_.span()});
    }

    CloudVotes results(const std::vector<Vec3f>& positions) const {
        const std::vector<Vec3f> normals = to_host(normals_), eigenvalues = to_host(eigenvalues_);
        const std::vector<float> support = to_host(support_);
        const std::vector<std::uint32_t> nearest = to_host(nearest_);
        CloudVotes out;
        const auto count = std::size_t(count_);
        out.kept.resize(count), out.positions.resize(count), out.normals.resize(count);
        out.eigenvalues.resize(count), out.confidences.resize(count);
        out.nearest.resize(nearest.size());
        for (std::size_t rank = 0; rank < count; ++rank) {
            const auto i = std::size_t(order_[rank]);
            const Vec3f l = eigenvalues[rank];
            out.kept[i] = i;
            out.positions[i] = positions[rank], out.normals[i] = normals[rank];
            out.eigenvalues[i] = l;
            out.confidences[i] =
                dot(normals[rank], normals[rank]) > 0 ? support[rank] * (l.y - l.z) / l.x : 0;
            for (std::size_t r = 0; r < kGraphNeighbours; ++r) {
                const std::uint32_t near = nearest[rank * kGraphNeighbours + r];
                out.nearest[i * kGraphNeighbours + r] =
                    near == kNoPoint ? near : std::uint32_t(order_[near]);
            }
        }
        return out;
    }

    const CloudVoteOptions& options_;
    const CloudProgress& progress_;
    int count_, k_ = 0;
    float agreement_ = 0;  // CloudVoters::agreement
    bool listed_ = false;
    std::vector<int> order_;  // [N] index in the input
    MortonTree tree_;
    Buffer<TreePoint, Device> points_;
    Buffer<TreeNode, Device> nodes_;
    Buffer<std::uint32_t, Device> rows_, nearest_;
    Buffer<Vec3f, Device> places_, given_, normals_, eigenvalues_, new_vectors_;
    Buffer<float, Device> confidences_, scales_, spacings_, balls_, sticks_, references_, spread_,
        support_;
};

}  // namespace detail

template <class Device>
CloudVotes vote_in_cloud(Device,
                         const PointCloud& cloud,
                         const CloudVoteOptions& options,
                         const CloudProgress& progress) {
    if (cloud.positions.empty()) return {};
    if (!options.reject) return detail::CloudVoting<Device>(cloud, options, progress).run();
    const std::vector<std::size_t> kept =
        detail::CloudVoting<Device>(cloud, options, progress).surface_points();
    PointCloud rest;
    const auto keep = [&](const auto& from, auto& to) {
        if (!from.empty())
            for (const std::size_t i : kept) to.push_back(from[i]);
    };
    keep(cloud.positions, rest.positions);
    keep(cloud.normals, rest.normals);
    keep(cloud.confidences, rest.confidences);
    if (kept.empty()) return {};
    CloudVotes votes = detail::CloudVoting<Device>(rest, options, progress).run();
    votes.kept = kept;
    return votes;
}

}  // namespace tvsgs
