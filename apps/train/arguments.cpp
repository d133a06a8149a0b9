#include "apps/train/arguments.h"

#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/common/key_flags.h"
#include "io/config/config.h"
#include "pipeline/scene/planned_scene.h"

namespace tvsgs {
namespace {

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

}  // namespace

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

}  // namespace tvsgs
