// Plots and tables as parts of a page.
#pragma once

#include <string>
#include <vector>

#include "io/files/json_value.h"
#include "report/plot.h"

namespace tvsgs {

/// Of a list; what is no number becomes NaN.
std::vector<double> numbers(const JsonValue& list);

/// 1234567 as 1,234,567.
std::string grouped(std::size_t value);

/// `style`: attributes of the table, with a space before them.
std::string html_table(const std::string& caption,
                       const std::vector<std::string>& heads,
                       const std::vector<std::vector<std::string>>& rows,
                       const std::string& style = "");

/// The plot with its table, unless it has nothing to show. `id` as in plot_svg(); `source`: the
/// file that has all rows where the table has not.
std::string plot_figure(const Plot& plot, const std::string& id, const std::string& source);

/// Distances, F1 and scores of the views by seconds of training: from "evaluations" of a
/// report.json. Empty with fewer than two.
std::vector<Plot> plots_over_time(const JsonValue& evaluations);

/// What colours by error mean, from 0 to `full`.
std::string error_scale(double full);

/// The text of a script element of type application/json: it cannot end the element.
std::string json_for_page(const JsonValue& value);

}  // namespace tvsgs
