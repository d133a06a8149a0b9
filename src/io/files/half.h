// Decoding of 16-bit floating-point numbers.
#pragma once

#include <cmath>
#include <cstdint>

namespace tvsgs {

/// Number with the given bits of IEEE 754 binary16.
inline double half_to_double(std::uint16_t bits) {
    const int exponent = bits >> 10 & 31, fraction = bits & 1023;
    const double magnitude = exponent == 31  ? (fraction ? std::nan("") : INFINITY)
                             : exponent == 0 ? std::ldexp(fraction, -24)
                                             : std::ldexp(fraction + 1024, exponent - 25);
    return bits >> 15 ? -magnitude : magnitude;
}

}  // namespace tvsgs
