// TSDF mesher: fuses depth maps into a truncated signed distance field and meshes it.
#pragma once

#include <vector>

#include "core/progress.h"
#include "mesh/fuse/device_algorithms.h"
#include "mesh/fuse/fusion.h"
#include "mesh/mesher.h"

namespace tvsgs {

/// Which surface that a single view has seen is kept.
enum class SingleView { trusted, all };

struct TsdfMesherOptions {
    float voxel_size = 0, voxel_scale = 1, truncation = 0, truncation_voxels = 4;
    int resolution = 0, min_weight = 1;
    bool carve = false;
    SingleView single_view = SingleView::trusted;
    float single_view_jump_px = kJumpPx;

    template <class Visitor>
    void fields(Visitor& field) {
        field("voxel_size", voxel_size, {0, 1e9},
              "voxel size, world units; 0: depth_max / resolution");
        field("resolution", resolution, {0, 65536},
              "voxels along depth_max, or across the ball if unbounded; 0: 2048, fewer for small "
              "images");
        field("voxel_scale", voxel_scale, {1, 2},
              "least size of a voxel in pixels, without voxel_size and resolution; the truncation "
              "stays that of 1; larger: less time, less detail");
        field("truncation", truncation, {0, 1e9}, "world units; 0: truncation_voxels");
        field("truncation_voxels", truncation_voxels, {1, 1000},
              "truncation in voxels of voxel_scale 1");
        field("carve", carve, "views also clear the space in front of their surface");
        field("min_weight", min_weight, {1, 65535}, "least number of views that see a voxel");
        field.choice("single_view", single_view, {"trusted", "all"},
                     "surface that a single view sees: keep the smooth parts, away from edges and "
                     "outside of other views' free space, or all; trusted needs min_weight 1");
        field("single_view_jump_px", single_view_jump_px, {0.01, 1000},
              "limit of a depth jump within trusted surface of a single view, in pixel widths");
    }
};

namespace detail {

/// The volume for `views`; sets the trust and the reach of `rules`.
TsdfOptions tsdf_volume(const TsdfMesherOptions& options,
                        const std::vector<View>& views,
                        const MeshRegion& region,
                        std::int64_t max_bytes,
                        DepthRules& rules);
/// Throws Error(ExitCode::usage) if the surface of a view would have gaps.
void check_truncation(const Camera& camera, std::vector<float> depths, const TsdfOptions& volume);
void log_volume(const FusionReport& fusion);

}  // namespace detail

template <class Device>
class TsdfMesher final : public Mesher<Device> {
public:
    explicit TsdfMesher(const TsdfMesherOptions& options) : options_(options) {}

    bool is_rough() const override { return true; }

    ExtractedMesh extract(const MesherInputs<Device>& in) override {
        const TsdfOptions volume =
            detail::tsdf_volume(options_, in.views, in.region, in.max_bytes, in.depth.rules());
        bool checked = false;
        const int passes = 1 + (volume.carve ? 1 : 0) + (volume.trust ? 1 : 0);
        Progress progress("depth maps", double(passes) * in.depth.size());
        const auto source = [&](int i) {
            progress.advance();
            const DepthView<Device> view = in.depth.view(i);
            if (!checked && in.depth.counts(i)[DepthOutcome::kept] > 0) {
                detail::check_truncation(view.camera, in.depth.depth_on_host(), volume);
                checked = true;
            }
            return view;
        };
        FusionReport fusion;
        ExtractedMesh found;
        found.mesh =
            fuse_views<Device>(in.depth.size(), source, volume,
                               static_cast<float>(options_.min_weight), in.spill_folder, fusion);
        found.why_empty = in.depth.why_none_passed();
        detail::log_volume(fusion);
        if (found.why_empty.empty() && found.mesh.faces.empty())
            found.why_empty =
                "no two views agree on a surface; lower --min-weight, or pass "
                "--set mesh.single_view=all";
        return found;
    }

private:
    TsdfMesherOptions options_;
};

}  // namespace tvsgs
