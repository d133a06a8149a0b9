// Depth maps of made-up scenes, which may differ from view to view, as evidence.
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

/// What a camera at `centre` that looks at the origin sees of `scene`: 200 pixels wide, and as many
/// units of focal length, so that a pixel is a 200th of its depth wide.
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

/// `scene` from all of these.
inline std::vector<EvidenceView> views_of(const TriangleMesh& scene) {
    std::vector<EvidenceView> views;
    for (const Vec3d eye : kEyes) views.push_back(view_of(scene, eye));
    return views;
}

/// A level square about (x, y, z).
inline TriangleMesh sheet(double x, double y, double z, double side, int n) {
    return square({x - side / 2, y - side / 2, z}, side, n);
}

}  // namespace tvsgs::test
