// tvsgs-init: makes a dense coloured cloud and depth maps from calibrated photographs; uses no
// network.
#include <filesystem>
#include <set>

#include "apps/common/command_line.h"
#include "apps/common/key_flags.h"
#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "io/config/config.h"
#include "io/files/atomic_file.h"
#include "io/files/manifest.h"
#include "io/files/npz.h"
#include "io/images/image_file.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"
#include "pipeline/scene/mask_use.h"
#include "pipeline/scene/stereo_cloud.h"
#include "render/depth/map_images.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct Arguments {
    std::string out, maps, device = "auto";
    std::int64_t max_points = 1500000;
    bool pictures = true, list_keys = false;
};

Arguments parse(int argc, char** argv, OptionTable& table, StereoOptions& stereo) {
    Arguments arguments;
    CLI::App app{"Makes a dense point cloud from calibrated photographs by multi-view stereo.",
                 "tvsgs-init"};
    app.get_formatter()->column_width(46);
    KeyFlags flags(app, table);
    flags.add_scene();
    start_group(app, "Stereo");
    flags.add("--use-masks", "stereo.use_masks");
    app.add_option("--seed", stereo.seed, "seed of all random numbers");
    app.add_option("--device", arguments.device, "auto, cpu, cuda or cuda:N");
    flags.add_set();
    app.add_flag("--list-keys", arguments.list_keys,
                 "print all keys with range, default and meaning");
    start_group(app, "Output");
    app.add_option("-o,--out,--output", arguments.out, "cloud to write (PLY)");
    app.add_option("--maps", arguments.maps,
                   "folder for depth, normal and confidence maps and their priors.json");
    app.add_flag("!--no-pictures", arguments.pictures, "do not write PNG pictures of the maps");
    add_number(app, "--max-points", arguments.max_points, 1, 2000000000,
               "most points of the cloud, which is thinned to it [1500000]");
    add_log_flags(app, Verbosity::verbose);
    parse_command_line(app, argc, argv);
    Configuration of_other_commands;
    flags.set_all(table, &of_other_commands.table);
    return arguments;
}

/// The description of the maps for programs that read them.
constexpr const char* kPriors = R"({
  "version": 1,
  "depth": {"dir": "depth", "encoding": "npy", "quantity": "depth", "geometry": "z",
            "alignment": "metric", "invalid": [0], "producer": "tvsgs-init"},
  "confidence": {"dir": "confidence", "encoding": "npy", "range": "unit"},
  "normal": {"dir": "normal", "encoding": "npy", "frame": "camera_opencv", "facing": "camera",
             "layout": "hwc", "range": "signed"}
}
)";

/// Removes maps of an earlier call that this one has not written; readers would take them for new
/// ones.
void remove_other_maps(const std::string& folder, const std::set<std::string>& written) {
    std::error_code code;
    const auto listing = folder_with_manifest(fs::path(folder) / "priors.json");
    std::vector<fs::path> others;
    for (const char* kind : {"depth", "confidence", "normal", "pictures"})
        for (fs::recursive_directory_iterator it(fs::path(folder) / kind, code), end;
             !code && it != end; it.increment(code))
            if (it->is_regular_file(code) && !written.contains(it->path().string()) && listing &&
                is_listed(*listing, it->path()))
                others.push_back(it->path());
    for (const fs::path& file : others) fs::remove(file, code);
    if (!others.empty())
        spdlog::info("{}: removed {} maps of an earlier call", folder, others.size());
}

void write_maps(const std::string& folder,
                const std::vector<View>& views,
                const std::vector<StereoMaps>& maps,
                bool pictures) {
    std::set<std::string> written;
    for (std::size_t v = 0; v < views.size(); ++v) {
        const StereoMaps& map = maps[v];
        const int width = map.camera.width_px, height = map.camera.height_px;
        const std::string stem = fs::path(views[v].name).replace_extension().string();
        const auto path = [&](const char* kind, const char* ending) {
            return *written.insert((fs::path(folder) / kind / (stem + ending)).string()).first;
        };
        write_npy(path("depth", ".npy"), {height, width}, map.depth.data());
        write_npy(path("confidence", ".npy"), {height, width}, map.confidence.data());
        write_npy(path("normal", ".npy"), {height, width, 3}, &map.normals.data()->x);
        if (!pictures) continue;
        write_png(path("pictures", "_depth.png"), depth_image(width, height, map.depth));
        write_png(path("pictures", "_normal.png"), normal_image(width, height, map.normals));
    }
    remove_other_maps(folder, written);
    write_text_file((fs::path(folder) / "priors.json").string(), kPriors);
}

}  // namespace

int command(int argc, char** argv) {
    SceneOptions scene_options;
    scene_options.min_train_views = 1;  // stereo reports a single view itself
    scene_options.points_required = false;
    StereoOptions stereo_options;
    OptionTable table;
    table.add("scene", scene_options);
    table.add("stereo", stereo_options);
    const Arguments arguments = parse(argc, argv, table, stereo_options);
    if (arguments.list_keys) {
        std::fputs(table.help().c_str(), stdout);
        return 0;
    }
    if (scene_options.path.empty()) throw usage_error("no scene given; give --scene DIR");
    if (!arguments.pictures && arguments.maps.empty())
        throw usage_error("--no-pictures: needs --maps DIR");
    if (arguments.out.empty() && arguments.maps.empty())
        throw usage_error("nothing to write; give --out CLOUD.ply, --maps DIR or both");
    std::error_code failure;
    if (fs::is_directory(arguments.out, failure))
        throw usage_error("--out ", arguments.out, ": is a folder; expected a file name");
    if (!arguments.out.empty()) require_output(arguments.out, {".ply"}, scene_options);
    if (!arguments.maps.empty())
        create_results_folder(arguments.maps,
                              {"depth", "confidence", "normal", "pictures", "priors.json"});
    const DeviceChoice device = choose_device(arguments.device);
    scene_options.scratch =
        arguments.out.empty() ? "" : fs::absolute(arguments.out).parent_path().string();
    const Scene scene = read_scene(scene_options);
    if (stereo_options.use_masks)
        require_masks("stereo.use_masks is true", "leave out --use-masks",
                      look_at_masks(scene.train, {}));
    const Camera& camera = scene.train.front().camera;
    spdlog::info("{}: {} photographs, {}x{}; {} sparse points; {}", scene_options.path,
                 scene.train.size(), camera.width_px, camera.height_px,
                 grouped(scene.points.positions.size()), device.description);
    const StereoResult result = stereo_cloud(device, scene.train, scene.points.positions,
                                             stereo_options, std::size_t(arguments.max_points));
    if (!arguments.maps.empty())
        write_maps(arguments.maps, scene.train, result.maps, arguments.pictures);
    if (!arguments.out.empty()) write_cloud_ply(arguments.out, result.cloud, scene.origin);
    for (const std::string& path : {arguments.out, arguments.maps})
        if (!path.empty())
            spdlog::info("{}: {}", path == arguments.out ? "Cloud" : "Depth and normal maps", path);
    if (!arguments.out.empty())
        say_next({"tvsgs-train", "--scene", scene_options.path, "--init-ply", arguments.out},
                 "train from it");
    else
        say_next({"tvsgs-train", "--scene", scene_options.path, "--priors", arguments.maps},
                 "train with the maps, if a loss uses them");
    return 0;
}

}  // namespace tvsgs
