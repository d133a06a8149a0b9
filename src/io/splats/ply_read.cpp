#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "core/grouped.h"
#include "core/log.h"
#include "core/math/smoothing_filter.h"
#include "core/scene/splat_lists.h"
#include "io/splats/ply.h"
#include "io/splats/ply_parser.h"

namespace tvsgs {
namespace {

using ply::Element;
using ply::PlyReader;
using ply::Property;

constexpr float kSh0 = 0.28209479177387814f;  // the constant spherical harmonic

/// Checks the vertex element before its rows are read.
void check_vertices(const PlyReader& in, const Element& vertex) {
    for (const Property& property : vertex.properties)
        if (property.count_type)
            in.header_error("a list, '", shown(property.name), "', in the vertex element");
    if (!vertex.has({"x", "y", "z"})) in.header_error("the vertex element has no x, y and z");
    in.check_count(vertex);
    if (vertex.count > static_cast<std::uint64_t>(std::numeric_limits<int>::max()))
        in.count_error(vertex, "more than 2^31 - 1 rows");
}

const Element& vertex_element(const PlyReader& in) {
    for (const Element& element : in.elements())
        if (element.name == "vertex") return element;
    in.header_error("no vertex element");
}

Vec3d pick(const std::vector<double>& row, Vec3i columns) {
    return {row[columns.x], row[columns.y], row[columns.z]};
}

Vec3i columns_of(const Element& vertex, const std::array<const char*, 3>& names) {
    return {vertex.find(names[0]), vertex.find(names[1]), vertex.find(names[2])};
}

/// NaN becomes 0.
Vec3f clamped_color(Vec3f color) {
    for (int c = 0; c < 3; ++c) color[c] = color[c] > 0 ? std::min(color[c], 1.0f) : 0;
    return color;
}

void read_cloud(PlyReader& in, const Element& vertex, Vec3d origin, PlyContents& out) {
    const Vec3i xyz = columns_of(vertex, {"x", "y", "z"});
    const Vec3i normal{vertex.find({"nx", "normal_x"}), vertex.find({"ny", "normal_y"}),
                       vertex.find({"nz", "normal_z"})};
    Vec3i color{vertex.find({"red", "r", "diffuse_red"}),
                vertex.find({"green", "g", "diffuse_green"}),
                vertex.find({"blue", "b", "diffuse_blue"})};
    const int weight = vertex.find({"confidence", "weight"});
    out.is_splats = vertex.has({"opacity", "scale_0", "rot_0"});
    const auto complete = [](Vec3i c) { return std::min({c.x, c.y, c.z}) >= 0; };
    float scale = 1, offset = 0;
    if (complete(color)) {
        const std::string_view type = vertex.properties[color.x].type->name;
        scale = type == "uchar" ? 1.0f / 255 : type == "ushort" ? 1.0f / 65535 : 1.0f;
    } else if (vertex.has({"f_dc_0", "f_dc_1", "f_dc_2"})) {
        color = columns_of(vertex, {"f_dc_0", "f_dc_1", "f_dc_2"});
        scale = kSh0, offset = 0.5f;
    }
    const auto count = static_cast<std::size_t>(vertex.count);
    PointCloud& points = out.points;
    // Splat files fill the columns of normals with zeros.
    const bool has_normals = complete(normal) && !out.is_splats, has_colors = complete(color);
    points.positions.resize(count);
    if (has_normals) points.normals.resize(count);
    if (weight >= 0) points.confidences.resize(count);
    if (has_colors) points.colors.resize(count);
    in.for_rows(vertex, [&](std::size_t i, const std::vector<double>& row) {
        points.positions[i] = vec_cast<float>(pick(row, xyz) - origin);
        if (has_normals) points.normals[i] = normalize(vec_cast<float>(pick(row, normal)));
        if (weight >= 0) points.confidences[i] = static_cast<float>(row[weight]);
        if (has_colors)
            points.colors[i] = clamped_color(scale * vec_cast<float>(pick(row, color)) +
                                             Vec3f{offset, offset, offset});
    });
}

/// Polygons become fans of triangles.
void read_faces(PlyReader& in,
                const Element& face,
                double vertex_count,
                std::vector<Vec3i>& faces) {
    in.check_count(face);
    const int indices = face.find({"vertex_indices", "vertex_index"});
    if (indices < 0 || !face.properties[indices].count_type)
        in.header_error("the face element has no list vertex_indices");
    std::vector<double> values;
    for (std::uint64_t i = 0; i < face.count; ++i)
        in.read_lists(face, values, [&](int property, const std::vector<double>& list) {
            if (property != indices) return;
            for (const double index : list)
                if (!(index >= 0 && index < vertex_count) || index != std::floor(index))
                    throw input_error("E_PLY_FACE: ", in.path(), ": face ", i, " refers to vertex ",
                                      index, " of ", vertex_count);
            for (std::size_t k = 2; k < list.size(); ++k)
                faces.push_back({static_cast<int>(list[0]), static_cast<int>(list[k - 1]),
                                 static_cast<int>(list[k])});
        });
}

/// Reads the faces, and calls on_vertices(in, element) in the order of the file.
template <class OnVertices>
void read_elements(const std::string& path,
                   std::vector<Vec3i>& faces,
                   const OnVertices& on_vertices) {
    PlyReader in(path);
    const Element& vertex = vertex_element(in);
    for (const Element& element : in.elements()) {
        if (&element == &vertex)
            check_vertices(in, vertex), on_vertices(in, vertex);
        else if (element.name == "face")
            read_faces(in, element, static_cast<double>(vertex.count), faces);
        else
            in.skip(element);
    }
    in.finish();
}

/// Columns of a splat's properties in the vertex element.
struct SplatColumns {
    Vec3i mean, scale, dc;
    std::array<int, 4> rot;
    std::vector<int> rest;  // [3 (K - 1)], channel major, as in the file
    int opacity, filter, file_coefficients;
    int sh_degree = 0;
};

SplatColumns splat_columns(const PlyReader& in, const Element& vertex) {
    if (!vertex.has({"opacity", "scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3", "f_dc_0",
                     "f_dc_1", "f_dc_2"}))
        throw input_error("E_PLY_NOT_SPLAT: ", in.path(),
                          ": not splats, as opacity, scale_*, rot_* or f_dc_* is missing; for a "
                          "cloud use --init-ply");
    SplatColumns c;
    c.mean = columns_of(vertex, {"x", "y", "z"});
    c.scale = columns_of(vertex, {"scale_0", "scale_1", "scale_2"});
    c.dc = columns_of(vertex, {"f_dc_0", "f_dc_1", "f_dc_2"});
    c.rot = {vertex.find("rot_0"), vertex.find("rot_1"), vertex.find("rot_2"),
             vertex.find("rot_3")};
    c.opacity = vertex.find("opacity"), c.filter = vertex.find("filter_3D");
    for (int i = 0; vertex.find(str("f_rest_", i)) >= 0; ++i)
        c.rest.push_back(vertex.find(str("f_rest_", i)));
    const auto named = std::ranges::count_if(vertex.properties,
                                             [](auto& p) { return p.name.starts_with("f_rest_"); });
    const std::size_t rest = c.rest.size();
    if (static_cast<std::size_t>(named) != rest ||
        (rest != 0 && rest != 9 && rest != 24 && rest != 45 && rest != 72))
        in.header_error(
            named, " properties f_rest_*; expected f_rest_0 to f_rest_8, 23, 44 or 71, or none");
    c.file_coefficients = static_cast<int>(rest / 3);
    while (c.sh_degree < 3 && sh_count(c.sh_degree) < c.file_coefficients + 1) ++c.sh_degree;
    if (rest == 72)
        spdlog::warn("{}: uses SH coefficients up to degree 3, the file has degree 4", in.path());
    return c;
}

}  // namespace

PlyContents read_ply(const std::string& path, Vec3d origin) {
    PlyContents out;
    read_elements(path, out.faces, [&](PlyReader& in, const Element& vertex) {
        read_cloud(in, vertex, origin, out);
    });
    return out;
}

PlyGeometry read_ply_geometry(const std::string& path) {
    PlyGeometry out;
    read_elements(path, out.faces, [&](PlyReader& in, const Element& vertex) {
        out.is_splats = vertex.has({"opacity", "scale_0", "rot_0"});
        const Vec3i xyz = columns_of(vertex, {"x", "y", "z"});
        const auto opacity = static_cast<std::size_t>(vertex.find("opacity"));
        out.positions.resize(static_cast<std::size_t>(vertex.count));
        if (out.is_splats) out.opacity_logits.resize(out.positions.size());
        in.for_rows(vertex, [&](std::size_t i, const std::vector<double>& row) {
            out.positions[i] = pick(row, xyz);
            if (out.is_splats) out.opacity_logits[i] = static_cast<float>(row[opacity]);
        });
    });
    return out;
}

PlyScales read_ply_scales(const std::string& path) {
    std::string header(PlyReader::kMaxHeader, '\0');
    header.resize(std::fread(header.data(), 1, header.size(), open_file(path).get()));
    const PlyReader in(path, std::move(header));
    const Element& vertex = vertex_element(in);
    return vertex.find("scale_0") >= 0 && vertex.find("scale_2") < 0 ? PlyScales::two
                                                                     : PlyScales::three;
}

Gaussians<Cpu> read_splat_ply(const std::string& path, Vec3d origin, PlyScales* scales) {
    PlyReader in(path);
    const Element& vertex = vertex_element(in);
    check_vertices(in, vertex);
    const SplatColumns columns = splat_columns(in, vertex);
    const bool flat = columns.scale.z < 0;
    if (scales) *scales = flat ? PlyScales::two : PlyScales::three;
    for (const Element& element : in.elements()) {
        if (&element == &vertex) break;
        in.skip(element);
    }
    in.check_count(vertex);

    const std::size_t rows = static_cast<std::size_t>(vertex.count);
    const auto per_splat = static_cast<std::size_t>(sh_count(columns.sh_degree));
    Gaussians<Cpu> out;
    resize(out, static_cast<int>(rows), columns.sh_degree);
    std::vector<char> usable(rows), activated(rows);
    in.for_rows(vertex, [&](std::size_t i, const std::vector<double>& row) {
        const auto value = [&](int column) { return static_cast<float>(row[column]); };
        Vec3f log_scale{value(columns.scale.x), value(columns.scale.y), 0};
        // Discs have no third scale, and a scale of zero has no finite logarithm. Both become a
        // millionth of the largest scale.
        if (!flat) log_scale.z = value(columns.scale.z);
        const float thin = std::max({log_scale.x, log_scale.y, flat ? log_scale.x : log_scale.z}) +
                           std::log(1e-6f);
        if (flat) log_scale.z = thin;
        for (int c = 0; c < 3; ++c)
            if (log_scale[c] == -std::numeric_limits<float>::infinity()) log_scale[c] = thin;
        // Infinite logits are valid: fully opaque or transparent, as is 30 in float.
        float opacity = value(columns.opacity);
        if (std::isinf(opacity)) opacity = std::copysign(30.0f, opacity);
        activated[i] = opacity >= 0 && opacity <= 1 && log_scale.x > 0 && log_scale.y > 0;
        if (columns.filter >= 0) {
            // Applies mip-splatting's 3D filter: larger scales, lower opacity.  [Yu24]
            const auto smooth = smoothed(vec_cast<double>(log_scale), row[columns.filter]);
            for (int c = 0; c < 3; ++c)
                log_scale[c] = static_cast<float>(std::log(smooth.scales[c]));
            const double alpha = smooth.dimming / (1 + std::exp(-double{opacity}));
            opacity = static_cast<float>(std::log(alpha / (1 - alpha)));
        }
        const Quatf quat{value(columns.rot[0]), value(columns.rot[1]), value(columns.rot[2]),
                         value(columns.rot[3])};
        const auto mean = vec_cast<float>(pick(row, columns.mean) - origin);
        bool finite = is_finite(mean) && is_finite(log_scale) && std::isfinite(opacity);
        finite = finite && is_finite(Vec3f{quat.x, quat.y, quat.z}) && std::isfinite(quat.w);
        for (std::size_t k = 0; k < per_splat; ++k) {
            Vec3f coefficient;
            for (int c = 0; c < 3; ++c)
                coefficient[c] = value(
                    k == 0 ? columns.dc[c] : columns.rest[c * columns.file_coefficients + k - 1]);
            finite = finite && is_finite(coefficient);
            out.sh[k * rows + i] = coefficient;
        }
        usable[i] = finite && !(quat.w == 0 && quat.x == 0 && quat.y == 0 && quat.z == 0);
        out.means[i] = mean, out.log_scales[i] = log_scale, out.quats[i] = quat;
        out.opacity_logits[i] = opacity;
    });
    if (&vertex == &in.elements().back()) in.finish();
    const std::vector<int> numbers =
        indices_where(rows, [&](std::size_t i) { return usable[i] != 0; });
    const std::size_t count = numbers.size();
    if (count < rows)
        spdlog::warn("{}: dropped {} of {} splats: not finite, or a zero quaternion", path,
                     grouped(rows - count), grouped(rows));
    if (rows > 0 && std::ranges::find(activated, 0) == activated.end())
        spdlog::warn(
            "{}: all opacities are in [0, 1] and all scales positive; expected logits and "
            "logarithms",
            path);

    if (count < rows) keep_splats(numbers, out);
    return out;
}

}  // namespace tvsgs
