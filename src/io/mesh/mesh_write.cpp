#include <zlib.h>

#include <cctype>
#include <charconv>
#include <cstring>
#include <deque>
#include <filesystem>

#include "core/error.h"
#include "core/version.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "io/mesh/mesh_files.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr int kQuality = 90;  // of JPEG and WebP

/// Shortest text that reads back as the same number, independent of the locale.
template <class Real>
void put_number(std::string& out, Real value) {
    char digits[40];
    out.append(digits, std::to_chars(digits, digits + sizeof digits, value).ptr);
}

std::string be32(std::uint32_t value) {
    std::string bytes;
    for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift & 0xff);
    return bytes;
}

/// The encoded image with the signature of tvsgs in its metadata.
std::string with_signature(std::string bytes, TextureFormat format) {
    const std::string name = kVersion;
    if (format == TextureFormat::jpeg) {  // as a comment after the first segment
        constexpr std::size_t kAfterJfif = 20;
        const std::size_t length = name.size() + 2;
        bytes.insert(kAfterJfif, std::string("\xff\xfe") + static_cast<char>(length >> 8) +
                                     static_cast<char>(length & 0xff) + name);
    } else {  // as a text chunk after the header
        constexpr std::size_t kAfterHeader = 33;
        const std::string text = std::string("tEXtSoftware") + '\0' + name;
        const uLong sum =
            crc32(0, reinterpret_cast<const Bytef*>(text.data()), static_cast<uInt>(text.size()));
        bytes.insert(kAfterHeader, be32(static_cast<std::uint32_t>(text.size() - 4)) + text +
                                       be32(static_cast<std::uint32_t>(sum)));
    }
    return bytes;
}

const char* extension_of(TextureFormat format) {
    return format == TextureFormat::jpeg ? ".jpg" : format == TextureFormat::png ? ".png" : ".webp";
}

/// Name by which one file of a mesh refers to another file beside it.
std::string name_of(const std::string& path) {
    return fs::path(path).filename().string();
}

std::string obj_text(const TriangleMesh& mesh,
                     const MeshTexture& texture,
                     const MeshFileOptions& options,
                     const std::string& material) {
    const Vec3d origin = options.origin;
    std::string out = str("# ", kVersion, "\n");
    if (!options.projection.empty()) out += "# projection " + options.projection + "\n";
    if (!material.empty()) out += "mtllib " + material + "\nusemtl photographs\n";
    const bool far = norm(origin) > 0, colors = texture.empty() && !mesh.colors.empty();
    for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
        out += 'v';
        for (int a = 0; a < 3; ++a) {
            out += ' ';
            if (far)
                put_number(out, double{mesh.vertices[i][a]} + origin[a]);
            else
                put_number(out, mesh.vertices[i][a]);
        }
        for (int c = 0; colors && c < 3; ++c) out += ' ', put_number(out, mesh.colors[i][c]);
        out += '\n';
    }
    for (const Vec2f place : texture.places) {  // up from the bottom left corner
        out += "vt ", put_number(out, place.x);
        out += ' ', put_number(out, 1 - double{place.y}), out += '\n';
    }
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
        out += 'f';
        for (int c = 0; c < 3; ++c) {
            out += ' ', put_number(out, mesh.faces[f][c] + 1);
            if (!texture.empty()) out += '/', put_number(out, texture.faces[f][c] + 1);
        }
        out += '\n';
    }
    return out;
}

}  // namespace

std::optional<MeshFormat> mesh_format(const std::string& path) {
    const std::string extension = lower_case(fs::path(path).extension().string());
    if (extension == ".glb") return MeshFormat::glb;
    if (extension == ".obj") return MeshFormat::obj;
    if (extension == ".ply") return MeshFormat::ply;
    return std::nullopt;
}

