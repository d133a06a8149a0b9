#include "mesh/draw/mesh_raster.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/device/parallel.h"

namespace tvsgs {
namespace {

constexpr int kBandRows = 8;             // rows per parallel task
constexpr int kFacesPerChunk = 1 << 14;  // faces per parallel task

/// Range of columns and rows that the face can touch; the ends are exclusive.
struct Box {
    int x0 = 0, x1 = 0, y0 = 0, y1 = 0;

    bool empty() const { return x0 >= x1 || y0 >= y1; }
};

int clamp_index(double value, int size) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(size)));
}

/// Vertices in the camera frame.
struct CameraMesh {
    const TriangleMesh& mesh;
    const Camera& camera;
    std::vector<Vec3d> vertices;
    std::vector<double> ray_x;  // per column

    CameraMesh(const TriangleMesh& m, const Camera& c)
        : mesh(m), camera(c), vertices(m.vertices.size()) {
        const Rigid3d camera_from_world{mat_cast<double>(c.camera_from_world.R),
                                        vec_cast<double>(c.camera_from_world.t)};
        parallel_for(Cpu{}, static_cast<int>(vertices.size()), [&](int i) {
            vertices[i] = camera_from_world * vec_cast<double>(m.vertices[i]);
        });
        for (int x = 0; x < c.width_px; ++x)
            ray_x.push_back((x + 0.5 - static_cast<double>(c.cx_px)) / c.fx_px);
    }

    Box box_of(Vec3i face) const {
        const Vec3d v[3] = {vertices[face.x], vertices[face.y], vertices[face.z]};
        const double nearest = std::min({v[0].z, v[1].z, v[2].z});
        const double farthest = std::max({v[0].z, v[1].z, v[2].z});
        if (!(farthest > 0)) return {};
        // Vertices behind the camera have no image. Such faces are rare; their box is the whole
        // image.
        if (!(nearest > 1e-6 * farthest)) return {0, camera.width_px, 0, camera.height_px};
        double min_x = 1e30, max_x = -1e30, min_y = 1e30, max_y = -1e30;
        for (const Vec3d& p : v) {
            const double x = camera.fx_px * p.x / p.z + camera.cx_px,
                         y = camera.fy_px * p.y / p.z + camera.cy_px;
            min_x = std::min(min_x, x), max_x = std::max(max_x, x);
            min_y = std::min(min_y, y), max_y = std::max(max_y, y);
        }
        // Box over pixel centres, widened so that rounding loses none.
        constexpr double kMargin = 1e-3;
        const auto first = [](double low, int size) {
            return clamp_index(std::ceil(low - 0.5 - kMargin), size);
        };
        const auto past = [](double high, int size) {
            return clamp_index(std::floor(high + 0.5 + kMargin), size);
        };
        return {first(min_x, camera.width_px), past(max_x, camera.width_px),
                first(min_y, camera.height_px), past(max_y, camera.height_px)};
    }

    /// Draws the part of a face inside `box`. The ray d through a sample meets the plane of the
    /// vertices v at sum(b v) = z d with b ~ (d.(v1 x v2), d.(v2 x v0), d.(v0 x v1)). This is
    /// perspective-correct without clipping. Two faces compute exactly opposite signs at their
    /// common edge, so there are no gaps.
    void draw(int face, Box box, Hits& hits) const {
        const Vec3i f = mesh.faces[face];
        const Vec3d v[3] = {vertices[f.x], vertices[f.y], vertices[f.z]};
        const Vec3d edges[3] = {cross(v[1], v[2]), cross(v[2], v[0]), cross(v[0], v[1])};
        const double volume = dot(v[0], edges[0]);
        if (volume == 0 || !std::isfinite(volume)) return;  // seen edge-on, or without area
        for (int y = box.y0; y < box.y1; ++y) {
            const double ray_y = (y + 0.5 - static_cast<double>(camera.cy_px)) / camera.fy_px;
            double row[3];
            for (int c = 0; c < 3; ++c) row[c] = ray_y * edges[c].y + edges[c].z;
            for (int x = box.x0; x < box.x1; ++x) {
                double b[3];
                for (int c = 0; c < 3; ++c) b[c] = ray_x[x] * edges[c].x + row[c];
                const bool inside =
                    (b[0] >= 0 && b[1] >= 0 && b[2] >= 0) || (b[0] <= 0 && b[1] <= 0 && b[2] <= 0);
                if (!inside) continue;
                const double sum = b[0] + b[1] + b[2];
                const auto depth = static_cast<float>(volume / sum);
                const std::size_t i = static_cast<std::size_t>(y) * hits.width + x;
                if (!(depth > 0) || !(depth < hits.depth[i])) continue;
                hits.depth[i] = depth;
                if (hits.face.empty()) continue;
                hits.face[i] = face;
                hits.weight[i] = {static_cast<float>(b[1] / sum), static_cast<float>(b[2] / sum)};
            }
        }
    }
};

