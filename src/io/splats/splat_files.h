// Reading and writing of splat files; the extension chooses the format.
#pragma once

#include <optional>
#include <string>

#include "io/splats/splat_frame.h"

namespace tvsgs {

/// Format by the extension of the name, in upper or lower case.
std::optional<SplatFormat> splat_format(const std::string& path);

const char* frame_name(SplatFrame frame);

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
