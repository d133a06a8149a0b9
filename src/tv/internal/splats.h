// The parameters of the Gaussians and fixed voters that tensor voting reads.
#pragma once

#include "core/scene/gaussians.h"
#include "tv/vote_math.h"

namespace tvsgs {

/// Geometry of the splats.
struct SplatSpans {
    Span<const Vec3f> means, log_scales;
    Span<const Quatf> quats;

    TVSGS_HD int size() const { return means.size(); }
    template <class Real>
    TVSGS_HD Vec3<Real> scales(int i) const {
        return exp(vec_cast<Real>(log_scales[i]));
    }
    /// Unusable splats neither vote nor receive votes.
    TVSGS_HD bool usable(int i) const {
        const Quatf q = quats[i];
        const Vec3f s = scales<float>(i);
        const float quat2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z, trace = dot(s, s);
        return is_finite(means[i]) && trace * 0 == 0 && quat2 > 0 && quat2 * 0 == 0;
    }
    template <class Real>
    TVSGS_HD Whitening<Real> whitening(int i, const WhitenRule& rule, double noise) const {
        return tvsgs::whitening(quat_cast<Real>(quats[i]), scales<Real>(i), rule, Real(noise));
    }
};

/// Measured points that only vote.
struct FixedVoterSpans {
    Span<const Vec3f> means, normals;  // normals: unit
    Span<const float> scales;   // world units; radius of the surface patch that a point represents
    Span<const float> weights;  // strength of its votes

    TVSGS_HD int size() const { return means.size(); }
    template <class Real>
    TVSGS_HD Whitening<Real> whitening(int i) const {
        const Real s = scales[i];
        return {{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}, {s, s, s}};
    }
};

template <class Device>
SplatSpans splat_spans(const Gaussians<Device>& g) {
    return {g.means.span(), g.log_scales.span(), g.quats.span()};
}

}  // namespace tvsgs
