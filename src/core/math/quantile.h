// Quantiles of a list of values.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace tvsgs {

/// Quantile at `share` (N - 1) in ascending order, interpolated between the two nearest values; 0
/// for an empty list. Reorders `values`.
template <class T>
T quantile(std::vector<T>& values, double share) {
    if (values.empty()) return 0;
    const double at = share * static_cast<double>(values.size() - 1);
    const auto below = static_cast<std::ptrdiff_t>(at);
    std::nth_element(values.begin(), values.begin() + below, values.end());
    const T low = values[static_cast<std::size_t>(below)];
    const auto next = std::min_element(values.begin() + below + 1, values.end());
    if (next == values.end()) return low;
    return low + static_cast<T>(at - static_cast<double>(below)) * (*next - low);
}

}  // namespace tvsgs
