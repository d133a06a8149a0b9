// tvsgs-extract-mesh: splats in, mesh out. Renders the depth of the training views, fuses it, and
// cleans the surface.
#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>

#include "common.h"
#include "io/image_file.h"
#include "io/ply.h"
#include "key_flags.h"
#include "mesh/depth_clean.h"
#include "mesh/device_algorithms.h"
#include "mesh/focus.h"
#include "mesh/marching_cubes.h"
#include "mesh/mesh_clean.h"
#include "mesh/mesh_render.h"
#include "mesh/tsdf.h"
#include "run_folder.h"
#include "run_options.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr int kTruncationVoxels = 5;        // as 2DGS and FatesGS
constexpr int kMeshResolution = 1024;       // as 2DGS and FatesGS
constexpr double kShareOfFreeMemory = 0.6;  // marching cubes needs half as much again

struct Arguments {
    std::string model, out, device = "auto";
    std::int64_t max_bytes = 0;  // of the voxels; 0: a share of the free memory
    DepthRules rules;            // depth_max 0: automatic
    float voxel_size = 0, truncation = 0, min_weight = 1;
    int mesh_resolution = 0, clusters = 50;
    bool no_masks = false, no_preview = false, quiet = false, verbose = false;
};

/// A number with an optional suffix K, M, G or T (powers of 1024).
std::int64_t parse_bytes(const std::string& text) {
    double value = 0;
    const auto [rest, code] = std::from_chars(text.data(), text.data() + text.size(), value);
    std::string suffix(rest, text.data() + text.size());
    for (const char* unit : {"iB", "B"})
        if (suffix.ends_with(unit)) suffix.resize(suffix.size() - std::string(unit).size());
    const std::size_t power = std::string("KMGT").find(suffix);
    if (code != std::errc{} || !(value > 0) || suffix.size() > 1 || power == std::string::npos)
        throw Error(ExitCode::usage,
                    str("--memory ", text, ": expected a number of bytes such as 8G or 500M"));
    const double bytes = std::ldexp(value, suffix.empty() ? 0 : 10 * (static_cast<int>(power) + 1));
    return static_cast<std::int64_t>(std::min(bytes, 9e18));
}

void parse_box(const std::string& text, DepthRules& rules) {
    float numbers[6];
    const char* at = text.data();
    const char* const end = at + text.size();
    bool good = !text.empty();
    for (int i = 0; i < 6 && good; ++i) {
        const auto [rest, code] = std::from_chars(at, end, numbers[i]);
        good = code == std::errc{} && std::isfinite(numbers[i]) &&
               (i < 5 ? rest != end && *rest == ',' : rest == end);
        at = rest + 1;
    }
    if (!good || !(numbers[0] < numbers[3] && numbers[1] < numbers[4] && numbers[2] < numbers[5]))
        throw Error(
            ExitCode::usage,
            str("--bbox ", text, ": expected x0,y0,z0,x1,y1,z1 with x0 < x1, y0 < y1, z0 < z1"));
    rules.has_box = true;
    rules.box_min = {numbers[0], numbers[1], numbers[2]};
    rules.box_max = {numbers[3], numbers[4], numbers[5]};
}

