#include "pipeline/mesh/mesh_output.h"

#include "core/error.h"
#include "core/log.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "mesh/draw/upright.h"
#include "mesh/texture/texture.h"
#include "pipeline/mesh/mesh_extraction.h"
#include "pipeline/run/run_folder.h"

namespace tvsgs {
namespace {

constexpr int kMinSide = 256, kMaxSide = 8192;  // px; all devices can show the largest

bool has_photographs(const std::vector<View>& views) {
    for (const View& view : views)
        if (!view.photo.empty()) return true;
    return false;
}

}  // namespace

int texture_side(const MeshOutputOptions& options) {
    if (options.texture == "none") return 0;
    if (options.texture == "auto") return kMaxSide;
    int side = 0;
    if (!parse_number(options.texture, side) || side < kMinSide || side > kMaxSide)
        throw Error(ExitCode::usage,
                    str("--texture ", options.texture, ": expected auto, none, or a side of ",
                        kMinSide, " to ", kMaxSide));
    return side;
}

void require_mesh_output(const std::string& out,
                         const MeshOutputOptions& options,
                         const SceneOptions& scene) {
    const bool textured = texture_side(options) > 0;
    require_output(out, {".glb", ".obj", ".ply"}, "a mesh is written as GLB, OBJ or PLY", scene);
    const MeshFormat format = mesh_format(out).value_or(MeshFormat::ply);
    if (format == MeshFormat::ply && options.texture != "none" && options.texture != "auto")
        throw Error(ExitCode::usage, str("--texture ", options.texture, ": ", out,
                                         " would be a PLY, which has none; name a .glb or .obj"));
    if (format == MeshFormat::ply || !textured) return;
    require_texture_format(out, options.texture_format);
    for (const std::string& file : mesh_files(out, true, options.texture_format))
        require_replaceable(file);
}

MeshTexture texture_of(const TriangleMesh& mesh,
                       const std::vector<View>& views,
                       const MeshOutputOptions& options,
                       bool masks,
                       const std::string& out) {
    const int side = texture_side(options);
    if (side == 0 || mesh_format(out).value_or(MeshFormat::ply) == MeshFormat::ply) return {};
    if (!has_photographs(views)) {
        spdlog::warn("there are no photographs: the mesh has the splats' colours and no texture");
        return {};
    }
    TextureOptions how;
    how.max_side = side, how.masks = masks, how.fixed_side = options.texture != "auto";
    TextureReport report;
    MeshTexture texture;
    try {
        texture = make_texture(mesh, views, how, &report);
    } catch (const Error& error) {
        if (how.fixed_side || error.code() != ExitCode::input) throw;
        spdlog::warn("{}; the mesh has the splats' colours and no texture", error.what());
        return {};
    }
    spdlog::info(
        "texture of {}x{}: {} charts of {} views at {:.3g} texels per pixel; {} faces in "
        "parts or unseen, {} places where views meet levelled",
        texture.image.width, texture.image.height, report.charts, report.views_used, report.scale,
        report.tiles, report.seams);
    for (const StageTime& stage : report.stages)
        spdlog::debug("texture: {:.2f} s for {}", stage.seconds, stage.name);
    return texture;
}

MeshFileOptions file_options(const MeshOutputOptions& options,
                             const std::vector<View>& views,
                             Vec3d origin) {
    MeshFileOptions out;
    out.texture_format = options.texture_format, out.origin = origin;
    out.normals = options.normals;
    if (!options.keep_axes) out.upright_from_scene = upright_from_scene(detail::cameras_of(views));
    return out;
}

}  // namespace tvsgs
