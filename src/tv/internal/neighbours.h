// Search for the neighbours that each voter votes for.  [docs/method/voting.md#neighbours]
#pragma once

#include <cstdint>
#include <functional>

#include "core/scene/gaussians.h"
#include "tv/internal/morton_tree.h"
#include "tv/internal/neighbour_lists.h"
#include "tv/internal/warp.h"
#include "tv/vote_math.h"

namespace tvsgs {

/// Geometry of the splats.
struct SplatSpans {
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;

    TVSGS_HD int size() const { return means.size(); }
    template <class Real>
    TVSGS_HD Vec3<Real> scales(int i) const {
        return exp(vec_cast<Real>(log_scales[i]));
    }
    /// Unusable splats neither vote nor receive votes.
    TVSGS_HD bool usable(int i) const {
        const Quatf q = quats[i];
        const Vec3f s = scales<float>(i);
        const float quat2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z, trace = dot(s, s);
        return is_finite(means[i]) && trace * 0 == 0 && quat2 > 0 && quat2 * 0 == 0;
    }
    template <class Real>
    TVSGS_HD Whitening<Real> whitening(int i, const WhitenRule& rule, double noise) const {
        return tvsgs::whitening(quat_cast<Real>(quats[i]), scales<Real>(i), rule, Real(noise));
    }
};

/// Measured points that only vote.
struct FixedVoterSpans {
    Span<const Vec3f> means, normals;  // normals: unit
    Span<const float> scales;   // world units; radius of the surface patch that a point represents
    Span<const float> weights;  // strength of its votes

    TVSGS_HD int size() const { return means.size(); }
    template <class Real>
    TVSGS_HD Whitening<Real> whitening(int i) const {
        const Real s = scales[i];
        return {{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, {s, s, s}};
    }
};

template <class Device>
SplatSpans splat_spans(const Gaussians<Device>& g) {
    return {g.means.span(), g.log_scales.span(), g.quats.span()};
}

/// Lists of one search, valid until the number or the order of the splats changes. They name usable
/// splats by rank, the place in Morton order. Voters below `usable` are splats; fixed ones follow.
template <class Device>
struct Neighbours {
    int k = 0;       // receivers per voter: min(k of the query, usable splats - 1)
    int usable = 0;  // splats that take part
    int voters_count = 0;
    ListStorage storage = ListStorage::full;
    Buffer<TreePoint, Device> points;  // [usable] the splats by rank, at the time of the search
    EdgeTiles<Device> tiles;           // the compact form; the full lists are built from it
    // The full form.
    Buffer<std::uint32_t, Device> receivers;  // [voters_count, k] ranks, ascending for each voter
    Buffer<std::int64_t, Device> begin;       // [usable + 1] index of the first voter of receiver i
    Buffer<std::uint32_t, Device> voters;     // [voters_count * k] ascending for each receiver
    float median_trace = 0;                   // of the usable splats' covariances
    double noise = 0;                         // value of the query's noise; 0 without one

    FullLists full_lists() const { return {k, receivers.span(), begin.span(), voters.span()}; }
    CompactLists compact_lists() const {
        const EdgeTiles<Device>& t = tiles;
        return {
            {t.tiles.data(), t.count}, {t.receiver_block.data(), t.count}, t.voter_begin.span(),
            {t.place.data(), t.count}, {t.voter_block.data(), t.count},    t.receiver_begin.span()};
    }
};

/// Scratch memory of the search, kept between calls.
template <class Device>
struct NeighbourScratch {
    SortScratch<Device> sort;
    Buffer<float, Device> values;  // [N] sorted: traces, then coordinates of one axis
    Buffer<float, Device> stats;   // median trace and noise, then quantiles
    Buffer<double, Device> sums;   // partial sums and their total
    Buffer<std::uint64_t, Device> codes;
    Buffer<std::uint32_t, Device> order;
    Buffer<TreeNode, Device> nodes;
    Buffer<int, Device> cursors;
    Buffer<std::int64_t, Device> begin;
    Buffer<std::uint32_t, Device> rows;  // receivers of a chunk; scratch of index_tiles()
};

struct NeighbourQuery {
    SplatSpans splats;
    FixedVoterSpans fixed;
    int k = 0;
    WhitenRule rule;
    const double* noise = nullptr;  // global regulariser of the whitening, on the device
    ListStorage storage = ListStorage::full;
};

/// Called with the name of each finished stage: "keys", "tree", "search", "reverse".
using StageDone = std::function<void(const char*)>;
inline void ignore_stage(const char* /*name*/) {}

/// For each voter, finds the 2k nearest usable splats except itself, and keeps the k of them that
/// are nearest in its whitened space; ties by rank. Exact for all inputs. Excludes splats with
/// values that are not finite. With fewer than two usable splats k is 0.
template <class Device>
void find_neighbours(const NeighbourQuery& query,
                     NeighbourScratch<Device>& s,
                     Neighbours<Device>& out,
                     const StageDone& done = ignore_stage);

}  // namespace tvsgs
