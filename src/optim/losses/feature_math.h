// Projects a pixel's surface point into another view, and compares both descriptors. [FatesGS]
#pragma once

#include <cmath>

#include "optim/losses/multiview_math.h"

namespace tvsgs {

/// A pixel's surface point as seen by another view.
template <class Real>
struct SeenPoint {
    bool inside = false;  // the other view's image
    Vec3<Real> there{};   // in the other view's frame
    Vec2<Real> point{};   // image point of the other view, corner coordinates
};

/// Not inside for a depth of 0, which means none.
template <class Real>
TVSGS_HD SeenPoint<Real> seen_point(const ViewPair<Real>& pair, Vec3<Real> ray, Real depth) {
    SeenPoint<Real> seen;
    if (!(depth > 0)) return seen;
    seen.there = pair.other_from_reference * (depth * ray);
    if (!(seen.there.z > pair.min_depth)) return seen;
    seen.point = project(pair.other, seen.there);
    seen.inside = seen.point.x >= 0 && seen.point.x < Real(pair.other.width) && seen.point.y >= 0 &&
                  seen.point.y < Real(pair.other.height);
    return seen;
}

/// Derivative by the depth.
template <class Real>
TVSGS_HD Real seen_point_vjp(const ViewPair<Real>& pair,
                             Vec3<Real> ray,
                             const SeenPoint<Real>& seen,
                             Vec2<Real> dL_dpoint) {
    return dot(project_vjp(pair.other, seen.there, dL_dpoint), pair.other_from_reference.R * ray);
}

/// [height width channels]
struct FeatureMap {
    const float* values;
    int width, height, channels;
};

/// The four pixels around a point, and the point's position between them.
template <class Real>
struct FeatureCell {
    // Four pixel centres surround the point: no sample uses pixels beyond the border.
    bool inside = false;
    std::size_t first = 0;  // index of the upper left pixel's first value
    Real u = 0, v = 0;
};

/// `point` in corner coordinates.
template <class Real>
TVSGS_HD FeatureCell<Real> feature_cell(const FeatureMap& map, Vec2<Real> point) {
    FeatureCell<Real> cell;
    const Real x = point.x - Real(0.5), y = point.y - Real(0.5);
    if (map.width < 2 || map.height < 2 || !(x >= 0) || !(y >= 0) || !(x <= Real(map.width - 1)) ||
        !(y <= Real(map.height - 1)))
        return cell;
    const int x0 = int(x), y0 = int(y);
    const int left = x0 < map.width - 2 ? x0 : map.width - 2,
              top = y0 < map.height - 2 ? y0 : map.height - 2;
    cell.inside = true;
    cell.first = (std::size_t(top) * map.width + left) * map.channels;
    cell.u = x - Real(left), cell.v = y - Real(top);
    return cell;
}

/// Bilinear sample of one channel.
template <class Real>
TVSGS_HD ImageSample<Real> feature_sample(const FeatureMap& map,
                                          const FeatureCell<Real>& cell,
                                          int channel) {
    const std::size_t i = cell.first + channel, row = std::size_t(map.width) * map.channels;
    const Real a = map.values[i], b = map.values[i + map.channels], c = map.values[i + row],
               d = map.values[i + row + map.channels];
    const Real top = a + cell.u * (b - a), bottom = c + cell.u * (d - c);
    return {top + cell.v * (bottom - top),
            {(1 - cell.v) * (b - a) + cell.v * (d - c), bottom - top}};
}

/// Shorter descriptors carry no information, and their directions have no derivatives.
inline constexpr double kLeastFeatureNorm = 1e-4;

template <class Real>
struct FeatureMatch {
    bool valid = false;          // both inside and not 0, and error < max_error
    Real error = 0;              // |1 - cosine|
    Vec2<Real> derror_dpoint{};  // by the point in `other`
};

/// Compares two descriptors; the one at `point` is a constant. `point` and `other_point` are in
/// corner coordinates of their maps, which have the same number of channels.
template <class Real>
TVSGS_HD FeatureMatch<Real> feature_match(const FeatureMap& map,
                                          Vec2<Real> point,
                                          const FeatureMap& other,
                                          Vec2<Real> other_point,
                                          Real max_error) {
    FeatureMatch<Real> match;
    const auto here = feature_cell(map, point), there = feature_cell(other, other_point);
    if (!here.inside || !there.inside) return match;
    Real aa = 0, bb = 0, ab = 0;
    Vec2<Real> a_slope{}, b_slope{};  // sums over channels
    for (int channel = 0; channel < map.channels; ++channel) {
        const Real a = feature_sample(map, here, channel).value;
        const auto sample = feature_sample(other, there, channel);
        const Real b = sample.value;
        aa += a * a, bb += b * b, ab += a * b;
        a_slope += a * sample.slope, b_slope += b * sample.slope;
    }
    constexpr Real kLeast = Real(kLeastFeatureNorm * kLeastFeatureNorm);
    if (!(aa > kLeast) || !(bb > kLeast)) return match;
    const Real over = 1 / (std::sqrt(aa) * std::sqrt(bb)), cosine = over * ab;
    match.error = std::abs(1 - cosine);
    match.valid = match.error < max_error;
    const Real sign = cosine < 1 ? Real(-1) : cosine > 1 ? Real(1) : Real(0);
    match.derror_dpoint = sign * (over * a_slope - (cosine / bb) * b_slope);
    return match;
}

}  // namespace tvsgs
