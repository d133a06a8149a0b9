#include "tv/neighbours.h"
#include "tv/neighbours_impl.h"
#include "tv/warp_cuda.h"

namespace tvsgs {
namespace detail {
namespace {

// Integer atomics: the counts, and after the sort the lists, do not depend on the order of the
// threads.
struct CountBody {
    int k;
    Span<const std::uint32_t> receivers;
    Span<int> counts;

    __device__ void operator()(const CudaWarp& warp, int voter, void*) const {
        for (int r = warp.lane(); r < k; r += CudaWarp::kLanes)
            atomicAdd(&counts[receivers[std::size_t(voter) * k + r]], 1);
    }
};

/// Fills each list from its end, counting down.
struct FillBody {
    int k;
    Span<const std::uint32_t> receivers;
    Span<const std::int64_t> begin;
    Span<int> counts;
    Span<std::uint32_t> voters;

    __device__ void operator()(const CudaWarp& warp, int voter, void*) const {
        for (int r = warp.lane(); r < k; r += CudaWarp::kLanes) {
            const std::uint32_t receiver = receivers[std::size_t(voter) * k + r];
            voters[begin[receiver] + atomicSub(&counts[receiver], 1) - 1] =
                static_cast<std::uint32_t>(voter);
        }
    }
};

struct SortListBody {
    static constexpr int kShared = 256;  // longer lists are rare and sorted where they are
    Span<const std::int64_t> begin;
    Span<std::uint32_t> voters;

    __device__ void operator()(const CudaWarp& warp, int i, void* scratch) const {
        std::uint32_t* list = voters.data + begin[i];
        const int count = static_cast<int>(begin[i + 1] - begin[i]);
        auto* shared = static_cast<std::uint32_t*>(scratch);
        if (count > kShared) {
            bitonic_sort(warp, list, count);
            return;
        }
        for (int j = warp.lane(); j < count; j += CudaWarp::kLanes) shared[j] = list[j];
        bitonic_sort(warp, shared, count);
        for (int j = warp.lane(); j < count; j += CudaWarp::kLanes) list[j] = shared[j];
    }
};

/// A zero after the counts of the lists, so that the scan ends with the total.
struct Counts {
    Span<const int> counts;
    __device__ std::int64_t operator()(std::int64_t i) const {
        return i < counts.size() ? counts[i] : 0;
    }
};

}  // namespace

void reverse_lists(NeighbourScratch<Cuda>& scratch, Neighbours<Cuda>& out) {
    scratch.cursors.resize(out.usable);
    scratch.cursors.fill_zero();
    for_each_warp(Cuda{}, out.voters_count, 0,
                  CountBody{out.k, out.receivers.span(), scratch.cursors.span()});
    exclusive_scan(Counts{scratch.cursors.span()}, out.begin, scratch.sort);
    for_each_warp(Cuda{}, out.voters_count, 0,
                  FillBody{out.k, out.receivers.span(), out.begin.span(), scratch.cursors.span(),
                           out.voters.span()});
    for_each_warp(Cuda{}, out.usable, SortListBody::kShared * sizeof(std::uint32_t),
                  SortListBody{out.begin.span(), out.voters.span()});
}

}  // namespace detail

void find_neighbours(const NeighbourQuery& query,
                     NeighbourScratch<Cuda>& scratch,
                     Neighbours<Cuda>& out,
                     const StageDone& done) {
    detail::find_neighbours(query, scratch, out, done);
}

}  // namespace tvsgs
