// From the name of a device to the code for it.
#pragma once

#include <string>

#include "core/device.h"

namespace tvsgs {

/// "auto" is the first GPU when there is a usable one and the build has CUDA, else the CPU; "cpu";
/// "cuda"; "cuda:N". Throws Error(ExitCode::device).
struct DeviceChoice {
    bool cuda = false;
    std::string description;
};
DeviceChoice choose_device(const std::string& name);

/// The one switch between the devices: calls action(Cpu{}) or action(Cuda{}).
template <class Action>
auto on_device(const DeviceChoice& device, Action&& action) {
    if constexpr (kHasCuda) {
        if (device.cuda) return action(Cuda{});
    }
    return action(Cpu{});
}

}  // namespace tvsgs
