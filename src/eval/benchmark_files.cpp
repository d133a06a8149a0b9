#include "eval/benchmark_files.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "io/files/read_file.h"
#include "io/mesh/mesh_files.h"

namespace tvsgs {
namespace {

/// matplotlib's "hot": black, red, yellow, white.
Vec3f hot(float x) {
    const auto ramp = [x](float from, float to, float low) {
        return std::clamp(low + (1 - low) * (x - from) / (to - from), low, 1.0f);
    };
    return {ramp(0, 0.365079f, 0.0416f), ramp(0.365079f, 0.746032f, 0), ramp(0.746032f, 1, 0)};
}

/// matplotlib's "cividis" at nine places, linear between them.
Vec3f cividis(float x) {
    constexpr Vec3f kStops[] = {
        {0.0f, 0.135f, 0.305f},   {0.105f, 0.227f, 0.440f}, {0.263f, 0.307f, 0.424f},
        {0.373f, 0.392f, 0.434f}, {0.485f, 0.480f, 0.471f}, {0.603f, 0.571f, 0.464f},
        {0.729f, 0.670f, 0.427f}, {0.862f, 0.780f, 0.351f}, {0.996f, 0.909f, 0.218f}};
    const float at = x * 8;
    const int i = std::min(static_cast<int>(at), 7);
    const float t = at - static_cast<float>(i);
    return (1 - t) * kStops[i] + t * kStops[i + 1];
}

}  // namespace

void keep_vertices(PreciseMesh& mesh, const std::vector<char>& keep) {
    std::vector<int> new_index(mesh.vertices.size(), -1);
    int kept = 0;
    for (std::size_t i = 0; i < keep.size(); ++i)
        if (keep[i]) {
            mesh.vertices[kept] = mesh.vertices[i];
            new_index[i] = kept++;
        }
    mesh.vertices.resize(kept);
    std::erase_if(mesh.faces, [&](Vec3i& face) {
        for (int k = 0; k < 3; ++k) face[k] = new_index[face[k]];
        return face.x < 0 || face.y < 0 || face.z < 0;
    });
}

std::size_t drop_non_finite(PreciseMesh& mesh) {
    const std::size_t before = mesh.vertices.size();
    std::vector<char> keep;
    for (const Vec3d v : mesh.vertices) keep.push_back(is_finite(v));
    keep_vertices(mesh, keep);
    return before - mesh.vertices.size();
}

ImageU8 dilated(const ImageU8& mask, int radius) {
    const int width = mask.width, height = mask.height, far = radius + 1;
    // Distance along the row to the nearest set pixel, at most `far`.
    std::vector<int> along(std::size_t(width) * height);
    const auto at = [width](int x, int y) { return std::size_t(y) * width + x; };
    parallel_for_heavy(Cpu{}, height, [&](int y) {
        for (int x = 0, d = far; x < width; ++x)
            along[at(x, y)] = d = mask.at(x, y) != 0 ? 0 : std::min(d + 1, far);
        for (int x = width - 1, d = far; x >= 0; --x) {
            d = mask.at(x, y) != 0 ? 0 : std::min(d + 1, far);
            along[at(x, y)] = std::min(along[at(x, y)], d);
        }
    });
    ImageU8 out(width, height, 1);
    parallel_for_heavy(Cpu{}, height, [&](int y) {
        const int first = std::max(0, y - radius), last = std::min(height - 1, y + radius);
        for (int row = first; row <= last; ++row) {
            const int left = radius * radius - (row - y) * (row - y);
            const int* const reach = &along[at(0, row)];
            std::uint8_t* const to = &out.pixels[at(0, y)];
            for (int x = 0; x < width; ++x)
                to[x] |= static_cast<std::uint8_t>(reach[x] * reach[x] <= left ? 255 : 0);
        }
    });
    return out;
}

std::vector<std::size_t> cull_by_masks(PreciseMesh& mesh,
                                       const std::vector<MaskView>& views,
                                       int radius) {
    std::vector<char> keep(mesh.vertices.size(), 1), on_mask(mesh.vertices.size());
    std::vector<std::size_t> removed;
    for (const MaskView& view : views) {
        const ImageU8 mask = dilated(view.mask, radius);
        parallel_for(Cpu{}, static_cast<int>(mesh.vertices.size()), [&](int i) {
            const Vec3d p = mesh.vertices[i];
            const double z = dot(view.rows[2], p) + view.last.z;
            const double x = (dot(view.rows[0], p) + view.last.x) / (z + 1e-6),
                         y = (dot(view.rows[1], p) + view.last.y) / (z + 1e-6);
            const bool inside = z > 0 && x > 0 && x < mask.width - 1 && y > 0 &&
                                y < mask.height - 1;  // false behind the camera
            on_mask[i] = !inside || mask.at(static_cast<int>(std::nearbyint(x)),
                                            static_cast<int>(std::nearbyint(y))) != 0;
        });
        removed.push_back(std::ranges::count(on_mask, 0));
        for (std::size_t v = 0; v < keep.size(); ++v) keep[v] &= on_mask[v];
    }
    keep_vertices(mesh, keep);
    return removed;
}

Prediction read_prediction(const std::string& path, double min_opacity) {
    PlyGeometry ply = read_mesh_geometry(path);
    Prediction out{{std::move(ply.positions), std::move(ply.faces)}, ply.is_splats, 0, 0, 0, 0};
    PreciseMesh& mesh = out.mesh;
    out.vertices = mesh.vertices.size(), out.faces = mesh.faces.size();
    if (out.is_splats && min_opacity > 0) {
        std::vector<char> keep(out.vertices);
        for (std::size_t i = 0; i < keep.size(); ++i)
            keep[i] = 1 / (1 + std::exp(-double{ply.opacity_logits[i]})) >= min_opacity;
        keep_vertices(mesh, keep);
        out.transparent = out.vertices - mesh.vertices.size();
    }
    out.dropped = drop_non_finite(mesh);
    if (out.dropped > 0)
        spdlog::warn("{}: dropped {} vertices that are not finite, and their faces", path,
                     grouped(out.dropped));
    if (mesh.vertices.empty())
        throw out.vertices == 0
            ? input_error(path, ": no vertices; nothing to measure")
            : input_error(path, ": none of its ", grouped(out.vertices),
                          " vertices is usable: ", grouped(out.dropped), " not finite, ",
                          grouped(out.transparent), " below --min-opacity ", min_opacity);
    spdlog::info("{}: {} {}{}", path, grouped(mesh.vertices.size()),
                 out.is_splats ? "splat centres" : "vertices",
                 out.faces > 0 ? str(", ", grouped(mesh.faces.size()), " faces") : "");
    return out;
}

void require_file(const std::string& path, const std::string& missing) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error))
        throw input_error(path, ": not found\n", missing);
}

