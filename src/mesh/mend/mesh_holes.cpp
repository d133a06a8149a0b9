#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <utility>

#include "core/device/parallel.h"
#include "mesh/fuse/depth_view.h"
#include "mesh/mend/mend.h"
#include "mesh/mend/mesh_loops.h"

namespace tvsgs {
namespace {

// The filling of a hole continues the surface around it; a filling of a component's outer boundary
// would fold back behind it. Least mean cosine between the two.
constexpr double kMinCosine = 0.5;
constexpr double kSamplesPerPixel = 2;  // along each axis, so that no pixel is missed

/// A hole and its filling.
struct Filling {
    std::size_t loop = 0;
    float pixel = 0;  // length of the finest pixel at its boundary
    Patch patch;
    bool contradicted = false;
};

/// A mesh and its boundary, addressed by places.
struct Surface {
    const TriangleMesh& mesh;
    const MeshBoundary& boundary;
    std::map<int, std::vector<std::size_t>> loops_at;  // of places with several loops, ascending

    Surface(const TriangleMesh& of, const MeshBoundary& its) : mesh(of), boundary(its) {
        for (std::size_t l = 0; l < boundary.loops.size(); ++l)
            for (const int place : boundary.loops[l])
                if (boundary.edge_counts[place] > 2) loops_at[place].push_back(l);
    }
    /// Whether two or more loops pass through both places.
    bool share_loops(int a, int b) const {
        const auto of_a = loops_at.find(a), of_b = loops_at.find(b);
        if (of_a == loops_at.end() || of_b == loops_at.end()) return false;
        std::vector<std::size_t> both;
        std::ranges::set_intersection(of_a->second, of_b->second, std::back_inserter(both));
        return both.size() > 1;
    }
    int vertex(int place) const { return boundary.vertices[place]; }
    Vec3d point(int vertex) const { return vec_cast<double>(mesh.vertices[vertex]); }
};

/// The length of a pixel at a loop that is small enough; else 0.
float pixel_of_small(const Surface& s,
                     const std::vector<int>& loop,
                     const std::vector<Camera>& cameras,
                     float largest_px) {
    if (loop.size() > kMaxHoleEdges) return 0;
    float pixel = 0;
    for (const int place : loop) {
        const float length = pixel_length(cameras, s.mesh.vertices[s.vertex(place)]);
        if (pixel == 0 || length < pixel) pixel = length;
    }
    const double limit = static_cast<double>(largest_px) * static_cast<double>(pixel);
    for (const int a : loop)
        for (const int b : loop)
            if (!(norm(s.point(s.vertex(a)) - s.point(s.vertex(b))) <= limit)) return 0;
    return pixel;
}

bool is_hole(const Surface& s, const std::vector<int>& loop) {
    Vec3d across, around;
    const Vec3d origin = s.point(s.vertex(loop[0]));
    for (std::size_t i = 0; i < loop.size(); ++i) {
        const int next = loop[(i + 1) % loop.size()];
        across += cross(s.point(s.vertex(loop[i])) - origin, s.point(s.vertex(next)) - origin);
        around += s.boundary.normals[loop[i]];
    }
    return dot(across, around) >= kMinCosine * norm(across) * static_cast<double>(loop.size());
}

HoleBoundary boundary_of(const Surface& s, const std::vector<int>& loop) {
    HoleBoundary boundary;
    std::vector<int> vertices;
    for (const int place : loop) vertices.push_back(s.vertex(place));
    std::vector<int> sorted = vertices;
    std::ranges::sort(sorted);
    for (const int v : vertices) {
        boundary.points.push_back(s.point(v));
        boundary.around.emplace_back();
        for (auto at = std::ranges::lower_bound(s.boundary.edges, std::pair{v, -1});
             at != s.boundary.edges.end() && at->first == v; ++at)
            if (!std::ranges::binary_search(sorted, at->second))
                boundary.around.back().push_back(s.point(at->second));
    }
    boundary.may_be_joined = [&s, &loop, vertices](int a, int b) {
        const auto i = std::size_t(a), j = std::size_t(b);
        // Otherwise another hole could use the same edge.
        return !s.boundary.has_edge(vertices[i], vertices[j]) && !s.share_loops(loop[i], loop[j]);
    };
    return boundary;
}

/// Whether all faces have an area and no edge is longer than `longest`, which bounds the number of
/// samples.
bool is_proper(const Patch& patch, double longest) {
    for (const Vec3i& face : patch.faces) {
        const auto corner = [&](int k) { return vec_cast<float>(patch.points[face[k]]); };
        if (!has_area(corner(0), corner(1), corner(2))) return false;
        for (int k = 0; k < 3; ++k)
            if (!(norm(patch.points[face[k]] - patch.points[face[(k + 1) % 3]]) <= longest))
                return false;
    }
    return !patch.faces.empty();
}

/// Samples the filling densely: each pixel that the patch covers gets a sample.
void add_samples(const Filling& filling, std::vector<SurfaceSample>& samples) {
    for (const Vec3i& face : filling.patch.faces) {
        const Vec3d a = filling.patch.points[face.x], ab = filling.patch.points[face.y] - a,
                    ac = filling.patch.points[face.z] - a;
        const double longest = std::max({norm(ab), norm(ac), norm(ac - ab)});
        const int n = std::max(1, static_cast<int>(std::ceil(kSamplesPerPixel * longest /
                                                             static_cast<double>(filling.pixel))));
        const Vec3f normal = vec_cast<float>(cross(ab, ac) / (2.0 * n * n));
        for (int i = 0; i < n; ++i)
            for (int j = 0; i + j < n; ++j)
                for (int half = 0; half < 2 && i + j + half < n; ++half) {
                    const double u = (i + (1 + half) / 3.0) / n, v = (j + (1 + half) / 3.0) / n;
                    samples.push_back({vec_cast<float>(a + u * ab + v * ac), normal});
                }
    }
}

void find_contradictions(std::vector<Filling>& fillings, const EvidenceSource& evidence) {
    std::vector<SurfaceSample> samples;
    std::vector<std::size_t> ends;
    for (const Filling& filling : fillings) {
        add_samples(filling, samples);
        ends.push_back(samples.size());
    }
    gather_evidence(evidence, samples, [&](const std::vector<Judgement>& judged) {
        for (std::size_t i = 0, at = 0; i < fillings.size(); ++i)
            for (; at < ends[i]; ++at) fillings[i].contradicted |= contradicts(judged[at].verdict);
    });
}

void append(const Patch& patch,
            const std::vector<int>& loop,
            const MeshBoundary& boundary,
            TriangleMesh& mesh) {
    std::vector<int> vertices;
    for (const int place : loop) vertices.push_back(boundary.vertices[place]);
    for (std::size_t i = loop.size(); i < patch.points.size(); ++i) {
        vertices.push_back(static_cast<int>(mesh.vertices.size()));
        mesh.vertices.push_back(vec_cast<float>(patch.points[i]));
        if (mesh.colors.empty()) continue;
        Vec3f sum;
        for (int k = 0; k < 3; ++k) sum += mesh.colors[vertices[patch.origins[i - loop.size()][k]]];
        mesh.colors.push_back(sum / 3);
    }
    for (const Vec3i& face : patch.faces)
        mesh.faces.push_back({vertices[face.x], vertices[face.y], vertices[face.z]});
}

}  // namespace

HoleReport close_holes(TriangleMesh& mesh,
                       const SurfaceEdges& edges,
                       const std::vector<Camera>& cameras,
                       const EvidenceSource& evidence,
                       float largest_px) {
    HoleReport report;
    if (!(largest_px > 0)) return report;
    const MeshBoundary boundary = find_boundary(mesh, edges);
    const Surface surface(mesh, boundary);
    report.loops = boundary.loops.size();
    std::vector<float> pixels(boundary.loops.size());
    parallel_for(Cpu{}, static_cast<int>(pixels.size()), [&](int l) {
        pixels[l] = pixel_of_small(surface, boundary.loops[l], cameras, largest_px);
    });
    std::vector<Filling> fillings;
    for (std::size_t l = 0; l < pixels.size(); ++l)
        if (pixels[l] > 0) fillings.push_back({l, pixels[l], {}});
    parallel_for_heavy(Cpu{}, static_cast<int>(fillings.size()), [&](int i) {
        Filling& filling = fillings[i];
        const std::vector<int>& loop = boundary.loops[filling.loop];
        if (is_hole(surface, loop)) filling.patch = make_patch(boundary_of(surface, loop));
    });
    std::erase_if(fillings, [&](const Filling& filling) {
        const bool unfit = !is_proper(
            filling.patch, static_cast<double>(largest_px) * static_cast<double>(filling.pixel));
        report.unfit += unfit;
        return unfit;
    });
    find_contradictions(fillings, evidence);
    for (const Filling& filling : fillings) {
        if (filling.contradicted) {
            ++report.contradicted;
            continue;
        }
        ++report.closed, report.faces += filling.patch.faces.size();
        append(filling.patch, boundary.loops[filling.loop], boundary, mesh);
    }
    return report;
}

}  // namespace tvsgs
