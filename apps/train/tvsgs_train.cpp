// tvsgs-train: scene in, splats out. Parses, calls the train loop, writes the run folder.
#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/common/key_flags.h"
#include "core/device_choice.h"
#include "io/atomic_file.h"
#include "io/ply.h"
#include "io/read_file.h"
#include "optim/fixed_voters.h"
#include "optim/time_budget.h"
#include "pipeline/built_in_configs.h"
#include "pipeline/checkpoints.h"
#include "pipeline/initial_points.h"
#include "pipeline/memory_plan.h"
#include "pipeline/planned_scene.h"
#include "pipeline/progress.h"
#include "pipeline/run_folder.h"
#include "pipeline/run_options.h"
#include "pipeline/run_plan.h"
#include "pipeline/signals.h"
#include "pipeline/train_evaluation.h"
#include "pipeline/view_evaluation.h"
#include "report/data.h"

namespace tvsgs {
namespace {

constexpr double kClearlyWorse = 0.5;  // dB of PSNR

struct Arguments {
    std::string out, device = "auto", progress = "auto";
    bool overwrite = false, quiet = false, verbose = false, profile = false, list_keys = false,
         deterministic = true, plan = false;
    int report_every = 50, checkpoint_every = 5000;

    // With --resume:
    bool resume = false, same_run = false;  // same_run: the run folder is the checkpoint's
    std::optional<ResumePoint> point;       // nothing: no checkpoint yet, so from the beginning
    std::vector<std::pair<std::string, std::string>> configured;  // what the checkpoint ran with
};

/// Finds the checkpoint; what the run was configured as comes before what this call says.
void open_resume(const std::string& given, Arguments& arguments, OptionTable& table) {
    namespace fs = std::filesystem;
    arguments.resume = true;
    const std::string place = given.empty() ? arguments.out : given;
    std::error_code code;
    if (place.empty())
        throw Error(ExitCode::usage,
                    "--resume: no run given; expected --resume RUN, or --out RUN with it");
    if (!given.empty() || fs::is_directory(place, code)) arguments.point = open_checkpoint(place);
    const std::string run = arguments.point ? arguments.point->run : place;
    if (arguments.out.empty()) arguments.out = run;
    arguments.same_run = run == arguments.out || fs::equivalent(run, arguments.out, code);
    if (arguments.point) {
        table.read_text(arguments.point->file, arguments.point->config);
        arguments.configured = config_values(table);
    }
    const std::string config = arguments.out + "/config.json";
    if (arguments.same_run && fs::exists(config, code)) table.read_file(config);
}

/// Defaults < configuration files in order < environment < command line, all in one table.
Arguments parse(int argc, char** argv, OptionTable& table) {
    Arguments arguments;
    CLI::App app{
        "Trains Gaussian splats on calibrated photographs; tensor voting keeps the surface.",
        "tvsgs-train"};
    app.get_formatter()->column_width(46);
    std::vector<std::string> configs, settings;
    KeyFlags flags(app);
    flags.add_scene();
    flags.add("--init-ply", "scene.init_ply", "initial cloud instead of the model's points",
              "Scene");
    const char* group = "Training";
    flags.add("--iterations", "iterations", "training iterations", group);
    flags.add("--seed", "seed", "of all random numbers", group);
    flags.add("--max-gaussians", "densify.max_gaussians", "growth stops there", group);
    flags.add("--gpu-memory", "memory.gpu", "GPU memory to use, such as 8G: growth stops before",
              group);
    flags.add("--host-memory", "memory.host", "the same of the host", group);
    app.add_option("--device", arguments.device, "auto, cpu, cuda or cuda:N")->group(group);
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
                 "look at the scene, print what it needs and why, and stop; without a "
                 "configuration that is what a run goes by")
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
    app.add_option("--checkpoint-every", arguments.checkpoint_every,
                   "iterations between checkpoints, the end is one as well; 0: only when the run "
                   "is stopped [5000]")
        ->check(CLI::Range(0, 1000000000))
        ->group(group);
    app.add_option("--progress", arguments.progress, "auto, plain or json")
        ->check(CLI::IsMember({"auto", "plain", "json"}))
        ->group(group);
    app.add_option("--report-every", arguments.report_every,
                   "iterations between lines of log.jsonl [50]")
        ->check(CLI::Range(1, 1000000000))
        ->group(group);
    CLI::Option* quiet =
        app.add_flag("--quiet", arguments.quiet, "warnings and errors only")->group(group);
    app.add_flag("--verbose", arguments.verbose, "more detail")->group(group)->excludes(quiet);
    app.add_flag("--profile", arguments.profile,
                 "seconds per stage in log.jsonl; waits around each stage, so the run is slower")
        ->group(group);
    app.set_version_flag("--version", kVersion);
    parse_command_line(app, argc, argv);
    init_log(arguments.quiet     ? Verbosity::quiet
             : arguments.verbose ? Verbosity::verbose
                                 : Verbosity::normal);

