// The parts of WaitingHarmonics; included by one file per device.
#pragma once

#include <algorithm>
#include <limits>

#include "core/parallel.h"
#include "optim/waiting_harmonics.h"

namespace tvsgs {

struct NoteInViewBody {
    WaitingArrays a;
    TVSGS_HD void operator()(int i) const {
        if (const std::uint32_t at = a.places.of(i); at < a.splats.count) a.splats[at] = i;
    }
};

/// Number j / 3 in view, of it channel j % 3 of coefficient k: neighbours in memory go over the bus
/// together.
struct ViewNumber {
    std::size_t all, in_view;  // where it lies

    TVSGS_HD ViewNumber(const WaitingArrays& a, int splat, int j, int k)
        : all(3 * (static_cast<std::size_t>(k) * a.all.stride + static_cast<std::size_t>(splat)) +
              static_cast<std::size_t>(j % 3)),
          in_view(3 * static_cast<std::size_t>(k) * a.in_view.stride +
                  static_cast<std::size_t>(j)) {}

    TVSGS_HD static void copy(const ShAdam& from,
                              std::size_t source,
                              const ShAdam& to,
                              std::size_t target) {
        const auto number = [](Vec3f* data, std::size_t at) -> float& {
            return reinterpret_cast<float*>(data)[at];
        };
        number(to.values, target) = number(from.values, source);
        number(to.m, target) = number(from.m, source);
        number(to.v, target) = number(from.v, source);
    }
};

struct FetchBody {
    WaitingArrays a;
    TVSGS_HD void operator()(int j, int k) const {
        const auto at = static_cast<std::size_t>(j / 3);
        if (at >= a.places.in_view()) return;
        const ViewNumber n(a, a.splats[at], j, k);
        ViewNumber::copy(a.all, n.all, a.in_view, n.in_view);
    }
};

/// And back, where a step was taken.
struct BringBackBody {
    WaitingArrays a;
    TVSGS_HD void operator()(int j, int k) const {
        const auto at = static_cast<std::size_t>(j / 3);
        if (at >= a.places.in_view()) return;
        const int splat = a.splats[at];
        if (a.taken[splat] <= a.due) return;
        const ViewNumber n(a, splat, j, k);
        ViewNumber::copy(a.in_view, n.in_view, a.all, n.all);
    }
};

template <class Body>
struct PlanesBody {
    Body body;
    int width, first;
    TVSGS_HD void operator()(int i) const { body(i % width, first + i / width); }
};
/// body(j, k) for numbers j of all places and coefficients k: many in a launch, as each costs time.
template <class Device, class Body>
void for_each_number(Device device, const WaitingArrays& a, const Body& body) {
    const int width = 3 * a.splats.size(), all = a.in_view.coefficients;
    if (width == 0) return;
    const int at_once = std::max(1, std::numeric_limits<int>::max() / width);
    for (int k = 0; k < all; k += at_once)
        parallel_for(device, std::min(at_once, all - k) * width, PlanesBody<Body>{body, width, k});
}

/// Takes the steps that wait, after `taken`, of the harmonics at `at` of `sh`.
TVSGS_HD inline void take_waiting_steps(const WaitingArrays& a,
                                        const ShAdam& sh,
                                        int at,
                                        int taken) {
    constexpr int kGroup = 2;
    const float zero[3 * kGroup]{};
    for (int first = 0; first < sh.coefficients && taken < a.due; first += kGroup) {
        auto g = sh.load<kGroup>(at, first);
        bool rests = true;  // never seen, or above the degree that was
        for (int j = 0; j < 3 * kGroup; ++j) rests &= g.m[j] == 0 && g.v[j] == 0;
        if (rests) continue;
        for (int t = taken; t < a.due; ++t) ShAdam::step<kGroup>(g, first, zero, a.scales[t]);
        sh.store(at, first, g);
    }
}
struct CatchUpInViewBody {
    WaitingArrays a;
    TVSGS_HD void operator()(int at) const {
        if (static_cast<std::uint32_t>(at) < a.places.in_view())
            take_waiting_steps(a, a.in_view, at, a.taken[a.splats[static_cast<std::size_t>(at)]]);
    }
};
struct CatchUpBody {
    WaitingArrays a;
    TVSGS_HD void operator()(int i) const { take_waiting_steps(a, a.all, i, a.taken[i]); }
};

template <class Device>
void fetch_in_view(Device device, const WaitingArrays& a) {
    const int room = a.splats.size();
    parallel_for(device, static_cast<int>(a.all.stride), NoteInViewBody{a});
    for_each_number(device, a, FetchBody{a});
    if (a.due > 0) parallel_for(device, room, CatchUpInViewBody{a});
}

template <class Device>
void bring_back(Device device, const WaitingArrays& a) {
    for_each_number(device, a, BringBackBody{a});
}

template <class Device>
void catch_up(Device device, const WaitingArrays& a) {
    parallel_for(device, static_cast<int>(a.all.stride), CatchUpBody{a});
}

}  // namespace tvsgs
