#include "mesh/draw/mesh_render.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/device/parallel.h"

namespace tvsgs {
namespace {

/// The front face at each pixel centre, with barycentric coordinates.
struct Hits {
    int width = 0, height = 0;
    std::vector<float> depth;  // [H W] z-depth, world units; kNoDepth: no hit
    std::vector<int> face;     // [H W] -1: no hit; empty if only depth was requested
    // [H W] of the second and third vertex; empty if only depth was requested.
    std::vector<Vec2f> weight;

    static constexpr float kNoDepth = 1e30f;
};

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

/// Draws both sides of a face. A face that crosses the camera plane is cut there, not dropped. Of
/// two faces at the same depth the first one wins.
Hits find_hits(const TriangleMesh& mesh, const Camera& camera, bool only_depth = false) {
    Hits hits;
    hits.width = camera.width_px, hits.height = camera.height_px;
    const std::size_t samples = static_cast<std::size_t>(hits.width) * hits.height;
    hits.depth.assign(samples, Hits::kNoDepth);
    if (!only_depth) hits.face.assign(samples, -1), hits.weight.resize(samples);

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

/// Interpolates a vertex attribute at a hit.
Vec3f interpolate(const TriangleMesh& mesh,
                  const std::vector<Vec3f>& values,
                  const Hits& hits,
                  std::size_t i) {
    const Vec3i face = mesh.faces[hits.face[i]];
    const Vec2f w = hits.weight[i];
    return (1 - w.x - w.y) * values[face.x] + w.x * values[face.y] + w.y * values[face.z];
}

/// Bilinear texture lookup at a hit.
Vec3f texture_color(const MeshTexture& texture, const Hits& hits, std::size_t i) {
    const Vec3i face = texture.faces[hits.face[i]];
    const Vec2f w = hits.weight[i];
    const auto& places = texture.places;
    const Vec2f place =
        (1 - w.x - w.y) * places[face.x] + w.x * places[face.y] + w.y * places[face.z];
    const ImageU8& image = texture.image;
    const float x = place.x * static_cast<float>(image.width) - 0.5f,
                y = place.y * static_cast<float>(image.height) - 0.5f;
    const float x0 = std::floor(x), y0 = std::floor(y);
    Vec3f sum;
    for (int j = 0; j < 2; ++j)
        for (int k = 0; k < 2; ++k) {
            const int at_x = std::clamp(static_cast<int>(x0) + k, 0, image.width - 1),
                      at_y = std::clamp(static_cast<int>(y0) + j, 0, image.height - 1);
            const float weight = (k ? x - x0 : 1 - x + x0) * (j ? y - y0 : 1 - y + y0) / 255;
            for (int c = 0; c < 3; ++c)
                sum[c] += weight * static_cast<float>(image.at(at_x, at_y, c));
        }
    return sum;
}

Vec3f face_normal(const TriangleMesh& mesh, Vec3i face) {
    const Vec3f a = mesh.vertices[face.x];
    return cross(mesh.vertices[face.y] - a, mesh.vertices[face.z] - a);
}

/// RGB image: shade(sample index) at hits, `background` elsewhere.
template <class Shade>
ImageF shade_samples(const Hits& hits, Vec3f background, const Shade& shade) {
    ImageF color(hits.width, hits.height, 3);
    parallel_for_heavy(Cpu{}, hits.height, [&](int y) {
        for (int x = 0; x < hits.width; ++x) {
            const std::size_t i = static_cast<std::size_t>(y) * hits.width + x;
            const Vec3f value = hits.face[i] >= 0 ? shade(i) : background;
            for (int c = 0; c < 3; ++c) color.at(x, y, c) = value[c];
        }
    });
    return color;
}

}  // namespace

ImageF box_filter(const ImageF& image, int n) {
    if (n == 1) return image;
    ImageF out(image.width / n, image.height / n, image.channels);
    parallel_for_heavy(Cpu{}, out.height, [&](int y) {
        for (int x = 0; x < out.width; ++x)
            for (int c = 0; c < out.channels; ++c) {
                float sum = 0;
                for (int sy = y * n; sy < (y + 1) * n; ++sy)
                    for (int sx = x * n; sx < (x + 1) * n; ++sx) sum += image.at(sx, sy, c);
                out.at(x, y, c) = sum / static_cast<float>(n * n);
            }
    });
    return out;
}

ImageF render_depth(const TriangleMesh& mesh, const Camera& camera) {
    ImageF depth(camera.width_px, camera.height_px, 0);
    depth.channels = 1, depth.pixels = find_hits(mesh, camera, true).depth;
    parallel_for_heavy(Cpu{}, depth.height, [&](int y) {
        for (int x = 0; x < depth.width; ++x)
            if (depth.at(x, y) == Hits::kNoDepth) depth.at(x, y) = 0;
    });
    return depth;
}

Image<int> render_faces(const TriangleMesh& mesh, const Camera& camera) {
    Image<int> faces(camera.width_px, camera.height_px, 0);
    faces.channels = 1, faces.pixels = find_hits(mesh, camera).face;
    return faces;
}

MeshRender render_mesh(const TriangleMesh& mesh,
                       const Camera& camera,
                       const MeshRenderOptions& options,
                       const MeshTexture& texture) {
    const int w = camera.width_px, h = camera.height_px;
    MeshRender out{{}, ImageF(w, h, 1), ImageF(w, h, 3), Image<int>(w, h, 1, -1)};
    const Hits centres = find_hits(mesh, camera);
    const std::vector<Vec3f> normals =
        options.smooth_normals ? vertex_normals(mesh) : std::vector<Vec3f>{};
    parallel_for_heavy(Cpu{}, h, [&](int y) {
        for (int x = 0; x < w; ++x) {
            const std::size_t i = static_cast<std::size_t>(y) * w + x;
            if (centres.face[i] < 0) continue;
            const Vec3f normal_world = options.smooth_normals
                                           ? interpolate(mesh, normals, centres, i)
                                           : face_normal(mesh, mesh.faces[centres.face[i]]);
            const Vec3f normal = normalize(camera.camera_from_world.R * normal_world);
            out.depth.at(x, y) = centres.depth[i];
            out.face.at(x, y) = centres.face[i];
            for (int c = 0; c < 3; ++c) out.normal.at(x, y, c) = normal[c];
        }
    });

    const int n = std::max(1, options.supersampling);
    const Hits fine = n == 1 ? centres : find_hits(mesh, scaled_camera(camera, w * n, h * n));
    out.color = box_filter(shade_samples(fine, options.background,
                                         [&](std::size_t i) {
                                             return !texture.empty()
                                                        ? texture_color(texture, fine, i)
                                                    : mesh.colors.empty()
                                                        ? Vec3f{1, 1, 1}
                                                        : interpolate(mesh, mesh.colors, fine, i);
                                         }),
                           n);
    return out;
}

Camera preview_camera(const TriangleMesh& mesh,
                      const std::vector<Camera>& cameras,
                      int width,
                      int height) {
    Camera camera = cameras[cameras.size() / 2];  // the names' order follows the camera path
    const Mat3f R = camera.camera_from_world.R;
    camera.cx_px = 0.5f * static_cast<float>(width);
    camera.cy_px = 0.5f * static_cast<float>(height);
    const float f =
        std::min(camera.fx_px * static_cast<float>(width) / static_cast<float>(camera.width_px),
                 camera.fy_px * static_cast<float>(height) / static_cast<float>(camera.height_px));
    camera.fx_px = camera.fy_px = f;
    camera.width_px = width, camera.height_px = height;
    if (mesh.vertices.empty()) return camera;

    // 1. Bounds of the central 96 % of the vertices along each camera axis; floaters must not
    // enlarge the frame.
    Vec3f low, high;
    std::vector<float> values(mesh.vertices.size());
    for (int c = 0; c < 3; ++c) {
        for (std::size_t i = 0; i < values.size(); ++i) values[i] = (R * mesh.vertices[i])[c];
        const auto at = [&](double fraction) {
            const auto k =
                static_cast<std::ptrdiff_t>(fraction * static_cast<double>(values.size() - 1));
            std::nth_element(values.begin(), values.begin() + k, values.end());
            return values[k];
        };
        low[c] = at(0.02), high[c] = at(0.98);
    }

    // 2. A camera inside of the bounds, as in a room, stays where it is.
    const Vec3f seen_from = -camera.camera_from_world.t;
    bool amid = true;
    for (int c = 0; c < 3; ++c) amid = amid && seen_from[c] > low[c] && seen_from[c] < high[c];
    if (amid) return camera;

    // 3. Any other camera moves to where the front of the box fits into the image, with a margin.
    constexpr float kMargin = 1.1f;
    const Vec3f half = 0.5f * (high - low);
    const float distance = kMargin * f * std::max(half.x / camera.cx_px, half.y / camera.cy_px);
    const Vec3f middle = 0.5f * (low + high);
    camera.camera_from_world.t = {-middle.x, -middle.y, std::max(distance, 1e-6f) - low.z};
    return camera;
}

ImageU8 preview_mesh(const TriangleMesh& mesh, const Camera& camera, const MeshTexture& texture) {
    constexpr int kSamples = 2;
    constexpr Vec3f kBackground{1, 1, 1}, kGrey{0.75f, 0.75f, 0.75f}, kInside{0.85f, 0.35f, 0.3f};
    const Camera fine_camera =
        scaled_camera(camera, camera.width_px * kSamples, camera.height_px * kSamples);
    const Hits hits = find_hits(mesh, fine_camera);
    const std::vector<Vec3f> normals = vertex_normals(mesh);
    const Vec3f centre = camera_centre(camera);
    const auto shade = [&](std::size_t i) {
        const Vec3f to_camera = normalize(centre - interpolate(mesh, mesh.vertices, hits, i));
        const bool inside = dot(face_normal(mesh, mesh.faces[hits.face[i]]), to_camera) < 0;
        const float facing =
            std::abs(dot(normalize(interpolate(mesh, normals, hits, i)), to_camera));
        const bool plain = texture.empty() && mesh.colors.empty();
        const Vec3f color = inside             ? kInside
                            : plain            ? kGrey
                            : !texture.empty() ? texture_color(texture, hits, i)
                                               : interpolate(mesh, mesh.colors, hits, i);
        // Vertex colours already contain the lighting of the photographs.
        return (plain || inside ? 0.3f + 0.7f * facing : 0.6f + 0.4f * facing) * color;
    };
    return to_8bit(box_filter(shade_samples(hits, kBackground, shade), kSamples));
}

ImageU8 to_8bit(const ImageF& image) {
    ImageU8 out(image.width, image.height, image.channels);
    for (std::size_t i = 0; i < image.pixels.size(); ++i) {
        const float value = image.pixels[i];
        // NaN fails both comparisons and becomes 0.
        out.pixels[i] = static_cast<std::uint8_t>(value >= 1  ? 255
                                                  : value > 0 ? value * 255 + 0.5f
                                                              : 0);
    }
    return out;
}

}  // namespace tvsgs
