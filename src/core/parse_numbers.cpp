#include "core/parse_numbers.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "core/error.h"

namespace tvsgs {

namespace {

/// The finite numbers between commas; empty if the text is something else.
std::vector<double> numbers_in(const std::string& text) {
    std::vector<double> numbers;
    const char* const end = text.data() + text.size();
    for (const char* at = text.data(); at <= end;) {
        double value = 0;
        const auto [rest, code] = std::from_chars(at, end, value);
        if (code != std::errc{} || !std::isfinite(value) || (rest != end && *rest != ','))
            return {};
        numbers.push_back(value);
        at = rest + 1;
    }
    return numbers;
}

}  // namespace

std::vector<double> parse_numbers(const std::string& flag, const std::string& text) {
    std::vector<double> numbers = numbers_in(text);
    if (numbers.empty() || !std::ranges::all_of(numbers, [](double v) { return v > 0; }))
        throw Error(ExitCode::usage, flag, " ", text,
                    ": expected positive numbers with commas between them");
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
        throw Error(ExitCode::usage, flag, " ", text,
                    ": expected a size in bytes, such as 8G or 500M");
    const double bytes = std::ldexp(value, suffix.empty() ? 0 : 10 * (static_cast<int>(power) + 1));
    return static_cast<std::int64_t>(std::min(bytes, 9e18));
}

Box3d parse_box(const std::string& flag, const std::string& text) {
    const std::vector<double> n = numbers_in(text);
    if (n.size() != 6 || !(n[0] < n[3] && n[1] < n[4] && n[2] < n[5]))
        throw Error(ExitCode::usage, flag, " ", text,
                    ": expected x0,y0,z0,x1,y1,z1 with x0 < x1, y0 < y1, z0 < z1");
    return {{n[0], n[1], n[2]}, {n[3], n[4], n[5]}};
}

}  // namespace tvsgs
