// Splats in glTF's binary form: KHR_gaussian_splatting, release candidate of July 2026.
// https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Khronos
#pragma once

#include <string>
#include <string_view>

#include "core/scene/gaussians.h"
#include "io/splats/splat_frame.h"

namespace tvsgs {

struct SplatGlbOptions {
    SplatFrame frame = SplatFrame::luf;  // of the numbers; glTF's own
    /// Of the frame of the splats in that of the scene; said in asset.extras, as what draws the
    /// file has floats only.
    Vec3d origin{};
    /// The turn of the scene that makes it stand upright, +y up; the file's node gets what is left
    /// of it. By default y points down.
    Mat3<double> upright_from_scene{{{-1, 0, 0}, {0, -1, 0}, {0, 0, 1}}};
    /// Opacities are of a renderer that keeps a splat's mass; said in asset.extras, as glTF has no
    /// word for it.
    bool antialiased = false;
};

/// The bytes of a GLB with all splats in their order: floats, but for a fallback of coloured points
/// (COLOR_0). Units are those of the scene; glTF takes them for metres. Throws
/// Error(ExitCode::numerical) for what is not finite, Error(ExitCode::input) when there is no splat
/// and beyond the format's 4 GiB.
std::string splat_glb_bytes(const std::string& path,
                            const Gaussians<Cpu>& gaussians,
                            const SplatGlbOptions& options = {});

/// The splats of the one primitive that has some. Nodes may turn or move them only where the file
/// is ours, whose nodes are left out of account. Throws Error(ExitCode::input).
Gaussians<Cpu> parse_splat_glb(std::string_view bytes,
                               const std::string& path,
                               SplatFrame frame = SplatFrame::luf);

/// asset.extras.origin of a file of ours; else zero. Throws Error(ExitCode::input).
Vec3d splat_glb_origin(std::string_view bytes, const std::string& path);

}  // namespace tvsgs
