#include "apps/train/command.h"

#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/common/key_flags.h"
#include "core/device/device_choice.h"
#include "core/progress.h"
#include "io/config/built_in_configs.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"
#include "pipeline/run/resume.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"
#include "pipeline/run/signals.h"
#include "pipeline/run/train_session.h"
#include "pipeline/scene/initial_points.h"
#include "pipeline/scene/planned_scene.h"
#include "pipeline/scene/sky.h"
#include "plan/memory.h"
#include "plan/settings.h"
#include "plan/time.h"
#include "report/data.h"

namespace tvsgs {
namespace {

struct Arguments {
    std::string out, device = "auto", progress = "auto";
    bool overwrite = false, quiet = false, verbose = false, list_keys = false, deterministic = true,
         plan = false;
    SessionOptions session;
    Resume resume;
};

/// Defaults < configuration files in order < environment < command line, all in one table.
Arguments parse(int argc, char* const* argv, OptionTable& table) {
    Arguments arguments;
    CLI::App app{
        "Trains Gaussian splats on calibrated photographs; tensor voting keeps the surface.",
        "tvsgs-train"};
    app.get_formatter()->column_width(46);
    std::vector<std::string> configs, settings;
    KeyFlags flags(app, table);
    flags.add_scene();
    flags.add("--mask-use", "loss.photometric.masks",
              "object: nothing is outside of the masks; ignore: what is outside is not looked at; "
              "none [the plan decides; none without it]",
              "Scene");
    flags.add("--init-ply", "scene.init_ply", "initial cloud instead of the model's points",
              "Scene");
    flags.add("--fixed-points", "tv.fixed_voters",
              "measured points (LiDAR) in the frame of the scene: they vote and never move",
              "Scene");
    flags.add("--priors", "priors.dir",
              "folder of depth, normals and features that others made of the photographs [looked "
              "for in the scene]",
              "Scene");
    const char* group = "Training";
    flags.add(
        "--iterations", "iterations",
        "training iterations, to which the plan fits its schedule [by the plan; with --config, "
        "that of the file]",
        group);
    flags.add("--seed", "seed", "of all random numbers", group);
    flags.add("--max-gaussians", "densify.max_gaussians", "growth stops there", group);
    flags.add("--gpu-memory", "memory.gpu", "GPU memory to use, such as 8G: growth stops before",
              group);
    flags.add("--host-memory", "memory.host", "the same of the host", group);
    app.add_option("--device", arguments.device, "auto, cpu, cuda or cuda:N")->group(group);
    flags.add_switch("--refine-cameras", "cameras.refine",
                     "move the training views' poses along with the splats [the plan decides; no "
                     "without it]",
                     group);
    flags.add("--time-budget", "plan.time_budget",
              "seconds of training to fit the schedule into, at most as long as it is", group);
    flags.add("--until", "plan.until",
              "iterations, or converged: stop when views that do not train gain no more", group);
    app.add_flag("--deterministic", arguments.deterministic,
                 "accepted for scripts: every run is reproducible bit for bit")
        ->group(group);
    group = "Evaluation";
    flags.add("--eval-at", "eval.at",
              "seconds of training after which to evaluate: 5,10,20,40 or 5,10,...", group);
    flags.add("--eval-every", "eval.every", "iterations between evaluations", group);
    flags.add("--gt", "eval.gt", "true surface (PLY): Chamfer and F1 of the splats' centres",
              group);
    flags.add_switch("--eval-mesh", "eval.mesh", "with --gt: extract and measure the mesh as well",
                     group);
    flags.add("--visible-gt", "eval.visible_gt", "part that completeness asks for", group);
    flags.add("--crop", "eval.crop", "selection volume, box or gt/info.json", group);
    flags.add("--tau", "eval.taus", "thresholds T,T,... of F1 [0.5, 1, 2 % of the truth]", group);
    group = "Configuration";
    app.add_option("-c,--config", configs, "JSON file; later ones win [configs/auto.json]")
        ->group(group)
        ->expected(1)
        ->take_all();
    app.add_option("--set", settings, "KEY=VALUE for any key of --list-keys")
        ->group(group)
        ->expected(1)
        ->take_all();
    app.add_flag("--plan", arguments.plan,
                 "look at the scene, print what it needs and why, with its memory and time, and "
                 "stop; without a configuration that is what a run goes by")
        ->group(group);
    app.add_flag("--list-keys", arguments.list_keys,
                 "print every key with its range, default and meaning")
        ->group(group);
    group = "Output";
    app.add_option("-o,-m,--out,--output,--model-path", arguments.out,
                   "run folder [runs/<name of the scene>]")
        ->group(group);
    app.add_flag("--overwrite", arguments.overwrite, "replace the run in an occupied folder")
        ->group(group);
    std::string resume;
    CLI::Option* const resume_flag =
        app.add_option("--resume", resume,
                       "go on from the newest checkpoint of that run folder (or of --out), or from "
                       "that checkpoint; other flags change the configuration from there on")
            ->expected(0, 1)
            ->group(group);
    app.add_option("--checkpoint-every", arguments.session.checkpoint_every,
                   "iterations between checkpoints, the end is one as well; 0: only when the run "
                   "is stopped [5000]")
        ->check(CLI::Range(0, 1000000000))
        ->group(group);
    app.add_option("--progress", arguments.progress, "auto, plain or json")
        ->check(CLI::IsMember({"auto", "plain", "json"}))
        ->group(group);
    app.add_option("--report-every", arguments.session.report_every,
                   "iterations between lines of log.jsonl [50]")
        ->check(CLI::Range(1, 1000000000))
        ->group(group);
    CLI::Option* quiet =
        app.add_flag("--quiet", arguments.quiet, "warnings and errors only")->group(group);
    app.add_flag("--verbose", arguments.verbose, "more detail")->group(group)->excludes(quiet);
    app.add_flag("--profile", arguments.session.profile,
                 "seconds per stage in log.jsonl; waits around each stage, so the run is slower")
        ->group(group);
    app.add_option("--live", arguments.session.live_every,
                   "write the splats every so many seconds, for tvsgs-view to follow the run [5]")
        ->expected(0, 1)
        ->default_str("5")
        ->check(in_range(1.0, 1e6))
        ->group(group);
    parse_command_line(app, argc, argv);
    init_log(arguments.quiet     ? Verbosity::quiet
             : arguments.verbose ? Verbosity::verbose
                                 : Verbosity::normal);
    if (!arguments.quiet && arguments.progress != "auto")
        set_progress_style(arguments.progress == "json" ? ProgressStyle::json
                                                        : ProgressStyle::plain);

    if (arguments.plan && resume_flag->count() > 0)
        throw Error(ExitCode::usage,
                    "--plan with --resume: a run that goes on keeps its settings; plan.json in its "
                    "folder is the plan");
    if (resume_flag->count() > 0) arguments.resume = open_resume(resume, arguments.out, table);
    if (configs.empty() && !is_configured(arguments.resume, arguments.out))
        table.read_text("configs/auto.json", built_in_config(kAutoConfig));
    for (const std::string& file : configs) table.read_file(file);
    table.read_environment();
    flags.set_keys(table);
    table.set_all(settings);
    return arguments;
}

/// What the scene has no say in is refused before it is read.
void check_options(const RunOptions& options) {
    if (options.scene.path.empty())
        throw Error(ExitCode::usage, "no scene given; expected --scene DIR; see --help");
    check_consistency(options.train);
    const EvaluationSchedule checked(options.eval);
    check_mesh_options(options.mesh);
}

std::string default_run_folder(const std::string& scene) {
    return "runs/" + std::filesystem::weakly_canonical(scene).filename().string();
}

/// The folder itself, where there is one.
std::string existing_folder_above(const std::string& path) {
    namespace fs = std::filesystem;
    std::error_code code;
    fs::path folder = fs::absolute(path, code).lexically_normal();
    while (!fs::is_directory(folder, code) && folder != folder.parent_path())
        folder = folder.parent_path();
    return folder.string();
}

/// The scene that is trained on, planned unless the run goes on with what it had.
Scene read_training_scene(const DeviceChoice& device,
                          const Arguments& arguments,
                          RunOptions& options,
                          OptionTable& table,
                          RunPlan& plan) {
    const auto& point = arguments.resume.point;
    if (!point) return read_and_plan(device, arguments.plan, options, table, plan);
    // Stereo went by the points that the scene came with.
    options.scene.need_points = !needs_of(options.train.loss).view_maps.empty();
    options.scene.points_required = false;
    Scene scene = read_views(options, true, table);
    read_fixed_points(options, scene);
    read_fixed_splats(options, scene);
    StereoStart stereo{scene.points.positions, {}};
    adopt_scene(*point, scene);
    read_sky(options.train.loss.photometric, point->run);
    provide_maps(device, options, std::move(stereo), scene);
    return scene;
}

/// A run that is resumed begins with the checkpoint's splats.
std::int64_t first_splats(const Resume& resume, const Scene& scene) {
    return static_cast<std::int64_t>(resume.point
                                         ? resume.point->state->get("opacity_logits", 4).count()
                                         : scene.points.positions.size());
}

/// What made the run, for config.json.
JsonValue run_info(const DeviceChoice& device,
                   const Resume& resume,
                   const JsonValue& changed,
                   int argc,
                   char* const* argv) {
    std::string line;
    for (int i = 0; i < argc; ++i) line += (i ? " " : "") + std::string(argv[i]);
    JsonValue info;
    info.add("version", kVersion).add("device", device.description).add("command_line", line);
    if (resume.point) info.add("resumed_from", resume.done()).add("changed", changed);
    return info;
}

/// The text of plan.json; empty: none. A run that starts again, as it was stopped before its first
/// checkpoint, keeps its plan.
std::string plan_json(const RunPlan& plan, const Arguments& arguments) {
    const std::string file = arguments.out + "/plan.json";
    std::error_code code;
    if (!plan.empty()) return plan.json();
    return arguments.resume.in_place() && std::filesystem::exists(file, code) ? read_bytes(file)
                                                                              : "";
}

void say_what_is_trained(const Scene& scene, const DeviceChoice& device, const MemoryPlan& memory) {
    const Camera& camera = scene.train.front().camera;
    spdlog::info(
        "{}: {} training and {} test views of {}x{}, {} initial points, extent {:.4g}, on {}",
        scene.path, scene.train.size(), scene.test.size(), camera.width_px, camera.height_px,
        scene.points.positions.size(), static_cast<double>(scene.extent), device.description);
    spdlog::info(memory.text());
}

/// A run without a report has what was asked for.
void report_if_possible(const std::string& run, const Scene& scene) {
    try {
        write_report(run, scene);
        spdlog::info("{}/report.html: report", run);
    } catch (const Error& error) {
        spdlog::warn("{}; there is no report (tvsgs-eval report --run {})", error.what(), run);
    }
}

/// What --plan says of memory and time, once there is a cloud to train from.
void print_costs(const DeviceChoice& device, RunOptions& options, Scene& scene) {
    if (options.scene.init_ply.empty() && needs_stereo(options, scene)) {
        std::fputs(
            "memory and time: not known before stereo has made its cloud; tvsgs-init --out "
            "CLOUD.ply makes it, --init-ply CLOUD.ply --plan goes by it\n",
            stdout);
        return;
    }
    TrainOptions training = options.train;
    const auto splats = static_cast<std::int64_t>(scene.points.positions.size());
    std::printf("%s\n",
                plan_memory(scene, options.memory, splats, device.cuda, training).text().c_str());
    std::fflush(stdout);
    try {
        std::printf("%s\n", plan_time(device, scene, training).text().c_str());
    } catch (const Error& error) {
        std::printf("time: not measured: %s\n", error.what());
    }
}

}  // namespace

int train_command(int argc, char* const* argv) {
    // 1. What is asked for.
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    Arguments arguments = parse(argc, argv, table);
    const Resume& resume = arguments.resume;
    if (arguments.list_keys) {
        std::fputs(table.help().c_str(), stdout);
        return 0;
    }
    check_options(options);
    const DeviceChoice device = choose_device(arguments.device);
    const std::optional<Truth> truth = read_truth(
        options.eval, options.eval.gt.empty() ? Vec3d{} : read_scene_origin(options.scene));
    if (arguments.out.empty()) arguments.out = default_run_folder(options.scene.path);
    if (!arguments.plan)
        require_free_run_folder(arguments.out, arguments.overwrite, resume.in_place(),
                                options.scene);
    if (!arguments.overwrite) require_nothing_lost(resume, arguments.out);
    options.scene.scratch = existing_folder_above(arguments.out);
    require_iterations_left(resume, options.train.iterations);
    require_same_backbone(resume, options.train.backbone);
    if (resume.point) check_start(*resume.point->state, options.train);

    // 2. The scene, and what it needs.
    RunPlan plan(table);
    Scene scene = read_training_scene(device, arguments, options, table, plan);
    if (arguments.plan) {
        std::fputs(plan.text().c_str(), stdout);
        std::fflush(stdout);
        print_costs(device, options, scene);
        return 0;
    }
    const JsonValue changed = resume.point ? changed_values(resume.configured, table) : JsonValue();
    TrainOptions training = options.train;  // the configuration keeps the cap that was asked for
    const MemoryPlan memory =
        plan_memory(scene, options.memory, first_splats(resume, scene), device.cuda, training);

    // 3. The run.
    const auto config = [&] { return table.json(run_info(device, resume, changed, argc, argv)); };
    const std::string plan_text = plan_json(plan, arguments);
    RunFolder run(arguments.out, resume.point && resume.in_place() ? resume.done() : -1);
    run.save_config(config());
    write_text_file(run.path() + "/memory.json", memory.json() + "\n");
    if (!plan_text.empty()) write_text_file(run.path() + "/plan.json", plan_text);
    write_sky(run.path(), training.loss.photometric);
    log_resume(resume, changed, run);
    run.save_cameras(scene);
    say_what_is_trained(scene, device, memory);
    const SessionInputs session{.scene = scene,
                                .training = training,
                                .options = options,
                                .session = arguments.session,
                                .resume = resume,
                                .truth = truth,
                                .config = config,
                                .write_report = [&] { report_if_possible(run.path(), scene); }};
    // Moved: the session frees the state as soon as it has loaded it.
    run_session(device, session, resume.point ? std::move(arguments.resume.point->state) : nullptr,
                run);
    spdlog::info("{}: splats", find_splats(run.path()));
    say_next({"tvsgs-extract-mesh", "--model", run.path()}, "makes the surface");
    return 0;
}

}  // namespace tvsgs
