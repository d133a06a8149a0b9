// Parts of a page: plots and tables as HTML, pictures small enough to embed, colours of errors.
#pragma once

#include <string>
#include <vector>

#include "core/scene/image.h"
#include "io/files/json_value.h"
#include "pipeline/run/train_evaluation.h"
#include "report/plot.h"

namespace tvsgs {

/// CSS of a page besides that of its plots, kPlotStyle.
extern const char* const kPageStyle;

/// Numbers of a JSON list; NaN for other values.
std::vector<double> numbers(const JsonValue& list);

using Rows = std::vector<std::vector<std::string>>;

/// `style`: attributes of the table, with a leading space.
std::string html_table(const std::string& caption,
                       const std::vector<std::string>& heads,
                       const Rows& rows,
                       const std::string& style = "");

/// The plot with its data table; empty for a plot without data. `id` as in plot_svg().
std::string plot_figure(const Plot& plot, const std::string& id);

/// Plots of distances, F1 and view scores over seconds of training, from "evaluations" of a
/// report.json. Empty for fewer than two evaluations.
std::vector<Plot> plots_over_time(const JsonValue& evaluations);

std::string base64(const std::string& bytes);

/// Data URI of a JPEG.
std::string jpeg_source(const std::string& bytes);

/// {"src": data URI of a JPEG, "width", "height"}; at most `width` wide.
JsonValue picture_json(const ImageU8& image, int width);

/// Difference of two pictures of one size, averaged over the channels; a quarter of the range or
/// more is the brightest shade.
ImageU8 difference_image(const ImageU8& a, const ImageU8& b);

/// Colours from dark (no error) to bright (full error): cividis without its darkest part, for a
/// black background.
struct Rgb {
    std::uint8_t r, g, b;
};
Rgb error_shade(double share);

/// End of the error colour scale: twice the largest threshold; 0: no threshold.
double full_error(const Truth& truth);

/// Legend of the error colours, from 0 to `full`.
std::string error_scale(double full);

/// At most `count` of all items, evenly spaced from the first to the last.
template <class Item>
std::vector<Item> thinned(const std::vector<Item>& all, std::size_t count) {
    if (all.size() <= count) return all;
    std::vector<Item> some;
    for (std::size_t k = 0; k < count; ++k)
        some.push_back(all[count < 2 ? 0 : k * (all.size() - 1) / (count - 1)]);
    return some;
}

/// Text for a script element of type application/json; escaped so that it cannot end the element.
std::string json_for_page(const JsonValue& value);

}  // namespace tvsgs
