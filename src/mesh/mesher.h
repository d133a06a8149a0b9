// Interface of the meshers, which extract a surface from splats.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/scene/mesh.h"
#include "mesh/fuse/depth_views.h"

namespace tvsgs {

/// The part of the world to mesh: up to the depth limit of DepthViews, or everything around a ball.
struct MeshRegion {
    bool unbounded = false;
    // The ball around the focus of the cameras, with full detail; undefined unless unbounded.
    Vec3f centre;
    float radius = 0;
};

/// Inputs of a mesher, in the frame of the splats. Valid for one call.
template <class Device>
struct MesherInputs {
    const std::vector<View>& views;
    const Gaussians<Device>& gaussians;
    Backbone<Device>& backbone;
    DepthViews<Device>& depth;  // of `views`, rendered by `backbone`
    MeshRegion region;
    float near;                       // the backbone draws nothing nearer to a camera's plane
    std::int64_t max_bytes;           // limit of the mesher's memory
    const std::string& spill_folder;  // for temporary files
};

struct ExtractedMesh {
    TriangleMesh mesh;
    std::string why_empty;  // how to get faces if there are none; else empty
};

template <class Device>
class Mesher {
public:
    virtual ~Mesher() = default;

    /// Extracts the surface with its colours. The caller removes components. Throws Error.
    virtual ExtractedMesh extract(const MesherInputs<Device>& in) = 0;

    /// Whether the surface has noise from fusion and should be smoothed.
    virtual bool is_rough() const { return false; }

    /// Its surfaces are closed and bounded; the caller leaves out what would open or extend them.
    virtual bool is_closed() const { return false; }
};

}  // namespace tvsgs
