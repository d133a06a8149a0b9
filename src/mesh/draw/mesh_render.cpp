#include "mesh/draw/mesh_render.h"

#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "mesh/draw/mesh_raster.h"

namespace tvsgs {
namespace {

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
    depth.channels = 1, depth.pixels = find_hits(mesh, camera, HitParts::depth).depth;
    parallel_for_heavy(Cpu{}, depth.height, [&](int y) {
        for (int x = 0; x < depth.width; ++x)
            if (depth.at(x, y) == Hits::kNoDepth) depth.at(x, y) = 0;
    });
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
