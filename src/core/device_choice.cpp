#include "core/device_choice.h"

#include "core/cuda_device.h"
#include "core/error.h"

namespace tvsgs {

DeviceChoice choose_device(const std::string& name) {
    if (name == "cpu") return {false, "cpu"};
    int index = 0;
    const bool automatic = name == "auto";
    if (!automatic && name != "cuda") {
        const bool numbered = name.starts_with("cuda:") && name.size() > 5 && name.size() < 9 &&
                              name.find_first_not_of("0123456789", 5) == std::string::npos;
        if (!numbered)
            throw Error(ExitCode::usage,
                        str("--device ", name, ": expected auto, cpu, cuda or cuda:N"));
        index = std::stoi(name.substr(5));
    }
    if constexpr (kHasCuda) {
        if (automatic && cuda_device_count() == 0) return {false, "cpu"};
        return {true, str("cuda:", index, " ", use_cuda_device(index))};
    } else {
        if (automatic) return {false, "cpu"};
        throw Error(
            ExitCode::device,
            str("--device ", name,
                ": this build has no CUDA; configure with -DTVSGS_CUDA=ON or use --device cpu"));
    }
}

}  // namespace tvsgs
