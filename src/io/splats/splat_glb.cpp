#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"
#include "io/mesh/glb_chunk.h"
#include "io/mesh/glb_document.h"
#include "io/splats/splat_checks.h"
#include "io/splats/splat_files.h"

namespace tvsgs {
namespace {

/// 3DGS adds it to the projected covariance.
constexpr double kLowPassPx2 = 0.3;

using glb::list_of, glb::put;
using json = nlohmann::json;

constexpr const char* kExtension = "KHR_gaussian_splatting";
constexpr float kShC0 = 0.28209479f;

std::string attribute(const std::string& name) {
    return str(kExtension, ":", name);
}

/// Calls fn(name, coefficient) for all coefficients of a degree.
template <class Fn>
void for_each_coefficient(int sh_degree, const Fn& fn) {
    int k = 0;
    for (int l = 0; l <= sh_degree; ++l)
        for (int n = 0; n <= 2 * l; ++n) fn(attribute(str("SH_DEGREE_", l, "_COEF_", n)), k++);
}

/// Rotation of the file's node: the scene's upright rotation without the part that the frame
/// covers.
Mat3<double> turn_of_node(const SplatFileOptions& options, const HalfTurn& turn) {
    Mat3<double> out = options.upright_from_scene;
    for (int row = 0; row < 3; ++row)
        for (int c = 0; c < 3; ++c) out[row][c] = out[row][c] * double{turn.signs[c]} + 0.0;
    return out;
}

class SplatGlbReader : GlbDocument {
public:
    SplatGlbReader(const std::string& path, std::string_view bytes) : GlbDocument(path, bytes) {
        check_extensions({kExtension, "KHR_materials_", "KHR_texture_", "EXT_texture_"});
    }

    Georeference place() const {
        if (!is_from_tvsgs("splats")) return {};
        const json& extras = member(member(doc_, "asset"), "extras");
        return {text(extras, "projection"), vector3(extras, "origin", {})};
    }

