// Seconds by stage. The clock waits for the device before and after each stage.
#pragma once

#include <chrono>
#include <string_view>
#include <vector>

#include "core/device/buffer.h"

namespace tvsgs {

/// Total time of one stage.
struct StageTime {
    const char* name;
    double seconds;
};

/// Runs actions and measures them if switched on.
template <class Device>
class StageClock {
public:
    explicit StageClock(bool on = false) : on_(on) {}

    template <class Action>
    decltype(auto) operator()(const char* name, Action&& action) {
        const Lap lap(*this, name);
        return action();
    }
    void clear() { stages_.clear(); }
    bool on() const { return on_; }

    /// In order of first appearance; adds up the laps of one name.
    const std::vector<StageTime>& stages() const { return stages_; }

private:
    struct Lap {
        Lap(StageClock& c, const char* n) : clock(c), name(n) {
            if (clock.on_) begin = now();
        }
        ~Lap() {
            if (clock.on_) clock.add(name, std::chrono::duration<double>(now() - begin).count());
        }
        static std::chrono::steady_clock::time_point now() {
            synchronize(Device{});
            return std::chrono::steady_clock::now();
        }
        StageClock& clock;
        const char* name;
        std::chrono::steady_clock::time_point begin;
    };
    void add(const char* name, double seconds) {
        for (StageTime& stage : stages_)
            if (std::string_view(stage.name) == name) {
                stage.seconds += seconds;
                return;
            }
        stages_.push_back({name, seconds});
    }

    bool on_;
    std::vector<StageTime> stages_;
};

}  // namespace tvsgs
