// Coarse to fine: a training may begin with photographs of half the size.
#pragma once

#include <algorithm>
#include <optional>

#include "optim/device_views.h"
#include "optim/train.h"

namespace tvsgs {

/// Means of 2 x 2 pixels; an odd last row or column goes.
inline ImageU8 halved(const ImageU8& image) {
    ImageU8 half(image.width / 2, image.height / 2, image.channels);
    for (int y = 0; y < half.height; ++y)
        for (int x = 0; x < half.width; ++x)
            for (int c = 0; c < half.channels; ++c)
                half.at(x, y, c) = static_cast<std::uint8_t>(
                    (image.at(2 * x, 2 * y, c) + image.at(2 * x + 1, 2 * y, c) +
                     image.at(2 * x, 2 * y + 1, c) + image.at(2 * x + 1, 2 * y + 1, c) + 2) /
                    4);
    return half;
}

/// The camera of the halved photograph.
inline Camera halved(Camera camera) {
    camera.width_px /= 2, camera.height_px /= 2;
    camera.fx_px /= 2, camera.fy_px /= 2;
    camera.cx_px /= 2, camera.cy_px /= 2;  // pixels' centres are at .5
    return camera;
}

/// What training reads of a view.
inline View halved(const View& view) {
    if (std::min(view.camera.width_px, view.camera.height_px) < 2) return view;
    return {view.name, halved(view.camera), halved(view.photo), {}, halved(view.grey)};
}

/// The training views on the device: halved up to the iteration coarse_until, then whole.
template <class Device>
class TrainingViews {
public:
    /// `scene` and `options` have to outlive this.
    TrainingViews(const Scene& scene, const TrainOptions& options)
        : scene_(scene), options_(options) {}

    DeviceViews<Device>& at(int step) {
        const bool coarse = step <= options_.coarse_until;
        if (views_ && coarse == coarse_) return *views_;
        coarse_ = coarse;
        views_.reset();
        halves_.clear();
        if (coarse)
            for (const View& view : scene_.train) halves_.push_back(halved(view));
        views_.emplace(coarse ? halves_ : scene_.train, options_.loss, options_.photo_bytes);
        return *views_;
    }

private:
    const Scene& scene_;
    const TrainOptions& options_;
    bool coarse_ = false;
    std::vector<View> halves_;
    std::optional<DeviceViews<Device>> views_;
};

}  // namespace tvsgs
