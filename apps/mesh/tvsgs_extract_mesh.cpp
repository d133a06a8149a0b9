// tvsgs-extract-mesh: extracts a mesh from trained splats. Renders depth maps of the training
// views, runs a mesher, and cleans, simplifies and textures the mesh.
#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/common/key_flags.h"
#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "io/files/atomic_file.h"
#include "io/files/manifest.h"
#include "io/images/image_file.h"
#include "io/mesh/mesh_files.h"
#include "io/scene/georeference.h"
#include "mesh/draw/mesh_render.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"
#include "report/run_report.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct Arguments {
    std::string model, out, device = "auto";
    bool no_preview = false, quiet = false, verbose = false;
    bool bounded = false;  // given limits switch off the run's background
};

/// Whether the command line gives a depth limit or a box while the run's configuration meshes the
/// background. The limit wins, as in the plan.
bool is_bounded_here(const RunOptions& options, const OptionTable& table, const std::string& run) {
    const auto of_run = [&](const char* key) { return table.option(key).source == run; };
    const bool limited = (options.mesh.depth_max > 0 && !of_run("mesh.depth_max")) ||
                         (!options.mesh.box.empty() && !of_run("mesh.box"));
    return limited && options.mesh.unbounded && of_run("mesh.unbounded");
}

/// Reads the run's configuration, if there is one, for the scene; flags override it.
Arguments parse(int argc, char** argv, RunOptions& options) {
    Arguments arguments;
    OptionTable table;
    options.add_to(table);
    std::vector<std::string> configs, settings;
    CLI::App app{"Extracts a triangle mesh from trained splats.", "tvsgs-extract-mesh"};
    app.get_formatter()->column_width(46);
    KeyFlags flags(app, table);
    app.add_option("model,-m,--model,--model-path", arguments.model, "run folder or splat PLY")
        ->required();
    app.add_option(
        "-o,--out,--output", arguments.out,
        "mesh to write, .glb, .obj or .ply [RUN/mesh/mesh.glb, or mesh.glb beside the splats]");
    app.add_option("--device", arguments.device, "auto, cpu, cuda or cuda:N");
    app.add_option("-c,--config", configs, "JSON file over the run's configuration; later ones win")
        ->expected(1)
        ->take_all();
    app.add_option("--set", settings, "KEY=VALUE, such as mesh.max_angle=80")
        ->expected(1)
        ->take_all();
    CLI::Option* quiet = app.add_flag("--quiet", arguments.quiet, "warnings and errors only");
    app.add_flag("-v,--verbose", arguments.verbose, "show every step")->excludes(quiet);
    flags.add_scene("Scene (default: that of the run)");
    const char* group = "Volume";
    flags.add("--method", "mesh.method",
              "mesher: tsdf, tetrahedra, or watertight, which closes unseen places too [tsdf]",
              group);
    flags.add("--voxel-size", "mesh.voxel_size", "world units [depth-max / mesh-resolution]",
              group);
    flags.add("--mesh-resolution", "mesh.resolution",
              "voxels along depth-max, or across the ball if unbounded [2048, fewer for small "
              "images]",
              group);
    flags.add("--truncation", "mesh.truncation", "world units [mesh.truncation_voxels]", group);
    flags.add("--depth-max", "mesh.depth_max",
              "limit of depth [twice the distance of the cameras' focus; none if unbounded]",
              group);
    flags.add("--bbox", "mesh.box", "x0,y0,z0,x1,y1,z1: drop the surface outside", group);
    flags.add("--alpha-min", "mesh.alpha_min", "least coverage of a pixel [0.5]; 0: any", group);
    flags.add("--max-angle", "mesh.max_angle",
              "largest angle between ray and normal in degrees [90: any]", group);
    flags.add_switch("--unbounded", "mesh.unbounded",
                     "mesh the background, too, with voxels that grow outside of a ball around "
                     "the cameras' focus; --depth-max and --bbox still apply",
                     group);
    flags.add_switch("--carve", "mesh.carve",
                     "views also clear the space in front of their surface", group);
    flags.add("--min-weight", "mesh.min_weight", "least number of views that see a voxel [1]",
              group);
    flags.add("--clusters", "mesh.clusters", "number of largest components to keep [0: all]",
              group);
    flags.add("--error", "mesh.error",
              "error bound of simplification, in pixels of the nearest view [0.3]; 0: keep all "
              "triangles",
              group);
    flags.add("--faces", "mesh.faces",
              "number of faces to simplify to, whatever the error [0: no limit]", group);
    flags.add("--memory", "mesh.memory",
              "memory limit, such as 8G or 500M; the mesh stays the same [80 % of the free memory]",
              group);
    app.add_flag("--given-cameras", options.scene.given_cameras,
                 "use the given poses of a run that refined them")
        ->group(group);
    bool no_masks = false;
    app.add_flag("--no-masks", no_masks, "also fuse pixels outside of the masks")->group(group);
    group = "File";
    app.add_flag("--no-preview", arguments.no_preview, "write no preview picture")->group(group);
    flags.add("--texture", "mesh.texture",
              "texture from the photographs: auto, none or its side in pixels [auto: up to 8192]",
              group);
    flags.add("--texture-format", "mesh.texture_format", "jpg, png or webp [jpg]", group);
    flags.add_switch("--keep-axes", "mesh.keep_axes",
                     "GLB: keep the scene's axes [the mesh stands upright]", group);
    parse_command_line(app, argc, argv);
    init_log(arguments.quiet     ? Verbosity::quiet
             : arguments.verbose ? Verbosity::verbose
                                 : Verbosity::normal);
    flags.set_keys(table);  // checks the flags before looking for any file
    make_mesher<Cpu>(options.mesh.method, {});

    std::error_code failure;
    if (!fs::exists(arguments.model, failure))
        throw Error(
            ExitCode::input,
            str(arguments.model, ": does not exist; --model expects a run folder or a splat PLY"));
    std::string run;  // the run's configuration file
    if (fs::is_directory(arguments.model, failure)) {
        run = run_config_path(arguments.model);
        table.read_file(run);
    }
    for (const std::string& file : configs) table.read_file(file);
    table.read_environment();
    flags.set_keys(table);
    table.set_all(settings);
    if (run.empty()) choose_backbone(arguments.model, options.train.render, table);
    if (no_masks) options.mesh.masks = false;
    arguments.bounded = !run.empty() && is_bounded_here(options, table, run);
    if (arguments.bounded) options.mesh.unbounded = false;
    if (options.scene.path.empty())
        throw Error(
            ExitCode::usage,
            str(arguments.model,
                ": is no run folder, so it does not say which scene it shows; give --scene DIR"));
    check_mesh_options(options.mesh);
    options.scene.need_points = false;
    options.scene.min_train_views = 1;
    return arguments;
}

