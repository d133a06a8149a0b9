// Puts a model into metres: at its true place by pairs of points in both frames, without outliers,
// or upright by square markers of known size in several photographs.
// [docs/guide/photographs.md#true-scale-and-place, docs/guide/photographs.md#markers]
#pragma once

#include <string>
#include <vector>

#include "apps/prepare/opencv.h"
#include "apps/prepare/photographs.h"
#include "apps/prepare/sparse_model.h"
#include "core/math/rigid.h"
#include "io/files/json_value.h"
#include "io/images/image_file.h"

namespace tvsgs::prepare {

/// The similarity that fits all pairs except outliers.
struct Fit {
    Affine3d world_from_model;
    std::vector<bool> inlier;  // one per pair
    double rmse = 0;           // of the inliers, metres
};

/// Tries similarities through three pairs each (all triples, or 2,000 random ones) and takes the
/// one for which the residual of the best two thirds of the pairs is smallest. Then fits all pairs
/// below a limit, until they stay the same; the limit is `tolerance` (metres) or a multiple of that
/// residual, 2.5 (1 + 5 / (n - 3)), the larger one. [Rousseeuw87] `where` begins messages. Throws
/// Error(ExitCode::input) for fewer than 3 pairs, and if all lie on one line. Its caller logs the
/// residuals, then calls check_fit().
Fit fit_without_outliers(const std::vector<Vec3d>& model,
                         const std::vector<Vec3d>& world,
                         double tolerance,
                         const std::string& where);

/// Throws Error(ExitCode::input) if the places (metres) do not determine the rotation around the
/// line through them: they spread across it by less than 2 % of the spread along it, or so little
/// that the errors (metres, one per place or none) across both directions turn them by 10 degrees.
void require_rotation(const std::vector<Vec3d>& places,
                      const std::vector<Vec3d>& errors,
                      const std::string& where);

/// The same for a fit. Warns if its residuals leave the scale unknown by more than 1 %.
void check_fit(const Fit& fit,
               const std::vector<Vec3d>& model,
               const std::vector<Vec3d>& world,
               const std::string& where);

/// East, north and up, in metres, from a point on the ellipsoid of WGS84.
class LocalFrame {
public:
    /// At the median of the places.
    explicit LocalFrame(const std::vector<GeodeticPlace>& places);

    Vec3d operator()(const GeodeticPlace& place) const;
    /// As a pipeline of PROJ.
    std::string projection() const;

private:
    GeodeticPlace origin_;
    Vec3d centre_;  // of the frame, from the Earth's
    Mat3<double> local_from_earth_;
};

/// Result of placing a model.
struct GeoFrame {
    Similarity to_world;  // from the model to metres
    std::string projection;
    JsonValue report;  // for prepare.json
};

GeoFrame geo_frame(const Fit& fit, std::string projection);

/// Throws Error(ExitCode::input) if fewer than three photographs have a place.
void require_places(const std::vector<Photograph>& photographs, const std::string& folder);

/// Fits the centres of the cameras to the places in EXIF, in a local frame.
GeoFrame place_by_exif(const SparseModel& model, const std::vector<Photograph>& photographs);

struct MarkerView {
    Intrinsics camera;
    Rigid3d camera_from_world;
    std::vector<Marker> markers;
};

struct MetricFrame {
    // metres; z up; the origin at the centre of the marker with the lowest number.
    Similarity to_new;
    int markers = 0;    // number of markers used
    double spread = 0;  // standard deviation of their sides, relative to the size
    // False: a marker deviates from the mean direction by 15 degrees or more, so only the scale is
    // used.
    bool upright = false;
};

/// `size`: side of a marker in metres. Markers lie on a floor (up is out of the paper) or hang on a
/// wall (up is up on the paper). A corner is the point nearest to its rays. Skips markers whose
/// rays differ by less than 2 degrees, and markers whose sides differ by more than a tenth. Throws
/// Error(ExitCode::input) if none is left.
MetricFrame metric_frame(const std::vector<MarkerView>& views, double size, bool on_wall);

}  // namespace tvsgs::prepare
