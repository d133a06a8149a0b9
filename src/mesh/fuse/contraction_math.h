// Contraction of an unbounded scene into a ball: voxels of constant size in the ball grow with
// their distance in the world. [Barron22, Eq. 10; 2DGS, utils/mesh_utils]
#pragma once

#include "core/math/vec.h"

namespace tvsgs {

/// Maps the world to the space in which voxels are cubes, with the origin in the ball's centre.
/// Inside of the ball the map only shifts. A point at distance n > radius from the centre moves to
/// distance 2 radius - radius^2 / n, so the whole world lies within twice the radius.
template <class Real>
struct Contraction {
    Vec3<Real> centre;  // world units
    Real radius = 0;    // world units; 0: no contraction, both spaces are the same

    TVSGS_HD bool is_on() const { return radius > 0; }

    TVSGS_HD Vec3<Real> contract(Vec3<Real> p_world) const {
        if (!is_on()) return p_world;
        const Vec3<Real> q = p_world - centre;
        const Real n = norm(q);
        return n > radius ? (2 - radius / n) * (radius / n) * q : q;
    }

    /// Not finite at distances of twice the radius and more.
    TVSGS_HD Vec3<Real> expand(Vec3<Real> p) const {
        if (!is_on()) return p;
        const Real m = norm(p) / radius;
        if (!(m < 2)) return {Real(INFINITY), Real(INFINITY), Real(INFINITY)};
        return centre + (m > 1 ? p / (m * (2 - m)) : p);
    }

    /// Distance from the centre in radii, at least 1. Outside of the ball, contraction scales a
    /// small radial length by 1 / growth^2 and a tangential one by about 2 / growth.
    TVSGS_HD Real growth(Vec3<Real> p_world) const {
        if (!is_on()) return 1;
        const Real g = norm(p_world - centre) / radius;
        return g > 1 ? g : 1;
    }

    /// Greatest distance of a surface from the centre at which a voxel `margin` behind it in
    /// contracted space still has a place in the world.
    TVSGS_HD Real reach(Real margin) const { return radius * (radius / margin); }
};

}  // namespace tvsgs
