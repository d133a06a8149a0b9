// What stereo could match, and what points leave open of it.
#pragma once

#include <vector>

#include "core/scene/scene.h"
#include "optim/photo/sky.h"

namespace tvsgs {

/// Start points per pixel that stereo could match. Decisions that depend on how far the cloud
/// covers the views change in proportion between these two bounds.
inline constexpr double kSparseCloud = 0.02, kCoveringCloud = 0.1;
inline double covered_share(double points_per_pixel) {
    const double share = (points_per_pixel - kSparseCloud) / (kCoveringCloud - kSparseCloud);
    return !(share > 0) ? 0 : share < 1 ? share : 1;
}

/// Of an even number the lower one, so that half of them at least are as large; NaN of none.
/// Reorders them.
double lower_median(std::vector<double>& values);

/// Where a point is seen.
struct Sighting {
    int x, y;
    double depth;
    std::size_t point;
};
/// Of every `stride`-th point, those in front of the camera and inside its image.
std::vector<Sighting> sightings(const Camera& camera,
                                const std::vector<Vec3f>& points,
                                std::size_t stride);

/// Their median; NaN of none.
double median_depth(const std::vector<Sighting>& seen);

/// Which pixels of a view stereo could match: inside of the mask, not flat, and where another view
/// looks. Flat is what differs by no more than noise over ten pixels, once blocks of four are one.
/// [docs/method/masks.md#pixels-that-could-be-matched]
class Matchable {
public:
    /// `depth`: of the view's surface, roughly; NaN: not known, and then the other views do not
    /// count. `sky`: of this view, whose far pixels have no surface; null: none is known.
    Matchable(const View& view,
              const std::vector<View>& views,
              bool masks,
              double depth,
              const FarPixels* sky = nullptr);

    bool at(int x, int y) const {
        if (masks_ && view_.mask.at(x, y) < kObjectMask) return false;
        if (sky_ != nullptr && sky_->is_far(x, y)) return false;
        return is_textured(x, y) && is_elsewhere(x, y);
    }

    /// Share of the pixels; of a sample.
    double share() const;

    double pixels() const {
        return static_cast<double>(view_.camera.width_px) * view_.camera.height_px;
    }

private:
    bool is_textured(int x, int y) const;
    bool is_elsewhere(int x, int y) const;

    const View& view_;
    bool masks_;
    double depth_;
    const FarPixels* sky_;
    std::vector<const Camera*> others_;  // those that may see something of that depth
};

/// How far points leave open what lies around each of them, 0 to 1: the share of the pixels of a
/// block near it, in the view where that is largest, that stereo could match, and that no block
/// beside covers; logs how many have any. [docs/guide/plan.md#growth-in-gaps]
std::vector<float> open_shares(const std::vector<View>& views,
                               const std::vector<Vec3f>& points,
                               bool masks);

}  // namespace tvsgs
