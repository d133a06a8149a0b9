// Watches a training for numbers that are not finite, and reports where they are.
#pragma once

#include <optional>
#include <string>

#include "core/error.h"
#include "core/scene/scene.h"
#include "optim/losses/loss.h"
#include "optim/optimiser/adam.h"

namespace tvsgs {

/// The first step whose loss was not finite; step 0: none yet.
struct LossFault {
    int step, term, view;
};

/// Counts a value too large for a loss as infinite.
struct WatchLossBody {
    Span<const double> values;
    int step, view;
    LossFault* fault;

    TVSGS_HD void operator()(int) const {
        if (fault->step != 0) return;
        for (int term = 0; term < values.size(); ++term)
            if (!(std::abs(values[term]) < 1e300)) {
                *fault = {step, term, view};
                return;
            }
    }
};

struct NotFiniteTerm {
    const float* values;
    TVSGS_HD double operator()(int i) const { return values[i] * 0 == 0 ? 0 : 1; }
};

/// The floats of one parameter group: element i has `width` floats, the first at begin[i * width].
struct GroupFloats {
    float* begin;
    int count, width;
};

template <class Device>
GroupFloats group_floats(Gaussians<Device>& g, ParameterGroup group) {
    const auto all = [](auto& values) -> GroupFloats {
        constexpr int width = sizeof(*values.data()) / sizeof(float);
        return {reinterpret_cast<float*>(values.data()), int(values.size()) * width, width};
    };
    const int dc = 3 * g.size();
    const GroupFloats sh = all(g.sh);
    const GroupFloats groups[] = {all(g.means),      all(g.log_scales),
                                  all(g.quats),      all(g.opacity_logits),
                                  {sh.begin, dc, 3}, {sh.begin + dc, sh.count - dc, 3}};
    return groups[int(group)];
}

/// Name of a parameter group in messages; rate_key() gives the key of its learning rate.
inline const char* name_of(ParameterGroup group) {
    constexpr const char* kNames[] = {"centre",  "scale",       "rotation",
                                      "opacity", "base colour", "SH coefficients"};
    return kNames[int(group)];
}
inline const char* rate_key(ParameterGroup group) {
    constexpr const char* kKeys[] = {"lr.position_start", "lr.scale", "lr.rotation",
                                     "lr.opacity",        "lr.sh_dc", "lr.sh_rest"};
    return kKeys[int(group)];
}

/// For tests: makes one number not finite, `times` times.
struct InjectedFault {
    int step = 0;   // 0: never
    int term = -1;  // of the losses in use
    std::optional<ParameterGroup> group;
    int splat = 0, times = 1;
};

template <class Real>
struct SpoilBody {
    Real* value;
    TVSGS_HD void operator()(int) const { *value = Real(NAN); }
};

/// A fault in words, with the parameter groups at fault; no group: only the loss is not finite.
struct Fault {
    std::string what;
    std::vector<ParameterGroup> groups;
};

template <class Device>
class Guard {
public:
    Guard() {
        counts_.resize(kParameterGroups);
        partial_.resize(kSumBlocks);
        reset();
    }

    void reset() {
        fault_.resize(1);
        fault_.fill_zero();
    }

    /// Checks the losses of a step without waiting for the device.
    void watch(int step, int view, Span<const double> values) {
        parallel_for(Device{}, 1, WatchLossBody{values, step, view, fault_.data()});
    }

    /// In device memory; not 0 from the first loss on that is not finite. Steps must then leave the
    /// splats unchanged, so that check() still finds the cause.
    const int* halted() const { return &fault_.data()->step; }

    /// Waits for the device. `step`: step of this check, for the message.
    std::optional<Fault> check(int step,
                               Gaussians<Device>& g,
                               const std::vector<std::unique_ptr<Loss<Device>>>& losses,
                               const std::vector<View>& views) {
        const LossFault loss = to_host(fault_)[0];
        counts_.fill_zero();
        for (int i = 0; i < kParameterGroups; ++i) {
            const GroupFloats floats = group_floats(g, static_cast<ParameterGroup>(i));
            add_sum(Device{}, floats.count, NotFiniteTerm{floats.begin}, 1, partial_.span(),
                    counts_.data() + i);
        }
        const std::vector<double> counts = to_host(counts_);
        Fault fault;
        if (loss.step != 0)
            fault.what = str("iteration ", loss.step, ": the loss term '", losses[loss.term]->key,
                             "' is not finite in view '", views[loss.view].name, "'");
        for (int i = 0; i < kParameterGroups; ++i) {
            if (counts[i] == 0) continue;
            const auto group = static_cast<ParameterGroup>(i);
            fault.what += str(fault.what.empty() ? str("iteration ", step, ": ") : "; ", "the ",
                              name_of(group), " of splat ", first_splat(g, group),
                              " is not finite (", counts[i], " such numbers)");
            fault.groups.push_back(group);
        }
        if (fault.what.empty()) return std::nullopt;
        return fault;
    }

private:
    /// Searches on the host: rare, as the run is about to be rolled back.
    static int first_splat(Gaussians<Device>& g, ParameterGroup group) {
        const GroupFloats floats = group_floats(g, group);
        std::vector<float> host(std::size_t(floats.count));
        detail::copy(Device{}, floats.begin, Cpu{}, host.data(), host.size() * sizeof(float));
        int i = 0;
        while (host[i] * 0 == 0) ++i;
        return i / floats.width % g.size();
    }

    Buffer<LossFault, Device> fault_;
    Buffer<double, Device> counts_, partial_;
};

}  // namespace tvsgs
