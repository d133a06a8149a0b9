// tvsgs-blocks split: trains the whole scene coarsely and splits it into independent blocks.
#include <filesystem>
#include <memory>

#include "apps/blocks/subcommands.h"
#include "apps/common/key_flags.h"
#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "core/scene/splat_lists.h"
#include "io/files/atomic_file.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"
#include "optim/loop/schedule.h"
#include "pipeline/blocks/blocks_split.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/scene/exposures.h"
#include "pipeline/scene/sky.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

struct SplitArguments {
    std::string scene, out, coarse, device = "auto";
    std::vector<std::string> configs, settings;
    std::vector<double> up;
    int resolution = -1, coarse_resolution = 4, coarse_splats = 2000000, iterations = 0;
    bool has_resolution = false;
    SplitOptions split;
};

/// Exists while a folder is being split; such a folder may be split again.
constexpr const char* kUnfinished = "/split-unfinished";

/// Requires a folder that is new, empty, or of an unfinished split. Never empties any other folder.
void require_free_folder(const std::string& out) {
    std::error_code code;
    if (fs::exists(out + "/manifest.json", code))
        throw usage_error("--out ", out,
                          ": holds a split scene; choose another folder, or remove it and all its "
                          "trained blocks");
    if (!fs::exists(out, code) || fs::exists(out + kUnfinished, code)) return;
    if (!fs::is_directory(out, code) || !fs::is_empty(out, code))
        throw usage_error("--out ", out,
                          ": already exists and is not empty; choose another folder");
}

/// Trains the coarse run in BLOCKS/coarse, or resumes it.
std::string train_coarse(const SplitArguments& a) {
    const std::string run = a.out + "/coarse";
    spdlog::info(
        "Trains a coarse run of the whole scene first, in {}; --set iterations=N shortens it", run);
    std::vector<std::string> words{"tvsgs-train"};
    words.insert(words.end(), {"--scene", a.scene, "--out", run, "-r", str(a.coarse_resolution),
                               "--device", a.device, "--max-gaussians", str(a.coarse_splats)});
    for (const std::string& config : a.configs) words.insert(words.end(), {"--config", config});
    for (const std::string& setting : a.settings) words.insert(words.end(), {"--set", setting});
    if (is_quiet()) words.push_back("--quiet");
    words.push_back("--resume");
    with_context("training the coarse run", [&] { run_train(words); });
    return run;
}

/// Settings of the whole scene, from the resolved settings of the coarse run.
void configure(const SplitArguments& a, const std::string& coarse, Configuration& whole) {
    OptionTable& table = whole.table;
    table.read_file(run_config_path(coarse));
    if (!a.coarse.empty()) {
        for (const std::string& config : a.configs) table.read_file(config);
        table.set_all(a.settings);
    }
    const std::string by = "tvsgs-blocks split";
    if (!a.scene.empty()) table.set("scene.path", a.scene, by);
    // The plan was made by the coarse run; all blocks keep it.
    table.set("plan.enabled", "false", by), table.set("plan.time_budget", "0", by);
    table.set("plan.until", "iterations", by);
    if (a.has_resolution || a.coarse.empty())
        table.set("scene.resolution", std::to_string(a.resolution), by);
    if (a.iterations > 0) fit_schedule(whole.options.train, a.iterations);
    for (const char* key : {"eval.gt", "eval.at", "init.fixed_splats"}) table.set(key, "", by);
    table.set("eval.every", "0", by), table.set("eval.mesh", "false", by);
}

void check_supported(const RunOptions& options) {
    if (!options.train.tv.fixed_voters.empty())
        throw usage_error(options.train.tv.fixed_voters,
                          ": blocks cannot use measured points (tv.fixed_voters); remove them");
    if (options.train.cameras.refine)
        spdlog::warn(
            "cameras.refine is off in blocks, which must share their poses; to use refined poses, "
            "split the scene with the poses of a run");
}

/// Settings of one block: the whole scene's without its view lists; rates and sizes relative
/// to the scene extent are converted to the extent of the whole.
std::string block_config(const RunOptions& options,
                         const std::string& base,
                         double whole_over_block,
                         const SplitOptions& split) {
    Configuration of_block;
    auto& [block, table] = of_block;
    table.read_text("BLOCKS/config.json", base);
    const std::string by = "tvsgs-blocks split";
    for (const char* key :
         {"scene.split", "scene.views", "scene.test_list", "scene.train_list", "scene.init_ply"})
        table.set(key, "", by);
    table.set("scene.num_views", "0", by), table.set("scene.eval", "false", by);
    table.set("cameras.refine", "false", by);
    table.set("init.force", "true", by);  // a block has few points in most of its views
    const AdamOptions& lr = options.train.lr;
    const DensifyOptions& densify = options.train.densify;
    block.train.lr.position_start = float(lr.position_start * whole_over_block);
    block.train.lr.position_end = float(lr.position_end * whole_over_block);
    block.train.densify.percent_dense = float(densify.percent_dense * whole_over_block);
    block.train.densify.prune_large = float(densify.prune_large * whole_over_block);
    if (split.max_splats > 0) block.train.densify.max_gaussians = int(split.max_splats);
    return table.json();
}

