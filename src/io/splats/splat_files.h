// Reading and writing of splat files: by the extension of the name, and single formats.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "io/scene/georeference.h"
#include "io/splats/splat_frame.h"

namespace tvsgs {

/// Format by the extension of the name, in upper or lower case.
std::optional<SplatFormat> splat_format(const std::string& path);

/// The JSON file with the origin and the projection of an SPZ or SOG file.
std::string origin_file(const std::string& path);

/// Writes all splats in order, in the format of the extension, as an atomic file. Returns the size
/// of the file in bytes. Throws like the writers of the formats, and Error(ExitCode::usage) for an
/// unknown extension.
std::uintmax_t write_splat_file(const std::string& path,
                                const Gaussians<Cpu>& gaussians,
                                const SplatFileOptions& options = {});

/// The place stored for an SPZ, SOG or GLB file of tvsgs: the origin of the splats' frame in the
/// scene's frame, and the projection of that one (empty: none); nothing for PLY. Throws
/// Error(ExitCode::input).
Georeference read_splat_place(const std::string& path);

/// Reads the splats of a file into our frame (RDF). `frame`: frame of the file; default:
/// default_frame(). Subtracts `origin` from positions of a PLY. Throws Error(ExitCode::input).
Gaussians<Cpu> read_splat_file(const std::string& path,
                               std::optional<SplatFrame> frame = {},
                               Vec3d origin = {});

// SPZ: splats packed to 20 to 65 bytes before compression. https://github.com/nianticlabs/spz

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

// SOG version 2: splats as images in a ZIP archive.
// https://developer.playcanvas.com/user-manual/gaussian-splatting/formats/sog/

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

// GLB: KHR_gaussian_splatting, release candidate of July 2026.
// https://github.com/KhronosGroup/glTF/tree/main/extensions/2.0/Khronos

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
Georeference splat_glb_place(std::string_view bytes, const std::string& path);

}  // namespace tvsgs
