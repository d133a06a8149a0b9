#include "pipeline/mesh/mesh_output.h"

#include <algorithm>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "mesh/draw/mesh_render.h"
#include "mesh/texture/texture.h"
#include "pipeline/run/run_folder.h"

namespace tvsgs {
namespace {

constexpr int kMinSide = 256, kMaxSide = 8192;  // all devices support 8192

}  // namespace

int texture_side(const MeshOutputOptions& options) {
    if (options.texture == "none") return 0;
    if (options.texture == "auto") return kMaxSide;
    int side = 0;
    if (!parse_number(options.texture, side) || side < kMinSide || side > kMaxSide)
        throw Error(ExitCode::usage, "--texture ", options.texture,
                    ": expected auto, none, or a side of ", kMinSide, " to ", kMaxSide);
    return side;
}

void require_mesh_output(const std::string& out,
                         const MeshOutputOptions& options,
                         const SceneOptions& scene) {
    const bool textured = texture_side(options) > 0;
    require_output(out, {".glb", ".obj", ".ply"}, scene);
    const MeshFormat format = mesh_format(out).value_or(MeshFormat::ply);
    if (format == MeshFormat::ply && options.texture != "none" && options.texture != "auto")
        throw Error(ExitCode::usage, "--texture ", options.texture, ": ", out,
                    " would be a PLY, which has no texture; choose a .glb or .obj");
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
    if (std::ranges::all_of(views, [](const View& view) { return view.photo.empty(); })) {
        spdlog::warn("No photographs: the mesh gets vertex colours and no texture");
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
        spdlog::warn("{}; the mesh gets vertex colours and no texture", error.what());
        return {};
    }
    spdlog::debug(
        "Texture {}x{}: {} faces not fully seen; {} seam points blended; {} charts of {} views, "
        "{:.3g} texels per pixel",
        texture.image.width, texture.image.height, grouped(report.tiles), grouped(report.seams),
        grouped(report.charts), report.views_used, report.scale);
    for (const StageTime& stage : report.stages)
        spdlog::debug("Texture, {}: {:.2f} s", stage.name, stage.seconds);
    return texture;
}

std::string summary_text(const MeshSummary& summary,
                         const TriangleMesh& mesh,
                         const MeshTexture& texture) {
    std::string text = str("Mesh: ", counted(mesh.faces.size(), "face"), ", ",
                           counted(summary.components, "component"));
    if (const std::size_t removed = summary.removed_components; removed > 0)
        text += str(" (", grouped(removed),
                    removed != summary.small_components ? ""
                    : removed == 1                      ? " small one"
                                                        : " small ones",
                    " removed)");
    if (summary.closed_holes > 0)
        text += ", " + counted(summary.closed_holes, "small hole") + " closed";
    if (texture.image.width > 0)
        text += str(", texture ", texture.image.width, "x", texture.image.height);
    return text;
}

std::string left_out_text(const MeshSummary& summary) {
    if (summary.object_radius > 0)
        return fmt::format(
            "Left out: everything farther than {:.3g} units from the object; --everything keeps it",
            summary.object_radius);
    if (!(summary.unmeasured >= 0.005)) return {};
    return fmt::format(
        "Left out: {:.0f} % of the surface, which the photographs do not confirm; "
        "mesh.measured=0 keeps it",
        100 * summary.unmeasured);
}

MeshFileOptions file_options(const MeshOutputOptions& options,
                             const std::vector<View>& views,
                             Vec3d origin) {
    MeshFileOptions out;
    out.texture_format = options.texture_format, out.origin = origin;
    out.normals = options.normals;
    if (!options.keep_axes) out.upright_from_scene = upright_from_scene(upright_cameras(views));
    return out;
}

}  // namespace tvsgs
