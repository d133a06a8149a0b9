#pragma once

#include "core/buffer.h"
#include "core/vec.h"

namespace tvsgs {

/// Number of spherical-harmonics coefficients per colour channel.
TVSGS_HD constexpr int sh_count(int degree) {
    return (degree + 1) * (degree + 1);
}

/// N Gaussians, one array per parameter; gradients reuse the struct, so shapes agree.
template <class Device>
struct Gaussians {
    Buffer<Vec3f, Device> means;           // [N] world units
    Buffer<Vec3f, Device> log_scales;      // [N] log of the standard deviations, world units
    Buffer<Quatf, Device> quats;           // [N] (w, x, y, z), normalised on use
    Buffer<float, Device> opacity_logits;  // [N]
    Buffer<Vec3f, Device> sh;  // [sh_count(sh_degree), N] RGB coefficients, coefficient major
    int sh_degree = 3;

    int size() const { return static_cast<int>(means.size()); }
};

/// Contents are undefined where a buffer had to grow.
template <class Device>
void resize(Gaussians<Device>& g, int count, int sh_degree) {
    g.sh_degree = sh_degree;
    g.means.resize(count);
    g.log_scales.resize(count);
    g.quats.resize(count);
    g.opacity_logits.resize(count);
    g.sh.resize(std::size_t(count) * sh_count(sh_degree));
}

/// The same without colours.
template <class Device>
void resize_geometry(Gaussians<Device>& g, int count) {
    resize(g, count, 0);
    g.sh.resize(0);
}

template <class Device>
void fill_zero(Gaussians<Device>& g) {
    g.means.fill_zero();
    g.log_scales.fill_zero();
    g.quats.fill_zero();
    g.opacity_logits.fill_zero();
    g.sh.fill_zero();
}

template <class From, class To>
void copy(const Gaussians<From>& from, Gaussians<To>& to) {
    to.sh_degree = from.sh_degree;
    copy(from.means, to.means);
    copy(from.log_scales, to.log_scales);
    copy(from.quats, to.quats);
    copy(from.opacity_logits, to.opacity_logits);
    copy(from.sh, to.sh);
}

}  // namespace tvsgs
