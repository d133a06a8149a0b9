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
#include "report/report.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct Arguments {
    std::string model, out, device = "auto";
    bool no_preview = false;
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
Arguments parse(int argc, char** argv, Configuration& configuration) {
    Arguments arguments;
    auto& [options, table] = configuration;
    CLI::App app{"Extracts a triangle mesh from trained splats.", "tvsgs-extract-mesh"};
    app.get_formatter()->column_width(46);
    KeyFlags flags(app, table);
    app.add_option("model,-m,--model,--model-path", arguments.model, "run folder or splat PLY")
        ->required();
    app.add_option(
        "-o,--out,--output", arguments.out,
        "mesh to write, .glb, .obj or .ply [RUN/mesh/mesh.glb, or mesh.glb beside the splats]");
    app.add_option("--device", arguments.device, "auto, cpu, cuda or cuda:N");
    flags.add_config("JSON file over the run's configuration; later ones win");
    add_log_flags(app, Verbosity::verbose);
    flags.add_scene("Scene (default: that of the run)");
    start_group(app, "Volume");
    flags.add("--method", "mesh.method");
    flags.add("--voxel-size", "mesh.voxel_size");
    flags.add("--mesh-resolution", "mesh.resolution");
    flags.add("--truncation", "mesh.truncation");
    flags.add("--depth-max", "mesh.depth_max");
    flags.add("--bbox", "mesh.box");
    flags.add("--alpha-min", "mesh.alpha_min");
    flags.add("--max-angle", "mesh.max_angle");
    flags.add("--unbounded", "mesh.unbounded");
    flags.add("--carve", "mesh.carve");
    flags.add("--min-weight", "mesh.min_weight");
    flags.add("--clusters", "mesh.clusters");
    flags.add("--error", "mesh.error");
    flags.add("--faces", "mesh.faces");
    flags.add("--memory", "mesh.memory");
    app.add_flag("--given-cameras", options.scene.given_cameras,
                 "use the given poses of a run that refined them");
    bool no_masks = false, everything = false;
    app.add_flag("--everything", everything, "also mesh the surroundings of the object");
    app.add_flag("--no-masks", no_masks, "also fuse pixels outside of the masks");
    start_group(app, "File");
    app.add_flag("--no-preview", arguments.no_preview, "write no preview picture");
    flags.add("--texture", "mesh.texture");
    flags.add("--texture-format", "mesh.texture_format");
    flags.add("--keep-axes", "mesh.keep_axes");
    parse_command_line(app, argc, argv);
    flags.set_keys(table);  // checks the flags before looking for any file
    make_mesher<Cpu>(options.mesh.method, {});

    std::error_code failure;
    if (!fs::exists(arguments.model, failure))
        throw Error(ExitCode::input, arguments.model,
                    ": does not exist; --model expects a run folder or a splat PLY");
    std::string run;  // the run's configuration file
    if (fs::is_directory(arguments.model, failure)) {
        run = run_config_path(arguments.model);
        table.read_file(run);
    }
    flags.set_all(table);
    if (run.empty()) choose_backbone(arguments.model, options.train.render, table);
    if (no_masks) options.mesh.masks = false;
    if (everything) options.mesh.object = 0;
    arguments.bounded = !run.empty() && is_bounded_here(options, table, run);
    if (arguments.bounded) options.mesh.unbounded = false;
    if (options.scene.path.empty())
        throw usage_error(
            arguments.model,
            ": is no run folder, so it does not say which scene it shows; give --scene DIR");
    check_mesh_options(options.mesh);
    options.scene.need_points = false;
    options.scene.min_train_views = 1;
    return arguments;
}

std::string default_output(const std::string& model) {
    if (fs::is_directory(model)) return (fs::path(model) / "mesh" / "mesh.glb").string();
    return (fs::path(model).parent_path() / "mesh.glb").string();
}

}  // namespace

int command(int argc, char** argv) {
    Configuration configuration;
    Arguments arguments = parse(argc, argv, configuration);
    const RunOptions& options = configuration.options;
    if (arguments.bounded)
        spdlog::info("Background left out because of the given limit; --unbounded keeps it");
    if (arguments.out.empty()) arguments.out = default_output(arguments.model);
    const std::string splat_path = find_splats(arguments.model);
    std::error_code failure;
    if (fs::equivalent(splat_path, arguments.out, failure))
        throw usage_error("--out ", arguments.out,
                          ": is the file of the splats; choose another name");
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
        throw Error(ExitCode::numerical, arguments.out,
                    ": not written, the mesh is empty: ", summary.why_empty);
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
                                              upright_cameras(scene.train), 960, 720),
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

}  // namespace tvsgs
