#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "report/page_data.h"
#include "report/plot.h"

namespace tvsgs {
namespace {

constexpr std::size_t kTableRows = 60;

/// Table of series over the same x, thinned.
std::string plot_table(const Plot& plot, const std::string& source) {
    std::vector<std::string> heads{plot.x_label};
    for (const Series& s : plot.series) heads.push_back(s.name);
    const std::vector<double>& x = plot.series.front().x;
    const std::size_t n = x.size(), count = std::min(n, kTableRows);
    std::vector<std::vector<std::string>> rows;
    for (std::size_t r = 0; r < count; ++r) {
        const std::size_t i = count < 2 ? 0 : r * (n - 1) / (count - 1);
        std::vector<std::string> row{short_number(x[i])};
        for (const Series& s : plot.series)
            row.push_back(i < s.y.size() ? short_number(s.y[i]) : "");
        rows.push_back(std::move(row));
    }
    std::string caption = plot.title + ", " + plot.y_label;
    if (count < n) caption += str("; ", count, " of ", n, " rows, all are in ", source);
    return html_table(caption, heads, rows);
}

}  // namespace

std::vector<double> numbers(const JsonValue& list) {
    std::vector<double> values;
    for (const JsonValue& item : list.items) values.push_back(item.number_or(std::nan("")));
    return values;
}

std::string html_table(const std::string& caption,
                       const std::vector<std::string>& heads,
                       const std::vector<std::vector<std::string>>& rows,
                       const std::string& style) {
    std::string text = str("<div class=\"scroll\" tabindex=\"0\"><table", style, "><caption>",
                           escaped(caption), "</caption><thead><tr>");
    for (const std::string& head : heads) text += "<th scope=\"col\">" + escaped(head) + "</th>";
    text += "</tr></thead><tbody>\n";
    for (const auto& row : rows) {
        text += "<tr>";
        for (const std::string& cell : row) text += "<td>" + escaped(cell) + "</td>";
        text += "</tr>\n";
    }
    return text + "</tbody></table></div>\n";
}

std::string plot_figure(const Plot& plot, const std::string& id, const std::string& source) {
    const auto shows = [](const Series& s) {
        return std::ranges::count_if(s.y, [](double v) { return std::isfinite(v); });
    };
    if (std::ranges::none_of(plot.series, shows)) return "";
    return str("<figure class=\"card\">\n", plot_svg(plot, id),
               "<details><summary>Table: ", escaped(plot.title), "</summary>",
               plot_table(plot, source), "</details></figure>\n");
}

std::vector<Plot> plots_over_time(const JsonValue& evaluations) {
    if (evaluations.items.size() < 2) return {};
    const auto series = [&](const std::string& name, const auto& value_of) {
        Series out{.name = name, .marks = true};
        for (const JsonValue& evaluation : evaluations.items) {
            out.x.push_back(evaluation["seconds"].number_or(std::nan("")));
            out.y.push_back(value_of(evaluation).number_or(std::nan("")));
        }
        return out;
    };
    std::vector<Plot> plots;
    for (const char* what : {"mesh", "centres"}) {
        Plot distance{str("Distance of the ", what, " to the truth"), "seconds", "scene units",
                      /*log_x=*/true, /*log_y=*/true};
        for (const auto& [name, key] : {std::pair("Chamfer", "chamfer"),
                                        {"accuracy", "accuracy"},
                                        {"completeness", "completeness"}})
            distance.series.push_back(
                series(name, [what, k = key](const JsonValue& e) { return e[what][k]; }));
        plots.push_back(std::move(distance));
        Plot f1{str("F1 of the ", what), "seconds", "share", true, false, /*y_from_zero=*/true};
        const auto& thresholds = evaluations.items.back()[what]["thresholds"].items;
        for (std::size_t t = 0; t < thresholds.size(); ++t)
            f1.series.push_back(series("at " + short_number(thresholds[t]["tau"].number),
                                       [what, t](const JsonValue& e) {
                                           const auto& items = e[what]["thresholds"].items;
                                           return t < items.size() ? items[t]["f1"] : JsonValue();
                                       }));
        plots.push_back(std::move(f1));
    }
    for (const auto& [title, unit, key] :
         {std::tuple("PSNR of the test views", "dB", "psnr"),
          std::tuple("SSIM of the test views", "1 is equal", "ssim")})
        plots.push_back({.title = title,
                         .x_label = "seconds",
                         .y_label = unit,
                         .log_x = true,
                         .series = {series(key, [k = key](const JsonValue& e) { return e[k]; })}});
    return plots;
}

std::string error_scale(double full) {
    std::string stops;
    for (int i = 0; i <= 8; ++i) {
        const Rgb c = error_shade(i / 8.0);
        stops += str(", rgb(", int{c.r}, " ", int{c.g}, " ", int{c.b}, ")");
    }
    return str("<div class=\"scale\"><span>0</span><i style=\"background:linear-gradient(to right",
               stops, ")\"></i><span>", short_number(full), " and more</span></div>\n");
}

std::string json_for_page(const JsonValue& value) {
    const std::string text = json_text(value);
    std::string out;
    out.reserve(text.size() + text.size() / 16);
    for (std::size_t at = 0, open; at < text.size(); at = open + 1) {
        open = std::min(text.find('<', at), text.size());
        out.append(text, at, open - at);
        if (open < text.size()) out += "\\u003c";
    }
    return out;
}

}  // namespace tvsgs
