// What all commands share: the device switch, and one place where exceptions become messages and exit codes.
#pragma once

#include <cstdio>
#include <exception>
#include <new>
#include <string>

#include "core/cuda_device.h"
#include "core/device.h"
#include "core/error.h"
#include "core/log.h"

namespace tvsgs {

/// "auto" is the first GPU when there is a usable one and the build has CUDA, else the CPU; "cpu"; "cuda"; "cuda:N".
struct DeviceChoice {
    bool cuda = false;
    std::string description;
};

inline DeviceChoice choose_device(const std::string& name) {
    if (name == "cpu") return {false, "cpu"};
    int index = 0;
    const bool automatic = name == "auto";
    if (!automatic && name != "cuda") {
        const bool numbered = name.starts_with("cuda:") && name.size() > 5 && name.size() < 9 &&
                              name.find_first_not_of("0123456789", 5) == std::string::npos;
        if (!numbered)
            throw Error(ExitCode::usage, str("--device ", name, ": expected auto, cpu, cuda or cuda:N"));
        index = std::stoi(name.substr(5));
    }
    if constexpr (kHasCuda) {
        if (automatic && cuda_device_count() == 0) return {false, "cpu"};
        return {true, str("cuda:", index, " ", use_cuda_device(index))};
    } else {
        if (automatic) return {false, "cpu"};
        throw Error(ExitCode::device, str("--device ", name, ": this build has no CUDA; configure with -DTVSGS_CUDA=ON or use --device cpu"));
    }
}

/// The one switch between the devices: calls action(Cpu{}) or action(Cuda{}).
template <class Action>
auto on_device(const DeviceChoice& device, Action&& action) {
    if constexpr (kHasCuda) {
        if (device.cuda) return action(Cuda{});
    }
    return action(Cpu{});
}

/// Runs a command; every exception ends as one message on standard error and the exit code of its kind.
template <class Command>
int run_command(Command&& command) {
    try {
        return command();
    } catch (const Error& error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        return static_cast<int>(error.code());
    } catch (const std::bad_alloc&) {
        std::fprintf(stderr, "error: out of memory; use fewer splats (--max-gaussians) or smaller images (-r)\n");
        return static_cast<int>(ExitCode::memory);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "error: internal: %s\n", error.what());
        return static_cast<int>(ExitCode::internal);
    }
}

}  // namespace tvsgs
