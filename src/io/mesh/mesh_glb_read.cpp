#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <tuple>
#include <utility>

#include "core/math/rigid.h"
#include "io/images/image_file.h"
#include "io/mesh/glb_document.h"
#include "io/mesh/mesh_files.h"

namespace tvsgs {
namespace {

using nlohmann::json;

constexpr std::int64_t kMostVertices = std::int64_t{1} << 30, kMostPixels = 8192 * 8192;
// Limit of the vertices and corners of a file, including copies by nodes: kCopiesPerByte per byte
// of the file, but at least kMinCopies.
constexpr std::size_t kCopiesPerByte = 64, kMinCopies = std::size_t{1} << 26;

class GlbReader : GlbDocument {
public:
    GlbReader(const std::string& path,
              std::string_view bytes,
              bool want_colors,
              EncodedTexture* texture)
        : GlbDocument(path, bytes),
          want_colors_(want_colors),
          texture_(texture),
          most_(std::max(kMinCopies, kCopiesPerByte * bytes.size())) {
        // Extensions that change the geometry must be supported; those that change images are
        // ignored.
        check_extensions(
            {"KHR_mesh_quantization", "KHR_materials_", "KHR_texture_", "EXT_texture_"});
        from_tvsgs_ = is_from_tvsgs("vertices");
        if (from_tvsgs_) origin_ = vector3(member(member(doc_, "asset"), "extras"), "origin", {});
    }

    PlyGeometry read() {
        const json& nodes = list(doc_, "nodes");
        visited_.assign(nodes.size(), 0);
        if (const json& scenes = list(doc_, "scenes"); !scenes.empty()) {
            const std::size_t scene = doc_.contains("scene") ? index(doc_, "scene", scenes) : 0;
            const json& roots = list(scenes[scene], "nodes");
            for (std::size_t i = 0; i < roots.size(); ++i) visit(index_at(roots, i, nodes), {}, 0);
        } else if (!nodes.empty()) {
            fail("nodes, but no scene");
        }
        if (out_.faces.empty()) fail("no triangles");
        if (!has_colors_) out_.colors.clear();
        if (from_tvsgs_ && texture_ && decoded_.first && !decoded_.second.empty() &&
            texture_->places.size() == out_.positions.size()) {
            texture_->image = view_bytes(list(doc_, "images")[*decoded_.first], nullptr);
            texture_->faces = out_.faces;
        } else if (texture_) {
            *texture_ = {};
        }
        if (from_tvsgs_) merge_duplicates();
        return std::move(out_);
    }

private:
    // 1. Nodes and meshes.
    Affine3d motion_of(const json& node) const {
        Affine3d T;
        if (const std::vector<double> m = numbers(node, "matrix", 16); !m.empty()) {
            for (int column = 0; column < 4; ++column)
                for (int row = 0; row < 3; ++row) {
                    const double value = m[static_cast<std::size_t>(4 * column + row)];
                    (column < 3 ? T.A[row][column] : T.t[row]) = value;
                }
            return T;
        }
        Quat<double> turn;
        if (const std::vector<double> q = numbers(node, "rotation", 4); !q.empty())
            turn = normalize(Quat<double>{q[3], q[0], q[1], q[2]});
        const Vec3d scale = vector3(node, "scale", {1, 1, 1});
        T.A = rotation(turn);
        for (int row = 0; row < 3; ++row)
            for (int column = 0; column < 3; ++column) T.A[row][column] *= scale[column];
        T.t = vector3(node, "translation", {});
        return T;
    }

    void visit(std::size_t i, const Affine3d& world_from_parent, int depth) {
        const json& nodes = list(doc_, "nodes");
        check_json_depth(depth, path_);
        if (visited_[i]++) fail("node ", i, " has two parents, or is its own parent");
        const json& node = nodes[i];
        const Affine3d world_from_node =
            from_tvsgs_ ? Affine3d{} : world_from_parent * motion_of(node);
        if (node.is_object() && node.contains("mesh")) {
            const json& meshes = list(doc_, "meshes");
            for (const json& primitive : list(meshes[index(node, "mesh", meshes)], "primitives"))
                add(primitive, world_from_node);
        }
        const json& children = list(node, "children");
        for (std::size_t c = 0; c < children.size(); ++c)
            visit(index_at(children, c, nodes), world_from_node, depth + 1);
    }