    Gaussians<Cpu> read(const HalfTurn& turn) const {
        const json& attributes = member(splats(), "attributes");
        const GlbAccessor mean = accessor(attributes, "POSITION", "VEC3", 3);
        const std::size_t count = mean.count;
        const auto take = [&](const std::string& name, const char* type, int width) {
            const GlbAccessor found = accessor(attributes, name.c_str(), type, width);
            if (found.count != count)
                fail(name, ": ", found.count, " values for ", count, " positions");
            return found;
        };
        const GlbAccessor rotation = take(attribute("ROTATION"), "VEC4", 4),
                          scale = take(attribute("SCALE"), "VEC3", 3),
                          opacity = take(attribute("OPACITY"), "SCALAR", 1);
        int degree = 0;
        while (degree < 3 &&
               attributes.contains(attribute(str("SH_DEGREE_", degree + 1, "_COEF_0"))))
            ++degree;
        std::vector<GlbAccessor> sh;
        for_each_coefficient(degree, [&](const std::string& name, std::size_t) {
            sh.push_back(take(name, "VEC3", 3));
        });
        if (count == 0 || count > std::size_t{1} << 30)
            fail("claims ", count, " splats; expected 1 to 2^30");

        Gaussians<Cpu> g;
        resize(g, static_cast<int>(count), degree);
        parallel_for(Cpu{}, g.size(), [&](std::size_t i) {
            const auto vector = [i](const GlbAccessor& from) {
                return vec_cast<float>(Vec3d{from.value(i, 0), from.value(i, 1), from.value(i, 2)});
            };
            const auto q = [&](int c) { return static_cast<float>(rotation.value(i, c)); };
            g.means[i] = turn(vector(mean));
            g.quats[i] = turn(Quatf{q(3), q(0), q(1), q(2)});
            const Vec3f s = vector(scale);
            // A scale of zero has no finite logarithm; uses a millionth of the largest instead.
            const float thin = 1e-6f * std::max({s.x, s.y, s.z});
            for (int c = 0; c < 3; ++c) g.log_scales[i][c] = std::log(s[c] > 0 ? s[c] : thin);
            const auto alpha = static_cast<float>(opacity.value(i, 0));
            g.opacity_logits[i] = std::isnan(alpha) ? alpha : logit(alpha);
            for (std::size_t k = 0; k < sh.size(); ++k)
                g.sh[k * count + i] = turn.of_coefficient(static_cast<int>(k)) * vector(sh[k]);
        });
        require_valid(g, path_);
        return g;
    }

private:
    const json& splats() const {
        const bool ours = is_from_tvsgs("splats");
        for (const json& node : list(doc_, "nodes"))
            for (const char* moved : {"matrix", "rotation", "scale", "translation"})
                if (!ours && node.is_object() && node.contains(moved))
                    fail("a node has a ", moved, "; apply it to the splats first");
        const json* found = nullptr;
        for (const json& mesh : list(doc_, "meshes"))
            for (const json& primitive : list(mesh, "primitives")) {
                if (!member(primitive, "extensions").contains(kExtension)) continue;
                if (found) fail("more than one set of splats; expected one");
                found = &primitive;
            }
        if (!found) fail("no splats (", kExtension, ")");
        const json& extension = member(member(*found, "extensions"), kExtension);
        if (whole(*found, "mode", glb::kTriangles) != glb::kPoints ||
            text(extension, "kernel") != "ellipse")
            fail("unknown kind of splats; expected points with the kernel \"ellipse\"");
        if (member(extension, "extensions").size() > 0)
            fail("compressed splats; save them without compression");
        return *found;
    }
};

}  // namespace

std::string splat_glb_bytes(const std::string& path,
                            const Gaussians<Cpu>& g,
                            const SplatFileOptions& options) {
    require_writable(g, path);
    const std::size_t count = g.means.size();
    if (count == 0) throw input_error(path, ": not written: no splats");
    const HalfTurn turn = half_turn(options.frame.value_or(SplatFrame::luf));
    glb::Chunk chunk;
    json attributes;
    const auto add = [&](const std::string& name, const char* type, const auto& put_splat) {
        const std::size_t begin = chunk.bytes.size();
        for (std::size_t i = 0; i < count; ++i) put_splat(i);
        attributes[name] =
            name == "POSITION"
                ? chunk.add_positions(chunk.add_view(begin, glb::kVertexTarget), count)
                : chunk.add_accessor(chunk.add_view(begin, glb::kVertexTarget), glb::f32, type,
                                     count);
    };
    add("POSITION", "VEC3", [&](std::size_t i) { put(chunk.bytes, turn(g.means[i])); });
    add(attribute("ROTATION"), "VEC4", [&](std::size_t i) {
        const Quatf q = turn(normalize(g.quats[i]));
        for (const float value : {q.x, q.y, q.z, q.w}) put(chunk.bytes, value);
    });
    add(attribute("SCALE"), "VEC3", [&](std::size_t i) { put(chunk.bytes, exp(g.log_scales[i])); });
    add(attribute("OPACITY"), "SCALAR",
        [&](std::size_t i) { put(chunk.bytes, sigmoid(g.opacity_logits[i])); });
    for_each_coefficient(g.sh_degree, [&](const std::string& name, std::size_t k) {
        const float sign = turn.of_coefficient(static_cast<int>(k));
        add(name, "VEC3", [&](std::size_t i) { put(chunk.bytes, sign * g.sh[k * count + i]); });
    });
    // Points for viewers that do not support splats.
    const std::size_t begin = chunk.bytes.size();
    for (std::size_t i = 0; i < count; ++i) {
        for (int c = 0; c < 3; ++c) put(chunk.bytes, glb::linear_u16(0.5f + kShC0 * g.sh[i][c]));
        put(chunk.bytes, static_cast<std::uint16_t>(65535 * sigmoid(g.opacity_logits[i]) + 0.5f));
    }
    attributes["COLOR_0"] =
        chunk.add_accessor(chunk.add_view(begin, glb::kVertexTarget), glb::u16, "VEC4", count);
    chunk.accessors.back()["normalized"] = true;

    json doc = glb::document(kExtension, options.origin, options.projection, "splats", count);
    doc["asset"]["extras"]["low_pass_px2"] = kLowPassPx2;
    doc["asset"]["extras"]["antialiased"] = options.antialiased;
    json primitive{{"attributes", std::move(attributes)}, {"mode", glb::kPoints}};
    primitive["extensions"][kExtension] = {{"kernel", "ellipse"},
                                           {"colorSpace", "srgb_rec709_display"},
                                           {"projection", "perspective"},
                                           {"sortingMethod", "cameraDistance"}};
    glb::add_scene(doc, "splats", list_of(std::move(primitive)), turn_of_node(options, turn));
    return glb::file_bytes(path, doc, chunk, "write a .spz, or keep fewer with --max-splats");
}

Gaussians<Cpu> parse_splat_glb(std::string_view bytes, const std::string& path, SplatFrame frame) {
    return SplatGlbReader(path, bytes).read(half_turn(frame));
}

Georeference splat_glb_place(std::string_view bytes, const std::string& path) {
    return SplatGlbReader(path, bytes).place();
}

}  // namespace tvsgs
