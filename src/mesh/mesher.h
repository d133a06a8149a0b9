// What makes a surface of splats.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/log.h"
#include "core/scene/mesh.h"
#include "mesh/fuse/depth_views.h"

namespace tvsgs {

/// The part of the world that is meshed: up to the depth limit of DepthViews, or all around a ball.
struct MeshRegion {
    bool unbounded = false;
    // The ball around what the cameras look at, where the detail is; undefined unless unbounded.
    Vec3f centre;
    float radius = 0;
};

/// What a mesher may go by, in the frame of the splats. It lives for one call.
template <class Device>
struct MesherInputs {
    const std::vector<View>& views;
    const Gaussians<Device>& gaussians;
    Backbone<Device>& backbone;
    DepthViews<Device>& depth;  // of `views`, rendered by `backbone`
    MeshRegion region;
    float near;                       // the backbone draws nothing nearer to a camera's plane
    std::int64_t max_bytes;           // that the mesher may take
    const std::string& spill_folder;  // for what does not fit, meanwhile
    spdlog::level::level_enum level;  // of what is said
};

struct ExtractedMesh {
    TriangleMesh mesh;
    std::string why_empty;  // what to do about a mesh without faces; else empty
};

template <class Device>
class Mesher {
public:
    virtual ~Mesher() = default;

    /// The surface with its colours, as it comes: components are cleaned by the caller. Throws
    /// Error.
    virtual ExtractedMesh extract(const MesherInputs<Device>& in) = 0;

    /// Its surfaces are rough, by the noise of what is fused, and worth smoothing.
    virtual bool is_rough() const { return false; }

    /// Its surfaces are closed and bounded; the caller leaves out what would open or extend them.
    virtual bool is_closed() const { return false; }
};

}  // namespace tvsgs
