// Options of all writers of splats; coordinate frames of the formats, and rotations between them.
#pragma once

#include <optional>
#include <string>

#include "core/math/vec.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// A frame is named by the directions of x, y and z. Ours, and by custom that of 3DGS's PLY files,
/// is rdf: right, down, forward. OpenGL and SPZ use rub: right, up, back. glTF uses luf: left, up,
/// forward.
enum class SplatFrame { rdf, rub, luf };

enum class SplatFormat { ply, spz, sog, glb };

/// The frame that readers of the format expect: RDF for PLY and SOG, RUB for SPZ, LUF for GLB.
inline SplatFrame default_frame(SplatFormat format) {
    return format == SplatFormat::spz   ? SplatFrame::rub
           : format == SplatFormat::glb ? SplatFrame::luf
                                        : SplatFrame::rdf;
}

/// Options of write_splat_file() and of the writers of single formats.
struct SplatFileOptions {
    std::optional<SplatFrame> frame{};  // of the file; default: default_frame()
    /// 2: rotations of 3 bytes, error up to 12 degrees. 3: rotations of 4 bytes, error up to 0.27
    /// degrees. 4: the same numbers, compressed by zstd instead of gzip.
    int spz_version = 3;
    /// Bits of SH coefficients, 1 to 8: of degree 1, and of degrees 2 and 3. 5 and 4 make small
    /// files; 8 is accurate.
    int spz_sh_bits_1 = 5, spz_sh_bits_rest = 4;
    int sog_palette = 0;  // most entries of the SH palette, up to 65536; 0: as PlayCanvas's tools
    /// SPZ, SOG and GLB: marks opacities as of a renderer that keeps a splat's mass.
    bool antialiased = false;
    /// Origin of the splats' frame in the scene's frame. PLY adds it to positions, in double. GLB
    /// stores it in the file, SPZ and SOG in FILE.json beside the file, because viewers use floats.
    Vec3d origin{};
    /// Projection of the scene's frame; stored like the origin, in PLY as a comment. Empty: none.
    std::string projection{};
    /// GLB: rotation that turns the scene upright (+y up). The file's node gets the part that
    /// `frame` does not cover. By default y points down.
    Mat3<double> upright_from_scene{{{-1, 0, 0}, {0, -1, 0}, {0, 0, 1}}};
};

/// Rotation by 180 degrees about an axis, or the identity. It is its own inverse and changes only
/// signs, also of SH coefficients, because each basis function is odd or even in x, y and z.
struct HalfTurn {
    Vec3f signs{1, 1, 1};

    Vec3f operator()(Vec3f p) const { return signs * p; }
    /// The rotation times `q`, followed by a half turn of the splat's own axes, which leaves its
    /// covariance unchanged. So the components only change signs.
    Quatf operator()(Quatf q) const { return {q.w, signs.x * q.x, signs.y * q.y, signs.z * q.z}; }
    /// Factor of SH coefficient `k` (below 16).
    float of_coefficient(int k) const {
        // Parity of the basis functions in render/tiles/sh_math.h; 1: odd in x, 2: in y, 4: in z.
        constexpr int kOdd[16] = {0, 2, 4, 1, 3, 6, 0, 5, 0, 2, 7, 2, 4, 1, 4, 1};
        float sign = 1;
        for (int axis = 0; axis < 3; ++axis)
            if (kOdd[k] >> axis & 1) sign *= signs[axis];
        return sign;
    }
};

/// Name and axes of a frame, in the order of SplatFrame, and its rotation from our frame.
struct FrameInfo {
    const char *name, *axes;
    HalfTurn turn;
};
inline constexpr FrameInfo kFrames[] = {{"rdf", "x right, y down, z forward", {{1, 1, 1}}},
                                        {"rub", "x right, y up, z back", {{1, -1, -1}}},
                                        {"luf", "x left, y up, z forward", {{-1, -1, 1}}}};
inline const FrameInfo& info_of(SplatFrame frame) {
    return kFrames[static_cast<int>(frame)];
}

/// Rotation between our frame and `frame`.
inline HalfTurn half_turn(SplatFrame frame) {
    return info_of(frame).turn;
}

/// Rotates all splats into the frame, or back.
inline void turn(Gaussians<Cpu>& g, const HalfTurn& by) {
    for (Vec3f& p : g.means.span()) p = by(p);
    for (Quatf& q : g.quats.span()) q = by(q);
    const std::size_t count = g.means.size();
    for (std::size_t at = 0; at < g.sh.size(); ++at)
        g.sh[at] = by.of_coefficient(static_cast<int>(at / count)) * g.sh[at];
}

}  // namespace tvsgs