/// The run's configuration, if there is one, gives the scene; flags override it.
Arguments parse(int argc, char** argv, RunOptions& options) {
    Arguments arguments;
    OptionTable table;
    options.add_to(table);
    std::string box, memory;
    arguments.rules.depth_max = 0, arguments.rules.alpha_min = 0.5f;
    CLI::App app{"Extracts a triangle mesh from trained splats.", "tvsgs-extract-mesh"};
    app.get_formatter()->column_width(46);
    KeyFlags flags(app);
    app.add_option("-m,--model,--model-path", arguments.model, "run folder or splat PLY")
        ->required();
    app.add_option("-o,--out,--output", arguments.out,
                   "mesh to write [RUN/mesh/mesh.ply, or mesh.ply beside the splats]");
    app.add_option("--device", arguments.device, "auto, cpu, cuda or cuda:N");
    CLI::Option* quiet = app.add_flag("--quiet", arguments.quiet, "warnings and errors only");
    app.add_flag("--verbose", arguments.verbose, "more detail")->excludes(quiet);
    flags.add_scene("Scene (default: that of the run)");
    const char* group = "Volume";
    app.add_option("--voxel-size", arguments.voxel_size,
                   "world units [depth-max / mesh-resolution]")
        ->group(group)
        ->check(kPositive);
    app.add_option("--mesh-resolution", arguments.mesh_resolution,
                   "voxels along depth-max [1024, fewer for small images]")
        ->group(group)
        ->check(CLI::Range(8, 65536));
    app.add_option("--truncation", arguments.truncation, "world units [5 voxels]")
        ->group(group)
        ->check(kPositive);
    app.add_option("--depth-max", arguments.rules.depth_max,
                   "depths from there on are dropped [twice the distance of the cameras' focus]")
        ->group(group)
        ->check(kPositive);
    app.add_option("--bbox", box, "x0,y0,z0,x1,y1,z1: surface outside is dropped")->group(group);
    app.add_option("--alpha-min", arguments.rules.alpha_min,
                   "least coverage of a pixel [0.5]; 0: any")
        ->group(group)
        ->check(CLI::Range(0.0, 1.0));
    app.add_flag("--no-masks", arguments.no_masks, "fuse what lies outside of the masks as well")
        ->group(group);
    app.add_option("--min-weight", arguments.min_weight, "views that must have seen a voxel [1]")
        ->group(group)
        ->check(CLI::Range(1, 65535));
    app.add_option("--clusters", arguments.clusters, "largest components to keep [50]; 0: all")
        ->group(group)
        ->check(CLI::Range(0, 1000000000));
    app.add_option("--memory", memory,
                   "bytes the voxels may take, as 8G or 500M [60 % of what is free]")
        ->group(group);
    app.add_flag("--no-preview", arguments.no_preview, "write no picture of the mesh")
        ->group(group);
    app.set_version_flag("--version", kVersion);
    parse_command_line(app, argc, argv);
    if (!box.empty()) parse_box(box, arguments.rules);
    if (!memory.empty()) arguments.max_bytes = parse_bytes(memory);

    std::error_code failure;
    if (!fs::exists(arguments.model, failure))
        throw Error(
            ExitCode::input,
            str(arguments.model, ": does not exist; --model expects a run folder or a splat PLY"));
    if (fs::is_directory(arguments.model, failure))
        table.read_file(run_config_path(arguments.model));
    flags.set_keys(table);
    if (options.scene.path.empty())
        throw Error(
            ExitCode::usage,
            str(arguments.model,
                ": is no run folder, so it does not say which scene it shows; give --scene DIR"));
    options.scene.need_points = false;
    options.scene.min_train_views = 1;
    return arguments;
}

/// Median of the depths that are there; 0 without any.
double median_depth(std::vector<float> depths) {
    std::erase_if(depths, [](float d) { return !(d > 0 && std::isfinite(d)); });
    if (depths.empty()) return 0;
    const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
    std::nth_element(depths.begin(), middle, depths.end());
    return *middle;
}

/// Voxels along the depth limit: as many as the official codes take, but none smaller than a pixel
/// at half that depth, where the object is: such voxels average nothing and hold only noise.
int automatic_resolution(const std::vector<View>& views) {
    float focal_px = kMeshResolution / 2.0f;
    for (const View& view : views) focal_px = std::min(focal_px, view.camera.fx_px);
    return std::max(8, static_cast<int>(2 * focal_px));
}