    if (arguments.plan && resume_flag->count() > 0)
        throw Error(ExitCode::usage,
                    "--plan with --resume: a run that goes on keeps its settings; plan.json in its "
                    "folder is the plan");
    if (resume_flag->count() > 0) open_resume(resume, arguments, table);
    std::error_code code;
    const bool goes_on =
        arguments.resume &&
        (arguments.point || std::filesystem::exists(arguments.out + "/config.json", code));
    if (configs.empty() && !goes_on) table.read_text("configs/auto.json", kAutoConfig);
    for (const std::string& file : configs) table.read_file(file);
    table.read_environment();
    flags.set_keys(table);
    table.set_all(settings);
    return arguments;
}

/// What made the run, for config.json.
std::string run_info(const DeviceChoice& device,
                     const Arguments& arguments,
                     const std::string& changed,
                     int argc,
                     char** argv) {
    std::string line;
    for (int i = 0; i < argc; ++i) line += (i ? " " : "") + std::string(argv[i]);
    JsonLine info;
    info.add("version", kVersion).add("device", device.description).add("command_line", line);
    if (arguments.point)
        info.add("resumed_from", arguments.point->done).add_json("changed", changed);
    return info.text();
}

/// `training` is what trains; `options` and `config` are what the run's files say of it.
template <class Device>
int train_and_save(const Scene& scene,
                   TrainOptions training,
                   RunOptions& options,
                   const Arguments& arguments,
                   const std::optional<Truth>& truth,
                   const std::function<std::string()>& config,
                   RunFolder& run) {
    const SignalGuard signals;
    const int& iterations = training.iterations;
    const ResumePoint* const point = arguments.point ? &*arguments.point : nullptr;
    Progress progress(iterations, arguments.quiet ? "quiet" : arguments.progress,
                      point ? point->seconds : 0);
    CheckpointWriter checkpoints(run.path(), config(), scene);
    // Of this call: what the run took before is past.
    const double before = point ? point->seconds : 0;
    TimeBudget budget(options.plan.time_budget, training, point ? point->done : 0);
    Convergence convergence;
    int step_now = 0, done_now = point ? point->done : 0;
    bool fit_now = false;  // the training pauses for a new schedule
    SharedState state = point ? point->state : nullptr;
    TrainCallbacks callbacks;
    callbacks.profile = arguments.profile;
    callbacks.report_due = [&](int step) {
        return step == 1 || step == iterations || step % arguments.report_every == 0;
    };
    callbacks.on_report = [&](const TrainReport& report) {
        run.log(progress.json(report));
        progress.show(report);
    };
    callbacks.stop_requested = [&] {
        const bool stop = signals.received() != 0 || convergence.over();
        fit_now = !stop && budget.due(done_now, progress.seconds() - before);
        return stop || fit_now;
    };
    callbacks.on_end = [&](int done) { step_now = done; };
    callbacks.save_due = [&](int done) {
        const int every = arguments.checkpoint_every;
        return every > 0 && done > (point ? point->done : 0) &&
               (done % every == 0 || done == iterations - 1);
    };
    callbacks.on_save = [&](int done, const SharedState& saved) {
        state = saved;
        if (!fit_now) checkpoints.save(done, progress.seconds(), saved);
    };
    callbacks.on_rollback = [&](int done, const std::string& what) {
        done_now = done;
        spdlog::warn(what);
        run.log(JsonLine().add("event", "rollback").add("iteration", done).add("why", what).text());
    };

    EvaluationSchedule schedule(options.eval, progress.seconds());
    EvaluationOptions validation;
    if (options.plan.until == Until::converged) validation.at = "1,1.2,...";
    EvaluationSchedule validations(validation, progress.seconds());
    if (point) schedule.due(point->done, point->seconds);  // what was due before is done
    const MeshSource mesh_source{scene.train, options.mesh, run.path() + "/mesh", scene.origin};
    double best_psnr = 0;
    int best_step = 0;
    const auto after_step = [&](int step, const SplatsNow<Device>& splats) {
        done_now = step;
        const double now = progress.seconds();
        const bool validate = validations.due(step, now);
        if ((!schedule.due(step, now) && !validate) || step == iterations) return;
        synchronize(Device{});
        progress.pause();
        const Evaluation evaluation =
            evaluate(step, progress.seconds(), splats(), scene.test, training, truth,
                     options.eval.mesh ? &mesh_source : nullptr);
        run.log(evaluation.line);
        if (evaluation.psnr > best_psnr) best_psnr = evaluation.psnr, best_step = step;
        if (validate) convergence.add(now, evaluation.psnr);
        progress.resume();
    };
    const auto train_or_explain = [&] {
        try {
            for (;;) {
                Gaussians<Device> trained =
                    train<Device>(scene, training, callbacks, after_step, state);
                if (!fit_now) return trained;
                callbacks.goes_on = true;
                budget.fit(step_now, progress.seconds() - before, training);
                copy_schedule(training, options.train);
                progress.set_iterations(iterations);
                run.save_config(config());
                checkpoints.set_config(config());
                run.log(JsonLine()
                            .add("event", "plan")
                            .add("iteration", step_now)
                            .add("seconds", progress.seconds())
                            .add("iterations", iterations)
                            .text());
                spdlog::info("after {:.1f} s: {} iterations in all for {:g} s", progress.seconds(),
                             iterations, static_cast<double>(options.plan.time_budget));
            }
        } catch (const Error& error) {
            progress.finish();
            const auto last = checkpoints.finish();
            if (!last) throw;
            throw Error(error.code(), str(error.what(), "\n  the last checkpoint is ", *last,
                                          "; --resume goes on from there"));
        }
    };
    const Gaussians<Device> gaussians = train_or_explain();
    synchronize(Device{});
    progress.finish();
    const double seconds = progress.seconds();
    if (const double asked = options.plan.time_budget; asked > 0 && step_now == iterations) {
        if (seconds - before > 1.1 * asked)
            spdlog::warn(
                "the training took {:.1f} s instead of {:g}: {} iterations are the fewest "
                "that its first seconds let foresee; give it more time, or smaller images "
                "(-r)",
                seconds - before, asked, step_now);
        // What was run, for whoever runs it again.
        options.plan.time_budget = 0;
        run.save_config(config());
    }
    Gaussians<Cpu> host;
    copy(gaussians, host);
    if (const std::size_t first = scene.points.positions.size();
        static_cast<std::size_t>(host.size()) < first / 100)
        spdlog::warn(
            "of {} initial points {} splats are left: learning rates (lr.*) or pruning "
            "(densify.*) do not suit this scene",
            first, host.size());
    run.save_splats(host, step_now, scene.origin);
    const auto last = checkpoints.finish();
    if (convergence.over())
        spdlog::info("converged: PSNR {:.2f} dB after {:.1f} s has not been exceeded by {:.1f} s",
                     convergence.best(), convergence.best_at(), seconds);
    else if (step_now < iterations) {
        spdlog::warn("stopped after {} of {} iterations; the splats so far are in {}", step_now,
                     iterations, run.path());
        run.log(JsonLine().add("event", "stopped").add("iteration", step_now).text());
        if (!last) throw Error(ExitCode::io, checkpoints.failure());
        spdlog::warn("tvsgs-train --resume {} goes on", run.path());
    }
    signals.check();
    run.remove_splats_of_stops(step_now);

    JsonLine summary;
    summary.add("event", "done")
        .add("iteration", step_now)
        .add("seconds", seconds)
        .add("gaussians", host.size());
    summary.add("peak_bytes", memory_use(Device{}).peak_bytes);
    if (!scene.test.empty()) {
        const ViewScores scores = evaluate_views(gaussians, scene.test, training, run.path());
        summary.add("psnr", scores.mean_psnr).add("ssim", scores.mean_ssim);
        spdlog::info("test views: PSNR {:.2f} dB, SSIM {:.4f} over {} views; pictures in {}/test",
                     scores.mean_psnr, scores.mean_ssim, scene.test.size(), run.path());
        if (scores.mean_psnr < best_psnr - kClearlyWorse)
            spdlog::warn(
                "PSNR was {:.2f} dB after {} iterations and is {:.2f} dB in the end: training went "
                "on for too long, or grew too much; try --iterations {}, --until converged or "
                "--set densify.enabled=false",
                best_psnr, best_step, scores.mean_psnr, best_step);
    }
    if (truth) add_centres(summary, to_host(gaussians.means), *truth, run.path());
    if (options.eval.mesh) {
        const TriangleMesh mesh =
            extract_mesh(scene.train, gaussians, training, options.mesh, mesh_source.spill_folder,
                         spdlog::level::info, scene.origin);
        write_mesh_ply(run.path() + "/mesh/mesh.ply", mesh, scene.origin);
        add_mesh(summary, mesh, *truth, run.path());
    }
    run.log(summary.text());
    try {
        write_report(run.path(), scene.test, truth, scene.origin);
    } catch (const Error& error) {  // what was asked for is done
        spdlog::warn("{}; there is no report (tvsgs-eval report --run {})", error.what(),
                     run.path());
    }
    spdlog::info("{} splats after {} iterations in {:.1f} s, peak {} MiB; run folder {}",
                 host.size(), step_now, seconds, memory_use(Device{}).peak_bytes >> 20, run.path());
    if (!checkpoints.failure().empty())
        throw Error(ExitCode::io,
                    str(run.path(), ": the run is finished and whole, but cannot be extended: ",
                        "its last checkpoint was not saved: ", checkpoints.failure()));
    return 0;
}

int command(int argc, char** argv) {
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    Arguments arguments = parse(argc, argv, table);
    if (arguments.list_keys) {
        std::fputs(table.help().c_str(), stdout);
        return 0;
    }
    if (options.scene.path.empty())
        throw Error(ExitCode::usage, "no scene given; expected --scene DIR; see --help");
    check_consistency(options.train);
    const EvaluationSchedule checked(options.eval);
    if (options.eval.mesh) check_mesh_options(options.mesh);
    const std::optional<Truth> truth = read_truth(
        options.eval, options.eval.gt.empty() ? Vec3d{} : read_scene_origin(options.scene));
    const DeviceChoice device = choose_device(arguments.device);
    if (arguments.out.empty()) {
        const auto scene_folder = std::filesystem::weakly_canonical(options.scene.path);
        arguments.out = "runs/" + scene_folder.filename().string();
    }
    // Before the scene is read:
    const bool go_on = arguments.resume && arguments.same_run;
    if (!arguments.plan)
        require_free_run_folder(arguments.out, arguments.overwrite, go_on, options.scene);
    const ResumePoint* const point = arguments.point ? &*arguments.point : nullptr;
    if (point && options.train.iterations <= point->done)
        throw Error(ExitCode::usage, str(point->file, ": ", point->done,
                                         " iterations are done; expected "
                                         "more than that in all, such as --iterations ",
                                         2 * point->done));
    RunPlan plan(table);
    options.scene.need_points = !point;
    Scene scene = point ? read_views(options, true, table)
                        : read_and_plan(device, arguments.plan, options, table, plan);
    if (point) adopt_scene(*point, scene);
    if (arguments.plan) {
        std::fputs(plan.text().c_str(), stdout);
        return 0;
    }
    read_fixed_voters(options, scene);
    if (const auto& voters = options.train.tv.fixed_voters; !scene.fixed_voters.positions.empty())
        make_fixed_voters(scene.fixed_voters, voters);  // complains before there is a run
    const std::string changed = point ? changed_values(arguments.configured, table) : "";
    const auto config = [&] {
        return table.json(run_info(device, arguments, changed, argc, argv));
    };
    const std::size_t first_splats =
        point ? point->state->get("opacity_logits", 4).count() : scene.points.positions.size();
    TrainOptions training = options.train;  // the configuration keeps the cap that was asked for
    const MemoryPlan memory = plan_memory(
        scene, options.memory, static_cast<std::int64_t>(first_splats), device.cuda, training);
    // A run that starts again, as it was stopped before its first checkpoint, keeps its plan.
    std::error_code code;
    const std::string plan_file = arguments.out + "/plan.json",
                      plan_text = !plan.empty() ? plan.json()
                                  : go_on && std::filesystem::exists(plan_file, code)
                                      ? read_bytes(plan_file)
                                      : "";
    RunFolder run(arguments.out, point && go_on ? point->done : -1);
    run.save_config(config());
    write_text_file(run.path() + "/memory.json", memory.json() + "\n");
    if (!plan_text.empty()) write_text_file(plan_file, plan_text);
    if (point) {
        if (go_on) remove_checkpoints_after(run.path(), point->done);
        run.log(JsonLine()
                    .add("event", "resumed")
                    .add("iteration", point->done)
                    .add("seconds", point->seconds)
                    .add("checkpoint", point->file)
                    .add_json("changed", changed)
                    .text());
        spdlog::info("{}: {} iterations are done; changed since: {}", point->file, point->done,
                     changed);
    } else if (arguments.resume) {
        spdlog::info("{}: no checkpoint yet, so the run starts from the beginning", run.path());
    }
    run.save_cameras(scene);
    const Camera& camera = scene.train.front().camera;
    spdlog::info(
        "{}: {} training and {} test views of {}x{}, {} initial points, extent {:.4g}, on {}",
        options.scene.path, scene.train.size(), scene.test.size(), camera.width_px,
        camera.height_px, scene.points.positions.size(), static_cast<double>(scene.extent),
        device.description);
    spdlog::info(memory.text());
    return on_device(device, [&](auto tag) {
        return train_and_save<decltype(tag)>(scene, training, options, arguments, truth, config,
                                             run);
    });
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    return tvsgs::run_command([&] { return tvsgs::command(argc, argv); });
}
