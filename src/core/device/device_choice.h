// Choice of the device by its name, and dispatch to the code for that device.
#pragma once

#include <string>
#include <vector>

#include "core/device/device.h"

namespace tvsgs {

/// Accepts "cpu", "cuda", "cuda:N", and "auto": the first usable GPU if the build has CUDA, else
/// the CPU. Throws Error(ExitCode::device).
struct DeviceChoice {
    bool cuda = false;
    std::string description;
};
DeviceChoice choose_device(const std::string& name);

/// Indices of the GPUs in `list`: "all", or numbers such as "0,2". Throws Error(ExitCode::usage)
/// for any other text and for a GPU listed twice, Error(ExitCode::device) for a GPU that the
/// machine lacks and in a build without CUDA.
std::vector<int> choose_gpus(const std::string& list);
/// The same for a machine with `count` GPUs.
std::vector<int> choose_gpus(const std::string& list, int count);

/// The one switch between the devices: calls action(Cpu{}) or action(Cuda{}).
template <class Action>
auto on_device(const DeviceChoice& device, Action&& action) {
    if constexpr (kHasCuda) {
        if (device.cuda) return action(Cuda{});
    }
    return action(Cpu{});
}

}  // namespace tvsgs
