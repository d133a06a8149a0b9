// Depth maps of synthetic scenes as evidence; the scene may differ from view to view.
#pragma once

#include <initializer_list>
#include <vector>

#include "mesh/draw/mesh_render.h"
#include "mesh/fuse/pixel_trust.h"
#include "mesh/mend/mesh_evidence.h"
#include "mesh/shapes.h"
#include "mesh/sphere_views.h"

namespace tvsgs::test {

inline TriangleMesh joined(std::initializer_list<TriangleMesh> parts) {
    TriangleMesh all;
    for (const TriangleMesh& part : parts) append(all, part);
    return all;
}

/// The depth map of `scene` for a camera at `centre` that looks at the origin: 200 pixels wide,
/// with a focal length of 200 pixels, so that a pixel is 1/200 of its depth wide.
inline EvidenceView view_of(const TriangleMesh& scene, Vec3d centre, bool trusted = true) {
    const Camera camera = look_at_origin(centre, 200);
    EvidenceView view{camera, render_mesh(scene, camera).depth.pixels, {}};
    view.weight.assign(view.depth.size(), trusted ? kTrustedWeight : kDoubtedWeight);
    return view;
}

inline EvidenceSource source_of(const std::vector<EvidenceView>& views) {
    return {static_cast<int>(views.size()),
            [&views](int i) { return views[static_cast<std::size_t>(i)]; }};
}

/// Three eyes above the origin, five units away.
inline constexpr Vec3d kEyes[] = {{-1.2, 0, 5}, {0, 0.3, 5}, {1.2, 0, 5}};

/// `scene` from each of kEyes.
inline std::vector<EvidenceView> views_of(const TriangleMesh& scene) {
    std::vector<EvidenceView> views;
    for (const Vec3d eye : kEyes) views.push_back(view_of(scene, eye));
    return views;
}

/// A horizontal square with the centre (x, y, z).
inline TriangleMesh sheet(double x, double y, double z, double side, int n) {
    return square({x - side / 2, y - side / 2, z}, side, n);
}

}  // namespace tvsgs::test