    void add(const json& primitive, const Affine3d& world_from_node) {
        if (whole(primitive, "mode", glb::kTriangles) != glb::kTriangles)
            fail("points, lines or strips; expected triangles");
        if (member(primitive, "extensions").contains("KHR_draco_mesh_compression"))
            fail("compressed (KHR_draco_mesh_compression); save it without compression");
        const json& attributes = member(primitive, "attributes");
        const GlbAccessor position = accessor(attributes, "POSITION", "VEC3", 3);
        const auto first = static_cast<std::int64_t>(out_.positions.size());
        if (first + static_cast<std::int64_t>(position.count) > kMostVertices)
            fail("more than 2^30 vertices");
        claim(position.count);
        for (std::size_t i = 0; i < position.count; ++i)
            out_.positions.push_back(world_from_node * Vec3d{position.value(i, 0),
                                                             position.value(i, 1),
                                                             position.value(i, 2)} +
                                     origin_);
        const auto add_faces = [&](std::size_t corners, const auto& corner) {
            claim(corners);
            if (corners % 3 != 0) fail(corners, " corners are not a multiple of 3");
            for (std::size_t k = 0; k < corners; k += 3) {
                Vec3i face;
                for (int c = 0; c < 3; ++c) {
                    const double vertex = corner(k + static_cast<std::size_t>(c));
                    if (!(vertex < static_cast<double>(position.count)))
                        fail("a triangle refers to vertex ", vertex, " of ", position.count);
                    face[c] = static_cast<int>(first + static_cast<std::int64_t>(vertex));
                }
                out_.faces.push_back(face);
            }
        };
        if (primitive.contains("indices")) {
            const GlbAccessor indices = accessor(primitive, "indices", "SCALAR", 1);
            if (const auto type = indices.component->number;
                type != glb::u8 && type != glb::u16 && type != glb::u32)
                fail("indices: expected an unsigned componentType");
            add_faces(indices.count, [&](std::size_t k) { return indices.value(k, 0); });
        } else {
            add_faces(position.count, [](std::size_t k) { return static_cast<double>(k); });
        }
        if (want_colors_) add_colors(primitive, attributes, position.count);
    }

    /// Limits the total size, because nodes may repeat one array many times.
    void claim(std::size_t count) {
        claimed_ += count;
        if (claimed_ > most_)
            fail("its nodes need ", claimed_,
                 " vertices and corners, more than a file of this size can hold (", most_, ")");
    }

