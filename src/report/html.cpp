#include "report/html.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/error.h"
#include "core/log.h"
#include "plan/settings.h"
#include "report/figures.h"
#include "report/plot.h"
#include "report/verdict.h"

namespace tvsgs {
namespace {

constexpr std::size_t kMaxBars = 40;

/// Replaces the picture of the 3D view by the view in an iframe: a document of its own, so that its
/// keys and styles do not affect the report. Without scripts the picture stays.
constexpr const char* kOpenViewScript = R"JS(
const open = document.getElementById('open-view');
open.addEventListener('click', () => {
  const frame = document.createElement('iframe'), figure = open.closest('figure');
  frame.title = 'View in 3D';
  frame.srcdoc = JSON.parse(document.getElementById('view-page').textContent);
  figure.querySelector('img').replaceWith(frame);
  open.remove();
  frame.focus();
});
)JS";

class Page {
public:
    Page(const JsonValue& report, const std::optional<ViewPage>& view)
        : report_(report), view_(view) {}

    std::string html() {
        verdict();
        overview();
        over_time();
        view();
        plan();
        losses();
        sizes();
        stages();
        curves();
        views();
        results();
        settings();
        return fmt::format(
            R"(<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>{name}: training report</title>
<style>{plot_style}{page_style}</style>
</head>
<body>
<header>
<h1>{name}</h1>
<p class="quiet">{about}</p>
<nav aria-label="Parts of this report"><ul>{links}</ul></nav>
</header>
<main>
{body}</main>
<footer>Written by {version} from report.json; nothing is loaded from elsewhere.</footer>
{script}</body>
</html>
)",
            fmt::arg("policy", kViewPolicy), fmt::arg("name", escaped(report_["run"]["name"].text)),
            fmt::arg("plot_style", kPlotStyle), fmt::arg("page_style", kPageStyle),
            fmt::arg("about", escaped(about())), fmt::arg("links", links_), fmt::arg("body", body_),
            fmt::arg("version", escaped(report_["run"]["version"].text_or("tvsgs"))),
            fmt::arg("script", view_ ? str("<script>", kOpenViewScript, "</script>\n") : ""));
    }

private:
    std::string about() const {
        const JsonValue& run = report_["run"];
        const JsonValue& scene = report_["config"]["scene"];
        std::string text = "Training report. Scene " + run["scene"].text_or("unknown");
        if (!scene["split"].text.empty()) text += ", split " + scene["split"].text;
        if (const double n = scene["num_views"].number_or(0); n > 0)
            text += ", " + short_number(n) + " views";
        return str(text, ", seed ", short_number(report_["config"]["seed"].number_or(0)), ", on ",
                   run["device"].text_or("unknown"), ".");
    }

    void heading(const std::string& id, const std::string& title) {
        links_ += fmt::format("<li><a href=\"#{}\">{}</a></li>\n", id, title);
        body_ += fmt::format("<h2 id=\"{}\">{}</h2>\n", id, title);
    }

    void paragraph(const std::string& text) { body_ += "<p>" + escaped(text) + "</p>\n"; }

    std::string figure(const Plot& plot) { return plot_figure(plot, str("plot", ++plots_)); }

    void plots(const std::string& figures) {
        body_ += "<div class=\"plots\">\n" + figures + "</div>\n";
    }

    void sentences(const char* title, const std::vector<std::string>& list) {
        if (list.empty()) return;
        body_ += str("<h3>", title, "</h3>\n<ul>\n");
        for (const std::string& one : list) body_ += "<li>" + escaped(one) + "</li>\n";
        body_ += "</ul>\n";
    }

    void verdict() {
        heading("verdict", "Verdict");
        if (report_["summary"]["event"].text != "done")
            body_ += "<p class=\"notice\">This run has not finished.</p>\n";
        const RunVerdict v = verdict_of(report_);
        body_ += str("<p class=\"lead\">", escaped(v.what), "</p>\n<p class=\"lead\">");
        if (!v.level.empty())
            body_ += str("<strong class=\"level\">Quality: ", v.level, ".</strong> ");
        body_ += escaped(v.quality) + "</p>\n";
        sentences("What limits the quality", v.limits);
        if (v.limits.empty() && report_["coverage"]) paragraph("No limit was found.");
        sentences("What to photograph next", v.next);
        if (!v.left_out.empty()) sentences("Not needed for this scene", {v.left_out});
        std::vector<std::string> missing;
        for (const JsonValue& what : report_["missing"].items) missing.push_back(what.text);
        sentences("Missing from this report", missing);
    }

    /// The plan's decisions, in their order.
    void plan() {
        Rows rows;
        std::set<std::string> stated;
        for (const JsonValue& d : report_["plan"].items) {
            std::string reason = unstated_parts(d["reason"].text, stated);
            for (const auto& [key, kept] : d["kept"].members)
                reason += str(" [", key, " stays ", kept.text, "]");
            rows.push_back({d["name"].text, d["choice"].text, reason});
        }
        if (rows.empty()) return;
        heading("plan", "Plan");
        body_ += html_table("Decisions for this scene; a reason that several share is stated once",
                            {"decision", "choice", "reason"}, rows, " class=\"plan\"");
    }