/// A pixel marks what lies within the truncation of its depth. Where the marks of neighbouring
/// pixels do not touch, the surface falls apart into specks.
void check_truncation(const Camera& camera, std::vector<float> depths, const TsdfOptions& volume) {
    const double pixel = median_depth(std::move(depths)) / std::max(camera.fx_px, camera.fy_px);
    if (2 * volume.truncation >= pixel) return;
    throw Error(ExitCode::usage, str("voxels of ", volume.voxel_size, " with a truncation of ",
                                     volume.truncation, ": the pixels lie ", pixel,
                                     " apart on the surface, so it would have gaps; give "
                                     "a --voxel-size of about ",
                                     pixel, ", or a --truncation of at least ", pixel));
}

std::vector<Camera> cameras_of(const std::vector<View>& views) {
    std::vector<Camera> cameras;
    for (const View& view : views) cameras.push_back(view.camera);
    return cameras;
}

/// Depths beyond twice the distance from the nearest camera to what all look at are background.
template <class Device>
float automatic_depth_max(const std::vector<View>& views,
                          const Gaussians<Device>& gaussians,
                          Backbone<Device>& backbone) {
    const std::vector<Camera> cameras = cameras_of(views);
    std::optional<Focus> focus = find_focus(cameras);
    if (!focus) {
        const auto& rendered = backbone.forward(gaussians, cameras.front(), gaussians.sh_degree,
                                                Channels::color_plane);
        focus = focus_at_depth(cameras, median_depth(to_host(rendered.depth)));
        spdlog::warn(
            "the optical axes are parallel: depths are limited by the median depth of {}; see "
            "--depth-max",
            views.front().name);
    }
    if (!(focus->radius > 0))
        throw Error(ExitCode::input,
                    "no depth limit can be found: a camera lies in the point that all look at; "
                    "give --depth-max");
    spdlog::info("cameras look at ({:.4g}, {:.4g}, {:.4g}), the nearest from {:.4g}",
                 focus->point.x, focus->point.y, focus->point.z, focus->radius);
    return static_cast<float>(2 * focus->radius);
}

void report_counts(const DepthCounts& counts, const DepthRules& rules) {
    const auto line = [&](const char* what, std::int64_t count) {
        if (count > 0) spdlog::info("  {:>12} pixels dropped: {}", count, what);
    };
    spdlog::info("  {:>12} pixels fused", counts.kept);
    line("depth not finite", counts.not_finite);
    line("no surface", counts.no_surface);
    line(str("depth at or beyond ", rules.depth_max).c_str(), counts.too_far);
    line(str("coverage below ", rules.alpha_min).c_str(), counts.transparent);
    line("outside of the mask", counts.masked);
    line("outside of --bbox", counts.outside);
}

