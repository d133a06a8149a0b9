// Frames in which formats keep splats, and the half turns between them.
#pragma once

#include "core/math/vec.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// Axes by where x, y and z point. Ours, and that of PLY files of 3DGS by custom, is rdf: right,
/// down, forward. OpenGL and SPZ have rub: right, up, back; glTF has luf: left, up, forward.
enum class SplatFrame { rdf, rub, luf };

/// A turn by 180 degrees about an axis, or none. Its own inverse; all three change signs only,
/// which harmonics take as well: each is odd or even in x, y and z.
struct HalfTurn {
    Vec3f signs{1, 1, 1};

    Vec3f operator()(Vec3f p) const { return signs * p; }
    /// The turn times `q`, then a half turn of the splat's own axes, which its covariance does not
    /// show: components change signs only.
    Quatf operator()(Quatf q) const { return {q.w, signs.x * q.x, signs.y * q.y, signs.z * q.z}; }
    /// What coefficient `k` below 16 of the harmonics is multiplied with.
    float of_coefficient(int k) const {
        // Of render/tiles/sh_math.h; 1: odd in x, 2: in y, 4: in z.
        constexpr int kOdd[16] = {0, 2, 4, 1, 3, 6, 0, 5, 0, 2, 7, 2, 4, 1, 4, 1};
        float sign = 1;
        for (int axis = 0; axis < 3; ++axis)
            if (kOdd[k] >> axis & 1) sign *= signs[axis];
        return sign;
    }
};

inline HalfTurn half_turn(SplatFrame frame) {
    return frame == SplatFrame::rub   ? HalfTurn{{1, -1, -1}}
           : frame == SplatFrame::luf ? HalfTurn{{-1, -1, 1}}
                                      : HalfTurn{};
}

/// All splats into that frame, or back.
inline void turn(Gaussians<Cpu>& g, const HalfTurn& by) {
    for (Vec3f& p : g.means.span()) p = by(p);
    for (Quatf& q : g.quats.span()) q = by(q);
    const std::size_t count = g.means.size();
    for (std::size_t at = 0; at < g.sh.size(); ++at)
        g.sh[at] = by.of_coefficient(static_cast<int>(at / count)) * g.sh[at];
}

}  // namespace tvsgs