/// The faces that may touch each band of rows, ascending.
struct Bands {
    std::vector<std::size_t> begin;  // first entry of each band
    std::vector<int> faces;

    Bands(const std::vector<Box>& boxes, int count) : begin(static_cast<std::size_t>(count) + 1) {
        const int face_count = static_cast<int>(boxes.size());
        const int chunks = (face_count + kFacesPerChunk - 1) / kFacesPerChunk;
        std::vector<std::size_t> next(static_cast<std::size_t>(chunks) * count, 0);
        const auto for_each = [&](int chunk, const auto& action) {
            std::size_t* const of = &next[static_cast<std::size_t>(chunk) * count];
            const int end = std::min(face_count, (chunk + 1) * kFacesPerChunk);
            for (int f = chunk * kFacesPerChunk; f < end; ++f)
                if (!boxes[f].empty())
                    for (int band = boxes[f].y0 / kBandRows; band <= (boxes[f].y1 - 1) / kBandRows;
                         ++band)
                        action(of[band], f);
        };
        parallel_for_heavy(Cpu{}, chunks, [&](int chunk) {
            for_each(chunk, [](std::size_t& number, int) { ++number; });
        });
        std::size_t total = 0;
        for (int band = 0; band < count; ++band) {
            begin[band] = total;
            for (int chunk = 0; chunk < chunks; ++chunk) {
                std::size_t& number = next[static_cast<std::size_t>(chunk) * count + band];
                total += std::exchange(number, total);
            }
        }
        begin[count] = total;
        faces.resize(total);
        parallel_for_heavy(Cpu{}, chunks, [&](int chunk) {
            for_each(chunk, [&](std::size_t& at, int f) { faces[at++] = f; });
        });
    }
};

}  // namespace

Hits find_hits(const TriangleMesh& mesh, const Camera& camera, HitParts parts) {
    Hits hits;
    hits.width = camera.width_px, hits.height = camera.height_px;
    const std::size_t samples = static_cast<std::size_t>(hits.width) * hits.height;
    hits.depth.assign(samples, Hits::kNoDepth);
    if (parts == HitParts::all) hits.face.assign(samples, -1), hits.weight.resize(samples);

    const CameraMesh seen(mesh, camera);
    std::vector<Box> boxes(mesh.faces.size());
    parallel_for(Cpu{}, static_cast<int>(boxes.size()),
                 [&](int f) { boxes[f] = seen.box_of(mesh.faces[f]); });
    const int count = (hits.height + kBandRows - 1) / kBandRows;
    const Bands bands(boxes, count);
    parallel_for_heavy(Cpu{}, count, [&](int band) {
        for (std::size_t k = bands.begin[band]; k < bands.begin[band + 1]; ++k) {
            Box box = boxes[bands.faces[k]];
            box.y0 = std::max(box.y0, band * kBandRows);
            box.y1 = std::min(box.y1, (band + 1) * kBandRows);
            seen.draw(bands.faces[k], box, hits);
        }
    });
    return hits;
}

}  // namespace tvsgs
