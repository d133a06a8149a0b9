// Plots as SVG text: no fonts, scripts or files from elsewhere. Colours come from the style below,
// chosen for colour-blind readers; lines differ in dashes and marks, too.
#pragma once

#include <string>
#include <vector>

namespace tvsgs {

struct Series {
    std::string name;
    std::vector<double> x, y;
    std::vector<double> low, high;  // a band around y; empty: none
    bool marks = false;             // a mark at each point
};

struct Plot {
    std::string title, x_label, y_label;
    bool log_x = false, log_y = false;
    bool y_from_zero = false;
    std::vector<Series> series;
    std::string note;  // for those who do not see the plot
};

/// Values that have no place (not finite; not positive on a logarithmic axis) are left out; an
/// axis with none that is positive becomes linear. `id` has to be unique on its page.
std::string plot_svg(const Plot& plot, const std::string& id);

struct Bars {
    std::string title, unit;
    std::vector<std::string> names;
    std::vector<double> values;
};
std::string bars_svg(const Bars& bars, const std::string& id);

/// CSS of both, light and dark; a page holds it once.
extern const char* const kPlotStyle;

/// The same as a file of its own.
std::string standalone_svg(std::string svg);

/// & < > " ' become entities; control characters, which no page may hold, U+FFFD.
std::string escaped(const std::string& text);

/// At most `digits` significant ones, no exponent where it can be avoided.
std::string short_number(double value, int digits = 4);

}  // namespace tvsgs
