#include "apps/train/arguments.h"

#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/common/key_flags.h"
#include "core/progress.h"
#include "io/config/built_in_configs.h"
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
    std::string progress = "auto";
    bool verbose = false, deterministic = true;
    CLI::App app{
        "Trains Gaussian splats on calibrated photographs; tensor voting keeps the surface.",
        "tvsgs-train"};
    app.get_formatter()->column_width(46);
    std::vector<std::string> configs, settings;
    KeyFlags flags(app, table);
    flags.add_scene();
    flags.add("--mask-use", "loss.photometric.masks",
              "object: nothing is outside the masks; ignore: pixels outside do not count; none "
              "[the plan decides; none without it]",
              "Scene");
    flags.add("--init-ply", "scene.init_ply", "initial cloud instead of the model's points",
              "Scene");
    flags.add_switch("--force", "init.force",
                     "train from less than 100 start points, or from points on less than 1 % of "
                     "the photographs",
                     "Scene");
    flags.add("--fixed-points", "tv.fixed_voters",
              "measured points (LiDAR) in the frame of the scene: they vote and never move",
              "Scene");
    flags.add("--priors", "priors.dir",
              "folder of depth, normals and features from other programs [searched in the scene]",
              "Scene");
    const char* group = "Training";
    flags.add("--iterations", "iterations",
              "training iterations; the plan fits its schedule to them [the plan decides; with "
              "--config, from the file]",
              group);
    flags.add("--seed", "seed", "seed of all random numbers", group);
    flags.add("--max-gaussians", "densify.max_gaussians", "growth stops at this number of splats",
              group);
    flags.add("--gpu-memory", "memory.gpu", "GPU memory to use, such as 8G; growth stops before",
              group);
    flags.add("--host-memory", "memory.host", "host memory to use", group);
    app.add_option("--device", arguments.device, "auto, cpu, cuda or cuda:N")->group(group);
    flags.add_switch("--refine-cameras", "cameras.refine",
                     "improve the training views' poses together with the splats [the plan "
                     "decides; off without it]",
                     group);
    flags.add("--time-budget", "plan.time_budget",
              "shorten the schedule to so many seconds of training; 0: no limit", group);
    flags.add(
        "--until", "plan.until",
        "iterations; or converged: stop when test photographs stop improving or, without any, "
        "when the surface stands still",
        group);
    app.add_flag("--deterministic", deterministic,
                 "accepted for scripts: every run repeats bit for bit")
        ->group(group);
    group = "Evaluation";
    flags.add("--eval-at", "eval.at",
              "seconds of training after which to evaluate: 5,10,20,40 or 5,10,...", group);
    flags.add("--eval-every", "eval.every",
              "iterations between evaluations, the first after iteration 1", group);
    flags.add("--gt", "eval.gt",
              "true surface (PLY): Chamfer distance and F1 of the splats' centres", group);
    flags.add_switch("--eval-mesh", "eval.mesh", "with --gt: also extract and measure the mesh",
                     group);
    flags.add("--visible-gt", "eval.visible_gt", "part of the truth that completeness counts",
              group);
    flags.add("--crop", "eval.crop", "selection volume, box or gt/info.json", group);
    flags.add("--tau", "eval.taus", "thresholds T,T,... of F1 [0.5, 1, 2 % of the truth's size]",
              group);
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
                 "print the decisions with their reasons, memory and time, and stop")
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
                       "continue from the newest checkpoint of that run folder (or of --out), or "
                       "from that checkpoint; other flags change the configuration from there on")
            ->expected(0, 1)
            ->group(group);
    app.add_option("--checkpoint-every", arguments.session.checkpoint_every,
                   "iterations between checkpoints, beside the last one; 0: only when the run is "
                   "stopped [5000]")
        ->check(CLI::Range(0, 1000000000))
        ->group(group);
    app.add_flag("!--no-report", arguments.report,
                 "leave report.html to tvsgs-extract-mesh or tvsgs-eval report")
        ->group(group);
    app.add_option("--progress", progress, "auto, plain or json")
        ->check(CLI::IsMember({"auto", "plain", "json"}))
        ->group(group);
    app.add_option("--report-every", arguments.session.report_every,
                   "iterations between lines of log.jsonl [50]")
        ->check(CLI::Range(1, 1000000000))
        ->group(group);
    CLI::Option* quiet =
        app.add_flag("--quiet", arguments.quiet, "warnings and errors only")->group(group);
    app.add_flag("-v,--verbose", verbose, "the plan's reasons and other details")
        ->group(group)
        ->excludes(quiet);
    app.add_flag("--profile", arguments.session.profile,
                 "seconds per stage in log.jsonl; the run is slower, as it waits around each stage")
        ->group(group);
    app.add_option("--live", arguments.session.live_every,
                   "write the splats every so many seconds, for tvsgs-view to follow the run [5]")
        ->expected(0, 1)
        ->default_str("5")
        ->check(in_range(1.0, 1e6))
        ->group(group);
    parse_command_line(app, argc, argv);
    init_log(arguments.quiet ? Verbosity::quiet : verbose ? Verbosity::verbose : Verbosity::normal);
    if (!arguments.quiet && progress != "auto")
        set_progress_style(progress == "json" ? ProgressStyle::json : ProgressStyle::plain);

    Resume& resume_from = arguments.resume;
    if (arguments.plan && resume_flag->count() > 0)
        throw Error(ExitCode::usage,
                    "--plan with --resume: a resumed run keeps its settings; its plan is plan.json "
                    "in the run folder");
    if (resume_flag->count() > 0) resume_from = open_resume(resume, arguments.out, table);
    if (configs.empty() && !is_configured(resume_from, arguments.out))
        table.read_text("configs/auto.json", built_in_config(kAutoConfig));
    for (const std::string& file : configs) table.read_file(file);
    table.read_environment();
    flags.set_keys(table);
    table.set_all(settings);

    SceneOptions& scene = arguments.asked.options.scene;
    if (arguments.out.empty()) arguments.out = default_run_folder(scene.path);
    scene.scratch = existing_folder_above(arguments.out);
    return arguments;
}

void check_train_arguments(const TrainArguments& arguments) {
    const RunOptions& options = arguments.asked.options;
    const Resume& resume = arguments.resume;
    if (options.scene.path.empty())
        throw Error(ExitCode::usage, "no scene given; expected --scene DIR; see --help");
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
