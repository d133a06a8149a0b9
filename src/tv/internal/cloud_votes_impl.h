// Votes between the points of a cloud, for both devices. [docs/guide/vote.md#formulas]
#pragma once

#include <algorithm>
#include <limits>

#include "core/device/morton.h"
#include "core/math/quantile.h"
#include "tv/internal/cloud_votes_bodies.h"

namespace tvsgs {
namespace detail {

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
        return quantile(shares, 0.25);
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
        CloudVotes out;
        out.order = order_, out.nearest = to_host(nearest_);
        const auto count = std::size_t(count_);
        out.kept.resize(count), out.positions.resize(count), out.normals.resize(count);
        out.eigenvalues.resize(count), out.confidences.resize(count);
        for (std::size_t rank = 0; rank < count; ++rank) {
            const auto i = std::size_t(order_[rank]);
            const Vec3f l = eigenvalues[rank];
            out.kept[i] = i;
            out.positions[i] = positions[rank], out.normals[i] = normals[rank];
            out.eigenvalues[i] = l;
            out.confidences[i] =
                dot(normals[rank], normals[rank]) > 0 ? support[rank] * (l.y - l.z) / l.x : 0;
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
