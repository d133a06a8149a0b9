// Distances of points to a surface: to triangles, or to points.
#pragma once

#include <limits>
#include <memory>
#include <vector>

#include "core/scene/mesh.h"
#include "eval/surface_samples.h"

namespace tvsgs {

/// What distances are measured to: the triangles of a mesh, exactly, or the points of a cloud where
/// there is nothing better.
class Surface {
public:
    Surface();
    /// Vertices and points that are not finite are left out. Throws Error(ExitCode::input) for an
    /// index out of range.
    explicit Surface(const TriangleMesh& mesh);
    explicit Surface(const std::vector<Vec3f>& points);
    explicit Surface(const std::vector<Vec3d>& points);
    Surface(Surface&&) noexcept;
    Surface& operator=(Surface&&) noexcept;
    ~Surface();

    /// No triangles and no points: distances to it are infinite.
    bool empty() const;
    /// The triangles; empty for a cloud.
    const TriangleTree& triangles() const;

    /// Of each point, where that is below `limit`, else infinite.
    std::vector<double> distances(const std::vector<Vec3d>& points,
                                  double limit = std::numeric_limits<double>::infinity()) const;

private:
    struct Cloud;
    TriangleTree triangles_;
    std::unique_ptr<Cloud> cloud_;
};

/// All of the points, not a sample.
SamplePoints all_points(const std::vector<Vec3f>& points);

/// Distance of each point to the nearest of `targets` (not empty).
std::vector<double> nearest_distances(const std::vector<Vec3d>& points,
                                      const std::vector<Vec3d>& targets);

}  // namespace tvsgs
