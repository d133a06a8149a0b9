#include "io/files/read_file.h"
#include "io/mesh/mesh_files.h"

namespace tvsgs {
namespace {

PlyGeometry read_obj(const std::string& path, std::string_view bytes, bool want_colors) {
    PlyGeometry out;
    std::int64_t line_number = 0;
    const auto fail = [&](const auto&... what) {
        throw input_error("E_OBJ: ", path, ": line ", line_number, ": ", what...);
    };
    const auto number = [&](std::string_view word) {
        double value = 0;
        if (!parse_number(word, value)) fail("'", shown(word), "' is not a number");
        return value;
    };
    bool all_colored = true;
    std::string whole;
    while (!bytes.empty()) {
        std::string_view line = next_line(bytes);
        ++line_number;
        if (line.ends_with('\r')) line.remove_suffix(1);
        // A backslash at the end continues the line.
        for (whole.clear(); line.ends_with('\\') && !bytes.empty(); ++line_number) {
            if (whole.empty()) whole = line;
            whole.back() = ' ';
            whole += next_line(bytes);
            if (whole.ends_with('\r')) whole.pop_back();
            line = whole;
        }
        line = line.substr(0, line.find('#'));
        const std::string_view kind = next_word(line);
        if (kind == "v") {
            Vec3d p;
            for (int a = 0; a < 3; ++a) p[a] = number(next_word(line));
            out.positions.push_back(p);
            // Three more numbers are a colour. A single one would be a weight.
            double rest[4];
            int count = 0;
            for (std::string_view word; count < 4 && !(word = next_word(line)).empty();)
                rest[count++] = number(word);
            all_colored = all_colored && count == 3;
            if (want_colors)
                out.colors.push_back(count == 3 ? vec_cast<float>(Vec3d{rest[0], rest[1], rest[2]})
                                                : Vec3f{});
        } else if (kind == "f") {
            Vec3i fan;
            int corners = 0;
            for (std::string_view word; !(word = next_word(line)).empty(); ++corners) {
                std::int64_t vertex = 0;
                if (!parse_number(word.substr(0, word.find('/')), vertex))
                    fail("'", shown(word), "' is not a corner of a face");
                const auto count = static_cast<std::int64_t>(out.positions.size());
                if (vertex == 0 || vertex > count || vertex < -count)
                    fail("a face refers to vertex ", vertex, "; expected 1 to ", count);
                const int i = static_cast<int>(vertex > 0 ? vertex - 1 : count + vertex);
                if (corners >= 2) out.faces.push_back({fan.x, fan.y, i});
                (corners == 0 ? fan.x : fan.y) = i;
            }
            if (corners < 3) fail("a face of ", corners, " corners; expected 3 or more");
        }
    }
    if (out.positions.empty()) throw input_error("E_OBJ: ", path, ": no vertices (v x y z)");
    if (!all_colored) out.colors.clear();
    return out;
}

/// Reads a file whose extension or first bytes show another format than PLY.
std::optional<PlyGeometry> read_other(const std::string& path,
                                      bool want_colors,
                                      EncodedTexture* texture = nullptr) {
    const MeshFormat format = mesh_format(path).value_or(MeshFormat::ply);
    if (format == MeshFormat::ply) return std::nullopt;
    const std::string bytes = read_bytes(path);
    if (std::string_view(bytes).starts_with("glTF"))
        return read_glb(path, bytes, want_colors, texture);
    if (format == MeshFormat::glb)
        throw input_error("E_GLB: ", path, ": not a binary glTF; expected glTF as its first bytes");
    return read_obj(path, bytes, want_colors);
}

}  // namespace

PlyContents read_mesh(const std::string& path,
                      Vec3d origin,
                      bool want_colors,
                      EncodedTexture* texture) {
    std::optional<PlyGeometry> mesh = read_other(path, want_colors, texture);
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
    const std::optional<PlyGeometry> mesh = read_other(path, false);
    return mesh ? *mesh : read_ply_geometry(path);
}

}  // namespace tvsgs
