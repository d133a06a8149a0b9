// Types of numbers in binary files: their bytes, and numbers of arrays read as double.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <iterator>
#include <string>
#include <type_traits>

namespace tvsgs {

/// Number with the given bits of IEEE 754 binary16.
inline double half_to_double(std::uint16_t bits) {
    const int exponent = bits >> 10 & 31, fraction = bits & 1023;
    const double magnitude = exponent == 31  ? (fraction ? std::nan("") : INFINITY)
                             : exponent == 0 ? std::ldexp(fraction, -24)
                                             : std::ldexp(fraction + 1024, exponent - 25);
    return bits >> 15 ? -magnitude : magnitude;
}

template <class T>
T load(const char* bytes) {
    T value;
    std::memcpy(&value, bytes, sizeof value);
    return value;
}
/// Appends the bytes of a number.
template <class T>
void put(std::string& out, const T& value) {
    static_assert(std::is_arithmetic_v<T>);
    out.append(reinterpret_cast<const char*>(&value), sizeof value);
}
template <class T>
double load_double(const char* bytes) {
    return static_cast<double>(load<T>(bytes));
}

/// Letter as in NumPy (f: float, i, u: integer, b: bool), size, and function that reads a number.
struct NumberType {
    char kind;
    std::size_t bytes;
    double (*load)(const char*);
};
inline constexpr NumberType kNumberTypes[] = {
    {'f', 2, [](const char* bytes) { return half_to_double(load<std::uint16_t>(bytes)); }},
    {'f', 4, load_double<float>},
    {'f', 8, load_double<double>},
    {'i', 1, load_double<std::int8_t>},
    {'i', 2, load_double<std::int16_t>},
    {'i', 4, load_double<std::int32_t>},
    {'i', 8, load_double<std::int64_t>},
    {'u', 1, load_double<std::uint8_t>},
    {'u', 2, load_double<std::uint16_t>},
    {'u', 4, load_double<std::uint32_t>},
    {'u', 8, load_double<std::uint64_t>},
    {'b', 1, load_double<std::uint8_t>}};

/// Null if there is no such type.
inline const NumberType* find_number_type(char kind, std::size_t bytes) {
    const auto* const found = std::ranges::find_if(
        kNumberTypes, [&](const NumberType& t) { return t.kind == kind && t.bytes == bytes; });
    return found == std::end(kNumberTypes) ? nullptr : found;
}

}  // namespace tvsgs
