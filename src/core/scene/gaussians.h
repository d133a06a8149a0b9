// Parameters of the Gaussians, and functions over all their arrays.
#pragma once

#include "core/device/buffer.h"
#include "core/math/vec.h"

namespace tvsgs {

/// Number of spherical-harmonics coefficients per colour channel.
TVSGS_HD constexpr int sh_count(int degree) {
    return (degree + 1) * (degree + 1);
}

/// N Gaussians, one array per parameter. Gradients and moments reuse the struct, so shapes agree.
template <class Device>
struct Gaussians {
    Buffer<Vec3f, Device> means;           // [N] world units
    Buffer<Vec3f, Device> log_scales;      // [N] log of the standard deviations, world units
    Buffer<Quatf, Device> quats;           // [N] (w, x, y, z), normalised on use
    Buffer<float, Device> opacity_logits;  // [N]
    Buffer<Vec3f, Device> sh;  // [sh_count(sh_degree), N] RGB coefficients, coefficient major
    /// [N] world units, or empty: width of the smoothing filter. Not a parameter;
    /// Backbone::prepare() writes it.
    Buffer<float, Device> filter;
    /// [N] world units, or empty: how far stereo may have put a splat off its surface. 0: stereo
    /// does not support the splat. No step changes it; splats that growth adds have 0.
    Buffer<float, Device> uncertainty;
    int sh_degree = 3;

    int size() const { return static_cast<int>(means.size()); }
};

/// Whether stereo supports splat i. `uncertainty`: [N], or empty.
TVSGS_HD inline bool is_supported(Span<const float> uncertainty, int i) {
    return !uncertainty.empty() && uncertainty[i] > 0;
}

/// Description of one array of Gaussians.
struct SplatArray {
    const char* name;
    int planes = 1;         // it holds `planes` times N elements
    bool shape = false;     // position, size or orientation
    bool optional = false;  // may be empty
    bool inherited = true;  // new splats have their parents' values, else zeros
};

/// Calls visit(SplatArray, array...) for each array of one object, or of several side by side. All
/// code that treats every array uses this list.
template <class Visit, class First, class... More>
void for_each_array(const Visit& visit, First& g, More&... more) {
    visit(SplatArray{.name = "means", .shape = true}, g.means, more.means...);
    visit(SplatArray{.name = "log_scales", .shape = true}, g.log_scales, more.log_scales...);
    visit(SplatArray{.name = "quats", .shape = true}, g.quats, more.quats...);
    visit(SplatArray{.name = "opacity_logits"}, g.opacity_logits, more.opacity_logits...);
    visit(SplatArray{.name = "sh", .planes = sh_count(g.sh_degree)}, g.sh, more.sh...);
    visit(SplatArray{.name = "filter", .optional = true}, g.filter, more.filter...);
    visit(SplatArray{.name = "uncertainty", .optional = true, .inherited = false}, g.uncertainty,
          more.uncertainty...);
}

/// Contents are undefined where a buffer had to grow. Optional arrays that are empty stay empty.
template <class Device>
void resize(Gaussians<Device>& g, int count, int sh_degree) {
    g.sh_degree = sh_degree;
    for_each_array(
        [count](const SplatArray& array, auto& values) {
            if (!array.optional || !values.empty())
                values.resize(std::size_t(count) * array.planes);
        },
        g);
}

/// The same without SH coefficients.
template <class Device>
void resize_geometry(Gaussians<Device>& g, int count) {
    resize(g, count, 0);
    g.sh.resize(0);
}

template <class Device>
void fill_zero(Gaussians<Device>& g) {
    for_each_array([](const SplatArray&, auto& values) { values.fill_zero(); }, g);
}

template <class From, class To>
void copy(const Gaussians<From>& from, Gaussians<To>& to) {
    to.sh_degree = from.sh_degree;
    for_each_array(
        [](const SplatArray&, const auto& values, auto& copied) { copy(values, copied); }, from,
        to);
}

}  // namespace tvsgs
