// The evaluation protocol of the Tanks and Temples benchmark, in double precision.  [Knapitsch17]
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "eval/dtu_protocol.h"
#include "eval/registration.h"

namespace tvsgs {

/// Refines in three stages of ICP, each from the last result: crops both clouds and thins them to
/// voxels of tau, tau / 2, and then to every k-th point (at most about 4 million); partners within
/// 80, 20 and 2 tau. `intended`: uses the 20 iterations that the official script specifies but does
/// not get.
struct IcpRefinement {
    Affine3d truth_from_prediction;
    std::vector<IcpResult> stages;
};
IcpRefinement refine_by_icp(const Points& prediction,
                            const Points& truth_cropped,
                            const Crop& crop,
                            const Affine3d& start,
                            double tau,
                            bool intended);

struct TntMetrics {
    double precision = 0, recall = 0, f1 = 0;  // fractions strictly closer than tau
    std::int64_t prediction_cropped = 0, truth_cropped = 0;
    MeasuredPoints prediction, truth;  // one mean per voxel
    std::string undefined;             // the cloud that the crop left empty; empty: none
    // Cumulative shares of points at or below edges[i + 1], as in the official plots.
    std::vector<double> edges, precision_curve, recall_curve;
};

/// Crops both clouds (in the frame of the truth), takes the mean per voxel (voxel 0: all points)
/// and compares them.
TntMetrics evaluate_tnt(
    const Points& prediction, const Points& truth, const Crop& crop, double tau, double voxel);

}  // namespace tvsgs