struct Splitting {
    const SplitArguments& a;
    const RunOptions& options;
    const Scene& scene;
    const Gaussians<Cpu>& coarse;
    PlyScales scales;
    const std::string& base;  // settings of the whole scene
    double finer;
};

/// Writes one block; returns its entry in the manifest.
FileRecord write_block(const Splitting& s,
                       const BlocksManifest& manifest,
                       int number,
                       const BlockContents& block) {
    const std::string folder = manifest.block_folder(number);
    Scene part;  // for its extent
    std::string names;
    for (const int v : block.views) {
        const View& view = s.scene.train[v];
        part.train.emplace_back().camera = view.camera;
        names += view.name + "\n";
    }
    BlockInputs inputs;
    inputs.block = number, inputs.split = manifest.split;
    inputs.views = int(block.views.size());
    inputs.points = std::int64_t(block.points.positions.size());
    inputs.expected_splats = std::int64_t(block.expected);
    inputs.fixed_splats = std::int64_t(block.fixed.size());
    const double ratio = double(s.scene.extent) / scene_extent(part);
    write_text_file(folder + "/views.txt", names);
    write_text_file(folder + "/config.json",
                    block_config(s.options, s.base, ratio, s.a.split) + "\n");
    write_cloud_ply(folder + "/points.ply", block.points, manifest.origin);
    std::vector<std::string> files{"views.txt", "config.json", "points.ply"};
    if (!block.fixed.empty()) {
        Gaussians<Cpu> fixed;
        copy(s.coarse, fixed);
        keep_splats(block.fixed, fixed);
        write_splat_ply(folder + "/fixed.ply", fixed, manifest.origin, s.scales);
        files.push_back("fixed.ply");
    }
    for (const std::string& file : files) inputs.files.push_back(record_of(folder, file));
    write_block_inputs(manifest, inputs);
    spdlog::info("Block {}: {} photographs, {} points, {} fixed splats around it", number,
                 inputs.views, grouped(inputs.points), grouped(inputs.fixed_splats));
    return record_of(manifest.folder, manifest.block_name(number) + "/block.json");
}

std::string commands_text(const BlocksManifest& manifest) {
    const std::string folder = for_shell(fs::absolute(manifest.folder).lexically_normal().string());
    std::string text;
    for (int block = 1; block <= manifest.count(); ++block)
        text += str("tvsgs-blocks run --blocks ", folder, " --block ", block, "\n");
    return text;
}

