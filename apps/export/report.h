// The report of tvsgs-export on the file it has written.
#pragma once

#include <optional>
#include <string>

#include "io/splats/splat_errors.h"
#include "io/splats/splat_files.h"
#include "pipeline/run/splat_selection.h"

namespace tvsgs {

struct ExportReport {
    std::string path;
    SplatFormat format = SplatFormat::ply;
    SplatFrame frame = SplatFrame::rdf;
    int splats = 0, sh_degree = 0;
    std::uintmax_t bytes = 0;
    SelectionReport left_out;
    // Results of the check, if there was one:
    std::optional<SplatErrors> errors;
    double typical_size = 0;  // result of typical_size()
    int views = 0;            // number of rendered views
    std::string view_kind;    // test or training
    double of_input = 0;      // PSNR of all splats
    RenderScores scores;      // of the exported splats, before and after
};

/// The median of the splats' second standard deviations, to compare errors of positions with.
double typical_size(const Gaussians<Cpu>& gaussians);

/// Logs how many splats were left out, and why.
void log_left_out(const SelectionReport& report, int of, std::size_t views);
void say(const ExportReport& report);

/// One line, with its end.
std::string report_json(const ExportReport& report);

}  // namespace tvsgs
