#include <algorithm>
#include <bit>
#include <cmath>

#include "core/error.h"
#include "core/version.h"
#include "io/files/atomic_file.h"
#include "io/mesh/mesh_files.h"
#include "io/splats/ply.h"

namespace tvsgs {
namespace {

static_assert(std::endian::native == std::endian::little,
              "PLY files are written in the machine's byte order");

bool is_zero(Vec3d v) {
    return v.x == 0 && v.y == 0 && v.z == 0;
}
const char* position_type(Vec3d origin) {
    return is_zero(origin) ? "float" : "double";
}

/// Writes a file in pieces of one MiB.
class PlyWriter {
public:
    explicit PlyWriter(const std::string& path) : file_(path) {}

    template <class T>
    void put(const T& value) {
        static_assert(std::is_arithmetic_v<T>);
        buffer_.append(reinterpret_cast<const char*>(&value), sizeof value);
        if (buffer_.size() >= 1 << 20) flush();
    }
    void put(const std::string& text) { buffer_ += text; }
    void put(Vec3f v) { put(v.x), put(v.y), put(v.z); }
    /// Position in the frame of the file; double if `origin` is not zero.
    void put_position(Vec3f v, Vec3d origin) {
        if (is_zero(origin)) return put(v);
        const Vec3d p = vec_cast<double>(v) + origin;
        put(p.x), put(p.y), put(p.z);
    }
    void put_color(Vec3f color) {
        for (int c = 0; c < 3; ++c)
            put(static_cast<std::uint8_t>(std::clamp(color[c], 0.0f, 1.0f) * 255 + 0.5f));
    }
    void commit() {
        flush();
        file_.commit();
    }

private:
    void flush() {
        file_.write(buffer_);
        buffer_.clear();
    }
    AtomicFile file_;
    std::string buffer_;
};

enum class Comment { before_count, after_count, none };

/// Viewers expect the number of splats in the third line.
std::string header(std::size_t count,
                   Vec3d origin,
                   Comment comment = Comment::before_count,
                   const std::string& projection = "") {
    const std::string ours =
        str("comment ", kVersion, "\n",
            projection.empty() ? "" : str("comment projection ", projection, "\n"));
    std::string text =
        str("ply\nformat binary_little_endian 1.0\n", comment == Comment::before_count ? ours : "",
            "element vertex ", count, "\n", comment == Comment::after_count ? ours : "");
    for (const char* axis : {"x", "y", "z"})
        text += str("property ", position_type(origin), " ", axis, "\n");
    return text;
}
constexpr const char* kNormals = "property float nx\nproperty float ny\nproperty float nz\n";
constexpr const char* kColors = "property uchar red\nproperty uchar green\nproperty uchar blue\n";

}  // namespace

void write_splat_ply(const std::string& path,
                     const Gaussians<Cpu>& g,
                     Vec3d origin,
                     PlyScales scales,
                     bool signature,
                     const std::string& projection) {
    const std::size_t count = g.means.size();
    const int rest = sh_count(g.sh_degree) - 1;

    std::vector<std::string> names = {"nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"};
    for (int i = 0; i < 3 * rest; ++i) names.push_back(str("f_rest_", i));
    const int scale_count = scales == PlyScales::two ? 2 : 3;
    names.push_back("opacity");
    for (int i = 0; i < scale_count; ++i) names.push_back(str("scale_", i));
    for (int i = 0; i < 4; ++i) names.push_back(str("rot_", i));
    if (!g.filter.empty()) names.push_back("filter_3D");
    check_size(path, g.filter.size(), count, "filters");
    std::string text =
        header(count, origin, signature ? Comment::after_count : Comment::none, projection);
    for (const std::string& name : names) text += "property float " + name + "\n";

    PlyWriter out(path);
    out.put(text + "end_header\n");
    std::vector<float> row(names.size(), 0.0f);
    for (std::size_t i = 0; i < count; ++i) {
        auto to = row.begin();
        const auto put3 = [&](Vec3f v) { to = std::copy_n(&v.x, 3, to); };
        if (!is_finite(g.means[i]))
            throw Error(ExitCode::numerical, path, ": not written: the centre of splat ", i,
                        " is (", g.means[i].x, ", ", g.means[i].y, ", ", g.means[i].z,
                        "); expected finite numbers");
        out.put_position(g.means[i], origin);
        put3({});  // normals
        put3(g.sh[i]);
        for (int c = 0; c < 3; ++c)  // channel major
            for (int k = 1; k <= rest; ++k) *to++ = g.sh[k * count + i][c];
        *to++ = g.opacity_logits[i];
        to = std::copy_n(&g.log_scales[i].x, scale_count, to);
        const Quatf q = g.quats[i];
        for (const float value : {q.w, q.x, q.y, q.z}) *to++ = value;
        if (!g.filter.empty()) *to++ = g.filter[i];
        for (std::size_t p = 0; p < row.size(); ++p) {
            if (!std::isfinite(row[p]))
                throw Error(ExitCode::numerical, path, ": not written: ", names[p], " of splat ", i,
                            " is ", row[p], "; expected a finite number");
            out.put(row[p]);
        }
    }
    out.commit();
}

void write_mesh_ply(const std::string& path,
                    const TriangleMesh& mesh,
                    Vec3d origin,
                    const std::string& projection) {
    check_mesh(path, mesh);
    PlyWriter out(path);
    out.put(str(header(mesh.vertices.size(), origin, Comment::before_count, projection),
                mesh.colors.empty() ? "" : kColors,
                mesh.views.empty() ? "" : "property uchar views\n", "element face ",
                mesh.faces.size(), "\nproperty list uchar int vertex_indices\nend_header\n"));
    for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
        out.put_position(mesh.vertices[i], origin);
        if (!mesh.colors.empty()) out.put_color(mesh.colors[i]);
        if (!mesh.views.empty()) out.put(mesh.views[i]);
    }
    for (const Vec3i face : mesh.faces) {
        out.put(std::uint8_t{3});
        for (int c = 0; c < 3; ++c) out.put(face[c]);
    }
    out.commit();
}

void write_cloud_ply(const std::string& path,
                     const PointCloud& points,
                     Vec3d origin,
                     const std::vector<PlyColumn>& columns) {
    check_finite(path, points.positions, "position");
    check_finite(path, points.colors, "colour");
    check_finite(path, points.normals, "normal");
    check_size(path, points.colors.size(), points.positions.size(), "colours");
    check_size(path, points.normals.size(), points.positions.size(), "normals");
    check_size(path, points.confidences.size(), points.positions.size(), "confidences");
    std::string names = points.confidences.empty() ? "" : "property float confidence\n";
    for (const PlyColumn& column : columns) {
        check_size(path, column.values.size(), points.positions.size(), column.name);
        names += str("property float ", column.name, "\n");
    }
    PlyWriter out(path);
    out.put(str(header(points.positions.size(), origin), points.normals.empty() ? "" : kNormals,
                points.colors.empty() ? "" : kColors, names, "end_header\n"));
    for (std::size_t i = 0; i < points.positions.size(); ++i) {
        out.put_position(points.positions[i], origin);
        if (!points.normals.empty()) out.put(points.normals[i]);
        if (!points.colors.empty()) out.put_color(points.colors[i]);
        if (!points.confidences.empty()) out.put(points.confidences[i]);
        for (const PlyColumn& column : columns) out.put(column.values[i]);
    }
    out.commit();
}

}  // namespace tvsgs
