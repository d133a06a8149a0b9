// Makes plots as SVG text, without external fonts, scripts or files, and HTML parts with them. The
// colours in kPlotStyle suit colour-blind readers; lines also differ in dashes and marks.
#pragma once

#include <string>
#include <vector>

#include "io/files/json_value.h"

namespace tvsgs {

struct Series {
    std::string name;
    std::vector<double> x{}, y{};
    std::vector<double> low{}, high{};  // a band around y; may be empty
    bool marks = false;                 // a mark at each point
};

struct Plot {
    std::string title, x_label, y_label;
    bool log_x = false, log_y = false, y_from_zero = false;
    std::vector<Series> series{};
    std::string note{};  // text for screen readers
};

/// Leaves out values that are not finite, or not positive on a logarithmic axis; an axis without
/// positive values becomes linear. `id` has to be unique on its page.
std::string plot_svg(const Plot& plot, const std::string& id);

struct Bars {
    std::string title, unit;
    std::vector<std::string> names;
    std::vector<double> values;
};
std::string bars_svg(const Bars& bars, const std::string& id);

/// CSS of both kinds of plot, light and dark; a page needs it once.
extern const char* const kPlotStyle;

/// The plot as a file of its own.
std::string standalone_svg(std::string svg);

/// Escapes & < > " ' as entities; replaces control characters, which HTML forbids, by U+FFFD.
std::string escaped(const std::string& text);

/// Formats with at most `digits` significant digits, without an exponent where possible.
std::string short_number(double value, int digits = 4);

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
