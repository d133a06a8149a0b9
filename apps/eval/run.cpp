// tvsgs-eval run: runs every evaluation that applies to a run folder, with the other subcommands.
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>

#include "apps/eval/subcommands.h"
#include "pipeline/run/run_folder.h"
#include "pipeline/run/run_options.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

/// A flag that is passed on to other subcommands.
struct Flag {
    const char *name, *owner, *help;  // owner: the flag that it needs with its value, or nothing
};
constexpr Flag kFlags[] = {
    {"--device", "", "auto, cpu, cuda or cuda:N"},
    {"--lpips-weights", "", "weights of LPIPS (.safetensors, .npz) [no LPIPS]"},
    {"--gt", "", "true surface, mesh or cloud [as in training]"},
    {"--visible-gt", "--gt FILE", "part of the truth that views see, for completeness and recall"},
    {"--crop", "--gt FILE", "selection volume of the measurement"},
    {"--tau", "--gt FILE", "thresholds of precision, recall and F1"},
    {"--max-distance", "--gt FILE", "cap of distances, in the truth's units [none]"},
    {"--dtu", "--scan N", "folder of the DTU benchmark, with --scan"},
    {"--scan", "--dtu DIR", "number of the DTU scan"},
    {"--cameras", "--dtu DIR", "DTU: cameras.npz with scale_mat_0 [of the scene]"},
    {"--mesh-units", "--dtu DIR", "DTU: auto, mm or normalised [auto]"},
    {"--cull-masks", "--dtu DIR", "DTU: folder of the masks that cull the mesh"},
    {"--cull", "--dtu DIR", "DTU: views whose masks cull: all, first:N, none or I,J,K [all]"},
    {"--cull-dilate", "--dtu DIR", "DTU: pixels by which the masks grow [24]"},
    {"--scene-dir", "", "Tanks and Temples: folder with the truth of the scene"},
    {"--traj", "--scene-dir DIR",
     "Tanks and Temples: cameras of the prediction [sparse/0 of the scene]"},
    {"--tnt-tau", "--scene-dir DIR", "Tanks and Temples: threshold [that of the scene]"}};

struct RunArguments {
    std::string model;
    bool masked = false;
    std::map<std::string, std::string> values{{"--device", "auto"}};  // by flag; empty: not given

    const std::string& operator[](const std::string& flag) const { return values.at(flag); }
};

/// Flags with their values; omits empty values.
Words flags(std::initializer_list<std::pair<const char*, std::string>> pairs) {
    Words words;
    for (const auto& [flag, value] : pairs)
        if (!value.empty()) words.insert(words.end(), {flag, value});
    return words;
}

void call(Subcommand add(CLI::App&), const char* name, Words words, const Words& more = {}) {
    words.insert(words.begin(), {"tvsgs-eval", name});
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
    const Subcommand command = add(app);
    parse_command_line(app, static_cast<int>(argv.size()), argv.data());
    command.run();
}

/// Arguments of `dtu` for the scene; only the mesh is culled.
Words dtu_words(const RunArguments& a, const std::string& scene, bool of_mesh) {
    std::string cameras = a["--cameras"];
    for (const char* name : {"cameras.npz", "cameras_sphere.npz"})
        if (cameras.empty() && fs::is_regular_file(fs::path(scene) / name))
            cameras = (fs::path(scene) / name).string();
    const auto if_mesh = [&](const char* flag) { return of_mesh ? a[flag] : ""; };
    return flags({{"--dtu", a["--dtu"]},
                  {"--scan", a["--scan"]},
                  {"--cameras", cameras},
                  {"--mesh-units", a["--mesh-units"]},
                  {"--cull-masks", if_mesh("--cull-masks")},
                  {"--cull", if_mesh("--cull")},
                  {"--cull-dilate", if_mesh("--cull-dilate")}});
}

