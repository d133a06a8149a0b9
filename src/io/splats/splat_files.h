// Files of splats: whichever format the name ends in.
#pragma once

#include <optional>
#include <string>

#include "io/splats/splat_frame.h"

namespace tvsgs {

enum class SplatFormat { ply, spz, sog, glb };

/// By the end of the name, in any case of letters.
std::optional<SplatFormat> splat_format(const std::string& path);

/// The frame that the format's readers take a file for: RDF for PLY and SOG, RUB for SPZ, LUF for
/// GLB.
SplatFrame usual_frame(SplatFormat format);
const char* frame_name(SplatFrame frame);

struct SplatFileOptions {
    std::optional<SplatFrame> frame;  // of the file; else the usual one
    int spz_version = 3;
    int spz_sh_bits_1 = 5, spz_sh_bits_rest = 4;
    int sog_palette = 0;
    bool antialiased = false;  // said in SPZ, SOG and GLB
    /// Of the frame of the splats in that of the scene. PLY adds it, in double; GLB says it inside,
    /// SPZ and SOG in a JSON file beside them, FILE.json, since what draws them has floats only.
    Vec3d origin{};
    std::optional<Mat3<double>> upright_from_scene;  // GLB: as in io/splats/splat_glb.h
};

/// The file with the origin of an SPZ or SOG file.
std::string origin_file(const std::string& path);

/// Writes the splats in the format of the name, all of them in their order; a temporary file,
/// flushed and renamed. Returns the bytes of the file. Throws as the writers of the formats, and
/// Error(ExitCode::usage) for a name of another kind.
std::uintmax_t write_splat_file(const std::string& path,
                                const Gaussians<Cpu>& gaussians,
                                const SplatFileOptions& options = {});

/// What an SPZ, SOG or GLB file of ours says of its origin; zero: nothing, and for PLY. Throws
/// Error(ExitCode::input).
Vec3d read_splat_origin(const std::string& path);

/// The splats of a file in our frame; `frame` is the file's, else the usual one. Positions of a PLY
/// lose `origin`. Throws Error(ExitCode::input).
Gaussians<Cpu> read_splat_file(const std::string& path,
                               std::optional<SplatFrame> frame = {},
                               Vec3d origin = {});

}  // namespace tvsgs
