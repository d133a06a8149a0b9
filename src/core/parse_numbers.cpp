#include "core/parse_numbers.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "core/error.h"

namespace tvsgs {

std::vector<double> parse_numbers(const std::string& flag, const std::string& text) {
    std::vector<double> numbers;
    const char* at = text.data();
    const char* const end = at + text.size();
    while (at <= end) {
        double value = 0;
        const auto [rest, code] = std::from_chars(at, end, value);
        if (code != std::errc{} || !(value > 0 && std::isfinite(value)) ||
            (rest != end && *rest != ','))
            throw Error(
                ExitCode::usage,
                str(flag, " ", text, ": expected positive numbers with commas between them"));
        numbers.push_back(value);
        at = rest + 1;
    }
    return numbers;
}

std::int64_t parse_bytes(const std::string& flag, const std::string& text) {
    double value = 0;
    const auto [rest, code] = std::from_chars(text.data(), text.data() + text.size(), value);
    std::string suffix(rest, text.data() + text.size());
    for (const std::string unit : {"iB", "B"})
        if (suffix.ends_with(unit)) suffix.resize(suffix.size() - unit.size());
    const std::size_t power = std::string("KMGT").find(suffix);
    if (code != std::errc{} || !(value > 0) || suffix.size() > 1 || power == std::string::npos)
        throw Error(ExitCode::usage,
                    str(flag, " ", text, ": expected a size in bytes, such as 8G or 500M"));
    const double bytes = std::ldexp(value, suffix.empty() ? 0 : 10 * (static_cast<int>(power) + 1));
    return static_cast<std::int64_t>(std::min(bytes, 9e18));
}

Box3d parse_box(const std::string& flag, const std::string& text) {
    double numbers[6];
    const char* at = text.data();
    const char* const end = at + text.size();
    bool good = true;
    for (int i = 0; i < 6 && good; ++i) {
        const auto [rest, code] = std::from_chars(at, end, numbers[i]);
        good = code == std::errc{} && std::isfinite(numbers[i]) &&
               (i < 5 ? rest != end && *rest == ',' : rest == end);
        at = rest + 1;
    }
    if (!good || !(numbers[0] < numbers[3] && numbers[1] < numbers[4] && numbers[2] < numbers[5]))
        throw Error(
            ExitCode::usage,
            str(flag, " ", text, ": expected x0,y0,z0,x1,y1,z1 with x0 < x1, y0 < y1, z0 < z1"));
    return {{numbers[0], numbers[1], numbers[2]}, {numbers[3], numbers[4], numbers[5]}};
}

}  // namespace tvsgs
