// Tables and overlaid plots of several runs, from their report.json.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "io/files/json_value.h"

namespace tvsgs {

struct TableRun {
    std::string scene;          // with its views, where these are named: "scan24, train_3"
    std::string configuration;  // as the user calls it, or empty
    double seed = 0;
    JsonValue report;
    std::string folder{};  // for messages
};

/// All numbers of a run by name: "chamfer (centres)", "f1@0.02 (centres)", "psnr", "seconds", ...
std::map<std::string, double> metrics_of(const JsonValue& report);

/// Runs without a name get the keys in which the runs differ, "tv.enabled=false"; the seed does not
/// count, nor what scenes have of their own. Runs of one name and scene that differ in what is
/// trained or scored get the keys in which they do, "ours, scene.resolution=2": what remains in a
/// row differs in its seed only.
void name_configurations(std::vector<TableRun>& runs);

/// A sentence for each seed that several runs of a named row have: their spread is not one of
/// seeds.
std::vector<std::string> equal_seeds(const std::vector<TableRun>& runs);

/// A result that somebody else has published for the mean over `scenes`, named as ours are.
struct PublishedFigure {
    std::string method, source;
    std::vector<std::string> scenes;
    std::string metric;
    double value = 0;
};

/// docs/published_figures.json says what they look like. Throws Error(ExitCode::input) naming
/// `where`.
std::vector<PublishedFigure> parse_published(const JsonValue& file, const std::string& where);

/// Mean over seeds, and their standard deviation where there are several.
struct Cell {
    double mean = 0, deviation = 0;
    int count = 0;
};
Cell cell_of(const std::vector<double>& values);

/// Markdown: distances per scene, precision, recall and F1, PSNR and SSIM, time and memory, and one
/// row per configuration with the means over the scenes. The best of each column is bold. Published
/// figures for the same scenes, or the mean over just these, are rows of their own.
std::string tables_markdown(const std::vector<TableRun>& runs,
                            const std::vector<PublishedFigure>& published = {});

/// scene,configuration,seed,metric,value
std::string tables_csv(const std::vector<TableRun>& runs);

/// One plot per scene and quality, a line per configuration, with a band from the lowest seed to
/// the highest; empty where no run was evaluated more than once.
struct OverlayPlot {
    std::string name, title, svg;  // name: for a file, [a-z0-9_-]
};
std::vector<OverlayPlot> overlay_plots(const std::vector<TableRun>& runs);

}  // namespace tvsgs
