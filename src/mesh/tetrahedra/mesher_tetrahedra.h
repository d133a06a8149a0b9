// Tetrahedra mesher: the zero level of an opacity field, in tetrahedra between points around the
// splats. [GOF], docs/method/tetrahedra.md
#pragma once

#include <string>
#include <vector>

#include "core/error.h"
#include "mesh/mesher.h"
#include "mesh/tetrahedra/tetrahedra_steps.h"

namespace tvsgs {

struct TetrahedraMesherOptions {
    float min_opacity = 0.5f;

    template <class Visitor>
    void fields(Visitor& field) {
        field("min_opacity", min_opacity, {0, 1},
              "least opacity of a splat with points; the more opaque half always has them");
    }
};

namespace detail {

/// Points with their tetrahedra; none if why_empty is set.
struct PivotTetrahedra {
    Pivots pivots;
    std::vector<Tetrahedron> tetrahedra;
    std::string why_empty;
};

/// Makes as many points as fit into `max_bytes`; merges close points if necessary. Throws
/// Error(ExitCode::memory) if the memory is too small for any.
PivotTetrahedra pivot_tetrahedra(const FieldSplats<Cpu>& splats,
                                 const FieldViews& views,
                                 const TetrahedraMesherOptions& options,
                                 const DepthRules& rules,
                                 const MeshRegion& region,
                                 std::int64_t max_bytes);

/// Extracts the faces where the field changes sign.
TetrahedraSurface crossed_tetrahedra(const PivotTetrahedra& points,
                                     const std::vector<Sight>& sights);

/// Mean colour of each vertex; the base colour of its splat if no view shows it.
std::vector<Vec3f> mean_colors(const std::vector<ColorSum>& sums,
                               const std::vector<CrossedEdge>& edges,
                               const std::vector<int>& splats,
                               const std::vector<Vec3f>& base_sh);

}  // namespace detail

template <class Device>
class TetrahedraMesher final : public Mesher<Device> {
public:
    explicit TetrahedraMesher(const TetrahedraMesherOptions& options) : options_(options) {}

    ExtractedMesh extract(const MesherInputs<Device>& in) override {
        try {
            return extract_surface(in);
        } catch (const std::bad_alloc&) {  // outside of buffers
            throw Error(ExitCode::memory,
                        "out of host memory while meshing; lower --memory, or stop other programs");
        }
    }

private:
    ExtractedMesh extract_surface(const MesherInputs<Device>& in) {
        const FieldViews views{in.views, in.depth.masks(), in.near};
        FieldSplats<Device> splats;
        detail::PivotTetrahedra points;
        {
            const FieldSplats<Cpu> on_host = field_splats(host_geometry(in.gaussians));
            points = detail::pivot_tetrahedra(on_host, views, options_, in.depth.rules(), in.region,
                                              in.max_bytes);
            copy(on_host, splats);
        }
        ExtractedMesh found;
        found.why_empty = points.why_empty;
        if (!found.why_empty.empty()) return found;

        TetrahedraSurface surface;
        {
            Buffer<Sight, Device> sights;
            see_points(splats, views, to_device<Device>(points.pivots.positions), sights);
            surface = detail::crossed_tetrahedra(points, to_host(sights));
        }
        points.tetrahedra = {};
        if (surface.faces.empty()) {
            found.why_empty = "no visible point is next to a hidden one; are the splats opaque?";
            return found;
        }
        const auto ends = [&](int CrossedEdge::*end) {
            std::vector<Vec3f> positions;
            positions.reserve(surface.edges.size());
            for (const CrossedEdge& edge : surface.edges)
                positions.push_back(points.pivots.positions[static_cast<std::size_t>(edge.*end)]);
            return to_device<Device>(positions);
        };
        auto free_ends = ends(&CrossedEdge::free_end), inside_ends = ends(&CrossedEdge::inside_end);
        find_crossings(splats, views, kBisections, free_ends, inside_ends);
        found.mesh.vertices = to_host(free_ends);
        found.mesh.faces = surface.faces;
        found.mesh.colors = detail::mean_colors(seen_colors(in.depth, free_ends), surface.edges,
                                                points.pivots.splats, base_sh(in.gaussians));
        return found;
    }

    static std::vector<ColorSum> seen_colors(DepthViews<Device>& depth,
                                             const Buffer<Vec3f, Device>& vertices) {
        Buffer<ColorSum, Device> sums(vertices.size());
        sums.fill_zero();
        for (int i = 0; i < depth.size(); ++i) add_colors(depth.view(i), vertices, sums);
        return to_host(sums);
    }

    /// Copies all but the SH coefficients.
    static Gaussians<Cpu> host_geometry(const Gaussians<Device>& gaussians) {
        Gaussians<Cpu> host;
        for_each_array(
            [](const SplatArray& array, const auto& values, auto& copied) {
                if (array.planes == 1) copy(values, copied);
            },
            gaussians, host);
        return host;
    }

    /// The SH coefficients of degree 0.
    static std::vector<Vec3f> base_sh(const Gaussians<Device>& gaussians) {
        return map_on_host(Device{}, gaussians.sh.span().sub(0, gaussians.size()));
    }

    // Halvings of an edge; leaves 1/256 of its length.
    static constexpr int kBisections = 8;

    TetrahedraMesherOptions options_;
};

}  // namespace tvsgs