std::string default_output(const std::string& model) {
    if (fs::is_directory(model)) return (fs::path(model) / "mesh" / "mesh.glb").string();
    return (fs::path(model).parent_path() / "mesh.glb").string();
}

int command(int argc, char** argv) {
    RunOptions options;
    Arguments arguments = parse(argc, argv, options);
    if (arguments.bounded)
        spdlog::info("Background left out because of the given limit; --unbounded keeps it");
    if (arguments.out.empty()) arguments.out = default_output(arguments.model);
    const std::string splat_path = find_splats(arguments.model);
    std::error_code failure;
    if (fs::equivalent(splat_path, arguments.out, failure))
        throw Error(ExitCode::usage, str("--out ", arguments.out,
                                         ": is the file of the splats; choose another name"));
    require_mesh_output(arguments.out, options.mesh_output, options.scene);
    const DeviceChoice device = choose_device(arguments.device);
    const std::string projection = projection_of(options.scene.path);
    const Scene scene = read_scene_of_run(options.scene, arguments.model);
    const Gaussians<Cpu> splats = read_splats(splat_path, scene.origin, options.train);
    spdlog::info("Input: {} splats of {}, {} training views of {}; {}", grouped(splats.size()),
                 splat_path, scene.train.size(), options.scene.path, device.description);

    MeshSummary summary;
    const TriangleMesh mesh = on_device(device, [&](auto tag) {
        Gaussians<decltype(tag)> gaussians;
        copy(splats, gaussians);
        return extract_mesh(scene.train, gaussians, options.train, options.mesh,
                            fs::absolute(arguments.out).parent_path().string(), scene.origin,
                            &summary);
    });
    if (mesh.faces.empty())
        throw Error(ExitCode::numerical,
                    str(arguments.out, ": not written, the mesh is empty: ", summary.why_empty));
    if (mesh_format(arguments.out) == MeshFormat::glb)
        require_glb_room(arguments.out, mesh.vertices.size(), mesh.faces.size(),
                         texture_side(options.mesh_output) > 0);
    const MeshTexture texture =
        texture_of(mesh, scene.train, options.mesh_output, options.mesh.masks, arguments.out);
    MeshFileOptions how = file_options(options.mesh_output, scene.train, scene.origin);
    how.projection = projection;
    if (!projection.empty() && !options.mesh_output.keep_axes)
        how.upright_from_scene = kUprightFromProjection;
    write_mesh(arguments.out, mesh, texture, how);
    spdlog::info("{}", summary_text(summary, mesh, texture));
    if (const std::string left_out = left_out_text(summary); !left_out.empty())
        spdlog::info("{}", left_out);
    spdlog::info("Wrote {}", arguments.out);
    // A picture that may not be ours belongs to the user.
    const std::string picture = fs::path(arguments.out).replace_extension(".png").string();
    const auto listing = folder_with_manifest(picture);
    const bool wanted = !arguments.no_preview && !is_stream(arguments.out);
    if (wanted && fs::exists(picture, failure) && !(listing && is_listed(*listing, picture))) {
        spdlog::warn("{} already exists and is not ours: kept, no preview written", picture);
    } else if (wanted) {
        const TriangleMesh none;  // a scene with background is best seen from inside
        write_png(picture,
                  preview_mesh(mesh,
                               preview_camera(options.mesh.meshes_background() ? none : mesh,
                                              detail::cameras_of(scene.train), 960, 720),
                               texture));
        spdlog::info("Wrote {} (preview)", picture);
    }
    refresh_report(arguments.out);
    if (fs::is_directory(arguments.model))
        say_next({"tvsgs-view", arguments.model}, "look at splats, mesh and cameras in a browser");
    else
        say_next({"tvsgs-eval", "geometry", "--pred", arguments.out, "--gt", "SURFACE.ply"},
                 "measure the mesh against the true surface, if known");
    return 0;
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::command(argc, argv); });
}
