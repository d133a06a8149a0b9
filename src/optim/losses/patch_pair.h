// Corresponding patches of a rendered surface in the grey photographs of two views.
#pragma once

#include "optim/losses/multiview_math.h"
#include "optim/views/device_view.h"
#include "optim/views/neighbour_views.h"

namespace tvsgs {

struct PatchPair {
    ViewPair<float> pair;  // lenses of the grey images
    // From corner coordinates of the render to the grey image's; from these to sample coordinates.
    Vec2f scale, shift;
    Camera camera;  // of the render
    GreyBytes reference, other;

    /// Whether the patches around pixel `at` and around the projection of `point` (camera frame)
    /// lie inside both photographs: outside all pixels are 0, so that borders would look similar.
    TVSGS_HD bool inside(int at, Vec3f point) const {
        const Vec3f there = pair.other_from_reference * point;
        return there.z > pair.min_depth && in_photo(centre(at), reference) &&
               in_photo(project(pair.other, there), other);
    }

    /// Score of the patch around pixel `at` on the plane with this normal through `point`.
    TVSGS_HD PatchScore<float> score(int at, Vec3f normal, Vec3f point) const {
        return patch_score(pair, centre(at), normal, -dot(normal, point), reference, other, shift);
    }

    TVSGS_HD Vec2f centre(int at) const {
        return {scale.x * (float(at % camera.width_px) + 0.5f),
                scale.y * (float(at / camera.width_px) + 0.5f)};
    }
    TVSGS_HD static bool in_photo(Vec2f p, const GreyBytes& photo) {
        constexpr float kReach = kPatchRadius + 1;
        return p.x > kReach && p.x < float(photo.width) - kReach && p.y > kReach &&
               p.y < float(photo.height) - kReach;
    }
};

/// Both views need their grey photographs. The official code scales pixel indices instead of
/// corners, and so reads half a training pixel off.
template <class Device>
PatchPair patch_pair(const RenderedImages<Device>& images,
                     const DeviceView<Device>& a,
                     const NeighbourView<Device>& other,
                     PixelCenter pixel_center) {
    const DeviceView<Device>& b = other.view();
    const Vec2f scale{float(a.grey_width) / float(a.camera.width_px),
                      float(a.grey_height) / float(a.camera.height_px)};
    return {view_pair(scaled_camera(images.camera, a.grey_width, a.grey_height),
                      scaled_camera(other.images().camera, b.grey_width, b.grey_height),
                      other.pair().min_depth),
            scale,
            pixel_center == PixelCenter::exact ? Vec2f{0.5f, 0.5f} : 0.5f * scale,
            images.camera,
            {a.grey.data(), a.grey_width, a.grey_height},
            {b.grey.data(), b.grey_width, b.grey_height}};
}

}  // namespace tvsgs
