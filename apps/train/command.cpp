#include "apps/train/command.h"

#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/common/key_flags.h"
#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "io/config/config.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"
#include "io/scene/georeference.h"
#include "pipeline/run/checkpoints.h"
#include "pipeline/run/run_options.h"
#include "pipeline/run/train_session.h"
#include "pipeline/scene/initial_points.h"
#include "pipeline/scene/planned_scene.h"
#include "pipeline/scene/sky.h"
#include "plan/figures.h"
#include "plan/time.h"
#include "report/report.h"

namespace tvsgs {
namespace {

struct TrainArguments {
    Configuration asked;  // defaults < configuration files < environment < command line
    std::string out;      // run folder; not empty
    std::string device = "auto";
    bool overwrite = false, plan = false, list_keys = false, report = true;
    SessionOptions session;
    Resume resume;
    std::string command_line;
};

std::string default_run_folder(const std::string& scene) {
    return "runs/" + std::filesystem::weakly_canonical(scene).filename().string();
}

/// The folder itself, if it exists; else the nearest one above it.
std::string existing_folder_above(const std::string& path) {
    namespace fs = std::filesystem;
    std::error_code code;
    fs::path folder = fs::absolute(path, code).lexically_normal();
    while (!fs::is_directory(folder, code) && folder != folder.parent_path())
        folder = folder.parent_path();
    return folder.string();
}

/// Reads the command line, the configurations and the checkpoint of --resume; starts the log.
TrainArguments parse_train_arguments(int argc, char* const* argv) {
    TrainArguments arguments;
    OptionTable& table = arguments.asked.table;
    for (int i = 0; i < argc; ++i) arguments.command_line += (i ? " " : "") + std::string(argv[i]);
    std::string progress = "auto", resume;
    bool deterministic = true;
    CLI::App app{
        "Trains Gaussian splats on calibrated photographs; tensor voting keeps the surface.",
        "tvsgs-train"};
    app.get_formatter()->column_width(46);
    KeyFlags flags(app, table);
    flags.add_scene();
    flags.add("--mask-use", "loss.photometric.masks");
    flags.add("--init-ply", "scene.init_ply");
    flags.add("--force", "init.force");
    flags.add("--fixed-points", "tv.fixed_voters");
    flags.add("--priors", "priors.dir",
              "folder of depth, normals and features from other programs [searched in the scene]");
    start_group(app, "Training");
    flags.add("--iterations", "iterations",
              "training iterations; the plan fits its schedule to them [the plan decides; with "
              "--config, from the file]");
    flags.add("--seed", "seed");
    flags.add("--max-gaussians", "densify.max_gaussians");
    flags.add("--gpu-memory", "memory.gpu");
    flags.add("--host-memory", "memory.host");
    app.add_option("--device", arguments.device, "auto, cpu, cuda or cuda:N");
    flags.add("--refine-cameras", "cameras.refine",
              "improve the training views' poses together with the splats [the plan decides; off "
              "without it]");
    flags.add("--time-budget", "plan.time_budget");
    flags.add("--until", "plan.until");
    app.add_flag("--deterministic", deterministic,
                 "accepted for scripts: every run repeats bit for bit");
    start_group(app, "Evaluation");
    flags.add("--eval-at", "eval.at");
    flags.add("--eval-every", "eval.every");
    flags.add("--gt", "eval.gt");
    flags.add("--eval-mesh", "eval.mesh");
    flags.add("--visible-gt", "eval.visible_gt");
    flags.add("--crop", "eval.crop");
    flags.add("--tau", "eval.taus");
    start_group(app, "Configuration");
    flags.add_config("JSON file; later ones win [configs/auto.json]");
    app.add_flag("--plan", arguments.plan,
                 "print the decisions with their reasons, memory and time, and stop");
    app.add_flag("--list-keys", arguments.list_keys,
                 "print every key with its range, default and meaning");
    start_group(app, "Output");
    app.add_option("-o,-m,--out,--output,--model-path", arguments.out,
                   "run folder [runs/<name of the scene>]");
    app.add_flag("--overwrite", arguments.overwrite, "replace the run in an occupied folder");
    CLI::Option* const resume_flag =
        app.add_option("--resume", resume,
                       "continue from the newest checkpoint of that run folder (or of --out), or "
                       "from that checkpoint; other flags change the configuration from there on")
            ->expected(0, 1);
    add_number(app, "--checkpoint-every", arguments.session.checkpoint_every, 0, 1000000000,
               "iterations between checkpoints, beside the last one; 0: only when the run is "
               "stopped [5000]");
    app.add_flag("!--no-report", arguments.report,
                 "leave report.html to tvsgs-extract-mesh or tvsgs-eval report");
    add_choice(app, "--progress", progress, {"auto", "plain", "json"}, "auto, plain or json");
    add_number(app, "--report-every", arguments.session.report_every, 1, 1000000000,
               "iterations between lines of log.jsonl [50]");
    add_log_flags(app, Verbosity::verbose);
    app.add_flag(
        "--profile", arguments.session.profile,
        "seconds per stage in log.jsonl; the run is slower, as it waits around each stage");
    app.add_option("--live", arguments.session.live_every,
                   "write the splats every so many seconds, for tvsgs-view to follow the run [5]")
        ->expected(0, 1)
        ->default_str("5")
        ->check(in_range(1.0, 1e6));
    parse_command_line(app, argc, argv);
    choose_progress_style(progress);

    Resume& resume_from = arguments.resume;
    if (arguments.plan && resume_flag->count() > 0)
        throw usage_error(
            "--plan with --resume: a resumed run keeps its settings; its plan is plan.json in the "
            "run folder");
    if (resume_flag->count() > 0) resume_from = open_resume(resume, arguments.out, table);
    if (!flags.has_files() && !is_configured(resume_from, arguments.out))
        table.read_text("configs/auto.json", built_in_config(kAutoConfig));
    flags.set_all(table);

    SceneOptions& scene = arguments.asked.options.scene;
    if (arguments.out.empty()) arguments.out = default_run_folder(scene.path);
    scene.scratch = existing_folder_above(arguments.out);
    return arguments;
}

/// Throws Error(ExitCode::usage) for arguments that cannot work, before the scene is read, which
/// takes a while.
void check_train_arguments(const TrainArguments& arguments) {
    const RunOptions& options = arguments.asked.options;
    const Resume& resume = arguments.resume;
    if (options.scene.path.empty())
        throw usage_error("no scene given; expected --scene DIR; see --help");
    check_consistency(options.train, options.plan.enabled && !resume.point);
    const EvaluationSchedule checked(options.eval);
    check_mesh_options(options.mesh);
    if (!arguments.plan)
        require_free_run_folder(arguments.out, arguments.overwrite, resume.in_place(),
                                options.scene);
    check_resume(resume, arguments.out, arguments.overwrite, options.train);
    if (resume.point) check_start(*resume.point->state, options.train);
}

/// "info" of config.json. `changed`: since the checkpoint.
JsonValue run_info(const DeviceChoice& device,
                   const TrainArguments& arguments,
                   const JsonValue& changed) {
    JsonValue info;
    info.add("version", kVersion)
        .add("device", device.description)
        .add("command_line", arguments.command_line);
    if (arguments.resume.point)
        info.add("resumed_from", arguments.resume.done()).add("changed", changed);
    return info;
}

/// The text of plan.json; empty: none. A run that was stopped before its first checkpoint starts
/// again and keeps its plan.
std::string plan_json(const RunPlan& plan, const TrainArguments& arguments) {
    const std::string file = arguments.out + "/plan.json";
    std::error_code code;
    if (!plan.empty()) return plan.json();
    return arguments.resume.in_place() && std::filesystem::exists(file, code) ? read_bytes(file)
                                                                              : "";
}

/// The scene, the machine and the plan, in two lines.
void log_start(const Resolved& run,
               const DeviceChoice& device,
               const MemoryPlan& memory,
               std::int64_t disk) {
    const Scene& scene = run.scene;
    const Camera& camera = scene.train.front().camera;
    spdlog::info(
        "{}: {} training and {} test photographs, {}x{}; {} start points. {}, {} of memory, {} of "
        "disk.",
        scene.path, scene.train.size(), scene.test.size(), camera.width_px, camera.height_px,
        grouped(scene.points.positions.size()), device.cuda ? device.description : "CPU",
        bytes_text(double(memory.first_bytes())), bytes_text(double(disk)));
    if (!run.plan.empty()) spdlog::info("Plan: {}. Why: --plan", run.plan.brief());
    spdlog::debug("Memory: {}; extent of the scene {:.4g}", memory.text(), double(scene.extent));
}

/// Returns false after a failure, which is a warning: the splats are written.
bool report_if_possible(const std::string& run, const Scene& scene) {
    try {
        write_report(run, scene);
        return true;
    } catch (const Error& error) {
        spdlog::warn("{}; there is no report. Try again: tvsgs-eval report --run {}", error.what(),
                     run);
        return false;
    }
}

/// --plan: the decisions, then memory and time if the start points are known.
void print_plan(const Resolved& run, const DeviceChoice& device) {
    const Scene& scene = run.scene;
    std::fputs(run.plan.text().c_str(), stdout);
    std::fflush(stdout);
    if (needs_stereo(run.options, scene)) {
        std::fputs(
            "memory and time: not known before stereo has made the start points. Make them with "
            "tvsgs-init --out CLOUD.ply, then plan with --init-ply CLOUD.ply\n",
            stdout);
        return;
    }
    TrainOptions training = run.options.train;
    const auto splats = std::int64_t(scene.points.positions.size());
    const MemoryPlan memory = plan_memory(scene, run.options.memory, splats, device.cuda, training);
    std::printf("memory: %s\n", memory.text().c_str());
    std::fflush(stdout);
    try {
        std::printf("time: %s\n", plan_time(device, scene, training).text().c_str());
    } catch (const Error& error) {
        std::printf("time: not measured: %s\n", error.what());
    }
}

}  // namespace

int train_command(int argc, char* const* argv, bool for_blocks) {
    // 1. The options that the user asks for.
    TrainArguments arguments = parse_train_arguments(argc, argv);
    arguments.session.for_blocks = for_blocks;
    const Configuration& asked = arguments.asked;
    Resume& resume = arguments.resume;
    if (arguments.list_keys) {
        std::fputs(asked.table.help().c_str(), stdout);
        return 0;
    }
    check_train_arguments(arguments);
    const DeviceChoice device = choose_device(arguments.device);
    if (!device.cuda && !asked.options.memory.gpu.empty())
        spdlog::warn("--gpu-memory is not used: the training runs on the CPU");
    const EvaluationOptions& eval = asked.options.eval;
    const std::optional<Truth> truth =
        read_truth(eval, eval.gt.empty() ? Vec3d{} : read_scene_origin(asked.options.scene));
    const std::optional<Georeference> georeference = read_georeference(asked.options.scene.path);
    std::optional<FolderClaim> claim;
    if (!arguments.plan && !resume.in_place()) claim.emplace(arguments.out);

    // 2. The scene, and the options that it needs.
    Resolved resolved = resume.point ? resolve_resumed(device, asked, *resume.point)
                                     : resolve(device, asked, arguments.plan);
    if (arguments.plan) {
        print_plan(resolved, device);
        return 0;
    }
    const auto first =
        std::int64_t(resume.point ? resume.point->state->get("opacity_logits", 4).count()
                                  : resolved.scene.points.positions.size());
    TrainOptions training = resolved.options.train;  // config.json keeps the cap as configured
    const MemoryPlan memory =
        plan_memory(resolved.scene, resolved.options.memory, first, device.cuda, training);

    // 3. The run folder.
    const JsonValue changed =
        resume.point ? changed_values(resume.configured, asked.table) : JsonValue();
    const JsonValue info = run_info(device, arguments, changed);
    const std::string plan = plan_json(resolved.plan, arguments);
    claim.reset();
    const int every = arguments.session.checkpoint_every,
              checkpoints = 1 + (every > 0 ? std::min(training.iterations / every, 2) : 0);
    const std::int64_t disk = disk_bytes(first, training.model.sh_degree, checkpoints);
    RunFolder run(arguments.out, resume.point && resume.in_place() ? resume.done() : -1);
    require_disk(run.path(), disk);
    run.save_config(config_json(resolved.options, info));
    write_text_file(run.path() + "/memory.json", memory.json() + "\n");
    if (!plan.empty()) write_text_file(run.path() + "/plan.json", plan);
    if (georeference) write_georeference(run.path(), *georeference);
    write_sky(run.path(), training.loss.photometric);
    log_resume(resume, changed, run);
    run.save_cameras(resolved.scene);
    log_start(resolved, device, memory, disk);

    // 4. The training. It gets the checkpoint's state for itself, to free it early.
    bool has_report = false;
    const SessionInputs session{.scene = resolved.scene,
                                .training = training,
                                .options = resolved.options,
                                .session = arguments.session,
                                .resume = resume,
                                .truth = truth,
                                .info = info,
                                .write_report = [&] {
                                    has_report = arguments.report &&
                                                 report_if_possible(run.path(), resolved.scene);
                                }};
    run_session(device, session, resume.point ? std::move(resume.point->state) : nullptr, run);
    if (for_blocks) return 0;
    spdlog::info("Wrote {}: {}point_cloud.ply", run.path(), has_report ? "report.html, " : "");
    say_next({"tvsgs-extract-mesh", run.path()}, "make the mesh");
    return 0;
}

}  // namespace tvsgs
