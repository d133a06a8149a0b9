// Finds the pixels that stereo could match, and the areas of such pixels without start points.
#pragma once

#include <vector>

#include "core/scene/scene.h"
#include "optim/photo/sky.h"

namespace tvsgs {

/// Limits of start points per matchable pixel; between them decisions change in proportion.
inline constexpr double kSparseCloud = 0.02, kCoveringCloud = 0.1;
inline double covered_share(double points_per_pixel) {
    const double share = (points_per_pixel - kSparseCloud) / (kCoveringCloud - kSparseCloud);
    return !(share > 0) ? 0 : share < 1 ? share : 1;
}

/// Median; for an even count the lower of the two middle values; NaN if empty. Reorders `values`.
double lower_median(std::vector<double>& values);

/// A point as a view sees it.
struct Sighting {
    int x, y;
    double depth;
    std::size_t point;
};
/// Every `stride`-th point that lies in front of the camera and inside its image.
std::vector<Sighting> sightings(const Camera& camera,
                                const std::vector<Vec3f>& points,
                                std::size_t stride);

/// Median depth; NaN if empty.
double median_depth(const std::vector<Sighting>& seen);

/// Takes every `stride`-th point. Returns the median depth of the points that the camera sees; if
/// it sees none, of the points in front of it; if there are none, 0.
double depth_of_view(const Camera& camera, const std::vector<Vec3f>& points, std::size_t stride);

/// Tells which pixels of a view stereo could match: inside the mask, textured, and inside another
/// view's image. A pixel is textured if the means of 2 x 2 pixels vary by more than noise in 10 x
/// 10 pixels. [docs/method/masks.md#pixels-that-could-be-matched]
class Matchable {
public:
    /// `depth`: rough depth of the view's surface; if it is NaN (not known), other views are not
    /// considered. `sky`: of this view, or null; its far pixels have no surface.
    Matchable(const View& view,
              const std::vector<View>& views,
              bool masks,
              double depth,
              const FarPixels* sky = nullptr);

    bool at(int x, int y) const {
        if (masks_ && view_.mask.at(x, y) < kObjectMask) return false;
        if (sky_ != nullptr && sky_->is_far(x, y)) return false;
        return is_textured(x, y) && is_in_other_view(x, y);
    }

    /// Share of matchable pixels, estimated from a sample.
    double share() const;

    double pixels() const { return double(view_.camera.width_px) * view_.camera.height_px; }

private:
    bool is_textured(int x, int y) const;
    bool is_in_other_view(int x, int y) const;

    static constexpr double kFlat = 2;  // grey levels in full light

    const View& view_;
    double flat_;  // largest deviation of an area without texture, grey levels
    bool masks_;
    double depth_;
    const FarPixels* sky_;
    std::vector<const Camera*> others_;  // cameras that may see this view's surface at depth_
};

/// Open share around each point, 0 to 1: largest share of a near block, in any view, that stereo
/// could match and no point covers in it or beside it. [docs/guide/plan.md#growth-in-gaps]
std::vector<float> open_shares(const std::vector<View>& views,
                               const std::vector<Vec3f>& points,
                               bool masks);

}  // namespace tvsgs
