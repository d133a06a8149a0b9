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
    const T low = values[below];
    const auto next = std::min_element(values.begin() + below + 1, values.end());
    if (next == values.end()) return low;
    return low + static_cast<T>(at - static_cast<double>(below)) * (*next - low);
}

/// The entry at `percent` % of N - 1, rounded down, in ascending order. Reorders `values`, which
/// must not be empty.
template <class T>
T percentile(std::vector<T>& values, std::size_t percent) {
    const auto at =
        values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) * percent / 100);
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

/// The entry at half the size in ascending order, the upper median. Reorders `values`, which must
/// not be empty.
template <class T>
T middle_of(std::vector<T>& values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace tvsgs
