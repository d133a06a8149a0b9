#include "report/table.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/version.h"
#include "io/files/read_file.h"
#include "report/plot.h"

namespace tvsgs {
namespace {

using Metrics = std::map<std::string, double>;

void add_number(Metrics& metrics, const std::string& name, const JsonValue& value) {
    if (value.is(JsonValue::Kind::number)) metrics[name] = value.number;
}

/// Reads the layout of `tvsgs-eval geometry`, dtu and tnt.
void add_geometry(Metrics& metrics, const std::string& source, const JsonValue& result) {
    for (const char* key : {"accuracy", "completeness", "chamfer"})
        add_number(metrics, str(key, " (", source, ")"), result[key]);
    for (const char* key : {"precision", "recall", "f1"}) {
        for (const JsonValue& at : result["thresholds"].items)
            add_number(metrics, str(key, "@", short_number(at["tau"].number), " (", source, ")"),
                       at[key]);
        // For tnt: at the threshold of the scene, so that scenes can be averaged.
        add_number(metrics, str(key, " (", source, ")"), result[key]);
    }
}

/// Distinct values in order of appearance.
std::vector<std::string> distinct(const std::vector<TableRun>& runs, std::string TableRun::*part) {
    std::vector<std::string> names;
    for (const TableRun& run : runs)
        if (std::ranges::find(names, run.*part) == names.end()) names.push_back(run.*part);
    return names;
}

/// Escapes characters that would end a cell or be read as markup in Markdown.
std::string in_cell(const std::string& text) {
    std::string out;
    for (const char c : escaped(text)) {
        if (c == '|' || c == '*' || c == '_' || c == '`' || c == '[' || c == '\\') out += '\\';
        out += c;
    }
    return out;
}

std::string cell_text(const Cell& cell, int digits) {
    if (cell.count == 0) return "\u2013";
    std::string text = short_number(cell.mean, digits);
    if (cell.count > 1) text += " \u00b1 " + short_number(cell.deviation, 2);
    return text;
}

struct Column {
    std::string head, metric;
    int better = 0;  // +1: higher is better, -1: lower is better, 0: neither
    int digits = 4;
    std::string scene{};  // empty: the mean over all scenes
};

class Tables {
public:
    Tables(const std::vector<TableRun>& runs, const std::vector<PublishedFigure>& published)
        : scenes_(distinct(runs, &TableRun::scene)),
          configurations_(distinct(runs, &TableRun::configuration)) {
        for (const TableRun& run : runs)
            for (const auto& [name, value] : metrics_of(run.report)) {
                values_[{run.scene, run.configuration, name}].push_back(value);
                known_.insert(name);
            }
        for (const PublishedFigure& figure : published) {
            const std::set<std::string> ours(scenes_.begin(), scenes_.end()),
                theirs(figure.scenes.begin(), figure.scenes.end());
            const bool mean = theirs == ours && ours.size() > 1;
            if (!mean && !(theirs.size() == 1 && ours.count(figure.scenes[0]))) continue;
            const std::string row = str(figure.method, " (", figure.source, ")");
            published_[{mean ? "" : figure.scenes[0], row, figure.metric}] = figure.value;
            if (std::ranges::find(published_rows_, row) == published_rows_.end())
                published_rows_.push_back(row);
        }
    }

    std::string markdown() const {
        std::string text;
        for (const std::string& source : sources("chamfer"))
            text += table("Chamfer distance" + source, "scene units",
                          per_scene({{"", "chamfer" + source, -1, 4}}));
        const auto add_scores = [&](const std::string& title, const std::string& suffix) {
            text += table("Precision, recall and F1 at " + title, "",
                          per_scene({{"P", "precision" + suffix, 1, 3},
                                     {"R", "recall" + suffix, 1, 3},
                                     {"F1", "f1" + suffix, 1, 3}}));
        };
        for (const std::string& at : sources("f1@")) add_scores(at, "@" + at);
        for (const std::string& source : sources("f1 "))
            add_scores("the scene's threshold " + source, " " + source);
        for (const char* masked : {"", "_masked"})
            text += table(*masked ? "Novel views, object only" : "Novel views", "",
                          per_scene({{"PSNR", str("psnr", masked), 1, 4},
                                     {"SSIM", str("ssim", masked), 1, 3},
                                     {"LPIPS", str("lpips", masked), -1, 3}}));
        text += table(
            "Run time and memory", "",
            per_scene(
                {{"s", "seconds", -1, 4}, {"MiB", "peak MiB", -1, 4}, {"splats", "splats", 0, 4}}));
        if (configurations_.size() > 1) text += table("Ablation", "means over the scenes", means());
        return text;
    }

private:
    /// Suffixes of the metric names with this prefix: " (centres)", "0.02 (centres)".
    std::vector<std::string> sources(const std::string& prefix) const {
        std::vector<std::string> found;
        for (const std::string& name : known_)
            if (name.starts_with(prefix)) found.push_back(name.substr(prefix.size()));
        return found;
    }

