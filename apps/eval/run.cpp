// tvsgs-eval run: runs every evaluation that applies to a run folder, with the other subcommands.
#include <filesystem>
#include <memory>

#include "apps/eval/result.h"
#include "apps/eval/subcommands.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

struct RunArguments {
    std::string model, scene, device = "auto", gt, visible_gt, crop, tau, max_distance, dtu, scan,
                              scene_dir, traj, tnt_tau, weights, cameras, units, masks, cull,
                              dilate;
    bool masked = false;
};

/// Flags with their values; omits empty values.
Words flags(std::initializer_list<std::pair<const char*, std::string>> pairs) {
    Words words;
    for (const auto& [flag, value] : pairs)
        if (!value.empty()) words.insert(words.end(), {flag, value});
    return words;
}

void call(EvalCommand add(CLI::App&), Words words, const Words& more) {
    words.insert(words.begin(), "tvsgs-eval");
    words.insert(words.end(), more.begin(), more.end());
    std::vector<char*> argv;
    std::string line;
    for (std::string& word : words) {
        argv.push_back(word.data());
        line += (line.empty() ? "" : " ") + word;
    }
    spdlog::debug("{}", line);
    CLI::App app;
    app.require_subcommand(1);
    const EvalCommand command = add(app);
    parse_command_line(app, static_cast<int>(argv.size()), argv.data());
    command.run();
}

/// Arguments of `dtu` for the scene; only the mesh is culled.
Words dtu_words(const RunArguments& a, const std::string& scene, bool of_mesh) {
    std::string cameras = a.cameras;
    for (const char* name : {"cameras.npz", "cameras_sphere.npz"})
        if (cameras.empty() && fs::is_regular_file(fs::path(scene) / name))
            cameras = (fs::path(scene) / name).string();
    Words words = flags({{"--cameras", cameras}, {"--mesh-units", a.units}});
    if (of_mesh)
        for (const std::string& word :
             flags({{"--cull-masks", a.masks}, {"--cull", a.cull}, {"--cull-dilate", a.dilate}}))
            words.push_back(word);
    return words;
}

/// Refuses flags of an evaluation that does not run.
void check_owners(const RunArguments& a, const std::string& gt) {
    struct Owned {
        const char* flag;
        const std::string& value;
        bool has_owner;
        const char* owner;
    };
    const bool masks = !a.masks.empty(), tnt = !a.scene_dir.empty();
    constexpr const char* kTruth = "--gt FILE, here or in training";
    for (const auto& [flag, value, has_owner, owner] :
         {Owned{"--cameras", a.cameras, !a.dtu.empty(), "--dtu DIR"},
          Owned{"--mesh-units", a.units, !a.dtu.empty(), "--dtu DIR"},
          Owned{"--cull-masks", a.masks, !a.dtu.empty(), "--dtu DIR"},
          Owned{"--cull", a.cull, !a.dtu.empty(), "--dtu DIR"},
          Owned{"--cull-dilate", a.dilate, !a.dtu.empty(), "--dtu DIR"},
          Owned{"--cull", a.cull, masks || a.cull == "none", "--cull-masks DIR"},
          Owned{"--cull-dilate", a.dilate, masks, "--cull-masks DIR"},
          Owned{"--visible-gt", a.visible_gt, !gt.empty(), kTruth},
          Owned{"--crop", a.crop, !gt.empty(), kTruth}, Owned{"--tau", a.tau, !gt.empty(), kTruth},
          Owned{"--max-distance", a.max_distance, !gt.empty(), kTruth},
          Owned{"--traj", a.traj, tnt, "--scene-dir DIR"},
          Owned{"--tnt-tau", a.tnt_tau, tnt, "--scene-dir DIR"}})
        if (!has_owner && !value.empty())
            throw Error(ExitCode::usage, str(flag, " ", value, ": needs ", owner));
}

