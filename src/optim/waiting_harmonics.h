// Harmonics of splats out of view: they have gradient 0, but the moments decay and move the values
// on. These steps wait until the splat is seen, and are then taken one by one: the same bits as if
// each had been taken when it was due. So a step reads and writes no more of them than what a view
// sees, in the device's memory or over the bus.
#pragma once

#include <vector>

#include "optim/adam_step.h"

namespace tvsgs {

/// What waits, and what of it is in view.
struct WaitingArrays {
    ShAdam all, in_view;  // in_view: by place
    SplatPlaces places;
    Span<int> splats;       // by place
    std::uint16_t* taken;   // [N] steps that were taken since none waited
    const ShScale* scales;  // of these steps
    int due;                // how many there were
};
/// in_view <- those of the view, up to date; `splats` as well.
template <class Device>
void fetch_in_view(Device device, const WaitingArrays& arrays);
/// all <- those in view that have taken one step more than were due.
template <class Device>
void bring_back(Device device, const WaitingArrays& arrays);
/// all <- up to date.
template <class Device>
void catch_up(Device device, const WaitingArrays& arrays);

template <class Device>
class WaitingHarmonics {
public:
    /// Steps that may wait: what fits the counters, and no more than is soon taken.
    static constexpr int kMost = 1000;

    /// Before a step, which may be of a view without colours. `scale_of(t)`: of the t-th step from
    /// now, asked where none waits.
    template <class ScaleOf>
    void begin(const ShAdam& all, const ScaleOf& scale_of) {
        if (due_ > 0) return;
        taken_.resize(all.stride);
        taken_.fill_zero();
        std::vector<ShScale> scales;
        for (int t = 1; t <= kMost; ++t) scales.push_back(scale_of(t));
        copy(scales, scales_);
    }

    /// Those of the view with these places, up to date.
    template <class ScaleOf>
    Harmonics fetch(const ShAdam& all,
                    const SplatPlaces& places,
                    std::size_t room,
                    const ScaleOf& scale_of) {
        begin(all, scale_of);
        const std::size_t count = static_cast<std::size_t>(all.coefficients) * room;
        values_.resize(count), m_.resize(count), v_.resize(count), splats_.resize(room);
        places_ = places;
        in_view_ = {values_.data(), m_.data(), v_.data(), room, all.coefficients};
        fetch_in_view(Device{}, arrays(all));
        return {values_.data(), room, /*by_place=*/true};
    }

    /// Of the view fetched since the last step.
    const ShAdam& in_view() const { return in_view_; }
    std::uint16_t* taken() { return taken_.data(); }
    int due() const { return due_; }

    /// After a step: brings back what it has moved.
    void step_done(const ShAdam& all) {
        bring_back(Device{}, arrays(all));
        ++due_;
        in_view_ = {};
        if (due_ == kMost) catch_up(all);
    }

    /// Takes all steps that wait.
    void catch_up(const ShAdam& all) {
        if (due_ > 0) tvsgs::catch_up(Device{}, arrays(all));
        due_ = 0;
    }

private:
    WaitingArrays arrays(const ShAdam& all) {
        return {all, in_view_, places_, splats_.span(), taken_.data(), scales_.data(), due_};
    }

    Buffer<Vec3f, Device> values_, m_, v_;  // [coefficients, room] of the view fetched last
    Buffer<int, Device> splats_;            // [room]
    Buffer<std::uint16_t, Device> taken_;   // [N]
    Buffer<ShScale, Device> scales_;        // [kMost]
    ShAdam in_view_{};
    SplatPlaces places_{};
    int due_ = 0;
};

}  // namespace tvsgs