    /// These columns for each scene, and for the mean over all scenes.
    std::vector<Column> per_scene(const std::vector<Column>& parts) const {
        std::vector<Column> columns;
        const auto add = [&](const std::string& head, const std::string& scene) {
            for (Column part : parts) {
                part.head = head + (part.head.empty() ? "" : ": " + part.head);
                part.scene = scene;
                columns.push_back(std::move(part));
            }
        };
        for (const std::string& scene : scenes_) add(scene, scene);
        if (scenes_.size() > 1) add("mean", "");
        return columns;
    }

    std::vector<Column> means() const {
        std::vector<Column> columns;
        for (const std::string& name : known_) {
            const bool quality = name.starts_with("f1") || name == "psnr" || name == "ssim";
            if (quality || name.starts_with("chamfer") || name == "lpips" || name == "seconds" ||
                name == "peak MiB")
                columns.push_back({name, name, quality ? 1 : -1, 4});
        }
        return columns;
    }

    /// The mean over the scenes exists where each scene has a value. Its deviation assumes seeds
    /// that are independent between scenes.
    Cell cell(const std::string& configuration, const Column& column) const {
        if (!column.scene.empty()) {
            const auto found = values_.find({column.scene, configuration, column.metric});
            return found == values_.end() ? Cell{} : cell_of(found->second);
        }
        Cell sum;
        for (const std::string& scene : scenes_) {
            const auto found = values_.find({scene, configuration, column.metric});
            if (found == values_.end()) return {};
            const Cell one = cell_of(found->second);
            sum.mean += one.mean;
            sum.deviation += one.deviation * one.deviation;
            sum.count = sum.count == 0 ? one.count : std::min(sum.count, one.count);
        }
        const auto n = static_cast<double>(scenes_.size());
        return {sum.mean / n, std::sqrt(sum.deviation) / n, sum.count};
    }

    /// Skips columns without values; empty if no columns remain.
    std::string table(const std::string& title,
                      const std::string& unit,
                      std::vector<Column> columns) const {
        std::erase_if(columns, [&](const Column& c) {
            return std::ranges::none_of(
                configurations_, [&](const std::string& name) { return cell(name, c).count > 0; });
        });
        if (columns.empty()) return "";
        std::string head = "| configuration |", rule = "| --- |";
        for (const Column& c : columns) head += " " + in_cell(c.head) + " |", rule += " ---: |";
        std::string text = str("## ", in_cell(title), unit.empty() ? "" : ", ", unit, "\n\n", head,
                               "\n", rule, "\n");
        for (const std::string& name : configurations_) {
            text += "| " + in_cell(name) + " |";
            for (const Column& c : columns) {
                const Cell own = cell(name, c);
                const std::string shown = cell_text(own, c.digits);
                text += is_best(own, c) ? " **" + shown + "** |" : " " + shown + " |";
            }
            text += "\n";
        }
        for (const std::string& row : published_rows_) {
            std::string cells;
            bool any = false;
            for (const Column& c : columns) {
                const auto found = published_.find({c.scene, row, c.metric});
                any |= found != published_.end();
                cells += found == published_.end()
                             ? " \u2013 |"
                             : " " + short_number(found->second, c.digits) + " |";
            }
            if (any) text += "| *" + in_cell(row) + "* |" + cells + "\n";
        }
        return text + "\n";
    }

    bool is_best(const Cell& own, const Column& column) const {
        if (column.better == 0 || own.count == 0 || configurations_.size() < 2) return false;
        return std::ranges::all_of(configurations_, [&](const auto& name) {
            const Cell other = cell(name, column);
            return other.count == 0 || column.better * (own.mean - other.mean) >= 0;
        });
    }