/// Refuses flags of an evaluation that does not run.
void check_owners(const RunArguments& a, const std::string& gt) {
    const auto require = [&](const char* flag, bool has_owner, const std::string& owner) {
        if (!has_owner && !a[flag].empty())
            throw usage_error(flag, " ", a[flag], ": needs ", owner);
    };
    for (const auto& [name, owner, help] : kFlags) {
        const std::string flag(owner, std::strcspn(owner, " "));
        if (flag == "--gt")
            require(name, !gt.empty(), "--gt FILE, here or in training");
        else if (!flag.empty())
            require(name, !a[flag].empty(), owner);
    }
    const bool masks = !a["--cull-masks"].empty();
    require("--cull", masks || a["--cull"] == "none", "--cull-masks DIR");
    require("--cull-dilate", masks, "--cull-masks DIR");
}

int run(const RunArguments& a) {
    Configuration configuration;
    auto& [options, table] = configuration;
    table.read_file(run_config_path(a.model));
    const std::string scene = a["--scene"].empty() ? options.scene.path : a["--scene"];
    const bool own_gt = a["--gt"].empty();  // with its own crop and thresholds
    const auto given = [&](const char* flag, const std::string& of_run) {
        return a[flag].empty() && own_gt ? of_run : a[flag];
    };
    const std::string gt = given("--gt", options.eval.gt);
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
                             {"--scene", a["--scene"]},
                             {"--device", a["--device"]},
                             {"--lpips-weights", a["--lpips-weights"]}});
        if (a.masked) words.push_back("--masked");
        call(add_eval_nvs, "nvs", words), ++done;
    }
    for (const auto& [suffix, file] : predictions) {
        const auto out = [&](const char* name) {
            return Words{"--pred", file, "--out", str(a.model, "/eval/", name, suffix, ".json")};
        };
        const auto samples = options.eval.point_samples;
        if (!gt.empty()) {
            const float cap = options.eval.max_distance;
            const Words words =
                flags({{"--gt", gt},
                       {"--visible-gt", given("--visible-gt", options.eval.visible_gt)},
                       {"--crop", given("--crop", options.eval.crop)},
                       {"--tau", given("--tau", options.eval.taus)},
                       {"--max-distance", given("--max-distance", cap > 0 ? str(cap) : "")},
                       {"--point-samples", samples > 0 ? str(samples) : ""}});
            call(add_eval_geometry, "geometry", words, out("geometry")), ++done;
        }
        if (!a["--dtu"].empty())
            call(add_eval_dtu, "dtu", dtu_words(a, scene, suffix.empty()), out("dtu")), ++done;
        if (!a["--scene-dir"].empty()) {
            // The trained frame is that of the scene's model; the centres use the mesh's.
            const std::string model = scene + "/sparse/0";
            const bool by_mesh = !suffix.empty() && predictions.size() == 2,
                       by_model = a["--traj"].empty() && fs::is_directory(model);
            const Words words =
                flags({{"--scene-dir", a["--scene-dir"]},
                       {"--traj", by_mesh    ? ""
                                  : by_model ? model
                                             : a["--traj"]},
                       {"--tau", a["--tnt-tau"]},
                       {"--results", suffix.empty() ? alignment : ""},
                       {"--align-file", by_mesh ? alignment + "/alignment.txt" : ""}});
            call(add_eval_tnt, "tnt", words, out("tnt")), ++done;
        }
    }
    if (done == 0)
        throw usage_error(
            a.model,
            ": nothing to measure: the run has no test views; give --gt, --dtu or --scene-dir");
    call(add_eval_report, "report", {"--run", a.model}, flags({{"--scene", a["--scene"]}}));
    result_of_run().clear();
    return 0;
}

}  // namespace

Subcommand add_eval_run(CLI::App& app) {
    const auto a = std::make_shared<RunArguments>();
    CLI::App* command = app.add_subcommand("run", "run all evaluations that apply to a run folder");
    command->add_option("-m,--model,--model-path", a->model, "run folder")->required();
    command->add_flag("--masked", a->masked, "also score the object alone, inside its masks");
    command->add_option("-s,--scene", a->values["--scene"],
                        "folder of the scene [that of the run]");
    for (const auto& [name, owner, help] : kFlags) command->add_option(name, a->values[name], help);
    return {command, [a] { return run(*a); }};
}

}  // namespace tvsgs
