#include "report/plot.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/error.h"
#include "core/log.h"
#include "core/version.h"

namespace tvsgs {
namespace {

constexpr double kWidth = 440, kPlotHeight = 240;  // px, of the viewBox
constexpr double kLeft = 56, kRight = 14, kTop = 56, kBottom = 46;
constexpr double kCharacter = 7.8;  // approximate width of a character in px, also on a phone
constexpr std::size_t kColors = 7;  // in kPlotStyle

/// Colour and dashes of a series; series beyond the last colour have other dashes.
std::string class_of(std::size_t series) {
    return str("s", series % kColors, series < kColors ? "" : " again");
}

std::string fixed(double value) {
    return fmt::format("{:.1f}", value);
}

struct Tick {
    double value;
    std::string label;
};

std::string tick_label(double value) {
    const double size = std::abs(value);
    return size >= 1e6   ? fmt::format("{:g}M", value / 1e6)
           : size >= 1e4 ? fmt::format("{:g}k", value / 1e3)
                         : fmt::format("{:g}", value);
}

/// About five steps of 1, 2 or 5 times a power of ten.
std::vector<Tick> linear_ticks(double low, double high) {
    const double raw = (high - low) / 5, power = std::pow(10, std::floor(std::log10(raw)));
    const double share = raw / power;
    const double step = power * (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10);
    std::vector<Tick> ticks;
    for (double i = std::ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; ++i)
        ticks.push_back({i * step, tick_label(i == 0 ? 0 : i * step)});
    return ticks;
}

/// Powers of ten, and 2 and 5 times them where there are few.
std::vector<Tick> log_ticks(double low, double high) {
    std::vector<Tick> ticks;
    const double decades = std::log10(high / low);
    const int every = std::max(1, static_cast<int>(decades / 6));
    for (int e = static_cast<int>(std::floor(std::log10(low))); std::pow(10, e) <= high; ++e)
        for (const double m : {1.0, 2.0, 5.0}) {
            const double value = m * std::pow(10, e);
            if (value < low * 0.999 || value > high * 1.001) continue;
            if ((m != 1 && decades > 2.5) || e % every != 0) continue;
            ticks.push_back({value, tick_label(value)});
        }
    return ticks;
}

struct Axis {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    bool log = false;

    bool has(double v) const { return std::isfinite(v) && (!log || v > 0); }
    void include(double v) {
        if (has(v)) low = std::min(low, v), high = std::max(high, v);
    }
    /// Adds a margin at both ends; the range is never empty.
    void settle(bool from_zero, double margin) {
        if (!(low <= high)) low = log ? 1 : 0, high = log ? 10 : 1;
        if (from_zero && !log) low = std::min(low, 0.0);
        if (log) {
            if (high / low < 1.2) low /= 1.3, high *= 1.3;
            const double room = std::pow(high / low, margin);
            low /= room, high *= room;
        } else {
            if (high - low < 1e-9 * std::max(1.0, std::abs(high)))
                low -= 0.5 * std::abs(high) + 1e-9, high += 0.5 * std::abs(high) + 1e-9;
            const double room = margin * (high - low);
            if (!(from_zero && low == 0)) low -= room;
            high += room;
        }
    }
    double share(double v) const {
        return log ? std::log(v / low) / std::log(high / low) : (v - low) / (high - low);
    }
    std::vector<Tick> ticks() const {
        if (log) {
            std::vector<Tick> result = log_ticks(low, high);
            if (result.size() > 1) return result;
        }
        return linear_ticks(low, high);
    }
};

struct Frame {
    Axis x, y;

