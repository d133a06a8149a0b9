// tvsgs-eval table: tables of several runs, and one plot of their errors over time.
#include "report/table.h"

#include <filesystem>
#include <map>
#include <memory>

#include "apps/eval/subcommands.h"
#include "io/files/atomic_file.h"
#include "io/files/manifest.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// DIR or LABEL=DIR.
TableRun named_run(const std::string& text) {
    TableRun run{"", "", 0, {}, text};
    std::error_code code;
    if (const std::size_t at = text.find('='); at != std::string::npos && !fs::exists(text, code)) {
        run.configuration = text.substr(0, at);
        run.folder = text.substr(at + 1);
    }
    return run;
}

/// A repeated run would count as several in the mean.
void refuse_repeated(const std::vector<TableRun>& runs) {
    std::map<std::pair<std::string, fs::path>, std::string> seen;
    for (const TableRun& run : runs) {
        std::error_code code;
        const fs::path whole = fs::weakly_canonical(run.folder + "/", code);
        const auto [first, is_new] = seen.emplace(std::pair(run.configuration, whole), run.folder);
        if (!is_new)
            throw usage_error("--runs: ", first->second, " and ", run.folder,
                              " are the same run; remove one");
    }
}

/// False if the run has not finished.
bool read_run(TableRun& run) {
    const std::string& folder = run.folder;
    const std::string file = (fs::path(folder) / "report.json").string();
    std::error_code code;
    if (!fs::is_regular_file(file, code))
        throw input_error(file,
                          ": not found; expected a run folder. To write the report of a run:\n    "
                          "tvsgs-eval report --run ",
                          for_shell(folder));
    run.report = parse_json_value(read_bytes(file), file);
    if (run.report["format"].text != "tvsgs-report")
        throw input_error(file, ": not a report of tvsgs-train");
    if (run.report["summary"]["event"].text != "done") {
        spdlog::warn("{}: skipped, this run has not finished", folder);
        return false;
    }
    const JsonValue& scene = run.report["config"]["scene"];
    run.scene = run.report["run"]["scene"].text_or("unknown");
    if (!scene["split"].text.empty()) run.scene += ", " + scene["split"].text;
    if (!scene["views"].text.empty()) run.scene += ", views " + scene["views"].text;
    if (const double n = scene["num_views"].number_or(0); n > 0)
        run.scene += str(", ", n, " views");
    run.seed = run.report["config"]["seed"].number_or(0);
    return true;
}

int table(std::vector<std::string> folders,
          const MatrixOptions& matrix,
          const std::string& published_file,
          const std::string& out) {
    if (folders.empty() == matrix.file.empty()) throw usage_error("give either --runs or --matrix");
    if (matrix.file.empty() && (matrix.dry_run || !matrix.data.empty() || !matrix.scenes.empty()))
        throw usage_error("--data, --scenes and --dry-run need --matrix");
    if (!out.empty()) require_replaceable(fs::path(out).replace_extension(".csv"));
    if (!matrix.file.empty()) folders = run_matrix(matrix);
    if (matrix.dry_run) return 0;
    std::vector<PublishedFigure> published;
    JsonValue file;
    if (!published_file.empty()) {
        file = parse_json_value(read_bytes(published_file), published_file);
        published = parse_published(file, published_file);
    }
    std::vector<TableRun> asked, runs;
    for (const std::string& folder : folders) asked.push_back(named_run(folder));
    refuse_repeated(asked);
    for (TableRun& run : asked)
        if (read_run(run)) runs.push_back(std::move(run));
    if (runs.empty()) throw input_error("no run has finished; expected at least one");
    name_configurations(runs);
    for (const std::string& sentence : equal_seeds(runs)) spdlog::warn(sentence);
    std::string text = str("# Results of ", runs.size(),
                           " runs\n\nMeans over seeds \u00b1 their standard deviation, by ",
                           kVersion, ".\n\n", tables_markdown(runs, published));
    for (const auto& [name, source] : file["sources"].members)
        if (text.find(" (" + name + ")* |") != std::string::npos)
            text += str("Published, ", name, ": ", source.text, ".\n\n");
    if (out.empty()) {
        std::fputs(text.c_str(), stdout);
        return 0;
    }
    const fs::path path(out), stem = fs::path(out).replace_extension();
    for (const OverlayPlot& plot : overlay_plots(runs)) {
        const std::string path_of_plot = str(stem.string(), "_", plot.name, ".svg");
        write_text_file(path_of_plot, plot.svg);
        text += str("![", plot.title, "](<", fs::path(path_of_plot).filename().string(), ">)\n\n");
    }
    write_text_file(stem.string() + ".csv", tables_csv(runs));
    write_text_file(out, text);
    spdlog::info("Table of {1} runs: {0}; their numbers: {2}.csv", out, runs.size(), stem.string());
    return 0;
}

}  // namespace

Subcommand add_eval_table(CLI::App& app) {
    struct Arguments {
        std::vector<std::string> runs;
        std::string published, out;
        MatrixOptions matrix;
    };
    const auto arguments = std::make_shared<Arguments>();
    CLI::App* command = app.add_subcommand(
        "table", "write tables of finished runs, and plots of their errors over time");
    command
        ->add_option("--runs", arguments->runs,
                     "run folders DIR or LABEL=DIR; runs that differ only in the seed are averaged")
        ->take_all();
    command->add_option("--matrix", arguments->matrix.file,
                        "JSON file of scenes, configurations and seeds to train and measure first");
    command->add_option("--data", arguments->matrix.data,
                        "folder of the scenes, ${data} in that file");
    command
        ->add_option("--scenes", arguments->matrix.scenes,
                     "only these scenes of that file: A,B,C [all]")
        ->delimiter(',');
    command->add_flag("--dry-run", arguments->matrix.dry_run,
                      "with --matrix: print the commands only");
    command->add_option(
        "--published", arguments->published,
        "JSON file of published figures of the same scenes (docs/published_figures.json)");
    add_output_flag(
        *command, "-o,--out", arguments->out,
        "FILE.md; FILE.csv and plots are written beside it [standard output, no plots]");
    return {command, [arguments] {
                return table(arguments->runs, arguments->matrix, arguments->published,
                             arguments->out);
            }};
}

}  // namespace tvsgs