Points read_truth(const std::string& path, const std::string& missing) {
    require_file(path, missing);
    Points points = read_mesh_geometry(path).positions;
    const std::size_t bad = std::erase_if(points, [](Vec3d p) { return !is_finite(p); });
    if (bad > 0) spdlog::warn("{}: dropped {} points that are not finite", path, grouped(bad));
    if (points.empty()) throw input_error(path, ": no points to compare with");
    return points;
}

FrameCheck check_frame(const Points& prediction, const Points& truth) {
    FrameCheck check;
    double size[2];
    Vec3d centre[2];
    for (const int side : {0, 1}) {
        const Points& points = side == 0 ? prediction : truth;
        const std::size_t stride = points.size() / 100000 + 1;  // enough for a percentile
        for (int axis = 0; axis < 3; ++axis) {
            std::vector<double> values;
            for (std::size_t i = 0; i < points.size(); i += stride)
                values.push_back(points[i][axis]);
            const auto percentile = [&](double share) {
                const auto at =
                    values.begin() +
                    static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
                std::nth_element(values.begin(), at, values.end());
                return *at;
            };
            check.lower[side][axis] = percentile(0.05);
            check.upper[side][axis] = percentile(0.95);
        }
        size[side] = norm(check.upper[side] - check.lower[side]);
        centre[side] = 0.5 * (check.upper[side] + check.lower[side]);
    }
    check.offset = centre[0] - centre[1];
    // A single point has no size to compare.
    if (size[0] > 0 && size[1] > 0) check.size_ratio = size[0] / size[1];
    for (int axis = 0; axis < 3; ++axis) {
        // Surfaces can be flat along an axis: allow a tenth of the truth's size.
        const double slack = 0.1 * size[1];
        check.apart |= check.lower[0][axis] > check.upper[1][axis] + slack ||
                       check.lower[1][axis] > check.upper[0][axis] + slack;
    }
    return check;
}

std::string FrameCheck::text() const {
    return str("the prediction spans ", point_text(lower[0]), " to ", point_text(upper[0]),
               ", the truth ", point_text(lower[1]), " to ", point_text(upper[1]),
               "; its centre is off by ", point_text(offset), ", ", norm(offset),
               " in all, and it is ", size_ratio, " times as large");
}

Vec3f error_color(ErrorPalette palette, double error, double full, PointStatus status) {
    if (status == PointStatus::excluded || !std::isfinite(error))
        return palette == ErrorPalette::safe ? Vec3f{0.6f, 0.6f, 0.6f} : Vec3f{0, 0, 1};
    if (status == PointStatus::outlier && palette == ErrorPalette::dtu) return {0, 1, 0};
    if (status == PointStatus::outlier && palette == ErrorPalette::safe) return {0.84f, 0.37f, 0};
    const auto x = static_cast<float>(std::clamp(error / full, 0.0, 1.0));
    if (palette == ErrorPalette::dtu) return {1, 1 - x, 1 - x};
    return palette == ErrorPalette::tnt ? hot(1 - x) : cividis(x);
}

ErrorPalette find_palette(const std::string& name, ErrorPalette standard) {
    static const std::map<std::string, ErrorPalette> kPalettes{
        {"dtu", ErrorPalette::dtu}, {"tnt", ErrorPalette::tnt}, {"safe", ErrorPalette::safe}};
    return name.empty() ? standard : kPalettes.at(name);
}

void write_error_cloud(const std::string& path,
                       const MeasuredPoints& points,
                       ErrorPalette palette,
                       double full) {
    PointCloud cloud;
    for (std::size_t i = 0; i < points.points.size(); ++i) {
        cloud.positions.push_back(vec_cast<float>(points.points[i]));
        cloud.colors.push_back(error_color(palette, points.distances[i], full, points.statuses[i]));
    }
    write_cloud_ply(path, cloud);
    spdlog::info("Cloud coloured by error: {}, {} points", path, grouped(cloud.positions.size()));
}

}  // namespace tvsgs
