#include "pipeline/blocks/blocks_merge.h"

#include <algorithm>
#include <cmath>

#include "core/math/sigmoid.h"
#include "core/scene/splat_lists.h"
#include "optim/growth/fixed_splats.h"
#include "optim/growth/splat_order.h"
#include "render/ewa/projection_math.h"

namespace tvsgs {
namespace {

constexpr double kInvisible = 1.0 / 255;  // smallest opacity visible in 8 bits

/// Standard deviations of a splat along the two ground axes, from its two larger axes: the smallest
/// axis is meaningless for discs.
Vec2<double> reach_on_ground(const GroundFrame& frame, Quatf quat, Vec3f log_scales) {
    const Mat3<double> axes = rotation(normalize(quat_cast<double>(quat)));
    const int smallest = smallest_axis(log_scales);
    double x = 0, y = 0;
    for (int axis = 0; axis < 3; ++axis) {
        if (axis == smallest) continue;
        const Vec2<double> along =
            frame.on_ground(std::exp(double{log_scales[axis]}) * column(axes, axis));
        x += along.x * along.x, y += along.y * along.y;
    }
    return {std::sqrt(x), std::sqrt(y)};
}

}  // namespace

BlockSplats part_of_block(const BlocksManifest& manifest,
                          const Gaussians<Cpu>& splats,
                          int block,
                          double fade) {
    BlockSplats part;
    copy(splats, part.splats);
    std::vector<int> places;
    for (std::size_t i = 0; i < splats.means.size(); ++i) {
        const Vec3d mean = vec_cast<double>(splats.means[i]);
        const int home = manifest.block_of(mean);
        const Vec3f l = splats.log_scales[i];
        double share = home == block ? 1 : 0;
        if (block > 0 && home > 0 && fade > 0) {
            const Vec2<double> reach = reach_on_ground(manifest.frame, splats.quats[i], l);
            share = manifest.cells[block - 1].share(manifest.frame.on_ground(mean),
                                                    {fade * reach.x, fade * reach.y});
        }
        if (share == 0) continue;
        if (share < 1) {
            const double logit = faded_logit(double{splats.opacity_logits[i]}, share);
            if (!(sigmoid(logit) >= kInvisible)) continue;
            part.splats.opacity_logits[i] = float(logit);
        }
        places.push_back(int(i));
        if (home != block) continue;
        ++part.own;
        part.far_reach +=
            block > 0 && 3 * std::exp(double{std::max({l.x, l.y, l.z})}) > manifest.margin;
    }
    part.splats.filter.resize(0), part.splats.uncertainty.resize(0);
    keep_splats(places, part.splats);
    if (!places.empty()) sort_by_place(part.splats);
    return part;
}

Gaussians<Cpu> join_splats(const std::vector<Gaussians<Cpu>>& parts, int sh_degree) {
    int all = 0, first = 0;
    for (const Gaussians<Cpu>& part : parts) all += part.size();
    Gaussians<Cpu> joined;
    resize(joined, all, sh_degree);
    for (const Gaussians<Cpu>& part : parts) {
        if (part.size() == 0) continue;
        const Gaussians<Cpu> same = with_sh_degree(part, sh_degree);
        for_each_array(
            [&](const SplatArray& array, const auto& from, auto& to) {
                for (std::size_t p = 0; !array.optional && p < std::size_t(array.planes); ++p)
                    std::copy_n(from.data() + p * part.size(), part.size(),
                                to.data() + p * all + first);
            },
            same, joined);
        first += part.size();
    }
    return joined;
}

}  // namespace tvsgs
