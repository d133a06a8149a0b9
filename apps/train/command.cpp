#include "apps/train/command.h"

#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/train/arguments.h"
#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"
#include "io/scene/georeference.h"
#include "pipeline/scene/initial_points.h"
#include "pipeline/scene/planned_scene.h"
#include "pipeline/scene/sky.h"
#include "plan/figures.h"
#include "plan/time.h"
#include "report/report.h"

namespace tvsgs {
namespace {

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
void log_start(const Resolved& run, const DeviceChoice& device, const MemoryPlan& memory) {
    const Scene& scene = run.scene;
    const Camera& camera = scene.train.front().camera;
    spdlog::info("{}: {} training and {} test photographs, {}x{}; {} start points. {}, needs {}.",
                 scene.path, scene.train.size(), scene.test.size(), camera.width_px,
                 camera.height_px, grouped(scene.points.positions.size()),
                 device.cuda ? device.description : "CPU",
                 bytes_text(double(memory.first_bytes())));
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

int train_command(int argc, char* const* argv) {
    // 1. The options that the user asks for.
    TrainArguments arguments = parse_train_arguments(argc, argv);
    const Configuration& asked = arguments.asked;
    Resume& resume = arguments.resume;
    if (arguments.list_keys) {
        std::fputs(asked.table.help().c_str(), stdout);
        return 0;
    }
    check_train_arguments(arguments);
    const DeviceChoice device = choose_device(arguments.device);
    const EvaluationOptions& eval = asked.options.eval;
    const std::optional<Truth> truth =
        read_truth(eval, eval.gt.empty() ? Vec3d{} : read_scene_origin(asked.options.scene));
    const std::optional<Georeference> georeference = read_georeference(asked.options.scene.path);

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
    RunFolder run(arguments.out, resume.point && resume.in_place() ? resume.done() : -1);
    run.save_config(config_json(resolved.options, info));
    write_text_file(run.path() + "/memory.json", memory.json() + "\n");
    if (!plan.empty()) write_text_file(run.path() + "/plan.json", plan);
    if (georeference) write_georeference(run.path(), *georeference);
    write_sky(run.path(), training.loss.photometric);
    log_resume(resume, changed, run);
    run.save_cameras(resolved.scene);
    log_start(resolved, device, memory);

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
    spdlog::info("Wrote {}: {}point_cloud.ply", run.path(), has_report ? "report.html, " : "");
    say_next({"tvsgs-extract-mesh", run.path()}, "make the mesh");
    return 0;
}

}  // namespace tvsgs
