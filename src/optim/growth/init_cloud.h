// Prepares an initial point cloud: thinning, outliers, size, and whether it belongs to the scene.
#pragma once

#include <string>

#include "core/scene/scene.h"
#include "optim/growth/init.h"
#include "tv/voting.h"

namespace tvsgs {

/// Returns the points `indices`, in that order.
PointCloud select_points(const PointCloud& cloud, const std::vector<std::size_t>& indices);

/// The mean point of every occupied cube with this edge (world units); renormalises normals.
PointCloud thin_cloud(const PointCloud& cloud, float edge);

/// Thins to at most `count` points, and at least nine tenths of that where possible.
PointCloud thin_to_count(const PointCloud& cloud, std::size_t count);

/// Removes points whose root mean square distance to their 20 nearest points exceeds the mean over
/// all points by two standard deviations.
PointCloud remove_outliers(const PointCloud& cloud);

/// Fractions of the points by the number of views that see them.
struct CloudVisibility {
    double no_view = 0, two_views = 0;  // no view; at least two views
};
CloudVisibility cloud_visibility(const PointCloud& cloud, const std::vector<View>& views);

/// Thins a cloud from a file and limits its size as the options say. `name`: for messages. Throws
/// Error(ExitCode::input) when too few points are seen by two training views.
PointCloud prepare_cloud(PointCloud cloud,
                         const std::vector<View>& views,
                         const InitOptions& options,
                         const std::string& name);

/// Makes voters from measured points, which constrain the votes. Drops points whose position is not
/// finite. A missing or zero normal becomes the normal of the plane through the 12 nearest points.
/// Each point votes as a disc; its radius is the root mean square distance to its three nearest
/// points. Weights are options.fixed_weight times the confidences (1 if absent). Throws
/// Error(ExitCode::input), naming options.fixed_voters, for fewer than three points or a weight
/// that is negative or not finite.
FixedVoters make_fixed_voters(const PointCloud& cloud, const TvOptions& options);

}  // namespace tvsgs