    // 2. Colours. White if the image is not readable.
    void add_colors(const json& primitive, const json& attributes, std::size_t count) {
        out_.colors.resize(out_.positions.size(), Vec3f{1, 1, 1});
        Vec3f* const to = out_.colors.data() + (out_.colors.size() - count);
        if (attributes.contains("COLOR_0")) {
            const json& accessors = list(doc_, "accessors");
            const bool alpha =
                text(accessors[index(attributes, "COLOR_0", accessors)], "type") == "VEC4";
            const GlbAccessor color =
                accessor(attributes, "COLOR_0", alpha ? "VEC4" : "VEC3", alpha ? 4 : 3);
            if (color.count != count) fail("COLOR_0: not one per position");
            for (std::size_t i = 0; i < count; ++i)
                for (int c = 0; c < 3; ++c) to[i][c] = srgb(color.value(i, c));
            has_colors_ = true;
        } else if (attributes.contains("TEXCOORD_0")) {
            const ImageU8* const image = texture_of(primitive);
            const GlbAccessor place = accessor(attributes, "TEXCOORD_0", "VEC2", 2);
            if (place.count != count) fail("TEXCOORD_0: not one per position");
            if (!image) return;
            const auto pixel = [](double at, int size) {
                return static_cast<int>(std::clamp(at * size, 0.0, size - 1.0));
            };
            for (std::size_t i = 0; i < count; ++i) {
                if (texture_)
                    texture_->places.push_back({static_cast<float>(place.value(i, 0)),
                                                static_cast<float>(place.value(i, 1))});
                const int x = pixel(place.value(i, 0), image->width),
                          y = pixel(place.value(i, 1), image->height);
                for (int c = 0; c < 3; ++c) to[i][c] = static_cast<float>(image->at(x, y, c)) / 255;
            }
            has_colors_ = true;
        }
    }
    static float srgb(double linear) {
        const auto v = static_cast<float>(std::clamp(linear, 0.0, 1.0));
        return v <= 0.0031308f ? 12.92f * v : 1.055f * std::pow(v, 1 / 2.4f) - 0.055f;
    }
    /// Null if there is no readable texture.
    const ImageU8* texture_of(const json& primitive) {
        const json& materials = list(doc_, "materials");
        if (!primitive.contains("material")) return nullptr;
        const json& base = member(
            member(materials[index(primitive, "material", materials)], "pbrMetallicRoughness"),
            "baseColorTexture");
        const json& textures = list(doc_, "textures");
        const json& images = list(doc_, "images");
        if (base.empty()) return nullptr;
        const json& texture = textures[index(base, "index", textures)];
        if (!texture.is_object() || !texture.contains("source")) return nullptr;
        const std::size_t image = index(texture, "source", images);
        if (!images[image].is_object() || !images[image].contains("bufferView")) return nullptr;
        if (text(images[image], "mimeType") == "image/webp") return nullptr;
        if (decoded_.first != image) {
            decoded_ = {image, {}};  // keeps one image: a small file may contain many
            try {
                decoded_.second =
                    decode_image(path_, view_bytes(images[image], nullptr), 3, kMostPixels);
            } catch (const Error&) {  // unsupported format or size
            }
        }
        return decoded_.second.empty() ? nullptr : &decoded_.second;
    }

    /// Merges vertices of a tvsgs file at equal positions, bit by bit. Keeps the order of first
    /// use.
    void merge_duplicates() {
        std::vector<int> order(out_.positions.size());
        std::iota(order.begin(), order.end(), 0);
        const auto key = [&](int i) {
            const Vec3d& p = out_.positions[i];
            return std::tie(p.x, p.y, p.z);
        };
        for (const Vec3d p : out_.positions)
            if (!is_finite(p)) return;
        std::ranges::sort(
            order, [&](int a, int b) { return key(a) < key(b) || (!(key(b) < key(a)) && a < b); });
        std::vector<int> joined(order.size());
        for (std::size_t k = 0; k < order.size(); ++k)  // to the first at its position
            joined[order[k]] =
                k > 0 && key(order[k]) == key(order[k - 1]) ? joined[order[k - 1]] : order[k];
        int count = 0;
        for (std::size_t i = 0; i < joined.size(); ++i) {
            const bool first = joined[i] == static_cast<int>(i);
            if (first) {
                out_.positions[count] = out_.positions[i];
                if (!out_.colors.empty()) out_.colors[count] = out_.colors[i];
            }
            joined[i] = first ? count++ : joined[joined[i]];
        }
        for (Vec3i& face : out_.faces)
            for (int c = 0; c < 3; ++c) face[c] = joined[face[c]];
        out_.positions.resize(static_cast<std::size_t>(count));
        if (!out_.colors.empty()) out_.colors.resize(static_cast<std::size_t>(count));
    }

    const bool want_colors_;
    EncodedTexture* const texture_;  // null: not wanted
    const std::size_t most_;         // vertices and corners
    std::size_t claimed_ = 0;
    bool has_colors_ = false, from_tvsgs_ = false;
    Vec3d origin_;
    std::vector<char> visited_;
    std::pair<std::optional<std::size_t>, ImageU8> decoded_;  // index and image decoded last
    PlyGeometry out_;
};

}  // namespace

PlyGeometry read_glb(const std::string& path,
                     std::string_view bytes,
                     bool want_colors,
                     EncodedTexture* texture) {
    return GlbReader(path, bytes, want_colors, texture).read();
}

}  // namespace tvsgs