    std::vector<std::string> scenes_, configurations_;
    using Key = std::tuple<std::string, std::string, std::string>;  // scene, row, metric
    std::map<Key, std::vector<double>> values_;
    std::map<Key, double> published_;  // scene empty: the mean
    std::vector<std::string> published_rows_;
    std::set<std::string> known_;
};

/// One metric of a run's evaluations over seconds.
struct Trace {
    std::vector<double> seconds, values;

    /// Linear in the logarithm of time; constant beyond the ends.
    double at(double t) const {
        const auto next = std::ranges::lower_bound(seconds, t);
        if (next == seconds.begin()) return values.front();
        if (next == seconds.end()) return values.back();
        const auto i = static_cast<std::size_t>(next - seconds.begin());
        const double share = std::log(t / seconds[i - 1]) / std::log(seconds[i] / seconds[i - 1]);
        return values[i - 1] + share * (values[i] - values[i - 1]);
    }
};

struct Quality {
    const char *name, *source, *title, *unit;  // source: a part of an evaluation, or empty
    bool log_y;
};
constexpr Quality kQualities[] = {
    {"chamfer", "centres", "Chamfer of the centres", "scene units", true},
    {"f1", "centres", "F1 of the centres", "share", false},
    {"chamfer", "mesh", "Chamfer of the mesh", "scene units", true},
    {"f1", "mesh", "F1 of the mesh", "share", false},
    {"psnr", "", "PSNR of the test views", "dB", false},
    {"ssim", "", "SSIM of the test views", "1 is equal", false}};

const JsonValue& part_of(const JsonValue& evaluation, const Quality& quality) {
    return *quality.source ? evaluation[quality.source] : evaluation;
}

/// Thresholds at which a run has that metric; a single 0 for a metric without thresholds.
std::set<double> thresholds_of(const JsonValue& report, const Quality& quality) {
    if (std::string_view(quality.name) != "f1") return {0};
    std::set<double> found;
    for (const JsonValue& evaluation : report["evaluations"].items)
        for (const JsonValue& at : part_of(evaluation, quality)["thresholds"].items)
            found.insert(at["tau"].number);
    return found;
}

Trace trace_of(const JsonValue& report, const Quality& quality, double threshold) {
    Trace trace;
    for (const JsonValue& evaluation : report["evaluations"].items) {
        const JsonValue* part = &part_of(evaluation, quality);
        for (const JsonValue& at : (*part)["thresholds"].items)
            if (threshold > 0 && at["tau"].number == threshold) part = &at;
        const JsonValue& value = (*part)[quality.name];
        const double t = evaluation["seconds"].number_or(0);
        if (!value.is(JsonValue::Kind::number) || !(t > 0) ||
            (!trace.seconds.empty() && t <= trace.seconds.back()))
            continue;
        trace.seconds.push_back(t);
        trace.values.push_back(value.number);
    }
    return trace;
}

Series overlay(const std::string& name, const std::vector<Trace>& seeds) {
    Series series{.name = name, .x = seeds.front().seconds, .marks = true};
    for (const double t : series.x) {
        double sum = 0, low = INFINITY, high = -INFINITY;
        for (const Trace& seed : seeds) {
            const double v = seed.at(t);
            sum += v, low = std::min(low, v), high = std::max(high, v);
        }
        series.y.push_back(sum / static_cast<double>(seeds.size()));
        if (seeds.size() > 1) series.low.push_back(low), series.high.push_back(high);
    }
    return series;
}

std::string file_name(const std::string& text) {
    std::string out;
    for (const char c : lower_case(text)) {
        if ((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-')
            out += c;
        else if (!out.ends_with('_'))
            out += '_';
    }
    return out;
}

std::string quoted(const std::string& text) {
    std::string out = "\"";
    for (const char c : text) out += c == '"' ? "\"\"" : std::string(1, c);
    return out + "\"";
}

/// Returns false when no run has several evaluations.
bool overlay_plot(const std::vector<TableRun>& runs,
                  const std::string& scene,
                  const Quality& quality,
                  double threshold,
                  OverlayPlot& out) {
    const std::string at = threshold > 0 ? short_number(threshold) : "";
    Plot plot{str(quality.title, at.empty() ? "" : " at " + at, ", ", scene), "seconds",
              quality.unit, /*log_x=*/true, quality.log_y};
    bool over_time = false;
    for (const std::string& configuration : distinct(runs, &TableRun::configuration)) {
        std::vector<Trace> seeds;
        for (const TableRun& run : runs)
            if (run.scene == scene && run.configuration == configuration)
                seeds.push_back(trace_of(run.report, quality, threshold));
        std::erase_if(seeds, [](const Trace& t) { return t.seconds.empty(); });
        if (seeds.empty()) continue;
        over_time |= seeds.front().seconds.size() > 1;
        plot.series.push_back(overlay(configuration, seeds));
        if (seeds.size() > 1)
            plot.note = "Means over seeds; bands show the lowest and the highest.";
    }
    const std::string name = file_name(str(scene, "_", quality.name, *quality.source ? "_" : "",
                                           quality.source, at.empty() ? "" : "_" + at));
    if (over_time) out = {name, plot.title, standalone_svg(plot_svg(plot, name))};
    return over_time;
}

}  // namespace

std::map<std::string, double> metrics_of(const JsonValue& report) {
    Metrics metrics;
    const JsonValue& summary = report["summary"];
    for (const char* key : {"psnr", "ssim", "seconds"}) add_number(metrics, key, summary[key]);
    add_number(metrics, "splats", summary["gaussians"]);
    if (summary["peak_bytes"])
        metrics["peak MiB"] = std::round(summary["peak_bytes"].number_or(0) / (1 << 20));
    for (const auto& [name, value] : report["nvs"].members)
        if (name.starts_with("ssim_") || name.starts_with("psnr_") || name.starts_with("lpips"))
            add_number(metrics, name, value);
    for (const char* what : {"centres", "mesh"}) add_geometry(metrics, what, summary[what]);
    for (const auto& [name, result] : report["results"].members)
        add_geometry(metrics, name, result);
    return metrics;
}

Cell cell_of(const std::vector<double>& values) {
    Cell cell{0, 0, static_cast<int>(values.size())};
    if (values.empty()) return cell;
    for (const double v : values) cell.mean += v / cell.count;
    for (const double v : values) cell.deviation += (v - cell.mean) * (v - cell.mean);
    cell.deviation = cell.count > 1 ? std::sqrt(cell.deviation / (cell.count - 1)) : 0;
    return cell;
}

std::vector<PublishedFigure> parse_published(const JsonValue& file, const std::string& where) {
    std::vector<PublishedFigure> figures;
    for (const JsonValue& entry : file["figures"].items) {
        PublishedFigure figure{entry["method"].text,
                               entry["source"].text,
                               {},
                               entry["metric"].text,
                               entry["value"].number_or(std::nan(""))};
        const JsonValue& scenes = entry["set"] ? file["sets"][entry["set"].text] : entry["scenes"];
        for (const JsonValue& scene : scenes.items)
            figure.scenes.push_back(scene.text + entry["with"].text);
        if (figure.method.empty() || !file["sources"][figure.source] || figure.scenes.empty() ||
            figure.metric.empty() || !std::isfinite(figure.value))
            throw input_error(
                where, ": figure ", figures.size() + 1,
                ": expected method, source (of 'sources'), set (of 'sets') or scenes, "
                "metric and value");
        figures.push_back(std::move(figure));
    }
    if (figures.empty())
        throw input_error(where, ": no list 'figures'; see docs/published_figures.json");
    return figures;
}

std::string tables_markdown(const std::vector<TableRun>& runs,
                            const std::vector<PublishedFigure>& published) {
    return Tables(runs, published).markdown();
}

std::string tables_csv(const std::vector<TableRun>& runs) {
    std::string text = "scene,configuration,seed,metric,value,version\n";
    for (const TableRun& run : runs)
        for (const auto& [name, value] : metrics_of(run.report))
            text += str(quoted(run.scene), ",", quoted(run.configuration), ",",
                        short_number(run.seed, 15), ",", quoted(name), ",", short_number(value, 9),
                        ",", kVersion, "\n");
    return text;
}

std::vector<OverlayPlot> overlay_plots(const std::vector<TableRun>& runs) {
    std::vector<OverlayPlot> plots;
    for (const std::string& scene : distinct(runs, &TableRun::scene))
        for (const Quality& quality : kQualities) {
            std::set<double> thresholds;
            for (const TableRun& run : runs)
                if (run.scene == scene) thresholds.merge(thresholds_of(run.report, quality));
            for (const double threshold : thresholds)
                if (OverlayPlot plot; overlay_plot(runs, scene, quality, threshold, plot))
                    plots.push_back(std::move(plot));
        }
    return plots;
}

}  // namespace tvsgs
