// Coordinate frames of splat formats, and rotations between them.
#pragma once

#include <string>

#include "core/math/vec.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// A frame is named by the directions of x, y and z. Ours, and by custom that of 3DGS's PLY files,
/// is rdf: right, down, forward. OpenGL and SPZ use rub: right, up, back. glTF uses luf: left, up,
/// forward.
enum class SplatFrame { rdf, rub, luf };

/// Place of the splats of a file: the origin of their frame in the scene's frame, and the
/// projection of that one; empty: none.
struct SplatPlace {
    Vec3d origin{};
    std::string projection{};
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

/// Rotation between our frame and `frame`.
inline HalfTurn half_turn(SplatFrame frame) {
    return frame == SplatFrame::rub   ? HalfTurn{{1, -1, -1}}
           : frame == SplatFrame::luf ? HalfTurn{{-1, -1, 1}}
                                      : HalfTurn{};
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
