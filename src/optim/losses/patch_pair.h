// The grey photographs of two views, and the patches that a rendered surface has in both.
#pragma once

#include "optim/losses/multiview_math.h"
#include "optim/views/device_view.h"
#include "optim/views/other_views.h"

namespace tvsgs {

struct PatchPair {
    ViewPair<float> pair;  // lenses of the grey images
    Vec2f scale, shift;  // from the render's corner coordinates to those of the grey image; onwards
    Camera camera;       // of the render
    GreyBytes reference, other;

    /// Whether the patches around pixel `at` and around where `point` (camera frame) is seen lie
    /// in the photographs: beyond them all is 0, and borders would resemble each other.
    TVSGS_HD bool inside(int at, Vec3f point) const {
        const Vec3f there = pair.other_from_reference * point;
        return there.z > pair.min_depth && in_photo(centre(at), reference) &&
               in_photo(project(pair.other, there), other);
    }

    /// How the patch around pixel `at` of the render agrees, on the plane with this normal through
    /// `point` (camera frame).
    TVSGS_HD PatchScore<float> score(int at, Vec3f normal, Vec3f point) const {
        return patch_score(pair, centre(at), normal, -dot(normal, point), reference, other, shift);
    }

    TVSGS_HD Vec2f centre(int at) const {
        return {scale.x * (static_cast<float>(at % camera.width_px) + 0.5f),
                scale.y * (static_cast<float>(at / camera.width_px) + 0.5f)};
    }
    TVSGS_HD static bool in_photo(Vec2f p, const GreyBytes& photo) {
        constexpr float kReach = kPatchRadius + 1;
        return p.x > kReach && p.x < static_cast<float>(photo.width) - kReach && p.y > kReach &&
               p.y < static_cast<float>(photo.height) - kReach;
    }
};

/// Both views need their grey photographs. The official code scales pixel indices, not corners,
/// and so reads half a training pixel off.
template <class Device>
PatchPair patch_pair(const RenderedImages<Device>& images,
                     const DeviceView<Device>& a,
                     const OtherView<Device>& other,
                     PixelCenter pixel_center) {
    const DeviceView<Device>& b = other.view();
    const Vec2f scale{static_cast<float>(a.grey_width) / static_cast<float>(a.camera.width_px),
                      static_cast<float>(a.grey_height) / static_cast<float>(a.camera.height_px)};
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
