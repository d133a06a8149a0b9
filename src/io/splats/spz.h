// Reading and writing of SPZ: splats packed to 20 to 65 bytes before compression.
// https://github.com/nianticlabs/spz
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/scene/gaussians.h"
#include "io/splats/splat_frame.h"

namespace tvsgs {

/// The bytes of a file with all splats in order; `options` rotates them from our frame. Does not
/// depend on the number of threads. Positions use 24 bits; the farthest one decides how many of
/// them are fractional, at most 20. docs/guide/exporting.md lists the errors. Clamps scales to
/// [exp(-10), exp(5.9375)] and colours to [-0.44, 1.44]; opacities below 1/510 become 0. Throws
/// Error(ExitCode::numerical) for numbers that are not finite, and Error(ExitCode::input) for no
/// splats or a splat farther than 2^23 from zero. Messages contain `name`. Gaussians::filter must
/// be empty.
std::vector<std::uint8_t> spz_bytes(const Gaussians<Cpu>& gaussians,
                                    const SplatFileOptions& options = {},
                                    const std::string& name = "SPZ");

/// Splats and header of a file.
struct SpzContents {
    Gaussians<Cpu> splats;  // in our frame; opacities of 0 and 1 have logits of -30 and 30
    int version = 0;
    int fractional_bits = 0;  // of positions, with errors up to 2^-(fractional_bits + 1)
    bool antialiased = false;
};

/// Parses versions 2 to 4. Drops coefficients of degree 4 with a warning. `frame`: frame of the
/// file, which it does not store. Throws Error(ExitCode::input) for anything else, before it
/// allocates more memory than the size of the file justifies, and for more than 50 million splats.
SpzContents parse_spz(std::span<const std::uint8_t> bytes,
                      const std::string& name,
                      SplatFrame frame = SplatFrame::rub);
SpzContents read_spz(const std::string& path, SplatFrame frame = SplatFrame::rub);

}  // namespace tvsgs
