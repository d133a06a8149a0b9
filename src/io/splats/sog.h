// Reading and writing of SOG version 2: splats as images in a ZIP archive.
// https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/
#pragma once

#include <string>

#include "core/scene/gaussians.h"
#include "io/splats/splat_frame.h"

namespace tvsgs {

/// The bytes of a file with all splats in order. A spatial order makes the images smaller. Does not
/// depend on the number of threads. Positions have 16 bits per axis on a scale that is finer near
/// zero; rotations have errors below one degree; scales, colours and the SH palette use fitted
/// codebooks of 256 values. Throws Error(ExitCode::numerical) for numbers that are not finite, and
/// Error(ExitCode::input) for no splats or more than the images can hold.
std::string sog_bytes(const std::string& path,
                      const Gaussians<Cpu>& gaussians,
                      const SplatFileOptions& options = {});

/// Reads version 2. Throws Error(ExitCode::input) before it allocates more memory than the size of
/// the file justifies. Opacities of 0 and 1 get logits of -30 and 30.
Gaussians<Cpu> read_sog(const std::string& path, SplatFrame frame = SplatFrame::rdf);

}  // namespace tvsgs
