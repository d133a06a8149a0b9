// A voting event with its results on the host, and how two results are compared; for tvsgs-bench
// and the tests of tensor voting.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/math/quantile.h"
#include "core/scene/gaussians.h"
#include "tv/vote_math.h"
#include "tv/voting.h"

namespace tvsgs {

struct FieldOnHost {
    std::vector<Sym3f> tensors;
    std::vector<Vec3f> eigenvalues, normals, targets;
    std::vector<std::uint8_t> flags;
    VotingDetails details;
};

template <class Device>
FieldOnHost read(const TensorField<Device>& field, const TensorVoter<Device>& voter) {
    return {to_host(field.tensors), to_host(field.eigenvalues), to_host(field.normals),
            to_host(field.targets), to_host(field.flags),       voter.details()};
}

/// `events` events on static splats: the first is a ball round and a plate round, the others a
/// plate round each; virtual receivers follow every time. `receivers`: lists to use instead of a
/// search.
template <class Device>
FieldOnHost run_events(const Gaussians<Device>& gaussians,
                       const TvOptions& options,
                       int events,
                       const std::vector<std::uint32_t>& receivers = {}) {
    TensorVoter<Device> voter(options);
    if (!receivers.empty())
        voter.set_receivers(options.start, static_cast<int>(receivers.size()) / gaussians.size(),
                            receivers);
    TensorField<Device> field;
    for (int event = 0; event < events; ++event)
        voter.vote(options.start + event * options.vote_every, gaussians, field);
    return read(field, voter);
}

inline double frobenius(const Sym3f& T) {
    const double off = double(T.xy) * T.xy + double(T.xz) * T.xz + double(T.yz) * T.yz;
    return std::sqrt(double(T.xx) * T.xx + double(T.yy) * T.yy + double(T.zz) * T.zz + 2 * off);
}
inline Sym3f difference(const Sym3f& a, const Sym3f& b) {
    return {a.xx - b.xx, a.xy - b.xy, a.xz - b.xz, a.yy - b.yy, a.yz - b.yz, a.zz - b.zz};
}
/// Between two axes; exact for small angles.
inline double angle_deg(Vec3<double> a, Vec3<double> b) {
    return std::atan2(norm(cross(a, b)), std::abs(dot(a, b))) * 180 / kPi;
}
/// Below this gap a normal is sensitive to rounding and not compared.
/// [docs/method/voting.md#bounds-of-agreement]
inline constexpr double kComparedGap = 1e-2;

/// List i of [N, k] lists, ascending.
inline std::vector<std::uint32_t> sorted_row(const std::vector<std::uint32_t>& lists,
                                             int k,
                                             int i) {
    std::vector<std::uint32_t> row(lists.begin() + std::ptrdiff_t(i) * k,
                                   lists.begin() + std::ptrdiff_t(i + 1) * k);
    std::sort(row.begin(), row.end());
    return row;
}

/// The middle one; of an even count the upper of the two.
inline double middle(std::vector<double> values) {
    return middle_of(values);
}

}  // namespace tvsgs
