#include "core/device/device_choice.h"

#include <algorithm>
#include <sstream>

#include "core/device/cuda_device.h"
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
            throw Error(ExitCode::usage, "--device ", name, ": expected auto, cpu, cuda or cuda:N");
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
                ": this build has no CUDA; use --device cpu, or build with -DTVSGS_CUDA=ON"));
    }
}

std::vector<int> choose_gpus(const std::string& list) {
    if constexpr (kHasCuda) {
        return choose_gpus(list, cuda_device_count());
    } else {
        throw Error(ExitCode::device, "--gpus ", list,
                    ": this build has no CUDA; use --jobs, or build with -DTVSGS_CUDA=ON");
    }
}

std::vector<int> choose_gpus(const std::string& list, int count) {
    if (count == 0) throw Error(ExitCode::device, "--gpus ", list, ": no usable GPU");
    std::vector<int> gpus;
    if (list == "all") {
        for (int gpu = 0; gpu < count; ++gpu) gpus.push_back(gpu);
        return gpus;
    }
    std::istringstream words(list + ",");
    for (std::string word; std::getline(words, word, ',');) {
        const bool is_number = !word.empty() && word.size() < 4 &&
                               word.find_first_not_of("0123456789") == std::string::npos;
        if (!is_number)
            throw Error(ExitCode::usage, "--gpus ", list,
                        ": expected all, or GPU numbers such as 0,1,3");
        const int gpu = std::stoi(word);
        if (std::ranges::find(gpus, gpu) != gpus.end())
            throw Error(ExitCode::usage, "--gpus ", list, ": GPU ", gpu, " is given twice");
        if (gpu >= count)
            throw Error(ExitCode::device, "--gpus ", list, ": no GPU ", gpu,
                        "; this machine has 0 to ", count - 1);
        gpus.push_back(gpu);
    }
    return gpus;
}

}  // namespace tvsgs
