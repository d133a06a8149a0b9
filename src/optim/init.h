// From a point cloud to the first Gaussians.
#pragma once

#include "core/gaussians.h"
#include "core/options.h"
#include "core/scene.h"

namespace tvsgs {

struct InitOptions {
    float opacity = 0.1f;

    template <class Visitor>
    void fields(Visitor& field) {
        field("opacity", opacity, {0.001, 0.999}, "of every Gaussian at the start");
    }
};

/// One Gaussian per point: isotropic, its standard deviation the root mean square distance to the
/// three nearest other points, at least 1e-3.5 world units; identity rotations; base colour from
/// the point. Points within 1e-2 of a training camera, where directions and projections lose their
/// meaning, are dropped. Throws Error(ExitCode::input) when none is left.
Gaussians<Cpu> init_gaussians(const Scene& scene, const InitOptions& options, int sh_degree);

/// Median distance along the optical axis from a training camera to the initial points in front of
/// it; 0 without any.
float median_depth(const Scene& scene);

/// Mean squared distance to the `k` nearest other points, exact; duplicates count as 0.
std::vector<float> mean_squared_neighbour_distance(const std::vector<Vec3f>& points, int k);

}  // namespace tvsgs
