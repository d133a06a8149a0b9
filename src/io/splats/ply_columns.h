// Writing of point clouds with further properties.
#pragma once

#include "io/splats/ply.h"

namespace tvsgs {

/// A float property with one number per point.
struct PlyColumn {
    const char* name;
    const std::vector<float>& values;
};

/// write_cloud_ply() with `columns` behind the other properties.
void write_cloud_ply(const std::string& path,
                     const PointCloud& points,
                     Vec3d origin,
                     const std::vector<PlyColumn>& columns);

}  // namespace tvsgs