template <class Device>
TriangleMesh extract(const Scene& scene,
                     const Gaussians<Cpu>& splats,
                     const RunOptions& options,
                     const Arguments& arguments) {
    Gaussians<Device> gaussians;
    copy(splats, gaussians);
    const auto backbone = make_backbone<Device>(options.train.backbone, options.train.core);

    DepthRules rules = arguments.rules;
    if (rules.depth_max == 0)
        rules.depth_max = automatic_depth_max(scene.train, gaussians, *backbone);
    TsdfOptions volume_options;
    const int resolution = arguments.mesh_resolution > 0 ? arguments.mesh_resolution
                                                         : automatic_resolution(scene.train);
    volume_options.voxel_size = arguments.voxel_size > 0
                                    ? arguments.voxel_size
                                    : rules.depth_max / static_cast<float>(resolution);
    volume_options.truncation = arguments.truncation > 0
                                    ? arguments.truncation
                                    : kTruncationVoxels * volume_options.voxel_size;
    volume_options.max_bytes =
        arguments.max_bytes > 0
            ? arguments.max_bytes
            : static_cast<std::int64_t>(kShareOfFreeMemory *
                                        static_cast<double>(free_bytes(Device{})));
    spdlog::info("voxels of {:.4g}, truncation {:.4g}, depths below {:.4g}",
                 volume_options.voxel_size, volume_options.truncation, rules.depth_max);

    TsdfVolume<Device> volume(volume_options);
    DepthCounts counts;
    Buffer<float, Device> depth;
    Buffer<std::uint8_t, Device> mask, fates;
    double median = 0;
    bool checked = false;
    for (const View& view : scene.train) {
        const auto& rendered =
            backbone->forward(gaussians, view.camera, gaussians.sh_degree, Channels::color_plane);
        const Camera& camera = rendered.camera;  // that of the depths
        copy(arguments.no_masks ? std::vector<std::uint8_t>() : view.mask.pixels, mask);
        counts += clean_depth(rendered, camera, std::as_const(mask).span(), rules, depth, fates);
        if (!checked && counts.kept > 0) {
            check_truncation(camera, to_host(depth), volume_options);
            checked = true;
        }
        with_context("fusing " + view.name, [&] {
            volume.integrate({camera, std::as_const(depth).span(), rendered.color.span()});
        });
        if (counts.kept == 0) median = median_depth(to_host(rendered.depth));
    }
    report_counts(counts, rules);
    spdlog::info("{} blocks of {}^3 voxels, {:.1f} MiB", volume.blocks().size(), kBlockEdge,
                 static_cast<double>(volume.bytes()) / (1 << 20));

    TriangleMesh mesh = marching_cubes(volume.blocks(), arguments.min_weight);
    if (counts.kept == 0)
        spdlog::warn(
            "empty mesh: none of {} depth pixels passed (depths below {:.4g} pass; the median "
            "depth of the last view is {:.4g}); "
            "raise --depth-max, lower --alpha-min, or look at the masks and --bbox",
            counts.not_finite + counts.too_far + counts.transparent + counts.masked +
                counts.outside,
            rules.depth_max, median);
    return mesh;
}

std::string default_output(const std::string& model) {
    if (fs::is_directory(model)) return (fs::path(model) / "mesh" / "mesh.ply").string();
    return (fs::path(model).parent_path() / "mesh.ply").string();
}

int command(int argc, char** argv) {
    RunOptions options;
    Arguments arguments = parse(argc, argv, options);
    init_log(arguments.quiet     ? Verbosity::quiet
             : arguments.verbose ? Verbosity::verbose
                                 : Verbosity::normal);
    if (arguments.out.empty()) arguments.out = default_output(arguments.model);
    const std::string splat_path = find_splats(arguments.model);
    std::error_code failure;
    if (fs::equivalent(splat_path, arguments.out, failure))
        throw Error(ExitCode::usage,
                    str("--out ", arguments.out, ": is the file of the splats; name another"));
    const DeviceChoice device = choose_device(arguments.device);
    const Gaussians<Cpu> splats = read_splats(splat_path);
    const Scene scene = read_scene_of_run(options.scene, arguments.model);
    spdlog::info("{}: {} splats; {} training views of {}, on {}", splat_path, splats.size(),
                 scene.train.size(), options.scene.path, device.description);

    TriangleMesh mesh = on_device(device, [&](auto tag) {
        return extract<decltype(tag)>(scene, splats, options, arguments);
    });
    const CleanReport cleaned = keep_largest_components(mesh, arguments.clusters);
    spdlog::info("{} components, {} kept; {} faces and {} vertices removed", cleaned.components,
                 cleaned.kept_components, cleaned.removed_faces, cleaned.removed_vertices);
    if (mesh.faces.empty() && cleaned.components > 0)
        spdlog::warn(
            "empty mesh: all {} components have fewer than 50 faces; lower --voxel-size, or pass "
            "--clusters 0",
            cleaned.components);
    write_mesh_ply(arguments.out, mesh);
    spdlog::info("{}: {} vertices, {} faces", arguments.out, mesh.vertices.size(),
                 mesh.faces.size());
    if (!arguments.no_preview && !mesh.faces.empty()) {
        const std::string picture = fs::path(arguments.out).replace_extension(".png").string();
        write_png(picture,
                  preview_mesh(mesh, preview_camera(mesh, cameras_of(scene.train), 960, 720)));
        spdlog::info("{}: picture of the mesh", picture);
    }
    return 0;
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::command(argc, argv); });
}
