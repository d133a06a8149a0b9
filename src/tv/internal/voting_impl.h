// Implementation of TensorVoter: when it searches and votes, and how growth changes the field.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include "tv/internal/voting_event.h"

namespace tvsgs {

namespace detail {
// Defined in voting.cpp, because CUDA sources do not include the log.
void warn_too_few(int usable, int count);
void warn_noise(double share);

template <class Device>
void clear(int count, TensorField<Device>& field) {
    const auto zeros = [&](auto&... buffers) {
        (buffers.resize(count), ...);
        (buffers.fill_zero(), ...);
    };
    zeros(field.tensors, field.eigenvalues, field.normals, field.targets, field.flags);
}

/// Converts lists of ranks to lists of splat indices, on the host.
template <class Device>
VotingDetails lists_by_splat(const Neighbours<Device>& near,
                             int count,
                             const std::vector<int>& fixed_order = {}) {
    VotingDetails result;
    result.k = near.k;
    result.begin.assign(std::size_t(count) + 1, 0);
    if (near.k == 0) return result;
    const auto points = to_host(near.points);
    const HostLists lists = host_lists(near);
    const auto splat = [&](std::uint32_t voter) {
        if (voter < points.size()) return points[voter].index;
        return std::uint32_t(count + fixed_order[voter - points.size()]);
    };
    result.receivers.assign(std::size_t(count) * near.k, 0);
    std::vector<int> rank_of(std::size_t(count), -1);
    for (std::size_t rank = 0; rank < points.size(); ++rank) {
        rank_of[points[rank].index] = int(rank);
        for (int r = 0; r < near.k; ++r)
            result.receivers[std::size_t(points[rank].index) * near.k + r] =
                points[lists.receivers[rank * near.k + r]].index;
    }
    for (int i = 0; i < count; ++i) {
        const int rank = rank_of[i];
        if (rank >= 0)
            for (auto e = lists.begin[rank]; e < lists.begin[rank + 1]; ++e)
                result.voters.push_back(splat(lists.voters[e]));
        std::sort(result.voters.begin() + result.begin[i], result.voters.end());
        result.begin[i + 1] = std::int64_t(result.voters.size());
    }
    return result;
}

}  // namespace detail

template <class Device>
TensorVoter<Device>::TensorVoter(const TvOptions& options)
    : options_(options), state_(new detail::VotingState<Device>) {}

template <class Device>
TensorVoter<Device>::~TensorVoter() = default;

template <class Device>
bool TensorVoter<Device>::due(int step) const {
    return options_.enabled && step >= options_.start &&
           ((step - options_.start) % options_.vote_every == 0 || state_->changed);
}

template <class Device>
void TensorVoter<Device>::vote(int step,
                               const Gaussians<Device>& gaussians,
                               TensorField<Device>& field,
                               bool targets) {
    auto& s = *state_;
    const int count = gaussians.size();
    const SplatSpans splats = splat_spans(gaussians);
    if (int(field.flags.size()) != count) detail::clear(count, field);  // nothing was inherited
    s.stale = s.stale || s.listed != count;
    s.changed = false;
    s.times.begin();

    measure_noise(splats);
    if (s.stale || step - s.searched_at >= options_.refresh_every || step < s.searched_at)
        search(step, splats);
    if (std::exchange(s.new_lists, false)) {
        const detail::Ranks ranks = s.ranks(splats);
        s.all_have_tensors =
            s.neighbours.k > 0 &&
            s.total_on_host(ranks.usable(), detail::RankTensorTerm{ranks, field.flags.span()}) ==
                ranks.usable();
    }
    if (s.neighbours.k == 0) return detail::clear(count, field);
    const auto vote_on = [&]<class Lists>(const Lists& lists) {
        if (options_.precision == VotePrecision::single_precision)
            detail::VotingEvent<float, Lists, Device>{options_, lists, splats, s, field}.run(
                targets);
        else
            detail::VotingEvent<double, Lists, Device>{options_, lists, splats, s, field}.run(
                targets);
    };
    if (s.neighbours.storage == ListStorage::full)
        vote_on(s.neighbours.full_lists());
    else
        vote_on(s.neighbours.compact_lists());
}

/// Computes the regulariser of the whitening: 1e-4 of the mean trace.
template <class Device>
void TensorVoter<Device>::measure_noise(const SplatSpans& splats) {
    using namespace detail;
    auto& s = *state_;
    const int count = splats.size();
    s.partial.resize(kSumBlocks), s.totals.resize(kSums);
    s.totals.fill_zero();
    s.total(kUsable, count, UsableSplatTerm{splats});
    s.total(kNoise, count, NoiseTerm{splats, options_.flatness_limit});
    s.total(kPositionNoise, count, NoiseTerm{splats, options_.flatness_limit_position});
    for (const Sum noise : {kNoise, kPositionNoise})
        parallel_for(Device{}, 1, NoiseBody{s.totals.data() + kUsable, s.totals.data() + noise});
}

template <class Device>
void TensorVoter<Device>::search(int step, const SplatSpans& splats) {
    auto& s = *state_;
    // Compact lists serve large scenes; free the event's records to make room for the search.
    if (options_.lists == ListStorage::compact) detail::free_memory(s.records, s.double_records);
    find_neighbours(
        {splats, s.fixed(), options_.k, detail::whiten_rule(options_, options_.flatness_limit),
         s.totals.data() + detail::kNoise, options_.lists},
        s.scratch, s.neighbours, [&s](const char* stage) { s.times.done(stage); });
    s.searched_at = step;
    s.listed = splats.size();
    s.stale = s.all_have_tensors = false;
    s.new_lists = true;  // vote() counts the tensors
    const Neighbours<Device>& found = s.neighbours;
    if (found.k == 0 && !std::exchange(s.warned_few, true))
        detail::warn_too_few(found.usable, splats.size());
    // A few giant splats raise the regulariser, which then makes the small splats rounder.
    constexpr double kCoarse = 0.1;
    const double size = std::sqrt(std::max(double(found.median_trace), 1e-300) / 3),
                 share = std::sqrt(found.noise) / size;
    if (found.k > 0 && share > kCoarse && options_.whiten_noise_mode == NoiseMode::global &&
        !std::exchange(s.warned_noise, true))
        detail::warn_noise(share);
}

template <class Device>
void TensorVoter<Device>::structure_changed(Span<const int> parents, TensorField<Device>& field) {
    auto& s = *state_;
    s.stale = s.changed = true;
    if (field.flags.empty()) return;  // no event yet
    const int count = parents.size();
    const auto inherit = [&]<class T>(Buffer<T, Device>& values, Buffer<T, Device>& scratch) {
        scratch.resize(count);
        parallel_for(Device{}, count,
                     detail::InheritBody<T>{parents, values.span(), scratch.span()});
        values.swap(scratch);
    };
    inherit(field.tensors, s.tensors);
    inherit(field.eigenvalues, s.vectors);
    inherit(field.normals, s.vectors);
    inherit(field.targets, s.vectors);
    inherit(field.flags, s.flags);
    parallel_for(Device{}, count,
                 detail::KeepFlagsBody{kHasTensor | kNormalValid, field.flags.span()});
}

template <class Device>
void TensorVoter<Device>::set_fixed_voters(const FixedVoters& voters) {
    auto& s = *state_;
    Buffer<int, Cpu> order;  // Morton order: near in space, near in memory
    morton_order(Span<const Vec3f>{voters.means.data(), voters.means.size()}, order);
    s.fixed_order = to_host(order);
    const auto in_order = [&](auto values) {
        const auto given = values;
        for (std::size_t i = 0; i < given.size(); ++i) values[i] = given[s.fixed_order[i]];
        return values;
    };
    copy(in_order(voters.means), s.fixed_means);
    copy(in_order(voters.normals), s.fixed_normals);
    copy(in_order(voters.scales), s.fixed_scales);
    copy(in_order(voters.weights), s.fixed_weights);
    s.stale = true;
}

template <class Device>
auto TensorVoter<Device>::progress() const -> Progress {
    return {state_->stale ? -1 : state_->searched_at, state_->changed};
}

template <class Device>
void TensorVoter<Device>::restore(const Progress& progress, const Gaussians<Device>& searched) {
    state_->changed = progress.changed;
    state_->stale = progress.searched_at < 0;
    if (state_->stale) return;
    const SplatSpans splats = splat_spans(searched);
    measure_noise(splats);
    search(progress.searched_at, splats);
}

template <class Device>
void TensorVoter<Device>::set_profiling(bool on) {
    state_->times.on = on;
}

template <class Device>
VotingProfile TensorVoter<Device>::profile() const {
    return {state_->times.stages, state_->bytes()};
}

// For tests and reports:

template <class Device>
void TensorVoter<Device>::set_receivers(int step,
                                        int k,
                                        const std::vector<std::uint32_t>& receivers) {
    auto& s = *state_;
    Neighbours<Device>& near = s.neighbours;
    const int count = int(receivers.size()) / k;
    std::vector<TreePoint> points(count);  // ranks are indices
    for (int i = 0; i < count; ++i) points[i] = {{}, std::uint32_t(i)};
    std::vector<std::uint32_t> sorted = receivers;
    for (auto row = sorted.begin(); row != sorted.end(); row += k) std::sort(row, row + k);
    copy(points, near.points);
    near.k = k;
    near.usable = near.voters_count = s.listed = count;
    near.storage = options_.lists;
    detail::store_lists(s.scratch, near, [&](int first, int rows, auto& to) {
        const auto from = sorted.begin() + std::ptrdiff_t(first) * k;
        copy(std::vector<std::uint32_t>(from, from + std::ptrdiff_t(rows) * k), to);
    });
    s.searched_at = step;
    s.stale = s.all_have_tensors = false;
}

template <class Device>
VotingDetails TensorVoter<Device>::details() const {
    const auto& s = *state_;
    VotingDetails result =
        detail::lists_by_splat(s.neighbours, std::max(s.listed, 0), s.fixed_order);
    const auto points = to_host(s.neighbours.points);
    const auto by_splat = [&]<class T>(const Buffer<T, Device>& values, std::vector<T>& out) {
        out.assign(std::max(s.listed, 0), T{});
        // Without neighbours, or before the first event, `values` has no entries for the splats.
        if (s.neighbours.k == 0 || values.size() < points.size()) return;
        const std::vector<T> host = to_host(values);
        for (std::size_t rank = 0; rank < points.size(); ++rank)
            out[points[rank].index] = host[rank];
    };
    by_splat(s.tau, result.tau);
    by_splat(s.variability, result.variability);
    by_splat(s.strengths, result.strength);
    by_splat(s.left_out, result.left_out);
    return result;
}

}  // namespace tvsgs
