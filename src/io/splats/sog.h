// SOG, splats as pictures in a ZIP archive, version 2.
// https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/
#pragma once

#include <string>

#include "core/scene/gaussians.h"
#include "io/splats/splat_frame.h"

namespace tvsgs {

struct SogOptions {
    SplatFrame frame = SplatFrame::rdf;  // of the numbers; PLY's, as its own tools have it
    int palette = 0;  // at most so many kinds of harmonics, up to 65536; 0: as its own tools choose
    bool antialiased = false;  // says that opacities are of a renderer that keeps a splat's mass
};

/// The bytes of a file with all splats in their order, which should be one of space: pictures are
/// smaller then. The same for any number of threads. Positions get 16 bits per axis, on a scale
/// that is finer near zero; rotations are off by less than a degree; scales, colours and the
/// harmonics' palette go by 256 values that suit them. Throws Error(ExitCode::numerical) for what
/// is not finite, Error(ExitCode::input) for no splats, or more than the pictures hold.
std::string sog_bytes(const std::string& path,
                      const Gaussians<Cpu>& gaussians,
                      const SogOptions& options = {});

/// Version 2. Throws Error(ExitCode::input), before it takes memory that the file does not bear
/// out. Opacities of 0 and 1 have logits of -30 and 30.
Gaussians<Cpu> read_sog(const std::string& path, SplatFrame frame = SplatFrame::rdf);

}  // namespace tvsgs