    bool has(double at, double value) const { return x.has(at) && y.has(value); }
    std::string point(double at, double value) const {
        return fixed(kLeft + (kWidth - kLeft - kRight) * x.share(at)) + "," +
               fixed(kTop + kPlotHeight * (1 - y.share(value)));
    }
};

Frame make_frame(const Plot& plot) {
    Frame frame;
    const auto any_positive = [&](auto member) {
        for (const Series& s : plot.series)
            for (const double v : s.*member)
                if (v > 0 && std::isfinite(v)) return true;
        return false;
    };
    frame.x.log = plot.log_x && any_positive(&Series::x);
    frame.y.log = plot.log_y && any_positive(&Series::y);
    for (const Series& s : plot.series)
        for (std::size_t i = 0; i < s.x.size(); ++i) {
            if (!frame.has(s.x[i], s.y[i])) continue;
            frame.x.include(s.x[i]);
            frame.y.include(s.y[i]);
            if (!s.low.empty()) frame.y.include(s.low[i]), frame.y.include(s.high[i]);
        }
    frame.x.settle(false, 0.02);
    frame.y.settle(plot.y_from_zero, 0.05);
    return frame;
}

std::string mark(const std::string& point, std::size_t kind) {
    const std::size_t comma = point.find(',');
    const std::string x = point.substr(0, comma), y = point.substr(comma + 1);
    if (kind % 4 == 0) return str("<circle cx=\"", x, "\" cy=\"", y, "\" r=\"3.5\"/>");
    constexpr const char* kPaths[] = {"m-3.5-3.5h7v7h-7z", "m0-4.5l4.5 8h-9z",
                                      "m0-4.5l4.5 4.5l-4.5 4.5l-4.5-4.5z"};
    return str("<path d=\"M", x, " ", y, kPaths[kind % 4 - 1], "\"/>");
}

std::string series_svg(const Series& s, const Frame& frame, std::size_t index) {
    std::string line, forth, back, marks;
    std::size_t in_line = 0;
    std::string path;
    bool pen_down = false;
    for (std::size_t i = 0; i < s.x.size(); ++i) {
        if (!frame.has(s.x[i], s.y[i])) {
            pen_down = false;
            continue;
        }
        const std::string at = frame.point(s.x[i], s.y[i]);
        path += (pen_down ? "L" : "M") + at;
        pen_down = true;
        ++in_line;
        if (s.marks) marks += mark(at, index);
        if (!s.low.empty() && frame.y.has(s.low[i]) && frame.y.has(s.high[i])) {
            forth += (forth.empty() ? "M" : "L") + frame.point(s.x[i], s.high[i]);
            back = "L" + frame.point(s.x[i], s.low[i]) + back;
        }
    }
    if (in_line == 1 && marks.empty())
        marks = mark(path.substr(1), index);  // a line of a single point is invisible
    std::string text = str("<g class=\"", class_of(index), "\">");
    if (!forth.empty()) text += str("<path class=\"band\" d=\"", forth, back, "Z\"/>");
    return text + str("<path class=\"line\" d=\"", path, "\"/>", marks, "</g>\n");
}

/// Shortens to about `longest` characters of UTF-8. Cuts the front, as names differ at their ends.
std::string fitting(const std::string& name, std::size_t longest) {
    if (name.size() <= longest) return name;
    std::size_t from = name.size() - longest + 1;
    while (from < name.size() && (static_cast<unsigned char>(name[from]) & 0xC0) == 0x80) ++from;
    return "\u2026" + name.substr(from);
}

/// Draws the legend below the plot, in as many rows as needed; sets `y` to the next free row.
std::string legend_svg(const std::vector<Series>& series, double& y) {
    constexpr std::size_t kLongest = 50;
    if (series.size() < 2) return "";
    std::string text = "<g>";
    double x = 8;
    for (std::size_t i = 0; i < series.size(); ++i) {
        const std::string name = fitting(series[i].name, kLongest);
        const double width = 50 + kCharacter * static_cast<double>(name.size());
        if (x > 8 && x + width > kWidth) x = 8, y += 18;
        text += str("<g class=\"", class_of(i), "\"><path class=\"line\" d=\"M", fixed(x), " ",
                    fixed(y - 4), "h26\"/>",
                    series[i].marks ? mark(fixed(x + 13) + "," + fixed(y - 4), i) : "",
                    "</g><text x=\"", fixed(x + 31), "\" y=\"", fixed(y), "\">", escaped(name),
                    "</text>");
        x += width;
    }
    y += 18;
    return text + "</g>\n";
}

std::string summary(const Plot& plot) {
    std::string text = plot.note;
    for (const Series& s : plot.series) {
        if (s.x.empty()) continue;
        text += str(text.empty() ? "" : " ", s.name, ": ", short_number(s.y.front()), " at ",
                    short_number(s.x.front()), ", ", short_number(s.y.back()), " at ",
                    short_number(s.x.back()), ".");
    }
    return text;
}

std::string svg_head(double height,
                     const std::string& id,
                     const std::string& title,
                     const std::string& description) {
    return str("<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"plot\" viewBox=\"0 0 ", kWidth,
               " ", fixed(height), "\" role=\"img\" aria-labelledby=\"", id, "-t ", id,
               "-d\">\n<title id=\"", id, "-t\">", escaped(title), "</title>\n<desc id=\"", id,
               "-d\">", escaped(description), "</desc>\n");
}

}  // namespace

const char* const kPlotStyle = R"(
.plot{--bg:#fff;--fg:#1b1b1b;--soft:#5a5a5a;--grid:#dcdcdc;
--c0:#0072b2;--c1:#d55e00;--c2:#00805e;--c3:#a8467f;--c4:#8a6100;--c5:#3f7fae;--c6:#444;
background:var(--bg);font:13px system-ui,-apple-system,"Segoe UI",sans-serif;fill:var(--fg)}
@media (prefers-color-scheme:dark){.plot{--bg:#16191d;--fg:#e8e8e8;--soft:#aab0b8;--grid:#363c44;
--c0:#56b4e9;--c1:#f0883a;--c2:#2fc79a;--c3:#e29cc8;--c4:#f0c04a;--c5:#9fc8ff;--c6:#cfcfcf}}
@media print{.plot{--bg:#fff;--fg:#000;--soft:#333;--grid:#ccc;
--c0:#0072b2;--c1:#d55e00;--c2:#00805e;--c3:#a8467f;--c4:#8a6100;--c5:#3f7fae;--c6:#444}}
.plot .title{font-size:15px;font-weight:600}.plot .soft{fill:var(--soft)}
.plot .grid{stroke:var(--grid);fill:none}.plot .axis{stroke:var(--soft);fill:none}
.plot .line{fill:none;stroke-width:2;stroke-linejoin:round}
.plot .band{stroke:none;opacity:.2}
.plot .s0{stroke:var(--c0);fill:var(--c0)}.plot .s1{stroke:var(--c1);fill:var(--c1)}
.plot .s2{stroke:var(--c2);fill:var(--c2)}.plot .s3{stroke:var(--c3);fill:var(--c3)}
.plot .s4{stroke:var(--c4);fill:var(--c4)}.plot .s5{stroke:var(--c5);fill:var(--c5)}
.plot .s6{stroke:var(--c6);fill:var(--c6)}
.plot .s1 .line{stroke-dasharray:7 3}.plot .s2 .line{stroke-dasharray:2 3}
.plot .s3 .line{stroke-dasharray:9 3 2 3}.plot .s4 .line{stroke-dasharray:12 4}
.plot .s5 .line{stroke-dasharray:4 2}.plot .s6 .line{stroke-dasharray:1 2}
.plot .again .line{stroke-dasharray:14 3 3 3 3 3}
.plot .bar{fill:var(--c0)}
)";

std::string plot_svg(const Plot& plot, const std::string& id) {
    const Frame frame = make_frame(plot);
    double below = kTop + kPlotHeight + kBottom + 14;
    std::string legend = legend_svg(plot.series, below);
    const double height = legend.empty() ? kTop + kPlotHeight + kBottom : below - 8;
    std::string text = svg_head(height, id, plot.title, summary(plot));
    text += str("<text class=\"title\" x=\"8\" y=\"20\">", escaped(plot.title),
                "</text>\n<text class=\"soft\" x=\"8\" y=\"43\">", escaped(plot.y_label),
                frame.y.log ? ", logarithmic" : "", "</text>\n");
    const double right = kWidth - kRight, bottom = kTop + kPlotHeight;
    for (const Tick& tick : frame.y.ticks()) {
        const std::string at = fixed(kTop + kPlotHeight * (1 - frame.y.share(tick.value)));
        text += str("<path class=\"grid\" d=\"M", kLeft, " ", at, "H", right, "\"/><text x=\"",
                    kLeft - 6, "\" y=\"", at, "\" dy=\"4\" text-anchor=\"end\">", tick.label,
                    "</text>\n");
    }
    double free_from = 0;  // where the next label of the x axis may begin without overlap
    for (const Tick& tick : frame.x.ticks()) {
        const double x = kLeft + (right - kLeft) * frame.x.share(tick.value);
        const double half = 0.5 * kCharacter * static_cast<double>(tick.label.size());
        text += str("<path class=\"grid\" d=\"M", fixed(x), " ", kTop, "V", bottom, "\"/>");
        if (x - half < free_from || x + half > kWidth) continue;
        free_from = x + half + 6;
        text += str("<text x=\"", fixed(x), "\" y=\"", bottom + 17, "\" text-anchor=\"middle\">",
                    tick.label, "</text>\n");
    }
    text += str("<path class=\"axis\" d=\"M", kLeft, " ", kTop, "V", bottom, "H", right,
                "\"/>\n<text class=\"soft\" x=\"", right, "\" y=\"", bottom + 36,
                "\" text-anchor=\"end\">", escaped(plot.x_label),
                frame.x.log ? ", logarithmic" : "", "</text>\n");
    for (std::size_t i = 0; i < plot.series.size(); ++i)
        text += series_svg(plot.series[i], frame, i);
    return text + legend + "</svg>\n";
}

std::string bars_svg(const Bars& bars, const std::string& id) {
    constexpr double kRow = 22, kNames = 150, kNumbers = 64;
    constexpr std::size_t kLongest = 20;  // characters
    double largest = 0;
    for (const double v : bars.values)
        if (std::isfinite(v)) largest = std::max(largest, v);
    const double height = 34 + kRow * static_cast<double>(bars.values.size()) + 6;
    std::string note = str(bars.values.size(), " values", bars.unit.empty() ? "" : " in ",
                           bars.unit, ", also in the table below.");
    std::string text = svg_head(height, id, bars.title, note);
    text += str("<text class=\"title\" x=\"8\" y=\"20\">", escaped(bars.title),
                bars.unit.empty() ? "" : ", ", escaped(bars.unit), "</text>\n");
    double y = 34;
    for (std::size_t i = 0; i < bars.values.size(); ++i, y += kRow) {
        const std::string name = fitting(bars.names[i], kLongest);
        const bool known = std::isfinite(bars.values[i]);
        const double width = known && largest > 0 ? std::max(0.0, bars.values[i]) / largest *
                                                        (kWidth - kNames - kNumbers)
                                                  : 0;
        text += str("<text x=\"", kNames - 6, "\" y=\"", fixed(y + 15), "\" text-anchor=\"end\">",
                    escaped(name), "</text><rect class=\"bar\" x=\"", kNames, "\" y=\"",
                    fixed(y + 3), "\" width=\"", fixed(width), "\" height=\"", kRow - 6,
                    "\"/><text x=\"", fixed(kNames + width + 6), "\" y=\"", fixed(y + 15), "\">",
                    known ? short_number(bars.values[i]) : "\u2013", "</text>\n");
    }
    return text + "</svg>\n";
}

std::string standalone_svg(std::string svg) {
    const std::size_t end = svg.find('>') + 1;
    return svg.insert(end, str("\n<!-- ", kVersion, " --><style>", kPlotStyle, "</style>"));
}

std::string escaped(const std::string& text) {
    std::string out;
    for (const char c : text) {
        const bool control = static_cast<unsigned char>(c) < 32 || c == 127;
        out += c == '&'                 ? "&amp;"
               : c == '<'               ? "&lt;"
               : c == '>'               ? "&gt;"
               : c == '"'               ? "&quot;"
               : c == '\''              ? "&#39;"
               : c == '\t' || c == '\n' ? " "
               : control                ? "\uFFFD"
                                        : std::string(1, c);
    }
    return out;
}

std::string short_number(double value, int digits) {
    if (!std::isfinite(value)) return "\u2013";
    const bool whole = std::abs(value) >= 1e4 && std::abs(value) < 1e15;
    return whole ? fmt::format("{:.0f}", value) : fmt::format("{:.{}g}", value, digits);
}

}  // namespace tvsgs
