// Implementation of find_neighbours() for both devices. Only the sorts and the loops differ.
#pragma once

#include <limits>

#include "core/device/parallel.h"
#include "tv/internal/neighbour_lists_impl.h"

namespace tvsgs {
namespace detail {

inline constexpr float kLast =
    std::numeric_limits<float>::infinity();  // sorts unusable splats to the end

struct TraceBody {
    SplatSpans splats;
    Span<float> traces;

    TVSGS_HD void operator()(int i) const {
        const Vec3f s = splats.scales<float>(i);
        traces[i] = splats.usable(i) ? dot(s, s) : kLast;
    }
};

struct UsableTerm {
    Span<const float> traces;
    TVSGS_HD double operator()(int i) const { return traces[i] < kLast ? 1 : 0; }
};

struct CoordinateBody {
    SplatSpans splats;
    int axis;
    Span<float> values;
    TVSGS_HD void operator()(int i) const {
        values[i] = splats.usable(i) ? splats.means[i][axis] : kLast;
    }
};

/// Copies two of the sorted values. For parallel_for over one element.
struct PickBody {
    Span<const float> sorted;
    int low, high;
    float* out;
    TVSGS_HD void operator()(int) const { out[0] = sorted[low], out[1] = sorted[high]; }
};

/// Copies the median trace and the regulariser for the host.
struct SizesBody {
    Span<const float> sorted_traces;
    int middle;
    const double* noise;
    float* out;
    TVSGS_HD void operator()(int) const {
        out[0] = sorted_traces[middle];
        out[1] = noise == nullptr ? 0.0f : float(*noise);
    }
};

/// `quantiles`: low and high value of each axis.
TVSGS_HD inline MortonCode code_in_box(Vec3f p, const float* quantiles) {
    double extent = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double edge = double(quantiles[2 * axis + 1]) - double(quantiles[2 * axis]);
        extent = edge > extent ? edge : extent;
    }
    return morton_code(p, {quantiles[0], quantiles[2], quantiles[4]}, extent);
}

struct CodeBody {
    SplatSpans splats;
    const float* quantiles;
    bool high_word;
    Span<const std::uint32_t> order;
    Span<std::uint64_t> codes;

    TVSGS_HD void operator()(int rank) const {
        const int i = int(order[rank]);
        const MortonCode code = code_in_box(splats.means[i], quantiles);
        codes[rank] = !splats.usable(i) ? ~0ull : high_word ? code.high : code.low;
    }
};

struct TreePointBody {
    SplatSpans splats;
    Span<const std::uint32_t> order;
    Span<TreePoint> points;
    TVSGS_HD void operator()(int rank) const {
        points[rank] = {splats.means[order[rank]], order[rank]};
    }
};

/// Finds the rank at which the search for a point outside the tree begins.
struct CodeSearch {
    Span<const std::uint64_t> codes;  // high words, ascending
    const float* quantiles;

    TVSGS_HD int operator()(Vec3f p, int usable) const {
        const std::uint64_t code = code_in_box(p, quantiles).high;
        int low = 0, high = usable - 1;
        while (low < high) {
            const int middle = (low + high) / 2;
            if (codes[middle] < code)
                low = middle + 1;
            else
                high = middle;
        }
        return low;
    }
};

struct QueryBody {
    static constexpr int kMinBlocks = 4;  // 1.5 million splats on an H200: 31 ms, 48 ms without it

    SplatSpans splats;
    FixedVoterSpans fixed;
    WhitenRule rule;
    const double* noise;
    MortonTree tree;
    CodeSearch near;
    int wanted, k, capacity;
    int first;                      // voter of the first row
    Span<std::uint32_t> receivers;  // [rows, k] ascending in each row

