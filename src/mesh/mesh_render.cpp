#include "mesh/mesh_render.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/parallel.h"

namespace tvsgs {
namespace {

constexpr int kBandRows = 8;  // rows of one parallel task

/// One sample grid: what is in front at each sample, as face and barycentric coordinates.
struct Hits {
    int width, height;
    std::vector<int> face;      // -1: none
    std::vector<float> depth;   // z-depth
    std::vector<Vec2f> weight;  // of the second and third vertex
};

/// First and past-the-last column and row that the face can touch.
struct Box {
    int x0 = 0, x1 = 0, y0 = 0, y1 = 0;
};

int clamp_index(double value, int size) {
    return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(size)));
}

Box face_box(const Camera& camera, const Vec3d (&v)[3]) {
    const double nearest = std::min({v[0].z, v[1].z, v[2].z});
    const double farthest = std::max({v[0].z, v[1].z, v[2].z});
    if (!(farthest > 0)) return {};
    // Vertices behind the camera have no image; such faces are rare and may be anywhere.
    if (!(nearest > 1e-6 * farthest)) return {0, camera.width_px, 0, camera.height_px};
    double min_x = 1e30, max_x = -1e30, min_y = 1e30, max_y = -1e30;
    for (const Vec3d& p : v) {
        const double x = camera.fx_px * p.x / p.z + camera.cx_px,
                     y = camera.fy_px * p.y / p.z + camera.cy_px;
        min_x = std::min(min_x, x), max_x = std::max(max_x, x);
        min_y = std::min(min_y, y), max_y = std::max(max_y, y);
    }
    // Pixel centres; rounding may not lose one.
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
/// vertices v at sum(b v) = z d with b ~ (d.(v1 x v2), d.(v2 x v0), d.(v0 x v1)):
/// perspective-correct without clipping, and two faces see their common edge with exactly opposite
/// signs, so nothing leaks.
void draw_face(const Camera& camera, const Vec3d (&v)[3], int face, Box box, Hits& hits) {
    const Vec3d edges[3] = {cross(v[1], v[2]), cross(v[2], v[0]), cross(v[0], v[1])};
    const double volume = dot(v[0], edges[0]);
    if (volume == 0 || !std::isfinite(volume)) return;  // seen edge-on, or without area
    for (int y = box.y0; y < box.y1; ++y) {
        const double ray_y = (y + 0.5 - static_cast<double>(camera.cy_px)) / camera.fy_px;
        for (int x = box.x0; x < box.x1; ++x) {
            const Vec3d ray{(x + 0.5 - static_cast<double>(camera.cx_px)) / camera.fx_px, ray_y, 1};
            const double b0 = dot(ray, edges[0]), b1 = dot(ray, edges[1]), b2 = dot(ray, edges[2]);
            const bool inside = (b0 >= 0 && b1 >= 0 && b2 >= 0) || (b0 <= 0 && b1 <= 0 && b2 <= 0);
            if (!inside) continue;
            const double sum = b0 + b1 + b2;
            const auto depth = static_cast<float>(volume / sum);
            const std::size_t i = static_cast<std::size_t>(y) * hits.width + x;
            if (!(depth > 0) || !(depth < hits.depth[i])) continue;
            hits.depth[i] = depth;
            hits.face[i] = face;
            hits.weight[i] = {static_cast<float>(b1 / sum), static_cast<float>(b2 / sum)};
        }
    }
}

Hits find_hits(const TriangleMesh& mesh, const Camera& camera) {
    Hits hits{camera.width_px, camera.height_px, {}, {}, {}};
    const std::size_t samples = static_cast<std::size_t>(hits.width) * hits.height;
    hits.face.assign(samples, -1);
    hits.depth.assign(samples, 1e30f);
    hits.weight.resize(samples);

    const int face_count = static_cast<int>(mesh.faces.size());
    const Rigid3d camera_from_world{mat_cast<double>(camera.camera_from_world.R),
                                    vec_cast<double>(camera.camera_from_world.t)};
    const auto corners = [&](int face, Vec3d(&v)[3]) {
        for (int c = 0; c < 3; ++c)
            v[c] = camera_from_world * vec_cast<double>(mesh.vertices[mesh.faces[face][c]]);
    };
    std::vector<Box> boxes(mesh.faces.size());
    parallel_for(Cpu{}, face_count, [&](int f) {
        Vec3d v[3];
        corners(f, v);
        boxes[f] = face_box(camera, v);
    });

    // Faces of each band in index order: of two faces at the same depth the first wins, always.
    const int bands = (hits.height + kBandRows - 1) / kBandRows;
    std::vector<std::vector<int>> faces_of_band(bands);
    for (int f = 0; f < face_count; ++f) {
        const Box& box = boxes[f];
        if (box.x0 >= box.x1 || box.y0 >= box.y1) continue;
        for (int band = box.y0 / kBandRows; band <= (box.y1 - 1) / kBandRows; ++band)
            faces_of_band[band].push_back(f);
    }
    parallel_for_heavy(Cpu{}, bands, [&](int band) {
        for (const int f : faces_of_band[band]) {
            Vec3d v[3];
            corners(f, v);
            Box box = boxes[f];
            box.y0 = std::max(box.y0, band * kBandRows);
            box.y1 = std::min(box.y1, (band + 1) * kBandRows);
            draw_face(camera, v, f, box, hits);
        }
    });
    return hits;
}

/// Vertex attribute at a hit.
Vec3f interpolate(const TriangleMesh& mesh,
                  const std::vector<Vec3f>& values,
                  const Hits& hits,
                  std::size_t i) {
    const Vec3i face = mesh.faces[hits.face[i]];
    const Vec2f w = hits.weight[i];
    return (1 - w.x - w.y) * values[face.x] + w.x * values[face.y] + w.y * values[face.z];
}

/// The texture there, between its four nearest texels.
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

/// RGB image of shade(sample index) where something was hit and `background` elsewhere.
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
    const Hits hits = find_hits(mesh, camera);
    ImageF depth(hits.width, hits.height, 1);
    for (std::size_t i = 0; i < depth.pixels.size(); ++i)
        if (hits.face[i] >= 0) depth.pixels[i] = hits.depth[i];
    return depth;
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
    Camera camera = cameras[cameras.size() / 2];  // in the order of the names, along the path
    const Mat3f R = camera.camera_from_world.R;
    camera.cx_px = 0.5f * static_cast<float>(width);
    camera.cy_px = 0.5f * static_cast<float>(height);
    const float f =
        std::min(camera.fx_px * static_cast<float>(width) / static_cast<float>(camera.width_px),
                 camera.fy_px * static_cast<float>(height) / static_cast<float>(camera.height_px));
    camera.fx_px = camera.fy_px = f;
    camera.width_px = width, camera.height_px = height;
    if (mesh.vertices.empty()) return camera;

    // 1. The central 96 % of the vertices along each axis of the camera: floaters must not push the
    // object into the distance.
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

    // 2. A camera that stands amid the surface, as in a room, stays there.
    const Vec3f seen_from = -camera.camera_from_world.t;
    bool amid = true;
    for (int c = 0; c < 3; ++c) amid = amid && seen_from[c] > low[c] && seen_from[c] < high[c];
    if (amid) return camera;

    // 3. Else as far away as the front of the box needs to fit, with a margin.
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
        // Colours carry the light of the photographs already.
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
