#include "mesh/fuse/mesher_tsdf.h"

#include <algorithm>

#include "core/error.h"
#include "core/log.h"
#include "mesh/fuse/focus.h"

namespace tvsgs::detail {

TsdfOptions tsdf_volume(const TsdfMesherOptions& options,
                        const std::vector<View>& views,
                        const MeshRegion& region,
                        std::int64_t max_bytes,
                        DepthRules& rules) {
    TsdfOptions volume;
    volume.carve = options.carve;
    volume.trust = options.single_view == SingleView::trusted && options.min_weight == 1;
    rules.trust = volume.trust;
    rules.jump_px = options.single_view_jump_px;
    const auto size = [&](float pixels) {
        return voxel_size(options.voxel_size, options.resolution,
                          region.unbounded ? 2 * region.radius : rules.depth_max, views, pixels);
    };
    const float fine = size(1);
    volume.voxel_size = size(options.voxel_scale);
    volume.truncation = options.truncation > 0
                            ? options.truncation
                            : std::max(options.truncation_voxels * fine, volume.voxel_size);
    if (options.voxel_scale > 1 && (options.voxel_size > 0 || options.resolution > 0))
        spdlog::warn("mesh.voxel_scale={} has no effect, because the voxel size is given",
                     options.voxel_scale);
    volume.max_bytes = max_bytes;
    spdlog::debug("Voxel size {:.4g}, truncation {:.4g}, depth limit {}", volume.voxel_size,
                  volume.truncation, limit_text(rules));
    if (region.unbounded) {
        volume.contraction = {region.centre, region.radius};
        rules.centre = volume.contraction.centre;
        rules.reach = volume.contraction.reach(volume.truncation);
        spdlog::debug(
            "Unbounded: voxels grow beyond {:.4g} units from the object and end at {:.4g} units",
            region.radius, rules.reach);
    }
    return volume;
}

/// A pixel marks the blocks within the truncation of its depth. If the marks of neighbouring pixels
/// do not touch, the surface breaks into specks.
void check_truncation(const Camera& camera, std::vector<float> depths, const TsdfOptions& volume) {
    if (volume.contraction.is_on())  // contraction moves far pixels closer together
        for (int i = 0; i < static_cast<int>(depths.size()); ++i) {
            float& d = depths[i];
            d /= volume.contraction.growth(
                unproject(camera, i % camera.width_px, i / camera.width_px, d));
        }
    const double pixel =
        median_depth(std::move(depths)) / static_cast<double>(std::max(camera.fx_px, camera.fy_px));
    if (2 * static_cast<double>(volume.truncation) >= pixel) return;
    throw Error(ExitCode::usage, "voxel size ", volume.voxel_size, " and truncation ",
                volume.truncation, " are too small: pixels are ", pixel,
                " apart on the surface, so it would have gaps; pass --voxel-size ", pixel,
                ", or --truncation ", pixel, " or more");
}

void log_volume(const FusionReport& fusion) {
    spdlog::debug("Fused {} blocks of {}^3 voxels, {:.1f} MiB", fusion.blocks, kBlockEdge,
                  static_cast<double>(fusion.bytes) / (1 << 20));
    if (fusion.parts > 1)
        spdlog::debug("Fused in {} parts to stay within --memory; {:.1f} MiB stored on disk",
                      fusion.parts, static_cast<double>(fusion.spilled_bytes) / (1 << 20));
}

}  // namespace tvsgs::detail
