// SPZ, packed splats of 20 to 65 bytes before gzip. https://github.com/nianticlabs/spz
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/scene/gaussians.h"
#include "io/splats/splat_frame.h"

namespace tvsgs {

struct SpzOptions {
    /// 2: rotations of three bytes, off by up to 12 degrees; 3: of four, by up to 0.27; 4: the same
    /// numbers, packed by zstd instead of gzip.
    int version = 3;
    SplatFrame frame = SplatFrame::rub;  // of the file; RUB by its specification
    /// 1 to 8: of coefficients of degree 1, of 2 and 3. These are small; 8 are good.
    int sh_bits_1 = 5, sh_bits_rest = 4;
    bool antialiased = false;  // says that opacities are of a renderer that keeps a splat's mass
};

/// The bytes of a file with all splats, in their order and our frame before `options` turns it. The
/// same bytes for any number of threads. Positions get as many fractional bits, at most 20, as the
/// farthest one leaves of 24. What bounds the errors is in docs/guide/exporting.md; scales outside
/// of [exp(-10), exp(5.9375)] and colours outside of [-0.44, 1.44] come to these limits. Opacities
/// below 1/510 become 0. Throws Error(ExitCode::numerical) for what is not finite,
/// Error(ExitCode::input) when there is no splat, or one farther than 2^23 from zero.
/// `name` is for messages; Gaussians::filter has to be empty.
std::vector<std::uint8_t> spz_bytes(const Gaussians<Cpu>& gaussians,
                                    const SpzOptions& options = {},
                                    const std::string& name = "SPZ");

/// The same to a temporary file, flushed and renamed.
void write_spz(const std::string& path,
               const Gaussians<Cpu>& gaussians,
               const SpzOptions& options = {});

struct SpzContents {
    Gaussians<Cpu> splats;  // in our frame; opacities of 0 and 1 have logits of -30 and 30
    int version = 0;
    int fractional_bits = 0;  // of positions: they are off by at most 2^-(this + 1)
    bool antialiased = false;
};

/// Versions 2 to 4; of degree 4 what is above 3 is left out with a warning. `frame`: the file's,
/// which it does not say. Throws Error(ExitCode::input) for anything else, before it takes memory
/// that the bytes do not bear out; at most 50 million splats.
SpzContents parse_spz(std::span<const std::uint8_t> bytes,
                      const std::string& name,
                      SplatFrame frame = SplatFrame::rub);
SpzContents read_spz(const std::string& path, SplatFrame frame = SplatFrame::rub);

}  // namespace tvsgs
