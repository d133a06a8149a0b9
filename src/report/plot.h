// Makes plots as SVG text, without external fonts, scripts or files. The colours in kPlotStyle suit
// colour-blind readers; lines also differ in dashes and marks.
#pragma once

#include <string>
#include <vector>

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

}  // namespace tvsgs
