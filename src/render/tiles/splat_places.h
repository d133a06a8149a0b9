// Compact storage of the splats in view: records only of these splats, in the order of their
// indices.
#pragma once

#include <algorithm>
#include <atomic>
#include <type_traits>
#include <vector>

#include "core/device/parallel.h"
#include "render/tiles/tiles.h"

namespace tvsgs {

inline constexpr std::uint32_t kNoPlace = 0xffffffffu;

struct SplatPlaces {
    Span<const float> radii;           // [N] > 0: in view
    Span<const std::uint32_t> before;  // [N + 1] splats in view before it; last: of all

    /// Place of splat i; kNoPlace: not in view. Compare it with the number of records before using
    /// it.
    TVSGS_HD std::uint32_t of(int i) const {
        const std::uint32_t place = before[i];  // unconditional, so that the loads overlap
        return radii[i] > 0 ? place : kNoPlace;
    }
    TVSGS_HD std::uint32_t in_view() const { return before[before.count - 1]; }
};

/// A Projection computes the records of splats:
///
///   Found           intermediate values of a splat
///   find(i, found)  true if splat i is in view
///   radius(found)   px, > 0: ScreenStatistics
///   to              the ViewRecords to write
///   store(i, found, place)  writes its records, including `rects`
template <class Projection>
struct MarkBody {
    Projection projection;
    Span<float> radii;

    TVSGS_HD void operator()(int i) const {
        typename Projection::Found found;
        radii[i] = projection.find(i, found) ? projection.radius(found) : 0;
    }
};
template <class Projection>
struct StoreBody {
    Projection projection;
    SplatPlaces places;

    TVSGS_HD void operator()(int i) const {
        const auto room = std::uint32_t(projection.to.rects.count);
        if (const std::uint32_t place = places.of(i); place < room) {
            typename Projection::Found found;
            if (projection.find(i, found)) projection.store(i, found, place);
        }
        // Clears places without a splat. There are at most as many places as splats.
        const auto beyond = std::uint32_t(i);
        if (beyond < room && beyond >= places.in_view()) projection.to.rects[beyond] = {};
    }
};

/// before[i] = number of radii > 0 among radii[0], ..., radii[i - 1], for i from 0 to their number.
void count_in_view(const Buffer<float, Cuda>& radii,
                   Buffer<std::uint32_t, Cuda>& before,
                   Buffer<std::uint8_t, Cuda>& temporary);

/// Finds the places of a view's splats and keeps memory for the records.
template <class Device>
class PlaceFinder {
public:
    /// Overwrites `radii` and `splats`. On a CPU `splats` gets a place for each splat in view. On a
    /// GPU the places may turn out to be too few, because the host does not wait for the number:
    /// call found_room(in_view) when splats.in_view is known. project(to) returns the Projection of
    /// splats [0, count) to the records in `to`.
    template <class Splats, class Project>
    void find(int count, const Project& project, Buffer<float, Device>& radii, Splats& splats) {
        const auto n = std::size_t(count);
        radii.resize(n), before_.resize(n + 1);
        room_ = std::min(room_, n);
        if constexpr (std::is_same_v<Device, Cpu>)
            find_once(count, project, radii, splats);
        else
            find_twice(count, project, radii, splats);
    }

    /// False if there were too few places; then it provides enough for the next find().
    bool found_room(std::size_t in_view) {
        if (in_view <= room_) return true;
        // Adds a margin, because the next view may have more. Buffer adds more when it grows.
        room_ = std::min(in_view + in_view / 16, before_.size() - 1);
        return false;
    }

    std::size_t room() const { return room_; }

    SplatPlaces places(const Buffer<float, Device>& radii) const {
        return {radii.span(), before_.span()};
    }

private:
    /// Projects chunks of splats to memory of each thread, then places the chunks in order.
    template <class Splats, class Project>
    void find_once(int count, const Project& project, Buffer<float, Cpu>& radii, Splats& splats) {
        constexpr int kChunk = 256;
        std::vector<Splats> own(thread_count());
        for (Splats& records : own) records.resize(kChunk);
        std::uint32_t in_view = 0;
        do {
            splats.resize(room_);
            in_view = 0;
            std::atomic<int> turn = 0;  // first splat of the range whose records are placed next
            run_ranges(count, kChunk, [&](int begin, int end, int slot) {
                Splats& records = own[slot];
                const auto projection = project(records);
                typename std::remove_const_t<decltype(projection)>::Found found;
                std::uint32_t here = 0, first = 0;
                for (int i = begin; i < end; ++i) {
                    const auto at = std::size_t(i);
                    before_[at] = here;
                    const bool seen = projection.find(i, found);
                    radii[at] = seen ? projection.radius(found) : 0;
                    if (seen) projection.store(i, found, here++);
                }
                for (int now; (now = turn.load(std::memory_order_acquire)) != begin;)
                    turn.wait(now, std::memory_order_relaxed);
                first = in_view, in_view += here;
                turn.store(end, std::memory_order_release);
                turn.notify_all();
                for (int i = begin; i < end; ++i) before_[i] += first;
                if (in_room(first, here)) copy_records(records, here, splats, first);
            });
        } while (!found_room(in_view));
        before_[count] = in_view;
        splats.resize(in_view);
    }
    bool in_room(std::size_t first, std::size_t count) const { return first + count <= room_; }
    template <class Splats>
    static void copy_records(const Splats& from,
                             std::uint32_t count,
                             Splats& to,
                             std::uint32_t at) {
        std::copy_n(from.shapes.data(), count, to.shapes.data() + at);
        std::copy_n(from.features.data(), count, to.features.data() + at);
        std::copy_n(from.depths.data(), count, to.depths.data() + at);
        std::copy_n(from.rects.data(), count, to.rects.data() + at);
    }

    /// Counts the splats in view first, then projects them again.
    template <class Splats, class Project>
    void find_twice(int count,
                    const Project& project,
                    Buffer<float, Device>& radii,
                    Splats& splats) {
        using Projection = decltype(project(splats));
        parallel_for(Device{}, count, MarkBody<Projection>{project(splats), radii.span()});
        count_in_view(radii, before_, temporary_);
        const std::uint32_t* const all = places(radii).before.data + count;
        if (room_ == 0) {  // the first view: the number is unknown
            std::uint32_t in_view = 0;
            detail::copy(Device{}, all, Cpu{}, &in_view, sizeof in_view);
            found_room(in_view);
        }
        splats.resize(room_);
        splats.in_view = all;
        parallel_for(Device{}, count, StoreBody<Projection>{project(splats), places(radii)});
    }

    Buffer<std::uint32_t, Device> before_;
    Buffer<std::uint8_t, Device> temporary_;  // CUDA only
    std::size_t room_ = 0;
};

}  // namespace tvsgs
