// TensorVoter::details() and set_receivers(), for tests and reports.
#pragma once

#include <algorithm>

#include "tv/internal/voting_state.h"

namespace tvsgs {
namespace detail {

/// Converts lists of ranks to lists of splat indices, on the host.
template <class Device>
VotingDetails lists_by_splat(const Neighbours<Device>& near,
                             int count,
                             const std::vector<int>& fixed_order = {}) {
    VotingDetails result;
    result.k = near.k;
    result.begin.assign(static_cast<std::size_t>(count) + 1, 0);
    if (near.k == 0) return result;
    const auto points = to_host(near.points);
    const HostLists lists = host_lists(near);
    const auto splat = [&](std::uint32_t voter) {
        if (voter < points.size()) return points[voter].index;
        return static_cast<std::uint32_t>(count + fixed_order[voter - points.size()]);
    };
    result.receivers.assign(static_cast<std::size_t>(count) * near.k, 0);
    std::vector<int> rank_of(static_cast<std::size_t>(count), -1);
    for (std::size_t rank = 0; rank < points.size(); ++rank) {
        rank_of[points[rank].index] = static_cast<int>(rank);
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
        result.begin[i + 1] = static_cast<std::int64_t>(result.voters.size());
    }
    return result;
}

}  // namespace detail

template <class Device>
void TensorVoter<Device>::set_receivers(int step,
                                        int k,
                                        const std::vector<std::uint32_t>& receivers) {
    auto& s = *state_;
    Neighbours<Device>& near = s.neighbours;
    const int count = static_cast<int>(receivers.size()) / k;
    std::vector<TreePoint> points(static_cast<std::size_t>(count));  // ranks are indices
    for (int i = 0; i < count; ++i) points[i] = {{}, static_cast<std::uint32_t>(i)};
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
        out.assign(static_cast<std::size_t>(std::max(s.listed, 0)), T{});
        // Without neighbours or an event nothing fits the splats.
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
