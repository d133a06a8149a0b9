#include "eval/benchmark_files.h"

#include <cmath>
#include <filesystem>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "io/mesh/mesh_files.h"

namespace tvsgs {

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
        throw Error(ExitCode::input,
                    out.vertices == 0
                        ? str(path, ": no vertices; nothing to measure")
                        : str(path, ": none of its ", grouped(out.vertices),
                              " vertices is usable: ", grouped(out.dropped), " not finite, ",
                              grouped(out.transparent), " below --min-opacity ", min_opacity));
    spdlog::info("{}: {} {}{}", path, grouped(mesh.vertices.size()),
                 out.is_splats ? "splat centres" : "vertices",
                 out.faces > 0 ? str(", ", grouped(mesh.faces.size()), " faces") : "");
    return out;
}

void require_file(const std::string& path, const std::string& missing) {
    std::error_code error;
    if (!std::filesystem::is_regular_file(path, error))
        throw Error(ExitCode::input, str(path, ": not found\n", missing));
}

std::vector<Vec3d> read_truth(const std::string& path, const std::string& missing) {
    require_file(path, missing);
    std::vector<Vec3d> points = read_mesh_geometry(path).positions;
    const std::size_t bad = std::erase_if(points, [](Vec3d p) { return !is_finite(p); });
    if (bad > 0) spdlog::warn("{}: dropped {} points that are not finite", path, grouped(bad));
    if (points.empty()) throw Error(ExitCode::input, str(path, ": no points to compare with"));
    return points;
}

ErrorPalette find_palette(const std::string& name, ErrorPalette standard) {
    if (name.empty()) return standard;
    return name == "safe"  ? ErrorPalette::safe
           : name == "dtu" ? ErrorPalette::dtu
                           : ErrorPalette::tnt;
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
