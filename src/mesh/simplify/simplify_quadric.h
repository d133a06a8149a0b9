// Quadric error: sum of squared distances to planes as a function of the point.
#pragma once

#include "core/math/vec.h"

namespace tvsgs {

/// x^T A x + 2 b^T x + c: the sum of `weight` times squared distances. [Garland97, 4]
struct Quadric {
    Sym3<double> A;
    Vec3d b;
    double c = 0, weight = 0;

    /// Adds the plane through `point` with the unit `normal`; distances are measured in `unit`s.
    void add_plane(Vec3d normal, Vec3d point, double plane_weight, double unit) {
        const double s = plane_weight / (unit * unit), d = -dot(normal, point);
        const Vec3d sn = s * normal;
        A.xx += sn.x * normal.x, A.xy += sn.x * normal.y, A.xz += sn.x * normal.z;
        A.yy += sn.y * normal.y, A.yz += sn.y * normal.z, A.zz += sn.z * normal.z;
        b += d * sn;
        c += s * d * d;
        weight += plane_weight;
    }
    /// Adds `scale` times another quadric.
    void add(const Quadric& q, double scale = 1) {
        A.xx += scale * q.A.xx, A.xy += scale * q.A.xy, A.xz += scale * q.A.xz;
        A.yy += scale * q.A.yy, A.yz += scale * q.A.yz, A.zz += scale * q.A.zz;
        b += scale * q.b;
        c += scale * q.c, weight += scale * q.weight;
    }
    /// Changes to a unit of distance that is `times` as long.
    void count_in(double times) {
        const double s = 1 / (times * times);
        A.xx *= s, A.xy *= s, A.xz *= s, A.yy *= s, A.yz *= s, A.zz *= s;
        b = s * b, c *= s;
    }
    Vec3d half_gradient(Vec3d x) const {
        return {A.xx * x.x + A.xy * x.y + A.xz * x.z + b.x,
                A.xy * x.x + A.yy * x.y + A.yz * x.z + b.y,
                A.xz * x.x + A.yz * x.y + A.zz * x.z + b.z};
    }
    /// The mean squared distance; 0 without planes.
    double mean(Vec3d x) const {
        if (!(weight > 0)) return 0;
        const double sum = dot(x, half_gradient(x)) + dot(b, x) + c;
        return sum > 0 ? sum / weight : 0;
    }
    /// The point of least sum, regularised towards `start` by a thousandth of the mean curvature so
    /// that it is unique also for parallel planes.
    Vec3d minimum(Vec3d start) const {
        const double pull = 1e-3 / 3 * (A.xx + A.yy + A.zz);
        if (!(pull > 0)) return start;
        const double xx = A.xx + pull, yy = A.yy + pull, zz = A.zz + pull;
        const double c00 = yy * zz - A.yz * A.yz, c01 = A.xz * A.yz - A.xy * zz,
                     c02 = A.xy * A.yz - A.xz * yy, c11 = xx * zz - A.xz * A.xz,
                     c12 = A.xy * A.xz - xx * A.yz, c22 = xx * yy - A.xy * A.xy;
        const double determinant = xx * c00 + A.xy * c01 + A.xz * c02;
        const Vec3d g = half_gradient(start);
        return start - Vec3d{c00 * g.x + c01 * g.y + c02 * g.z, c01 * g.x + c11 * g.y + c12 * g.z,
                             c02 * g.x + c12 * g.y + c22 * g.z} /
                           determinant;
    }
};

}  // namespace tvsgs
