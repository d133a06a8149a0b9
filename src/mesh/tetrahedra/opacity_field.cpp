#include "mesh/tetrahedra/opacity_field.h"

#include "core/math/smoothing_filter.h"
#include "mesh/tetrahedra/opacity_field_impl.h"
#include "render/tiles/tiles_cpu.h"

namespace tvsgs {

TVSGS_TILES_CPU(FieldShape, RayGaussian<float>)

FieldSplats<Cpu> field_splats(const Gaussians<Cpu>& gaussians) {
    FieldSplats<Cpu> splats;
    const auto n = static_cast<std::size_t>(gaussians.size());
    splats.means.resize(n), splats.scales.resize(n);
    splats.quats.resize(n), splats.opacities.resize(n);
    parallel_for(Cpu{}, gaussians.size(), [&](int at) {
        const auto i = static_cast<std::size_t>(at);
        const auto smooth = smoothed(gaussians.log_scales[i],
                                     gaussians.filter.empty() ? 0.0f : gaussians.filter[i]);
        splats.means[i] = gaussians.means[i], splats.scales[i] = smooth.scales;
        splats.quats[i] = normalize(gaussians.quats[i]);
        splats.opacities[i] = smooth.dimming * sigmoid(gaussians.opacity_logits[i]);
    });
    return splats;
}

void see_points(const FieldSplats<Cpu>& splats,
                const FieldViews& views,
                const Buffer<Vec3f, Cpu>& points,
                Buffer<Sight, Cpu>& sights) {
    detail::FieldScratch<Cpu> scratch;
    detail::see_points_on(splats, views, points, scratch, sights);
}

void find_crossings(const FieldSplats<Cpu>& splats,
                    const FieldViews& views,
                    int steps,
                    Buffer<Vec3f, Cpu>& free_ends,
                    Buffer<Vec3f, Cpu>& inside_ends) {
    detail::find_crossings_on(splats, views, steps, free_ends, inside_ends);
}

}  // namespace tvsgs
