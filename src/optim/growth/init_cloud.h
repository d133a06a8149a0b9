// Making an initial cloud fit for training: thinning, outliers, a cap, and whether it belongs to
// the scene at all.
#pragma once

#include <string>

#include "core/scene/scene.h"
#include "optim/growth/init.h"

namespace tvsgs {

/// Keeps the entries `indices` of all arrays, in that order.
PointCloud select_points(const PointCloud& cloud, const std::vector<std::size_t>& indices);

/// The mean point of every occupied cube of that edge (world units), normals renormalised.
PointCloud thin_cloud(const PointCloud& cloud, float edge);

/// Thinned with the edge that leaves at most `count` points, and at least nine tenths of that where
/// possible; unchanged when it has no more.
PointCloud thin_to_count(const PointCloud& cloud, std::size_t count);

/// Without points whose root mean square distance to their 20 nearest exceeds the mean of all by
/// two standard deviations.
PointCloud remove_outliers(const PointCloud& cloud);

/// Shares of the points in front of and inside the images of ...
struct CloudVisibility {
    double no_view = 0, two_views = 0;  // none; at least two
};
CloudVisibility cloud_visibility(const PointCloud& cloud, const std::vector<View>& views);

/// Thins a cloud from outside and caps its size, as the options say. `name` is for messages. Throws
/// Error(ExitCode::input) when too few points lie where two training views look.
PointCloud prepare_cloud(PointCloud cloud,
                         const std::vector<View>& views,
                         const InitOptions& options,
                         const std::string& name);

}  // namespace tvsgs
