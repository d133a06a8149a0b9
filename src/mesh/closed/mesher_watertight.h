// Watertight mesher: the closed surface of the solid behind the points of the depth maps.
// [Kazhdan13], docs/method/watertight.md
#pragma once

#include <cstdint>
#include <vector>

#include "core/progress.h"
#include "mesh/closed/view_points.h"
#include "mesh/fuse/device_algorithms.h"
#include "mesh/fuse/focus.h"
#include "mesh/mesher.h"

namespace tvsgs {

namespace detail {

/// Reconstructs the closed surface of `points`, with vertex colours.
ExtractedMesh close_surface(const ViewPoints& points,
                            const EvidenceSource& evidence,
                            std::int64_t max_bytes);

}  // namespace detail

/// Makes a surface that is closed also where no view sees it: each edge has two faces, and the
/// faces at each vertex form one fan. The surface is computed on the host, whatever the device.
template <class Device>
class WatertightMesher final : public Mesher<Device> {
public:
    /// The finest nodes are voxel_size() apart.
    WatertightMesher(float given_size, int resolution)
        : given_size_(given_size), resolution_(resolution) {}

    bool is_closed() const override { return true; }

    ExtractedMesh extract(const MesherInputs<Device>& in) override {
        const EvidenceSource evidence = evidence_of(in.depth);
        const std::int64_t max_bytes = host_budget(in.max_bytes);
        ViewPoints points(
            voxel_size(given_size_, resolution_, in.depth.rules().depth_max, in.views));
        Progress progress("depth maps", in.depth.size());
        for (int i = 0; i < in.depth.size(); ++i, progress.advance()) {
            const DepthView<Device> view = in.depth.view(i);
            const auto on_host = [](auto map) { return map_on_host(Device{}, map); };
            points.add({view.camera, on_host(view.depth), on_host(view.color), on_host(view.weight),
                        on_host(view.normal)});
            points.fit(max_bytes);
        }
        ExtractedMesh found;
        found.why_empty = in.depth.why_none_passed();
        if (!found.why_empty.empty()) return found;
        points.drop_looked_through(evidence);
        return detail::close_surface(points, evidence, max_bytes);
    }

private:
    float given_size_;
    int resolution_;
};

}  // namespace tvsgs
