// Reading and writing of splats in GLB files: KHR_gaussian_splatting, release candidate of July
// 2026.
// https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Khronos
#pragma once

#include <string>
#include <string_view>

#include "core/scene/gaussians.h"
#include "io/splats/splat_frame.h"

namespace tvsgs {

/// The bytes of a GLB with all splats in order, as floats, and coloured points (COLOR_0) as a
/// fallback. `antialiased` is stored in asset.extras, because glTF has no property for it. Units
/// are those of the scene; glTF readers assume metres. Throws Error(ExitCode::numerical) for
/// numbers that are not finite, and Error(ExitCode::input) for no splats and beyond the format's 4
/// GiB.
std::string splat_glb_bytes(const std::string& path,
                            const Gaussians<Cpu>& gaussians,
                            const SplatFileOptions& options = {});

/// The splats of the file's only primitive of splats. Ignores the nodes of a file of tvsgs; in
/// other files they must not rotate or move the splats. Throws Error(ExitCode::input).
Gaussians<Cpu> parse_splat_glb(std::string_view bytes,
                               const std::string& path,
                               SplatFrame frame = SplatFrame::luf);

/// asset.extras.origin and .projection of a file of tvsgs, else nothing. Throws
/// Error(ExitCode::input).
SplatPlace splat_glb_place(std::string_view bytes, const std::string& path);

}  // namespace tvsgs
