// The parts of AskedHarmonics; included by one file per device.
#pragma once

#include "core/parallel.h"
#include "optim/asked_harmonics.h"

namespace tvsgs {

struct ListAskedBody {
    SplatPlaces places;
    Part own;
    std::uint32_t own_in_view;
    Span<int> asked;
    TVSGS_HD void operator()(int i) const {
        if (own.holds(i)) return;
        if (const std::uint32_t at = places.of(i); at != kNoPlace)
            asked[i < own.begin ? at : at - own_in_view] = i;
    }
};

/// Row j of coefficient k.
template <bool kGives>
struct RowsBody {
    MovingHarmonics all;
    Span<const int> splats;
    std::conditional_t<kGives, Vec3f*, const Vec3f*> rows;
    TVSGS_HD void operator()(int at) const {
        const int k = at / splats.size(), j = at % splats.size();
        Vec3f& value = all.sh[static_cast<std::size_t>(k) * all.stride +
                              static_cast<std::size_t>(splats[static_cast<std::size_t>(j)])];
        if constexpr (kGives)
            rows[at] = value;
        else
            value = rows[at];
    }
};

template <class Device>
void find_part_edges(Device device,
                     Span<const std::uint32_t> before,
                     int ranks,
                     std::uint32_t* edges) {
    parallel_for(device, ranks + 1, PartEdgesBody<std::uint32_t>{before, ranks, edges});
}

template <class Device>
void list_asked(Device device,
                const SplatPlaces& places,
                Part own,
                std::uint32_t own_in_view,
                Span<int> asked) {
    parallel_for(device, places.radii.size(), ListAskedBody{places, own, own_in_view, asked});
}

template <class Device>
void give_rows(Device device, const MovingHarmonics& all, Span<const int> splats, Vec3f* rows) {
    parallel_for(device, all.coefficients * splats.size(), RowsBody<true>{all, splats, rows});
}

template <class Device>
void take_rows(Device device,
               const MovingHarmonics& all,
               Span<const int> splats,
               const Vec3f* rows) {
    parallel_for(device, all.coefficients * splats.size(), RowsBody<false>{all, splats, rows});
}

}  // namespace tvsgs
