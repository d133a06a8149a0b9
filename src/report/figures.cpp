#include "report/figures.h"

#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/log.h"
#include "eval/benchmark_files.h"
#include "io/images/image_file.h"

namespace tvsgs {
namespace {

constexpr std::size_t kTableRows = 60;

/// Table of series over the same x, thinned.
std::string plot_table(const Plot& plot) {
    std::vector<std::string> heads{plot.x_label};
    for (const Series& s : plot.series) heads.push_back(s.name);
    const std::vector<double>& x = plot.series.front().x;
    Rows rows;
    for (std::size_t i = 0; i < x.size(); ++i) {
        std::vector<std::string> row{short_number(x[i])};
        for (const Series& s : plot.series)
            row.push_back(i < s.y.size() ? short_number(s.y[i]) : "");
        rows.push_back(std::move(row));
    }
    std::string caption = plot.title + ", " + plot.y_label;
    if (x.size() > kTableRows)
        caption += str("; ", kTableRows, " of ", x.size(), " rows, all are in report.json");
    return html_table(caption, heads, thinned(rows, kTableRows));
}

constexpr double kFullDifference = 0.25;

std::uint8_t byte_of(double value) {
    return static_cast<std::uint8_t>(std::clamp(std::lround(255 * value), 0L, 255L));
}

Rgb cividis(double share) {
    const Vec3f c = error_color(ErrorPalette::safe, share, 1, PointStatus::measured);
    return {byte_of(double{c.x}), byte_of(double{c.y}), byte_of(double{c.z})};
}

}  // namespace

const char* const kPageStyle = R"(
:root{color-scheme:light dark;--page:#f4f5f7;--card:#fff;--text:#1b1b1b;--quiet:#55585e;--line:#d5d8dd;--link:#005a9c;--mark:#b35c00}
@media (prefers-color-scheme:dark){:root{--page:#0e1013;--card:#16191d;--text:#e8e8e8;--quiet:#aab0b8;--line:#363c44;--link:#7cc4ff;--mark:#e69f00}}
*{box-sizing:border-box}
body{margin:0;background:var(--page);color:var(--text);font:16px/1.5 system-ui,-apple-system,"Segoe UI",sans-serif}
main,header{max-width:1240px;margin:0 auto;padding:0 16px}
header{padding-top:20px}h1{font-size:1.6rem;margin:0;overflow-wrap:anywhere}h2{font-size:1.25rem;margin:36px 0 10px}
h3{font-size:1rem;margin:18px 0 6px;overflow-wrap:anywhere}p{margin:6px 0 10px;max-width:75ch}
a{color:var(--link)}.quiet{color:var(--quiet)}
nav ul{list-style:none;display:flex;flex-wrap:wrap;gap:2px 18px;margin:10px 0 0;padding:0}nav a{display:inline-block;padding:5px 0}
.notice{border-left:4px solid #d55e00;background:var(--card);padding:8px 12px;max-width:none}
.facts{display:grid;grid-template-columns:repeat(auto-fill,minmax(132px,1fr));gap:10px;margin:16px 0}
.facts div{background:var(--card);border:1px solid var(--line);border-radius:6px;padding:8px 12px}
.facts dt{font-size:.82rem;color:var(--quiet)}.facts dd{margin:0;font-size:1.2rem;font-weight:600;overflow-wrap:anywhere}
.plots{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,420px),1fr));gap:14px;align-items:start}
figure{margin:0;min-width:0}.card{background:var(--card);border:1px solid var(--line);border-radius:6px;padding:10px}
svg.plot{display:block;width:100%;height:auto}
details{margin-top:6px}summary{cursor:pointer;color:var(--link);padding:6px 0}
.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums}
th,td{padding:3px 10px;border-bottom:1px solid var(--line);text-align:right;white-space:nowrap}
th:first-child,td:first-child{text-align:left}.words td,.words th{text-align:left;white-space:normal;overflow-wrap:anywhere}
.plan td,.plan th{text-align:left;white-space:normal;overflow-wrap:break-word}
caption{text-align:left;color:var(--quiet);padding-bottom:4px}
.pictures{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(46%,210px),1fr));gap:8px}
.pictures img{width:100%;height:auto;display:block;background:#101010;border-radius:3px}
figcaption{font-size:.86rem;color:var(--quiet);padding-top:3px}
.lead{font-size:1.08rem}.level{display:inline-block}main>ul{margin:4px 0 12px;padding-left:22px;max-width:75ch}li{margin:3px 0;overflow-wrap:anywhere}
.viewer img{width:100%;max-width:900px;height:auto;display:block;border-radius:4px}
.viewer iframe{width:100%;height:92vh;min-height:420px;border:0;display:block}
.scroll:focus-visible,iframe:focus-visible,button:focus-visible,a:focus-visible,summary:focus-visible,input:focus-visible{outline:3px solid var(--mark);outline-offset:2px}
.controls{display:flex;flex-wrap:wrap;gap:6px;margin:8px 0}.controls[hidden]{display:none}
button{font:inherit;min-width:44px;min-height:40px;padding:4px 12px;background:var(--card);color:var(--text);border:1px solid var(--quiet);border-radius:5px;cursor:pointer}
.scale{display:grid;grid-template-columns:auto minmax(60px,240px) auto;gap:8px;align-items:center;justify-content:start;font-size:.86rem;margin-top:8px}
.scale[hidden]{display:none}.scale i{display:block;height:14px;border-radius:2px;print-color-adjust:exact;-webkit-print-color-adjust:exact}
footer{max-width:1240px;margin:36px auto 0;padding:0 16px 28px;color:var(--quiet);font-size:.86rem}
@media screen and (max-width:600px){svg.plot{font-size:15px}svg.plot .title{font-size:17px}main,header{padding:0 10px}.card{padding:4px}.card summary,figcaption{padding-left:6px}}
@media print{:root{color-scheme:light;--page:#fff;--card:#fff;--text:#000;--quiet:#333;--line:#ccc;--link:#000}
body{font-size:10.5pt}nav,.controls,button,details{display:none!important}.viewer img{max-width:12cm}
main,header,footer{max-width:none;padding:0}.plots{grid-template-columns:1fr 1fr}.pictures{grid-template-columns:repeat(5,1fr)}
figure,.facts div,.view{break-inside:avoid}h2,h3,main>p{break-after:avoid}}
)";

std::vector<double> numbers(const JsonValue& list) {
    std::vector<double> values;
    for (const JsonValue& item : list.items) values.push_back(item.number_or(std::nan("")));
    return values;
}

std::string html_table(const std::string& caption,
                       const std::vector<std::string>& heads,
                       const Rows& rows,
                       const std::string& style) {
    std::string text =
        fmt::format(R"(<div class="scroll" tabindex="0"><table{}><caption>{}</caption><thead><tr>)",
                    style, escaped(caption));
    for (const std::string& head : heads) text += "<th scope=\"col\">" + escaped(head) + "</th>";
    text += "</tr></thead><tbody>\n";
    for (const auto& row : rows) {
        text += "<tr>";
        for (const std::string& cell : row) text += "<td>" + escaped(cell) + "</td>";
        text += "</tr>\n";
    }
    return text + "</tbody></table></div>\n";
}

std::string plot_figure(const Plot& plot, const std::string& id) {
    const auto shows = [](const Series& s) {
        return std::count_if(s.y.begin(), s.y.end(), [](double v) { return std::isfinite(v); });
    };
    if (std::none_of(plot.series.begin(), plot.series.end(), shows)) return "";
    return str("<figure class=\"card\">\n", plot_svg(plot, id),
               "<details><summary>Table: ", escaped(plot.title), "</summary>", plot_table(plot),
               "</details></figure>\n");
}

std::vector<Plot> plots_over_time(const JsonValue& evaluations) {
    const std::vector<JsonValue>& list = evaluations.items;
    if (list.size() < 2) return {};
    /// One number per evaluation, selected by `find`.
    const auto of_each = [&](auto&& find) {
        std::vector<double> values;
        for (const JsonValue& item : list) values.push_back(find(item).number_or(std::nan("")));
        return values;
    };
    const std::vector<double> seconds = of_each([](const JsonValue& e) { return e["seconds"]; });
    const auto series = [&](const std::string& name, auto&& find) {
        return Series{name, seconds, of_each(find), true};
    };
    std::vector<Plot> plots;
    for (const char* what : {"mesh", "centres"}) {
        Plot distances{str("Distance of the ", what, " to the truth"), "seconds", "scene units"};
        distances.log_x = distances.log_y = true;
        for (const auto& [name, key] : {std::pair("Chamfer", "chamfer"),
                                        {"accuracy", "accuracy"},
                                        {"completeness", "completeness"}})
            distances.series.push_back(
                series(name, [=, k = key](const JsonValue& e) { return e[what][k]; }));
        plots.push_back(std::move(distances));
        Plot f1{str("F1 of the ", what), "seconds", "share"};
        f1.log_x = f1.y_from_zero = true;
        const auto& thresholds = list.back()[what]["thresholds"].items;
        for (std::size_t t = 0; t < thresholds.size(); ++t)
            f1.series.push_back(
                series("at " + short_number(thresholds[t]["tau"].number), [=](const JsonValue& e) {
                    const auto& items = e[what]["thresholds"].items;
                    return t < items.size() ? items[t]["f1"] : JsonValue();
                }));
        plots.push_back(std::move(f1));
    }
    for (const auto& [title, unit, key] :
         {std::tuple("PSNR of the test views", "dB", "psnr"),
          std::tuple("SSIM of the test views", "1 is equal", "ssim")}) {
        plots.push_back({title, "seconds", unit});
        plots.back().log_x = true;
        plots.back().series = {series(key, [k = key](const JsonValue& e) { return e[k]; })};
    }
    return plots;
}

std::string base64(const std::string& bytes) {
    static const char* const digits =
        "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    std::string out;
    out.reserve(bytes.size() / 3 * 4 + 4);
    for (std::size_t i = 0; i < bytes.size(); i += 3) {
        const auto at = [&](std::size_t j) {
            return j < bytes.size() ? static_cast<unsigned char>(bytes[j]) : 0u;
        };
        const unsigned bits = at(i) << 16 | at(i + 1) << 8 | at(i + 2);
        out += digits[bits >> 18];
        out += digits[bits >> 12 & 63];
        out += i + 1 < bytes.size() ? digits[bits >> 6 & 63] : '=';
        out += i + 2 < bytes.size() ? digits[bits & 63] : '=';
    }
    return out;
}

std::string jpeg_source(const std::string& bytes) {
    return "data:image/jpeg;base64," + base64(bytes);
}

JsonValue picture_json(const ImageU8& image, int width) {
    const int w = std::min(width, image.width);
    const int h = std::max(
        1, static_cast<int>(std::lround(static_cast<double>(image.height) * w / image.width)));
    return JsonValue()
        .add("src", jpeg_source(jpeg_bytes(resize_bicubic(image, w, h), 85)))
        .add("width", w)
        .add("height", h);
}

Rgb error_shade(double share) {
    return cividis(0.2 + 0.8 * std::clamp(share, 0.0, 1.0));
}

ImageU8 difference_image(const ImageU8& a, const ImageU8& b) {
    ImageU8 out(a.width, a.height, 3);
    for (int y = 0; y < a.height; ++y)
        for (int x = 0; x < a.width; ++x) {
            int sum = 0;
            for (int c = 0; c < 3; ++c) sum += std::abs(a.at(x, y, c) - b.at(x, y, c));
            const Rgb shade = cividis(sum / (3 * 255 * kFullDifference));
            out.at(x, y, 0) = shade.r, out.at(x, y, 1) = shade.g, out.at(x, y, 2) = shade.b;
        }
    return out;
}

double full_error(const Truth& truth) {
    double full = 0;
    for (const double tau : truth.taus) full = std::max(full, 2 * tau);
    return full;
}

std::string error_scale(double full) {
    std::string stops;
    for (int i = 0; i <= 8; ++i) {
        const Rgb c = error_shade(i / 8.0);
        stops += str(", rgb(", int{c.r}, " ", int{c.g}, " ", int{c.b}, ")");
    }
    return fmt::format(
        "<div class=\"scale\"><span>0</span><i style=\"background:linear-gradient(to "
        "right{})\"></i>"
        "<span>{} and more</span></div>\n",
        stops, short_number(full));
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
