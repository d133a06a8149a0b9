#include "mesh/fuse/focus.h"

#include <Eigen/Dense>
#include <algorithm>
#include <limits>

#include "core/math/quantile.h"

namespace tvsgs {
namespace {

// Beyond it, the axes are parallel up to the rounding of the poses.
constexpr double kMaxCondition = 1e8;

Eigen::Vector3d centre(const Camera& camera) {
    const Vec3f c = camera_centre(camera);
    return {c.x, c.y, c.z};
}
Eigen::Vector3d axis(const Camera& camera) {
    const float* row = camera.camera_from_world.R[2];
    return Eigen::Vector3d(row[0], row[1], row[2]).normalized();
}

Focus focus_of(const std::vector<Camera>& cameras, const Eigen::Vector3d& point) {
    double radius = std::numeric_limits<double>::infinity();
    for (const Camera& camera : cameras) radius = std::min(radius, (centre(camera) - point).norm());
    return {{point.x(), point.y(), point.z()}, radius};
}

}  // namespace

std::optional<Focus> find_focus(const std::vector<Camera>& cameras) {
    Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
    Eigen::Vector3d b = Eigen::Vector3d::Zero();
    for (const Camera& camera : cameras) {
        const Eigen::Vector3d d = axis(camera);
        const Eigen::Matrix3d M = Eigen::Matrix3d::Identity() - d * d.transpose();
        A += M, b += M * centre(camera);
    }
    const Eigen::Vector3d eigenvalues =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(A).eigenvalues();
    if (!(eigenvalues[0] * kMaxCondition > eigenvalues[2])) return std::nullopt;
    return focus_of(cameras, A.ldlt().solve(b));
}

Focus focus_at_depth(const std::vector<Camera>& cameras, double depth) {
    Eigen::Vector3d mean_centre = Eigen::Vector3d::Zero(), mean_axis = Eigen::Vector3d::Zero();
    for (const Camera& camera : cameras)
        mean_centre += centre(camera) / static_cast<double>(cameras.size()),
            mean_axis += axis(camera);
    return focus_of(cameras, mean_centre + depth * mean_axis.normalized());
}

double common_radius(const std::vector<Camera>& cameras, const Focus& focus) {
    std::vector<double> radii;
    for (const Camera& camera : cameras) {
        const Vec3f p = camera.camera_from_world * vec_cast<float>(focus.point);
        double radius = std::numeric_limits<double>::infinity();
        // Inner normals of the planes through the camera and the image's edges.
        for (const Vec3f& n : {Vec3f{camera.fx_px, 0, camera.cx_px},
                               Vec3f{-camera.fx_px, 0, float(camera.width_px) - camera.cx_px},
                               Vec3f{0, camera.fy_px, camera.cy_px},
                               Vec3f{0, -camera.fy_px, float(camera.height_px) - camera.cy_px}})
            radius = std::min(radius, static_cast<double>(dot(n, p) / norm(n)));
        if (!(radius > 0)) return 0;
        radii.push_back(radius);
    }
    return quantile(radii, 0.5);
}

double one_sidedness(const std::vector<Camera>& cameras, const Focus& focus) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    const Eigen::Vector3d point(focus.point.x, focus.point.y, focus.point.z);
    for (const Camera& camera : cameras) sum += (centre(camera) - point).normalized();
    return cameras.empty() ? 1 : sum.norm() / static_cast<double>(cameras.size());
}

float voxel_size(
    float given, int resolution, float extent, const std::vector<View>& views, float pixels) {
    if (given > 0) return given;
    if (resolution > 0) return extent / static_cast<float>(resolution);
    float voxels = 2048;  // twice as many as 2DGS and FatesGS
    for (const View& view : views) voxels = std::min(voxels, 2 * view.camera.fx_px / pixels);
    return extent / static_cast<float>(std::max(8, static_cast<int>(voxels)));
}

}  // namespace tvsgs