    void overview() {
        const JsonValue& s = report_["summary"];
        std::string list;
        const auto add = [&](const std::string& name, const JsonValue& value, const char* unit = "",
                             int digits = 4) {
            if (value.is(JsonValue::Kind::number))
                list += str("<div><dt>", name, "</dt><dd>", short_number(value.number, digits),
                            unit, "</dd></div>\n");
        };
        add("Iterations", s["iteration"]);
        add("Training time", s["seconds"], " s");
        add("Splats", s["gaussians"]);
        if (s["peak_bytes"])
            add("Peak memory", std::round(s["peak_bytes"].number / (1 << 20)), " MiB");
        add("PSNR, test views", s["psnr"], " dB");
        add("SSIM, test views", s["ssim"]);
        add("LPIPS, test views", report_["nvs"]["lpips"]);
        for (const char* what : {"mesh", "centres"}) {
            add(str("Chamfer, ", what), s[what]["chamfer"]);
            for (const JsonValue& t : s[what]["thresholds"].items)
                add(str("F1 at ", short_number(t["tau"].number), ", ", what), t["f1"], "", 3);
        }
        if (list.empty()) return;
        heading("overview", "Overview");
        body_ += "<dl class=\"facts\">\n" + list + "</dl>\n";
    }

    void over_time() {
        std::string figures;
        const std::vector<Plot> all = plots_over_time(report_["evaluations"]);
        if (all.empty()) return;
        heading("time", "Error against time");
        paragraph("Seconds of training, without evaluations.");
        for (const Plot& plot : all) figures += figure(plot);
        plots(figures);
    }

    void losses() {
        const JsonValue& reports = report_["reports"];
        if (reports["iteration"].items.size() < 2) return;
        heading("losses", "Loss");
        const std::vector<double> iterations = numbers(reports["iteration"]);
        Plot plot{"Terms of the loss", "iterations", "weighted value"};
        plot.log_y = true;
        plot.series.push_back({"total", iterations, numbers(reports["loss"])});
        for (const auto& [name, values] : reports["terms"].members) {
            const std::vector<double> term = numbers(values);
            if (std::any_of(term.begin(), term.end(), [](double v) { return v > 0; }))
                plot.series.push_back({name, iterations, term});
        }
        paragraph("Measured on the training view of each reported iteration.");
        plots(figure(plot));
    }

    void sizes() {
        const JsonValue& reports = report_["reports"];
        if (reports["iteration"].items.size() < 2) return;
        heading("size", "Splats and memory");
        const std::vector<double> seconds = numbers(reports["seconds"]);
        const auto mebibytes = [&](const char* key) {
            std::vector<double> values = numbers(reports[key]);
            for (double& v : values) v /= 1 << 20;
            return values;
        };
        const std::string splats = figure(from_zero(
            "Splats", "seconds", "count", {{"splats", seconds, numbers(reports["gaussians"])}}));
        plots(splats + figure(from_zero("Memory", "seconds", "MiB of buffers",
                                        {{"in use", seconds, mebibytes("bytes")},
                                         {"peak so far", seconds, mebibytes("peak_bytes")}})));
    }

    static Plot from_zero(const std::string& title,
                          const char* x,
                          const char* y,
                          std::vector<Series> series) {
        return {title, x, y, std::move(series), false, false, true};
    }

    std::string bar_figure(Bars bars, const std::string& head) {
        Rows rows;
        for (const auto& [name, value] : bars.rows) rows.push_back({name, short_number(value)});
        const std::string table = fmt::format(
            "<details><summary>Table: {}</summary>{}</details>", escaped(bars.title),
            html_table(bars.title, {head, bars.unit.empty() ? "value" : bars.unit}, rows));
        if (bars.rows.size() > kMaxBars) {
            std::stable_sort(bars.rows.begin(), bars.rows.end(),
                             [](const auto& a, const auto& b) { return a.second < b.second; });
            bars.title += str(", the ", kMaxBars, " lowest of ", bars.rows.size());
            bars.rows.resize(kMaxBars);
        }
        return fmt::format("<figure class=\"card\">\n{}{}</figure>\n",
                           bars_svg(bars, str("plot", ++plots_)), table);
    }

    void stages() {
        Bars bars{"Time per stage", "seconds"};
        for (const auto& [name, seconds] : report_["stages"].members)
            bars.rows.emplace_back(name, seconds.number_or(std::nan("")));
        if (bars.rows.empty()) return;
        heading("stages", "Time per stage");
        plots(bar_figure(bars, "stage"));
    }

    void curves() {
        std::string figures;
        for (const auto& [key, what] : {std::pair("curve", "centres"), {"mesh_curve", "mesh"}}) {
            const JsonValue& curve = report_[key];
            if (curve["tau"].items.size() < 2) continue;
            const std::vector<double> tau = numbers(curve["tau"]);
            figures +=
                figure(from_zero(str("Precision and recall of the ", what), "threshold", "share",
                                 {{"precision", tau, numbers(curve["precision"])},
                                  {"recall", tau, numbers(curve["recall"])}}));
        }
        if (figures.empty()) return;
        heading("curves", "Precision and recall");
        paragraph(
            "Precision: share of the splat centres or the mesh within the threshold of the true "
            "surface. Recall: share of the true surface within the threshold of a centre or the "
            "mesh.");
        plots(figures);
    }

