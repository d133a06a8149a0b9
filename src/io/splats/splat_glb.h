// Reading and writing of splats in GLB files: KHR_gaussian_splatting, release candidate of July
// 2026.
// https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Khronos
#pragma once

#include <string>
#include <string_view>

#include "core/scene/gaussians.h"
#include "io/splats/splat_frame.h"

namespace tvsgs {

/// Options of splat_glb_bytes().
struct SplatGlbOptions {
    SplatFrame frame = SplatFrame::luf;  // of the file; glTF's own
    /// Origin of the splats' frame in the scene's frame. Stored in asset.extras, because viewers
    /// use floats.
    Vec3d origin{};
    std::string projection{};  // of the scene's frame, stored like the origin; empty: none
    /// Rotation that turns the scene upright (+y up). The file's node gets the part that `frame`
    /// does not cover. By default y points down.
    Mat3<double> upright_from_scene{{{-1, 0, 0}, {0, -1, 0}, {0, 0, 1}}};
    /// Marks opacities as of a renderer that keeps a splat's mass. Stored in asset.extras, because
    /// glTF has no property for it.
    bool antialiased = false;
};

/// The bytes of a GLB with all splats in order, as floats, and coloured points (COLOR_0) as a
/// fallback. Units are those of the scene; glTF readers assume metres. Throws
/// Error(ExitCode::numerical) for numbers that are not finite, and Error(ExitCode::input) for no
/// splats and beyond the format's 4 GiB.
std::string splat_glb_bytes(const std::string& path,
                            const Gaussians<Cpu>& gaussians,
                            const SplatGlbOptions& options = {});

/// The splats of the file's only primitive of splats. Ignores the nodes of a file of tvsgs; in
/// other files they must not rotate or move the splats. Throws Error(ExitCode::input).
Gaussians<Cpu> parse_splat_glb(std::string_view bytes,
                               const std::string& path,
                               SplatFrame frame = SplatFrame::luf);

/// asset.extras.origin and .projection of a file of tvsgs, else nothing. Throws
/// Error(ExitCode::input).
SplatPlace splat_glb_place(std::string_view bytes, const std::string& path);

}  // namespace tvsgs
