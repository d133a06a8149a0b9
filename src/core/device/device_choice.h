// From the name of a device to the code for it.
#pragma once

#include <string>
#include <vector>

#include "core/device/device.h"

namespace tvsgs {

/// "auto" is the first GPU when there is a usable one and the build has CUDA, else the CPU; "cpu";
/// "cuda"; "cuda:N". Throws Error(ExitCode::device).
struct DeviceChoice {
    bool cuda = false;
    std::string description;
};
DeviceChoice choose_device(const std::string& name);

/// The numbers of the GPUs that `list` names: "all", or numbers such as "0,2". Throws
/// Error(ExitCode::usage) for another text or a GPU that is named twice, Error(ExitCode::device)
/// for a GPU that the machine lacks and in a build without CUDA.
std::vector<int> choose_gpus(const std::string& list);
/// The same on a machine with so many.
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
