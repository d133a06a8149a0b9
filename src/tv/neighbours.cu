#include "tv/neighbours.h"
#include "tv/neighbours_impl.h"
#include "tv/warp_cuda.h"

namespace tvsgs {
namespace detail {
namespace {

// Integer atomics: the counts, and after the sort the lists, do not depend on the order of the
// threads.
__device__ std::int64_t add_one(std::int64_t* counter) {
    return static_cast<std::int64_t>(
        atomicAdd(reinterpret_cast<unsigned long long*>(counter), 1ull));
}

struct CountBody {
    Span<const TreePoint> points;
    int k;
    Span<const std::uint32_t> receivers;
    Span<std::int64_t> counts;

    __device__ void operator()(const CudaWarp& warp, int slot, void*) const {
        const std::size_t row = std::size_t(points[slot].index) * k;
        for (int r = warp.lane(); r < k; r += CudaWarp::kLanes)
            add_one(&counts[receivers[row + r]]);
    }
};

struct FillBody {
    Span<const TreePoint> points;
    int k;
    Span<const std::uint32_t> receivers;
    Span<const std::int64_t> begin;
    Span<int> cursors;
    Span<std::uint32_t> voters;

    __device__ void operator()(const CudaWarp& warp, int slot, void*) const {
        const std::uint32_t voter = points[slot].index;
        const std::size_t row = std::size_t(voter) * k;
        for (int r = warp.lane(); r < k; r += CudaWarp::kLanes) {
            const std::uint32_t receiver = receivers[row + r];
            voters[begin[receiver] + atomicAdd(&cursors[receiver], 1)] = voter;
        }
    }
};

struct SortListBody {
    Span<const std::int64_t> begin;
    Span<std::uint32_t> voters;

    __device__ void operator()(const CudaWarp& warp, int i, void*) const {
        bitonic_sort(warp, voters.data + begin[i], static_cast<int>(begin[i + 1] - begin[i]));
    }
};

}  // namespace

void reverse_lists(Span<const TreePoint> points,
                   NeighbourScratch<Cuda>& scratch,
                   Neighbours<Cuda>& out) {
    const int count = static_cast<int>(out.begin.size()) - 1, k = out.k;
    out.begin.fill_zero();
    for_each_warp(Cuda{}, points.size(), 0,
                  CountBody{points, k, out.receivers.span(), out.begin.span()});
    exclusive_scan(out.begin, scratch.sort);
    scratch.cursors.resize(count);
    scratch.cursors.fill_zero();
    for_each_warp(Cuda{}, points.size(), 0,
                  FillBody{points, k, out.receivers.span(), out.begin.span(),
                           scratch.cursors.span(), out.voters.span()});
    for_each_warp(Cuda{}, count, 0, SortListBody{out.begin.span(), out.voters.span()});
}

}  // namespace detail

void find_neighbours(const SplatSpans& splats,
                     int k,
                     const WhitenRule& rule,
                     const double* noise,
                     NeighbourScratch<Cuda>& scratch,
                     Neighbours<Cuda>& out) {
    detail::find_neighbours(splats, k, rule, noise, scratch, out);
}

}  // namespace tvsgs
