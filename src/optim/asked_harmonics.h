// Of several processes each moves the harmonics of its part of the splats. The others have those
// as they last asked for them: before a photograph is rendered its process asks for what it sees
// there. So a step sends harmonics of what is in view, and not those of all splats.
#pragma once

#include <algorithm>
#include <cstring>
#include <utility>
#include <vector>

#include "comm/communicator.h"
#include "core/gaussians.h"
#include "render/splat_places.h"

namespace tvsgs {

/// Harmonics that move, coefficient major.
struct MovingHarmonics {
    Vec3f* sh;
    std::size_t stride;  // splats
    int coefficients;
};

/// edges[r] <- values[where part r of the splats begins]; the last one: where all end. `values`
/// has one more than there are splats.
template <class T>
struct PartEdgesBody {
    Span<const T> values;
    int ranks;
    T* edges;  // [ranks + 1]
    TVSGS_HD void operator()(int r) const {
        const int count = values.size() - 1;
        edges[r] =
            values[static_cast<std::size_t>(r < ranks ? part_of(count, r, ranks).begin : count)];
    }
};

/// asked[..] <- the splats in view, in their order, but for those of part `own`, of which there are
/// `own_in_view`.
template <class Device>
void list_asked(
    Device device, const SplatPlaces& places, Part own, std::uint32_t own_in_view, Span<int> asked);
/// As PartEdgesBody.
template <class Device>
void find_part_edges(Device device,
                     Span<const std::uint32_t> before,
                     int ranks,
                     std::uint32_t* edges);
/// rows[k * splats.count + j] <- coefficient k of splats[j]; and back.
template <class Device>
void give_rows(Device device, const MovingHarmonics& all, Span<const int> splats, Vec3f* rows);
template <class Device>
void take_rows(Device device,
               const MovingHarmonics& all,
               Span<const int> splats,
               const Vec3f* rows);

/// Of what a photograph says of splats, or sees of them, a process sends and is sent that of a
/// quarter of all, or of 65,536, at a time: it takes memory, and each exchange takes its time on a
/// GPU however little it moves.
inline constexpr int kExchangesOfPhotograph = 4, kLeastExchanged = 1 << 16;
inline bool goes_at_once(const SentCounts& counts, int splats) {
    return most_of_a_rank(counts) <= std::max(kLeastExchanged, splats / kExchangesOfPhotograph);
}

/// What a process sends, and what it is sent: words of whatever is on its way just now.
template <class Device>
struct OnItsWay {
    Buffer<std::uint32_t, Device> sent, come;
};

template <class Device>
class AskedHarmonics {
public:
    /// After a step of so many coefficients; those beyond have never moved.
    void step_done(int coefficients) { moved_ = std::max(moved_, coefficients); }

    /// Before a photograph, on all ranks: the next ask() is its first one.
    void begin_photograph() { asked_for_ = false; }

    /// g.sh <- those of the splats in view, up to date; null: of none, for a rank that has no
    /// photograph. All ranks have to call it once, and may do so again for the same photograph.
    /// Where one sees much, all are sent those of all splats, which go straight to their places.
    void ask(Communicator& peers, Gaussians<Device>& g, const SplatPlaces* places) {
        if (moved_ == 0 || std::exchange(asked_for_, true)) return;
        const auto ranks = static_cast<std::size_t>(peers.size());
        std::vector<int> mine(ranks, 0);
        if (places != nullptr) mine = count(peers, *places);
        std::vector<std::byte> all_said;
        peers.all_gather_v("harmonics", mine.data(), ranks * sizeof(int), all_said);
        SentCounts counts(ranks, mine);
        for (std::size_t r = 0; r < ranks; ++r)
            std::memcpy(counts[r].data(), all_said.data() + r * ranks * sizeof(int),
                        ranks * sizeof(int));
        if (!goes_at_once(counts, g.size())) return catch_up(peers, g);
        if (places != nullptr) list(peers, *places);
        std::vector<std::size_t> to{0};
        for (const int count : mine) to.push_back(to.back() + static_cast<std::size_t>(count));
        const std::vector<std::size_t> from = received_begins(counts, peers.rank(), 1);
        peers.deal_known("harmonics", asked_, to, wanted_, from);
        const MovingHarmonics all{g.sh.data(), g.means.size(), moved_};
        const auto moved = static_cast<std::size_t>(moved_);
        const std::size_t each = moved * (sizeof(Vec3f) / sizeof(std::uint32_t));
        on_its_way_.sent.resize(from.back() * each);
        over_rows(from, wanted_, [&](Span<const int> splats, std::size_t at) {
            give_rows(Device{}, all, splats, rows(on_its_way_.sent) + at * moved);
        });
        peers.deal_known("harmonics", on_its_way_.sent, times(from, each), on_its_way_.come,
                         times(to, each));
        over_rows(to, asked_, [&](Span<const int> splats, std::size_t at) {
            take_rows(Device{}, all, splats, rows(on_its_way_.come) + at * moved);
        });
    }

    /// Room that others may use between two calls.
    OnItsWay<Device>& on_its_way() { return on_its_way_; }

    /// All of them, on all ranks: before anything but a photograph looks at harmonics.
    void catch_up(Communicator& peers, Gaussians<Device>& g) {
        if (moved_ == 0) return;
        share_parts(&peers, "all harmonics", Device{},
                    {{g.sh.data(), sizeof(Vec3f), std::exchange(moved_, 0)}}, g.size());
    }

private:
    static Vec3f* rows(Buffer<std::uint32_t, Device>& words) {
        return reinterpret_cast<Vec3f*>(words.data());
    }
    static std::vector<std::size_t> times(std::vector<std::size_t> begins, std::size_t each) {
        for (std::size_t& begin : begins) begin *= each;
        return begins;
    }

    /// How many of those in view each of the others owns.
    std::vector<int> count(const Communicator& peers, const SplatPlaces& places) {
        const int ranks = peers.size();
        edges_.resize(static_cast<std::size_t>(ranks) + 1);
        find_part_edges(Device{}, places.before, ranks, edges_.data());
        const std::vector<std::uint32_t> edges = to_host(edges_);
        std::vector<int> counts;
        for (std::size_t r = 0; r + 1 < edges.size(); ++r)
            counts.push_back(static_cast<int>(edges[r + 1] - edges[r]));
        own_in_view_ = std::exchange(counts[static_cast<std::size_t>(peers.rank())], 0);
        in_view_ = static_cast<int>(edges.back());
        return counts;
    }

    /// asked_ <- these.
    void list(const Communicator& peers, const SplatPlaces& places) {
        asked_.resize(static_cast<std::size_t>(in_view_ - own_in_view_));
        list_asked(Device{}, places, own_part(&peers, places.radii.size()),
                   static_cast<std::uint32_t>(own_in_view_), asked_.span());
    }

    template <class Run>
    static void over_rows(const std::vector<std::size_t>& begins,
                          const Buffer<int, Device>& splats,
                          const Run& run) {
        for (std::size_t r = 0; r + 1 < begins.size(); ++r)
            if (const std::size_t count = begins[r + 1] - begins[r]; count > 0)
                run(splats.span().sub(begins[r], count), begins[r]);
    }

    int moved_ = 0;  // coefficients that have moved since all had all of them
    bool asked_for_ = false;
    int in_view_ = 0, own_in_view_ = 0;  // of the photograph
    Buffer<std::uint32_t, Device> edges_;
    Buffer<int, Device> asked_, wanted_;  // splats: of others, by others
    OnItsWay<Device> on_its_way_;         // rows of rank after rank, coefficient major
};

}  // namespace tvsgs
