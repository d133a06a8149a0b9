// Distances of points to a surface of triangles or points.
#pragma once

#include <limits>
#include <memory>
#include <vector>

#include "core/scene/mesh.h"
#include "eval/surface_samples.h"

namespace tvsgs {

/// A surface that distances are measured to: triangles of a mesh (exact), or points of a cloud.
class Surface {
public:
    Surface() = default;  // empty: all distances are infinite
    /// Drops vertices and points that are not finite. Throws Error(ExitCode::input) for an index
    /// out of range.
    explicit Surface(const TriangleMesh& mesh);
    explicit Surface(const std::vector<Vec3f>& points);
    explicit Surface(const Points& points);

    /// The triangles; empty for a cloud.
    const TriangleTree& triangles() const { return triangles_; }

    /// Distance of each point, or infinity where it is not below `limit`.
    std::vector<double> distances(const Points& points,
                                  double limit = std::numeric_limits<double>::infinity()) const;

private:
    struct Cloud;
    TriangleTree triangles_;
    std::shared_ptr<const Cloud> cloud_;
};

/// All of the points as SamplePoints, without sampling.
SamplePoints all_points(const std::vector<Vec3f>& points);

/// Distance of each point to the nearest of `targets` (not empty).
std::vector<double> nearest_distances(const Points& points, const Points& targets);

}  // namespace tvsgs