int run(const RunArguments& a) {
    RunOptions options;
    OptionTable table;
    options.add_to(table);
    table.read_file(run_config_path(a.model));
    const std::string scene = a.scene.empty() ? options.scene.path : a.scene,
                      gt = a.gt.empty() ? options.eval.gt : a.gt;
    const bool own_gt = a.gt.empty();  // with its own crop and thresholds
    const auto given = [&](const std::string& flag, const std::string& of_run) {
        return flag.empty() && own_gt ? of_run : flag;
    };
    if (a.dtu.empty() != a.scan.empty())
        throw Error(ExitCode::usage, "--dtu DIR and --scan N: give both");
    check_owners(a, gt);

    struct Prediction {
        std::string suffix, file;
    };
    std::vector<Prediction> predictions = {{"_centres", find_splats(a.model)}};
    const std::string mesh = find_mesh(a.model), alignment = a.model + "/eval/tnt";
    if (!mesh.empty())
        // First, because the centres use its frame.
        predictions.insert(predictions.begin(), {"", mesh});
    else
        spdlog::info(
            "No mesh in {}/mesh; only the splats are measured. To make one:\n    "
            "tvsgs-extract-mesh {}",
            a.model, for_shell(a.model));
    int done = 0;
    if (fs::is_directory(a.model + "/test")) {
        Words words = flags({{"--model", a.model},
                             {"--scene", a.scene},
                             {"--device", a.device},
                             {"--lpips-weights", a.weights}});
        if (a.masked) words.push_back("--masked");
        call(add_eval_nvs, {"nvs"}, words), ++done;
    }
    for (const auto& [suffix, file] : predictions) {
        const auto out = [&](const char* name) {
            return Words{"--pred", file, "--out", str(a.model, "/eval/", name, suffix, ".json")};
        };
        const auto samples = options.eval.point_samples;
        if (!gt.empty()) {
            const float cap = options.eval.max_distance;
            Words words = flags({{"--gt", gt},
                                 {"--visible-gt", given(a.visible_gt, options.eval.visible_gt)},
                                 {"--crop", given(a.crop, options.eval.crop)},
                                 {"--tau", given(a.tau, options.eval.taus)},
                                 {"--max-distance", given(a.max_distance, cap > 0 ? str(cap) : "")},
                                 {"--point-samples", samples > 0 ? str(samples) : ""}});
            words.insert(words.begin(), "geometry");
            call(add_eval_geometry, words, out("geometry")), ++done;
        }
        if (!a.dtu.empty()) {
            Words words = dtu_words(a, scene, suffix.empty());
            words.insert(words.begin(), {"dtu", "--dtu", a.dtu, "--scan", a.scan});
            call(add_eval_dtu, words, out("dtu")), ++done;
        }
        if (!a.scene_dir.empty()) {
            // The trained frame is that of the scene's model; the centres use the mesh's.
            const std::string model = scene + "/sparse/0";
            const bool by_mesh = !suffix.empty() && predictions.size() == 2;
            const std::string traj = a.traj.empty() && fs::is_directory(model) ? model : a.traj;
            Words words = flags({{"--scene-dir", a.scene_dir},
                                 {"--traj", by_mesh ? "" : traj},
                                 {"--tau", a.tnt_tau},
                                 {"--results", suffix.empty() ? alignment : ""},
                                 {"--align-file", by_mesh ? alignment + "/alignment.txt" : ""}});
            words.insert(words.begin(), "tnt");
            call(add_eval_tnt, words, out("tnt")), ++done;
        }
    }
    if (done == 0)
        throw Error(ExitCode::usage, str(a.model,
                                         ": nothing to measure: the run has no test views; give "
                                         "--gt, --dtu or --scene-dir"));
    call(add_eval_report, {"report", "--run", a.model}, flags({{"--scene", a.scene}}));
    result_of_run().clear();
    return 0;
}

}  // namespace

EvalCommand add_eval_run(CLI::App& app) {
    const auto arguments = std::make_shared<RunArguments>();
    RunArguments& a = *arguments;
    CLI::App* command = app.add_subcommand("run", "run all evaluations that apply to a run folder");
    command->add_option("-m,--model,--model-path", a.model, "run folder")->required();
    command->add_option("-s,--scene", a.scene, "folder of the scene [that of the run]");
    command->add_option("--device", a.device, "auto, cpu, cuda or cuda:N");
    command->add_flag("--masked", a.masked, "also score the object alone, inside its masks");
    command->add_option("--lpips-weights", a.weights,
                        "weights of LPIPS (.safetensors, .npz) [no LPIPS]");
    command->add_option("--gt", a.gt, "true surface, mesh or cloud [as in training]");
    command->add_option("--visible-gt", a.visible_gt,
                        "part of the truth that views see, for completeness and recall");
    command->add_option("--crop", a.crop, "selection volume of the measurement");
    command->add_option("--tau", a.tau, "thresholds of precision, recall and F1");
    command->add_option("--max-distance", a.max_distance,
                        "cap of distances, in the truth's units [none]");
    command->add_option("--dtu", a.dtu, "folder of the DTU benchmark, with --scan");
    command->add_option("--scan", a.scan, "number of the DTU scan");
    command->add_option("--cameras", a.cameras, "DTU: cameras.npz with scale_mat_0 [of the scene]");
    command->add_option("--mesh-units", a.units, "DTU: auto, mm or normalised [auto]");
    command->add_option("--cull-masks", a.masks, "DTU: folder of the masks that cull the mesh");
    command->add_option("--cull", a.cull,
                        "DTU: views whose masks cull: all, first:N, none or I,J,K [all]");
    command->add_option("--cull-dilate", a.dilate, "DTU: pixels by which the masks grow [24]");
    command->add_option("--scene-dir", a.scene_dir,
                        "Tanks and Temples: folder with the truth of the scene");
    command->add_option("--traj", a.traj,
                        "Tanks and Temples: cameras of the prediction [sparse/0 of the scene]");
    command->add_option("--tnt-tau", a.tnt_tau, "Tanks and Temples: threshold [that of the scene]");
    return {command, [arguments] { return run(*arguments); }};
}

}  // namespace tvsgs
