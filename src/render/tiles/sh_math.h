// Real spherical harmonics up to degree 3, with the basis and signs of 3DGS.  [Kerbl23]
#pragma once

#include "core/scene/gaussians.h"

namespace tvsgs {

inline constexpr double kShC0 = 0.28209479177387814;
// Loops run to this constant and test the degree inside: unrolled, they keep arrays in registers.
inline constexpr int kMaxShCount = sh_count(3);

/// Y_k(v) for k < sh_count(degree). v must be a unit vector.
template <class Real>
TVSGS_HD void sh_basis(int degree, Vec3<Real> v, Real* Y) {
    Y[0] = Real(kShC0);
    if (degree < 1) return;
    const Real x = v.x, y = v.y, z = v.z;
    constexpr Real c1 = Real(0.4886025119029199);
    Y[1] = -c1 * y, Y[2] = c1 * z, Y[3] = -c1 * x;
    if (degree < 2) return;
    const Real xx = x * x, yy = y * y, zz = z * z;
    Y[4] = Real(1.0925484305920792) * x * y;
    Y[5] = Real(-1.0925484305920792) * y * z;
    Y[6] = Real(0.31539156525252005) * (2 * zz - xx - yy);
    Y[7] = Real(-1.0925484305920792) * x * z;
    Y[8] = Real(0.5462742152960396) * (xx - yy);
    if (degree < 3) return;
    Y[9] = Real(-0.5900435899266435) * y * (3 * xx - yy);
    Y[10] = Real(2.890611442640554) * x * y * z;
    Y[11] = Real(-0.4570457994644658) * y * (4 * zz - xx - yy);
    Y[12] = Real(0.3731763325901154) * z * (2 * zz - 3 * xx - 3 * yy);
    Y[13] = Real(-0.4570457994644658) * x * (4 * zz - xx - yy);
    Y[14] = Real(1.445305721320277) * z * (xx - yy);
    Y[15] = Real(-0.5900435899266435) * x * (xx - 3 * yy);
}

/// sum_k dL_dY[k] dY_k/dv, with v as three independent numbers.
template <class Real>
TVSGS_HD Vec3<Real> sh_basis_vjp(int degree, Vec3<Real> v, const Real* dL_dY) {
    Vec3<Real> g{};
    if (degree < 1) return g;
    const Real x = v.x, y = v.y, z = v.z;
    constexpr Real c1 = Real(0.4886025119029199);
    g += Vec3<Real>{-c1 * dL_dY[3], -c1 * dL_dY[1], c1 * dL_dY[2]};
    if (degree < 2) return g;
    constexpr Real c4 = Real(1.0925484305920792), c6 = Real(0.31539156525252005),
                   c8 = Real(0.5462742152960396);
    g += c4 * dL_dY[4] * Vec3<Real>{y, x, 0};
    g += -c4 * dL_dY[5] * Vec3<Real>{0, z, y};
    g += c6 * dL_dY[6] * Vec3<Real>{-2 * x, -2 * y, 4 * z};
    g += -c4 * dL_dY[7] * Vec3<Real>{z, 0, x};
    g += c8 * dL_dY[8] * Vec3<Real>{2 * x, -2 * y, 0};
    if (degree < 3) return g;
    const Real xx = x * x, yy = y * y, zz = z * z;
    constexpr Real c9 = Real(0.5900435899266435), c10 = Real(2.890611442640554),
                   c11 = Real(0.4570457994644658);
    constexpr Real c12 = Real(0.3731763325901154), c14 = Real(1.445305721320277);
    g += -c9 * dL_dY[9] * Vec3<Real>{6 * x * y, 3 * xx - 3 * yy, 0};
    g += c10 * dL_dY[10] * Vec3<Real>{y * z, x * z, x * y};
    g += -c11 * dL_dY[11] * Vec3<Real>{-2 * x * y, 4 * zz - xx - 3 * yy, 8 * y * z};
    g += c12 * dL_dY[12] * Vec3<Real>{-6 * x * z, -6 * y * z, 6 * zz - 3 * xx - 3 * yy};
    g += -c11 * dL_dY[13] * Vec3<Real>{4 * zz - 3 * xx - yy, -2 * x * y, 8 * x * z};
    g += c14 * dL_dY[14] * Vec3<Real>{2 * x * z, -2 * y * z, xx - yy};
    g += -c9 * dL_dY[15] * Vec3<Real>{3 * xx - 3 * yy, -6 * x * y, 0};
    return g;
}

/// max(0, 0.5 + sum_k sh_k Y_k(v)) for Gaussian i. `sh` is coefficient major with `stride`
/// Gaussians per coefficient.
template <class Real, class Stored>
TVSGS_HD Vec3<Real> sh_color(
    int degree, Vec3<Real> direction, const Vec3<Stored>* sh, std::size_t stride, std::size_t i) {
    Real Y[kMaxShCount];
    sh_basis(degree, direction, Y);
    Vec3<Real> color{Real(0.5), Real(0.5), Real(0.5)};
    for (int k = 0; k < kMaxShCount; ++k)
        if (k < sh_count(degree)) color += Y[k] * vec_cast<Real>(sh[k * stride + i]);
    return {color.x > 0 ? color.x : 0, color.y > 0 ? color.y : 0, color.z > 0 ? color.z : 0};
}

/// Returns dL/d(mean - camera centre), and stores it in visit.dL_ddirection if it exists. `color`:
/// result of sh_color(); a channel of 0 was clamped and passes no gradient. Visits coefficients in
/// groups of `Visit::kGroup`: visit(first, dL_dsh, sh) takes their gradients and sets their values;
/// coefficients beyond the degree have gradient 0.
template <class Real, class Visit>
TVSGS_HD Vec3<Real> sh_color_vjp(int degree,
                                 Vec3<Real> offset,  // mean - camera centre, not normalised
                                 Vec3<Real> color,
                                 Vec3<Real> dL_dcolor,
                                 Visit& visit) {
    constexpr int kGroup = Visit::kGroup;
    static_assert(kMaxShCount % kGroup == 0);
    const Vec3<Real> g{color.x > 0 ? dL_dcolor.x : 0, color.y > 0 ? dL_dcolor.y : 0,
                       color.z > 0 ? dL_dcolor.z : 0};
    const Vec3<Real> direction = normalize(offset);
    Real Y[kMaxShCount]{}, dL_dY[kMaxShCount]{};
    sh_basis(degree, direction, Y);
    for (int first = 0; first < kMaxShCount; first += kGroup) {
        if (first >= sh_count(degree)) break;
        Vec3<Real> dL_dsh[kGroup], sh[kGroup];
        for (int k = 0; k < kGroup; ++k) dL_dsh[k] = Y[first + k] * g;
        visit(first, dL_dsh, sh);
        for (int k = 0; k < kGroup; ++k) dL_dY[first + k] = dot(sh[k], g);
    }
    const Vec3<Real> dL_ddirection = sh_basis_vjp(degree, direction, dL_dY);
    const Real length = norm(offset);
    if (!(length > Real(1e-12))) return {};
    const Vec3<Real> dL_doffset =
        (dL_ddirection - dot(dL_ddirection, direction) * direction) / length;
    if constexpr (requires { visit.dL_ddirection; }) visit.dL_ddirection = dL_doffset;
    return dL_doffset;
}

/// Adds the gradients of Gaussian i to `dL_dsh`. Both arrays are coefficient major.
template <class Real>
struct AddShGradient {
    static constexpr int kGroup = 1;
    const Vec3<Real>* sh;
    Vec3<Real>* dL_dsh;
    std::size_t stride, i;

    TVSGS_HD void operator()(int k,
                             const Vec3<Real> (&gradient)[kGroup],
                             Vec3<Real> (&values)[kGroup]) const {
        values[0] = sh[k * stride + i];
        dL_dsh[k * stride + i] += gradient[0];
    }
};

}  // namespace tvsgs
