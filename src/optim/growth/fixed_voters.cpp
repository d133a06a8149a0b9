#include "optim/growth/fixed_voters.h"

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/math/eigen.h"
#include "core/math/point_tree.h"
#include "optim/growth/init.h"

namespace tvsgs {
namespace {

/// Normal of the plane through point i and the points nearest to it.
Vec3f plane_normal(const std::vector<Vec3f>& points, const PointTree<float>& tree, std::size_t i) {
    constexpr std::size_t kPoints = 13;
    std::size_t index[kPoints];
    float squared[kPoints];
    const std::size_t found =
        tree.nearest(points[i], std::min(kPoints, points.size()), index, squared);
    Vec3<double> mean;
    for (std::size_t j = 0; j < found; ++j) mean += vec_cast<double>(points[index[j]]);
    mean = mean / static_cast<double>(found);
    Sym3<double> scatter;
    for (std::size_t j = 0; j < found; ++j) {
        const Vec3<double> d = vec_cast<double>(points[index[j]]) - mean;
        scatter.xx += d.x * d.x, scatter.xy += d.x * d.y, scatter.xz += d.x * d.z;
        scatter.yy += d.y * d.y, scatter.yz += d.y * d.z, scatter.zz += d.z * d.z;
    }
    return vec_cast<float>(column(sym_eigen(scatter).vectors, 2));
}

}  // namespace

FixedVoters make_fixed_voters(const PointCloud& cloud, const TvOptions& options) {
    const std::string& path = options.fixed_voters;
    FixedVoters voters;
    for (std::size_t i = 0; i < cloud.positions.size(); ++i) {
        if (!is_finite(cloud.positions[i])) continue;
        const float weight = cloud.confidences.empty() ? 1.0f : cloud.confidences[i];
        if (!(weight >= 0 && weight < 1e30f))
            throw Error(ExitCode::input, str(path, ": weight ", weight, " of point ", i,
                                             "; expected a number of at least 0"));
        voters.means.push_back(cloud.positions[i]);
        voters.normals.push_back(cloud.normals.empty() ? Vec3f{} : cloud.normals[i]);
        voters.weights.push_back(options.fixed_weight * weight);
    }
    if (voters.size() < 3)
        throw Error(ExitCode::input,
                    str(path, ": ", voters.size(),
                        " usable points; measured points that vote need at least 3"));
    for (const float squared : mean_squared_neighbour_distance(voters.means, 3))
        voters.scales.push_back(std::sqrt(squared));
    const PointTree<float> tree(voters.means);
    parallel_for(Cpu{}, voters.size(), [&](int i) {
        const auto at = static_cast<std::size_t>(i);
        if (!(dot(voters.normals[at], voters.normals[at]) > 0.5f))
            voters.normals[at] = plane_normal(voters.means, tree, at);
    });
    return voters;
}

}  // namespace tvsgs
