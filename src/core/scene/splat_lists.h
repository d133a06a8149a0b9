// Selection of splats on the host.
#pragma once

#include <vector>

#include "core/device/parallel_lists.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// For each plane of an array: plane[numbers[0]], plane[numbers[1]], ...
template <class T>
Buffer<T, Cpu> taken(const Buffer<T, Cpu>& from, const std::vector<int>& numbers, int planes) {
    Buffer<T, Cpu> out(numbers.size() * planes);
    const std::size_t all = from.size() / planes;
    for (int p = 0; p < planes; ++p)
        parallel_for(Cpu{}, static_cast<int>(numbers.size()), [&](std::size_t at) {
            out[p * numbers.size() + at] = from[p * all + numbers[at]];
        });
    return out;
}

/// The splats at `places`, in this order.
inline Gaussians<Cpu> splats_at(const std::vector<int>& places, const Gaussians<Cpu>& all) {
    Gaussians<Cpu> out;
    out.sh_degree = all.sh_degree;
    for_each_array(
        [&](const SplatArray& array, const auto& from, auto& to) {
            if (!from.empty()) to = taken(from, places, array.planes);
        },
        all, out);
    return out;
}

/// Keeps only the splats at `places`, in this order.
inline void keep_splats(const std::vector<int>& places, Gaussians<Cpu>& g) {
    for_each_array(
        [&](const SplatArray& array, auto& values) {
            if (!values.empty()) values = taken(values, places, array.planes);
        },
        g);
}

}  // namespace tvsgs