std::vector<std::string> mesh_files(const std::string& path, bool textured, TextureFormat format) {
    if (!textured || mesh_format(path) != MeshFormat::obj) return {path};
    // OBJ readers end names at blanks and lines at '#', so the names of these two files avoid such
    // characters. "_texture" avoids the name of the mesh's preview, mesh.png.
    std::string stem = fs::path(path).stem().string();
    for (char& c : stem)
        if (std::isspace(static_cast<unsigned char>(c)) ||
            std::iscntrl(static_cast<unsigned char>(c)) || std::strchr("#\\\"'", c))
            c = '_';
    const std::string beside = (fs::path(path).parent_path() / stem).string();
    return {beside + "_texture" + extension_of(format), beside + ".mtl", path};
}

void require_texture_format(const std::string& path, TextureFormat format) {
    if (format == TextureFormat::webp && mesh_format(path) == MeshFormat::obj)
        throw Error(ExitCode::usage, path, ": an OBJ needs a texture in jpg or png, not WebP");
}

std::string encode_texture(const ImageU8& image, TextureFormat format) {
    return format == TextureFormat::jpeg  ? jpeg_bytes(image, kQuality)
           : format == TextureFormat::png ? png_bytes(image)
                                          : webp_bytes(image, kQuality);
}

void check_finite(const std::string& path, const std::vector<Vec3f>& values, const char* what) {
    for (std::size_t i = 0; i < values.size(); ++i)
        if (!is_finite(values[i]))
            throw Error(ExitCode::numerical, path, ": not written: ", what, " ", i, " is (",
                        values[i].x, ", ", values[i].y, ", ", values[i].z,
                        "); expected finite numbers");
}

void check_size(const std::string& path,
                std::size_t found,
                std::size_t expected,
                const char* what) {
    if (found != 0 && found != expected)
        throw Error(ExitCode::internal, path, ": not written: ", found, " ", what, " for ",
                    expected, " positions");
}

void check_mesh(const std::string& path, const TriangleMesh& mesh) {
    check_finite(path, mesh.vertices, "vertex");
    check_finite(path, mesh.colors, "colour");
    check_size(path, mesh.colors.size(), mesh.vertices.size(), "colours");
    check_size(path, mesh.views.size(), mesh.vertices.size(), "numbers of views");
    const int count = static_cast<int>(mesh.vertices.size());
    for (const Vec3i face : mesh.faces)
        for (int c = 0; c < 3; ++c)
            if (face[c] < 0 || face[c] >= count)
                throw Error(ExitCode::internal, path, ": not written: a face refers to vertex ",
                            face[c], " of ", count);
}

void write_mesh(const std::string& path,
                const TriangleMesh& mesh,
                const MeshTexture& texture,
                const MeshFileOptions& options) {
    const MeshFormat format = mesh_format(path).value_or(MeshFormat::ply);
    if (format == MeshFormat::ply)
        return write_mesh_ply(path, mesh, options.origin, options.projection);
    check_mesh(path, mesh);
    if (!texture.empty() && texture.faces.size() != mesh.faces.size())
        throw Error(ExitCode::internal, path, ": not written: ", texture.faces.size(),
                    " textured faces of ", mesh.faces.size());
    if (!texture.empty()) require_texture_format(path, options.texture_format);
    // No file appears under its name before all are on the disk.
    std::deque<AtomicFile> files;
    const auto add = [&](const std::string& file, const std::string& bytes) {
        files.emplace_back(file).write(bytes);
        files.back().flush();
    };
    if (format == MeshFormat::glb) {
        add(path, glb_bytes(path, mesh, texture, options));
    } else if (texture.empty()) {
        add(path, obj_text(mesh, texture, options, ""));
    } else {
        const std::vector<std::string> names = mesh_files(path, true, options.texture_format);
        add(names[0], with_signature(encode_texture(texture.image, options.texture_format),
                                     options.texture_format));
        add(names[1], str("# ", kVersion, "\nnewmtl photographs\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0",
                          "\nillum 0\nmap_Kd ", name_of(names[0]), "\n"));
        add(path, obj_text(mesh, texture, options, name_of(names[1])));
    }
    for (AtomicFile& file : files) file.commit();
}

}  // namespace tvsgs
