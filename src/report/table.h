// Tables and overlaid plots of several runs, from their report.json.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "io/files/json_value.h"

namespace tvsgs {

struct TableRun {
    std::string scene;          // with its views, if named: "scan24, train_3"
    std::string configuration;  // name given by the user, or empty
    double seed = 0;
    JsonValue report;
    std::string folder{};  // for messages
};

/// All numbers of a run by name: "chamfer (centres)", "f1@0.02 (centres)", "psnr", "seconds", ...
std::map<std::string, double> metrics_of(const JsonValue& report);

/// Names runs without a name by the keys in which they differ, "tv.enabled=false", except the seed
/// and keys of the scene. To runs with the same name and scene that differ in training or scoring
/// it appends the keys in which they differ, "ours, scene.resolution=2". Then runs of a row differ
/// only in their seed.
void name_configurations(std::vector<TableRun>& runs);

/// Warnings: one sentence per seed that several runs of a row share, as their spread does not show
/// the effect of seeds.
std::vector<std::string> equal_seeds(const std::vector<TableRun>& runs);

/// A published result of another method: the mean over `scenes`, with the metric named as here.
struct PublishedFigure {
    std::string method, source;
    std::vector<std::string> scenes;
    std::string metric;
    double value = 0;
};

/// Parses a file as in docs/published_figures.json. Throws Error(ExitCode::input) with `where`.
std::vector<PublishedFigure> parse_published(const JsonValue& file, const std::string& where);

/// Mean over seeds, and their standard deviation for several seeds.
struct Cell {
    double mean = 0, deviation = 0;
    int count = 0;
};
Cell cell_of(const std::vector<double>& values);

/// Markdown tables: distances per scene; precision, recall and F1; PSNR and SSIM; time and memory;
/// and one row per configuration with the means over the scenes. The best value of a column is
/// bold. Published figures for the same scenes, or the mean over exactly these, are separate rows.
std::string tables_markdown(const std::vector<TableRun>& runs,
                            const std::vector<PublishedFigure>& published = {});

/// scene,configuration,seed,metric,value
std::string tables_csv(const std::vector<TableRun>& runs);

/// One plot per scene and metric, with a line per configuration and a band from the lowest to the
/// highest seed. Empty where no run has several evaluations.
struct OverlayPlot {
    std::string name, title, svg;  // part of a file name, [a-z0-9_-]
};
std::vector<OverlayPlot> overlay_plots(const std::vector<TableRun>& runs);

}  // namespace tvsgs
