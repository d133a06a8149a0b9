// Reading and writing of splat files; the extension chooses the format.
#pragma once

#include <optional>
#include <string>

#include "io/splats/splat_frame.h"

namespace tvsgs {

enum class SplatFormat { ply, spz, sog, glb };

/// Format by the extension of the name, in upper or lower case.
std::optional<SplatFormat> splat_format(const std::string& path);

/// The frame that readers of the format expect: RDF for PLY and SOG, RUB for SPZ, LUF for GLB.
SplatFrame default_frame(SplatFormat format);
const char* frame_name(SplatFrame frame);

/// Options of write_splat_file().
struct SplatFileOptions {
    std::optional<SplatFrame> frame;  // of the file; default: default_frame()
    int spz_version = 3;
    int spz_sh_bits_1 = 5, spz_sh_bits_rest = 4;
    int sog_palette = 0;
    bool antialiased = false;  // stored in SPZ, SOG and GLB
    /// Origin of the splats' frame in the scene's frame. PLY adds it to positions, in double. GLB
    /// stores it in the file, SPZ and SOG in FILE.json beside the file, because viewers use floats.
    Vec3d origin{};
    /// Projection of the scene's frame; stored like the origin, in PLY as a comment. Empty: none.
    std::string projection{};
    std::optional<Mat3<double>> upright_from_scene;  // GLB: as in io/splats/splat_glb.h
};

/// The JSON file with the origin and the projection of an SPZ or SOG file.
std::string origin_file(const std::string& path);

/// Writes all splats in order, in the format of the extension, as an atomic file. Returns the size
/// of the file in bytes. Throws like the writers of the formats, and Error(ExitCode::usage) for an
/// unknown extension.
std::uintmax_t write_splat_file(const std::string& path,
                                const Gaussians<Cpu>& gaussians,
                                const SplatFileOptions& options = {});

/// The place stored for an SPZ, SOG or GLB file of tvsgs; nothing for PLY. Throws
/// Error(ExitCode::input).
SplatPlace read_splat_place(const std::string& path);

/// Reads the splats of a file into our frame (RDF). `frame`: frame of the file; default:
/// default_frame(). Subtracts `origin` from positions of a PLY. Throws Error(ExitCode::input).
Gaussians<Cpu> read_splat_file(const std::string& path,
                               std::optional<SplatFrame> frame = {},
                               Vec3d origin = {});

}  // namespace tvsgs
