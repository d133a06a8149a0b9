// What tvsgs-export says of the file it has written.
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
    // Of the check, where there was one:
    std::optional<SplatErrors> errors;
    double typical_size = 0;  // of typical_size()
    int views = 0;            // that were rendered
    std::string view_kind;    // test or training
    double of_input = 0;      // PSNR of all splats
    RenderScores scores;      // of those in the file, before and after
};

/// The median of the splats' second standard deviations: what an error of positions compares with.
double typical_size(const Gaussians<Cpu>& gaussians);

/// As messages.
void say_left_out(const SelectionReport& report, int of, std::size_t views);
void say(const ExportReport& report);

/// On one line, with its end.
std::string report_json(const ExportReport& report);

}  // namespace tvsgs
