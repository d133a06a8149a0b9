#include "io/files/read_file.h"
#include "io/mesh/mesh_glb.h"

namespace tvsgs {
namespace {

/// Reads a file whose extension or first bytes show another format than PLY.
std::optional<ReadMesh> read_other(const std::string& path, bool want_colors) {
    const MeshFormat format = mesh_format(path).value_or(MeshFormat::ply);
    if (format == MeshFormat::ply) return std::nullopt;
    const std::string bytes = read_bytes(path);
    if (std::string_view(bytes).starts_with("glTF")) return read_glb(path, bytes, want_colors);
    if (format == MeshFormat::glb)
        throw input_error("E_GLB: ", path, ": not a binary glTF; expected glTF as its first bytes");
    return read_obj(path, bytes, want_colors);
}

}  // namespace

PlyContents read_mesh(const std::string& path, Vec3d origin, bool want_colors) {
    std::optional<ReadMesh> mesh = read_other(path, want_colors);
    if (!mesh) return read_ply(path, origin);
    PlyContents out;
    out.points.positions.reserve(mesh->positions.size());
    for (const Vec3d p : mesh->positions)
        out.points.positions.push_back(vec_cast<float>(p - origin));
    out.points.colors = std::move(mesh->colors);
    out.faces = std::move(mesh->faces);
    return out;
}

PlyGeometry read_mesh_geometry(const std::string& path) {
    std::optional<ReadMesh> mesh = read_other(path, false);
    if (!mesh) return read_ply_geometry(path);
    PlyGeometry out;
    out.positions = std::move(mesh->positions), out.faces = std::move(mesh->faces);
    return out;
}

}  // namespace tvsgs