    void views() {
        const auto& views = report_["views"].items;
        if (views.empty()) return;
        heading("views", "Test views");
        Bars psnr{"PSNR of each view", "dB"}, ssim{"SSIM of each view", ""};
        for (const JsonValue& view : views) {
            psnr.rows.emplace_back(view["name"].text, view["psnr"].number_or(std::nan("")));
            ssim.rows.emplace_back(view["name"].text, view["ssim"].number_or(std::nan("")));
        }
        const std::string first = bar_figure(psnr, "view");
        plots(first + bar_figure(ssim, "view"));
        const auto& pictures = report_["pictures"].items;
        if (pictures.size() < views.size())
            paragraph(str("Pictures of ", pictures.size(), " of ", views.size(),
                          " views, lowest PSNR first."));
        for (const JsonValue& view : pictures) {
            const std::string name = escaped(view["name"].text);
            body_ += fmt::format(
                "<section class=\"view\"><h3>{}: {} dB, SSIM {}</h3>\n<div class=\"pictures\">\n",
                name, short_number(view["psnr"].number_or(std::nan(""))),
                short_number(view["ssim"].number_or(std::nan("")), 3));
            for (const auto& [key, title] : {std::pair("photo", "Photograph"),
                                             {"render", "Render"},
                                             {"difference", "Difference"},
                                             {"normal", "Normals"},
                                             {"depth", "Depth"}})
                picture(view[key], title, name);
            body_ += "</div></section>\n";
        }
        if (!pictures.empty())
            paragraph(
                "Difference: dark is 0, bright is a quarter of the range or more. Normals: blue "
                "faces the camera, red right, green up. Depth: near is bright.");
    }

    void picture(const JsonValue& image, const char* title, const std::string& view) {
        // Accept only data URIs: a file edited by others must not load anything else.
        if (!image || !image["src"].text.starts_with("data:image/")) return;
        body_ += fmt::format(
            R"(<figure><img src="{0}" width="{1}" height="{2}" alt="{3} of view {4}">)"
            "<figcaption>{3}</figcaption></figure>\n",
            escaped(image["src"].text), image["width"].number, image["height"].number, title, view);
    }

    /// The page of tvsgs-view, loaded into an iframe on request.
    void view() {
        if (!view_) return;
        heading("view", "View in 3D");
        std::string notes;
        for (const std::string& note : view_->notes) notes += " " + escaped(note);
        body_ += fmt::format(
            R"(<figure class="viewer card">
<img src="{}" alt="The splats from the middle camera">
<p><button type="button" id="open-view">Open the view in 3D</button></p>
<figcaption>Splats, mesh, cameras with photographs; colours by error if the true surface is known.{}</figcaption>
</figure>
<script type="application/json" id="view-page">{}</script>
)",
            view_->poster, notes, json_for_page(JsonValue(view_->html)));
    }

    /// Numbers from the result files of `tvsgs-eval geometry|dtu|tnt`.
    void results() {
        const auto& members = report_["results"].members;
        if (members.empty()) return;
        heading("results", "Evaluations");
        for (const auto& [name, result] : members)
            body_ += html_table(name, {"quantity", "value"}, flat(result));
    }

    static Rows flat(const JsonValue& value, const std::string& prefix = "") {
        if (value.is(JsonValue::Kind::list) && value.items.size() > 12) return {};  // curves
        if (value.is(JsonValue::Kind::number)) return {{prefix, short_number(value.number, 6)}};
        if (value.is(JsonValue::Kind::boolean))
            return {{prefix, value.number != 0 ? "true" : "false"}};
        if (value.is(JsonValue::Kind::text)) return {{prefix, value.text}};
        Rows rows;
        const auto append = [&](const Rows& more) {
            rows.insert(rows.end(), more.begin(), more.end());
        };
        for (const auto& [name, member] : value.members)
            append(flat(member, prefix.empty() ? name : prefix + "." + name));
        for (std::size_t i = 0; i < value.items.size(); ++i)
            append(flat(value.items[i], str(prefix, "[", i, "]")));
        return rows;
    }

    void settings() {
        heading("settings", "Settings");
        paragraph("Command: " + report_["run"]["command_line"].text_or("unknown"));
        body_ += "<details><summary>All keys of the configuration</summary>" +
                 html_table("The resolved configuration", {"key", "value"}, flat(report_["config"]),
                            " class=\"words\"") +
                 "</details>\n";
    }

    const JsonValue& report_;
    const std::optional<ViewPage>& view_;
    std::string links_, body_;
    int plots_ = 0;
};

}  // namespace

std::string report_html(const JsonValue& report, const std::optional<ViewPage>& view) {
    return Page(report, view).html();
}

}  // namespace tvsgs
