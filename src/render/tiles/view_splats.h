// Projection of splats to ellipses of one view, for both devices.
#pragma once

#include "render/ewa/projection_math.h"
#include "render/tiles/blend_math.h"
#include "render/tiles/tiles.h"

namespace tvsgs {

/// px^2, added to the covariance of an ellipse, so that none is thinner than about a pixel.
/// [Kerbl23]
inline constexpr float kLowPassPx2 = 0.3f;

struct ViewParameters {
    Pinhole<float> camera;
    Vec3f centre;  // of the camera, world
    TileGrid grid;
    int sh_degree;
    float near, low_pass;
};

/// Share of the derivatives by colour that reaches the shape of a splat: `supported` if stereo
/// supports it, else all.
struct ColorShare {
    Span<const float> uncertainty;  // [N] or empty
    float supported = 1;

    TVSGS_HD float operator()(int i) const {
        return is_supported(uncertainty, i) ? supported : 1.0f;
    }
    bool parts() const { return supported < 1 && !uncertainty.empty(); }
};

/// A splat in the image. Without tiles it is not in view, and the other members are not valid.
struct ViewEllipse {
    SplatShape<float> shape;
    TileRect rect;
    float radius;  // 3-sigma radius of 3DGS, px; only for statistics, tiles use an exact test
};

/// Projects a splat at `p`, in front of the camera. `R`: world_from_gaussian. The splat is not
/// drawn unless the determinant of its image covariance, px^4, exceeds `least_det`.
TVSGS_HD inline ViewEllipse view_ellipse(const ViewParameters& view,
                                         Vec3f p,
                                         const Mat3f& R,
                                         Vec3f scales,
                                         float opacity,
                                         float least_det) {
    ViewEllipse out{};
    const ImageEllipse<float> e =
        image_ellipse(projection_jacobian(view.camera, p), R, scales, view.low_pass);
    if (!(e.det > least_det) || !(e.det < 1e30f)) return out;
    out.shape = {project_point(view.camera, p), ellipse_root(e), opacity, splat_reach(opacity)};
    const TileGrid& grid = view.grid;
    const TileRect rect = tile_rect(out.shape.mean, splat_extent(out.shape), grid);
    // Construction of the lists tests the single tiles.
    if (rect.count() == 0 || !meets_tiles(out.shape, grid, rect)) return out;
    out.rect = rect;
    const float mid = 0.5f * (e.covariance.xx + e.covariance.yy);
    const float under_root = mid * mid - e.det;
    out.radius = std::ceil(3 * std::sqrt(mid + std::sqrt(under_root > 0.1f ? under_root : 0.1f)));
    return out;
}

}  // namespace tvsgs
