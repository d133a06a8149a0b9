// Checks shared by all writers and readers of splats.
#pragma once

#include <cmath>
#include <string>

#include "core/error.h"
#include "core/math/sigmoid.h"
#include "core/scene/gaussians.h"

namespace tvsgs {

/// Opacities of 0 and 1 have no finite logit. In float, this logit and its negative give 1 and 0.
inline constexpr float kMaxLogit = 30;

/// Logit of an opacity, limited to +-kMaxLogit.
inline float logit(float alpha) {
    if (!(alpha > 0)) return -kMaxLogit;
    return alpha < 1 ? std::log(alpha / (1 - alpha)) : kMaxLogit;
}

/// Throws Error(code) for numbers that are not finite and for zero rotations. `where` begins its
/// message.
inline void check_splats(const Gaussians<Cpu>& g, ExitCode code, const std::string& where) {
    const auto fail = [&](const char* what, std::size_t i) {
        throw Error(code, where, what, " of splat ", i,
                    " is not finite, or zero; expected finite numbers");
    };
    const std::size_t count = g.means.size();
    for (std::size_t i = 0; i < count; ++i) {
        const Quatf q = g.quats[i];
        const float size = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
        if (!is_finite(g.means[i])) fail("the centre", i);
        if (!is_finite(g.log_scales[i])) fail("a scale", i);
        if (!(size > 0) || !std::isfinite(size)) fail("the rotation", i);
        if (!std::isfinite(g.opacity_logits[i])) fail("the opacity", i);
    }
    for (std::size_t i = 0; i < g.sh.size(); ++i)
        if (!is_finite(g.sh[i])) fail("a colour", i % count);
}

/// Call it before writing. Throws Error(ExitCode::numerical), or Error(ExitCode::internal) if there
/// is a filter, which only PLY can store.
inline void require_writable(const Gaussians<Cpu>& g, const std::string& path) {
    if (!g.filter.empty())
        throw Error(ExitCode::internal, path, ": not written: splats with filters");
    check_splats(g, ExitCode::numerical, path + ": not written: ");
}

/// Call it after reading. Throws Error(ExitCode::input).
inline void require_valid(const Gaussians<Cpu>& g, const std::string& path) {
    check_splats(g, ExitCode::input, path + ": ");
}

}  // namespace tvsgs
