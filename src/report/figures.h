// Plots and tables as HTML parts of a page.
#pragma once

#include <string>
#include <vector>

#include "io/files/json_value.h"
#include "report/plot.h"

namespace tvsgs {

/// Numbers of a JSON list; NaN for other values.
std::vector<double> numbers(const JsonValue& list);

/// `style`: attributes of the table, with a leading space.
std::string html_table(const std::string& caption,
                       const std::vector<std::string>& heads,
                       const std::vector<std::vector<std::string>>& rows,
                       const std::string& style = "");

/// The plot with its data table; empty for a plot without data. `id` as in plot_svg(); `source`:
/// the file with all rows where the table is thinned.
std::string plot_figure(const Plot& plot, const std::string& id, const std::string& source);

/// Plots of distances, F1 and view scores over seconds of training, from "evaluations" of a
/// report.json. Empty for fewer than two evaluations.
std::vector<Plot> plots_over_time(const JsonValue& evaluations);

/// Legend of the error colours, from 0 to `full`.
std::string error_scale(double full);

/// Text for a script element of type application/json; escaped so that it cannot end the element.
std::string json_for_page(const JsonValue& value);

}  // namespace tvsgs