int split_scene(SplitArguments a) {
    if ((a.split.blocks > 0) == (a.split.max_splats > 0))
        throw usage_error("give either --blocks N or --max-splats N");
    if (a.scene.empty() && a.coarse.empty())
        throw usage_error("give --scene DIR, or --coarse RUN, which knows its scene");
    if (!a.up.empty()) {
        const Vec3d up{a.up[0], a.up[1], a.up[2]};
        if (!(norm(up) > 0))
            throw usage_error("--up: expected a direction such as 0,0,1, found length 0");
        a.split.up = up;
    }
    while (a.out.size() > 1 && a.out.back() == '/') a.out.pop_back();
    require_free_folder(a.out);
    const DeviceChoice device = choose_device(a.device);
    if (has_manifest(a.out)) remove_listed_files(a.out);
    fs::create_directories(a.out);
    start_manifest(a.out);
    write_text_file(a.out + kUnfinished, "tvsgs-blocks split has not come to its end\n");

    // 1. The coarse run, and the settings of the whole scene.
    const std::string run = a.coarse.empty() ? train_coarse(a) : a.coarse;
    Configuration coarse_run, whole;
    coarse_run.table.read_file(run_config_path(run));
    RunOptions& of_coarse = coarse_run.options;
    if (!a.scene.empty()) of_coarse.scene.path = a.scene;
    configure(a, run, whole);
    auto& [options, table] = whole;
    check_supported(options);
    of_coarse.scene.points_required = false;
    const Scene scene = read_scene_of_run(of_coarse.scene, run);
    const Gaussians<Cpu> coarse = read_splats(find_splats(run), scene.origin, of_coarse.train);

    // 2. Cells and their contents.
    const View& first = scene.train.front();
    const auto file_px = [&](int photo_px) { return int(std::lround(first.reduction * photo_px)); };
    const double finer =
        double(resized_size(options.scene.resolution, file_px(first.camera.width_px),
                            file_px(first.camera.height_px))
                   .width_px) /
        first.camera.width_px;
    const bool grows =
        options.train.densify.enabled && options.train.densify.growth_in_gaps_only < 1;
    const double expected =
        (grows ? 5.0 : 1.0) * double(std::max(scene.points.positions.size(), std::size_t{1}));
    BlocksManifest manifest;
    manifest.folder = a.out;
    manifest.scene = fs::absolute(options.scene.path).lexically_normal().string();
    manifest.scene_crc = scene_identity(options.scene);
    manifest.seed = options.train.seed, manifest.iterations = options.train.iterations;
    plan_cells(scene, coarse, options, a.split, finer, expected, manifest);
    if (!options.mesh.meshes_background() && !(options.mesh.meshers.tsdf.voxel_size > 0))
        table.set("mesh.voxel_size", str(float(manifest.voxel_size)), "tvsgs-blocks split");
    manifest.split = split_of(manifest);
    const auto looks = find_block_views(device, scene, coarse, of_coarse.train, manifest);
    const std::vector<BlockContents> blocks = fill_blocks(scene, coarse, manifest, expected, looks);

    // 3. The files; the manifest last.
    const PlyScales scales =
        make_backbone<Cpu>(of_coarse.train.backbone, of_coarse.train.render)->traits.flat
            ? PlyScales::two
            : PlyScales::three;
    const std::string base = table.json(JsonValue().add("version", kVersion).add("coarse", run));
    write_text_file(a.out + "/config.json", base + "\n");
    write_splat_ply(a.out + "/coarse.ply", coarse, scene.origin, scales);
    manifest.files = {record_of(a.out, "config.json"), record_of(a.out, "coarse.ply")};
    if (has_exposures(run)) {  // all blocks use the exposures of the coarse run
        write_text_file(a.out + "/exposure.json", read_bytes(run + "/exposure.json"));
        manifest.files.push_back(record_of(a.out, "exposure.json"));
        spdlog::info("All blocks use the exposures that {} fitted", run);
    }
    if (has_sky_file(run)) {
        write_text_file(a.out + "/sky.png", read_bytes(run + "/sky.png"));
        manifest.files.push_back(record_of(a.out, "sky.png"));
    }
    const Splitting splitting{a, options, scene, coarse, scales, base, finer};
    for (std::size_t b = 0; b < blocks.size(); ++b)
        manifest.files.push_back(write_block(splitting, manifest, int(b) + 1, blocks[b]));
    write_text_file(a.out + "/commands.txt", commands_text(manifest));
    write_manifest(manifest);
    fs::remove(a.out + kUnfinished);
    spdlog::info("Wrote {}: {} blocks with margins of {:.4g}", a.out, manifest.count(),
                 manifest.margin);
    const std::string what =
        "train the blocks (commands.txt has a line per block for a batch system)";
    if (device.cuda)
        say_next({"tvsgs-blocks", "run", a.out, "--gpus", "all"}, what);
    else
        say_next({"tvsgs-blocks", "run", a.out, "--jobs", "1"}, what);
    return 0;
}

}  // namespace

Subcommand add_blocks_split(CLI::App& app) {
    const auto a = std::make_shared<SplitArguments>();
    CLI::App* const command = app.add_subcommand(
        "split", "cut a scene into blocks by a coarse run of the whole scene, trained if missing");
    command->add_option("-s,--scene", a->scene, "folder of the scene [that of --coarse]");
    command->add_option("-o,--out", a->out, "folder to write")->required();
    CLI::Option* const coarse = command->add_option(
        "--coarse", a->coarse,
        "finished run of the whole scene [trained in OUT/coarse on smaller photographs]");
    add_number(*command, "--blocks", a->split.blocks, 1, 4096,
               "number of blocks [by --max-splats]");
    add_number(*command, "--max-splats", a->split.max_splats, 1, 2000000000,
               "most splats of a block, with its margin; decides the number of blocks [any]");
    command
        ->add_option(
            "--margin", a->split.margin,
            "width that blocks train beyond their cells, world units [by cells, votes and voxels]")
        ->check(kPositive);
    command->add_option("--up", a->up, "direction of up, x,y,z [by the cameras]")
        ->delimiter(',')
        ->expected(3)
        ->type_name("X,Y,Z");
    CLI::Option* const resolution =
        command->add_option("-r,--resolution", a->resolution,
                            "photographs of the blocks: 1, 2, 4, 8 divide the size; -1: at most "
                            "1600 px wide; other: width in pixels [-1, or that of --coarse]");
    add_number(*command, "--iterations", a->iterations, 1, 1000000000,
               "training iterations of each block [those of the coarse run]");
    command
        ->add_option("--coarse-resolution", a->coarse_resolution,
                     "photographs of the coarse run, as -r")
        ->excludes(coarse);
    command->add_option("--coarse-splats", a->coarse_splats, "most splats of the coarse run")
        ->excludes(coarse);
    command->add_option("--device", a->device, "auto, cpu, cuda or cuda:N");
    add_repeated(*command, "-c,--config", a->configs, "JSON file for tvsgs-train; later files win");
    add_repeated(*command, "--set", a->settings, "key for tvsgs-train");
    return {command, [a, resolution] {
                a->has_resolution = resolution->count() > 0;
                return split_scene(*a);
            }};
}

}  // namespace tvsgs
