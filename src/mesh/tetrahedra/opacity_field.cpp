#include "mesh/tetrahedra/opacity_field.h"

#include "core/math/smoothing_filter.h"
#include "mesh/tetrahedra/opacity_field_impl.h"
#include "render/tiles/tiles_cpu.h"

namespace tvsgs {

TVSGS_TILES_CPU(FieldShape, RayGaussian<float>)
TVSGS_OPACITY_FIELD(Cpu)

FieldSplats<Cpu> field_splats(const Gaussians<Cpu>& gaussians) {
    FieldSplats<Cpu> splats;
    const auto n = static_cast<std::size_t>(gaussians.size());
    splats.means.resize(n), splats.scales.resize(n);
    splats.quats.resize(n), splats.opacities.resize(n);
    parallel_for(Cpu{}, gaussians.size(), [&](int i) {
        const auto smooth = smoothed(gaussians.log_scales[i],
                                     gaussians.filter.empty() ? 0.0f : gaussians.filter[i]);
        splats.means[i] = gaussians.means[i], splats.scales[i] = smooth.scales;
        splats.quats[i] = normalize(gaussians.quats[i]);
        splats.opacities[i] = smooth.dimming * sigmoid(gaussians.opacity_logits[i]);
    });
    return splats;
}

}  // namespace tvsgs