    template <class Warp>
    TVSGS_HD void operator()(const Warp& warp, int row, void* scratch) const {
        auto* keys = static_cast<std::uint64_t*>(scratch);
        const int voter = first + row;
        const int usable = tree.points.size(), f = voter - usable;
        const bool moves = voter < usable;  // else a fixed voter
        const Vec3f position = moves ? tree.points[voter].position : fixed.means[f];
        NearestSearch<Warp> search(warp, tree, keys, capacity, wanted);
        const int found =
            search.run(position, moves ? voter : -1, moves ? voter : near(position, usable));
        const Mat3f W = whitened_from_world(
            moves ? splats.whitening<float>(int(tree.points[voter].index), rule, *noise)
                  : fixed.whitening<float>(f));
        for (int r = warp.lane(); r < found; r += Warp::kLanes) {
            const std::uint32_t receiver = key_rank(keys[r]);
            const Vec3f d = W * (tree.points[receiver].position - position);
            keys[r] = distance_key(dot(d, d), receiver);
        }
        warp.smallest_first(keys, found, k);
        write_ascending(warp, search, keys, reinterpret_cast<std::uint32_t*>(keys + k),
                        receivers.data + std::size_t(row) * k);
    }

private:
    /// Writes the ranks in ascending order. Those inside, below and above the search's first leaves
    /// are each sorted, as selections of up to 512 keys keep the order.
    template <class Warp>
    TVSGS_HD void write_ascending(const Warp& warp,
                                  const NearestSearch<Warp>& search,
                                  const std::uint64_t* keys,
                                  std::uint32_t* ranks,
                                  std::uint32_t* row) const {
        int inside = 0, below = 0;
        for (int r = warp.lane(); r < k; r += Warp::kLanes) {
            const int side = search.side_of_window(key_rank(keys[r]));
            inside += side == 0 ? 1 : 0, below += side < 0 ? 1 : 0;
        }
        inside = warp.sum(inside), below = warp.sum(below);
        for (int r = warp.lane(); r < k; r += Warp::kLanes)
            ranks[r < inside ? r + below : r < inside + below ? r - inside : r] = key_rank(keys[r]);
        warp.sync();
        int descents = 0;
        for (int r = warp.lane() + 1; r < k; r += Warp::kLanes)
            descents += ranks[r - 1] > ranks[r] ? 1 : 0;
        if (warp.sum(descents) > 0) warp.sort(ranks, k);
        for (int r = warp.lane(); r < k; r += Warp::kLanes) row[r] = ranks[r];
    }
};

/// Sum of the terms on the host. Waits for the device.
template <class Device, class Term>
double sum_on_host(NeighbourScratch<Device>& s, int count, const Term& term) {
    s.sums.resize(kSumBlocks + 1);
    s.sums.fill_zero();
    add_sum(Device{}, count, term, 1, Span<double>{s.sums.data(), kSumBlocks},
            s.sums.data() + kSumBlocks);
    return to_host(s.sums).back();
}

template <class Device>
void count_usable(const NeighbourQuery& query,
                  NeighbourScratch<Device>& s,
                  Neighbours<Device>& out) {
    const int count = query.splats.size();
    s.values.resize(count);
    parallel_for(Device{}, count, TraceBody{query.splats, s.values.span()});
    // Waits for the device: the size of all later steps depends on this number.
    out.usable = int(sum_on_host(s, count, UsableTerm{s.values.span()}));
    if (out.usable < 2) return;
    sort(s.values, s.sort);
    s.stats.resize(8);
    s.stats.fill_zero();  // read back as a whole before the quantiles are known
    parallel_for(Device{}, 1,
                 SizesBody{s.values.span(), out.usable / 2, query.noise, s.stats.data()});
    const std::vector<float> stats = to_host(s.stats);
    out.median_trace = stats[0], out.noise = double(stats[1]);
}

/// Sorts the usable splats in Morton order in the box of the 0.1 % and 99.9 % quantiles.
template <class Device>
void sort_points(const SplatSpans& splats, NeighbourScratch<Device>& s, Neighbours<Device>& out) {
    const int count = splats.size(), usable = out.usable;
    const int low = usable / 1000, high = usable - 1 - low;
    float* quantiles = s.stats.data() + 2;
    for (int axis = 0; axis < 3; ++axis) {
        parallel_for(Device{}, count, CoordinateBody{splats, axis, s.values.span()});
        sort(s.values, s.sort);
        parallel_for(Device{}, 1, PickBody{s.values.span(), low, high, quantiles + 2 * axis});
    }
    s.codes.resize(count);
    s.order.resize(count);
    parallel_for(Device{}, count, IotaBody{s.order.span()});
    for (const bool high_word : {false, true}) {  // low word first: the sort is stable
        parallel_for(Device{}, count,
                     CodeBody{splats, quantiles, high_word, s.order.span(), s.codes.span()});
        sort_by_key(s.codes, s.order, s.sort);
    }
    out.points.resize(usable);
    parallel_for(Device{}, usable, TreePointBody{splats, s.order.span(), out.points.span()});
}

}  // namespace detail

template <class Device>
void find_neighbours(const NeighbourQuery& query,
                     NeighbourScratch<Device>& s,
                     Neighbours<Device>& out,
                     const StageDone& done) {
    using namespace detail;
    out.k = 0;
    count_usable(query, s, out);
    if (out.usable < 2) return;
    sort_points(query.splats, s, out);
    done("keys");

    MortonTree tree;
    s.nodes.resize(set_tree_shape(tree, out.usable));
    tree.points = out.points.span();
    tree.nodes = s.nodes.span();
    for (int level = 0; level < tree.levels; ++level)
        parallel_for(Device{}, tree.level_size[level], TreeNodeBody{tree, level});
    done("tree");

    const int wanted = std::min(2 * query.k, out.usable - 1), capacity = search_capacity(wanted);
    out.k = std::min(query.k, wanted);
    out.voters_count = out.usable + query.fixed.size();
    out.storage = query.storage;
    store_lists(
        s, out,
        [&](int first, int count, Buffer<std::uint32_t, Device>& rows) {
            for_each_warp(Device{}, count, capacity * sizeof(std::uint64_t),
                          QueryBody{query.splats, query.fixed, query.rule, query.noise, tree,
                                    CodeSearch{s.codes.span(), s.stats.data() + 2}, wanted, out.k,
                                    capacity, first, rows.span()});
        },
        done);

    if (out.storage == ListStorage::compact)  // the event does not need them
        free_memory(s.values, s.codes, s.order, s.nodes, s.rows, s.sort.keys, s.sort.values);
}

}  // namespace tvsgs
