#include <algorithm>
#include <cmath>
#include <set>

#include "core/error.h"
#include "plan/settings.h"
#include "report/page.h"
#include "report/plot.h"
#include "report/report.h"

namespace tvsgs {
namespace {

constexpr std::size_t kMaxBars = 40;

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
        const std::string name = escaped(report_["run"]["name"].text);
        std::string text =
            str("<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta "
                "http-equiv=\"Content-Security-Policy\" content=\"",
                kViewPolicy,
                "\">\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
                "<link rel=\"icon\" href=\"data:,\">\n<title>",
                name, ": training report</title>\n<style>", kPlotStyle, kPageStyle,
                "</style>\n</head>\n<body>\n<header>\n<h1>", name, "</h1>\n<p class=\"quiet\">",
                escaped(about()), "</p>\n<nav aria-label=\"Parts of this report\"><ul>", links_,
                "</ul></nav>\n</header>\n<main>\n");
        text += body_ + "</main>\n<footer>Written by " +
                escaped(report_["run"]["version"].text_or("tvsgs")) +
                " from report.json; nothing is loaded from elsewhere.</footer>\n";
        if (view_) text += str("<script>", kOpenViewScript, "</script>\n");
        return text + "</body>\n</html>\n";
    }

private:
    std::string about() const {
        const JsonValue& run = report_["run"];
        const JsonValue& scene = report_["config"]["scene"];
        std::string text = "Training report. Scene " + run["scene"].text_or("unknown");
        if (!scene["split"].text.empty()) text += ", split " + scene["split"].text;
        if (const double n = scene["num_views"].number_or(0); n > 0)
            text += ", " + short_number(n) + " views";
        text += str(", seed ", short_number(report_["config"]["seed"].number_or(0)), ", on ",
                    run["device"].text_or("unknown"), ".");
        return text;
    }

    void heading(const std::string& id, const std::string& title) {
        links_ += str("<li><a href=\"#", id, "\">", title, "</a></li>\n");
        body_ += str("<h2 id=\"", id, "\">", title, "</h2>\n");
    }

    void paragraph(const std::string& text) { body_ += "<p>" + escaped(text) + "</p>\n"; }

    std::string figure(const Plot& plot) {
        return plot_figure(plot, str("plot", ++plots_), "report.json");
    }

    void fact(std::string& list, const char* name, const std::string& value) {
        list += str("<div><dt>", name, "</dt><dd>", escaped(value), "</dd></div>\n");
    }

    void sentences(const char* title, const std::vector<std::string>& list) {
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
        if (!v.limits.empty())
            sentences("What limits the quality", v.limits);
        else if (report_["coverage"])
            paragraph("No limit was found.");
        if (!v.next.empty()) sentences("What to photograph next", v.next);
        if (!v.left_out.empty()) sentences("Not needed for this scene", {v.left_out});
        std::vector<std::string> missing;
        for (const JsonValue& what : report_["missing"].items) missing.push_back(what.text);
        if (!missing.empty()) sentences("Missing from this report", missing);
    }

    /// The plan's decisions, in their order.
    void plan() {
        std::vector<std::vector<std::string>> rows;
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
        const auto add = [&](const char* name, const JsonValue& value, const char* unit = "",
                             int digits = 4) {
            if (value.is(JsonValue::Kind::number))
                fact(list, name, short_number(value.number, digits) + unit);
        };
        add("Iterations", s["iteration"]);
        add("Training time", s["seconds"], " s");
        add("Splats", s["gaussians"]);
        if (s["peak_bytes"])
            fact(list, "Peak memory",
                 short_number(std::round(s["peak_bytes"].number / (1 << 20))) + " MiB");
        add("PSNR, test views", s["psnr"], " dB");
        add("SSIM, test views", s["ssim"]);
        add("LPIPS, test views", report_["nvs"]["lpips"]);
        for (const char* what : {"mesh", "centres"}) {
            add(str("Chamfer, ", what).c_str(), s[what]["chamfer"]);
            for (const JsonValue& t : s[what]["thresholds"].items)
                add(str("F1 at ", short_number(t["tau"].number), ", ", what).c_str(), t["f1"], "",
                    3);
        }
        if (list.empty()) return;
        heading("overview", "Overview");
        body_ += "<dl class=\"facts\">\n" + list + "</dl>\n";
    }

    void over_time() {
        const std::vector<Plot> plots = plots_over_time(report_["evaluations"]);
        if (plots.empty()) return;
        heading("time", "Error against time");
        paragraph("Seconds of training, without evaluations.");
        body_ += "<div class=\"plots\">\n";
        for (const Plot& plot : plots) body_ += figure(plot);
        body_ += "</div>\n";
    }

    void losses() {
        const JsonValue& reports = report_["reports"];
        if (reports["iteration"].items.size() < 2) return;
        heading("losses", "Loss");
        const std::vector<double> iterations = numbers(reports["iteration"]);
        Plot plot{"Terms of the loss", "iterations", "weighted value", false, /*log_y=*/true};
        plot.series.push_back({"total", iterations, numbers(reports["loss"])});
        for (const auto& [name, values] : reports["terms"].members) {
            Series term{name, iterations, numbers(values)};
            if (std::ranges::any_of(term.y, [](double v) { return v > 0; }))
                plot.series.push_back(std::move(term));
        }
        paragraph("Measured on the training view of each reported iteration.");
        body_ += "<div class=\"plots\">\n" + figure(plot) + "</div>\n";
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
        Plot splats{"Splats", "seconds", "count"}, memory{"Memory", "seconds", "MiB of buffers"};
        splats.y_from_zero = memory.y_from_zero = true;
        splats.series = {{"splats", seconds, numbers(reports["gaussians"])}};
        memory.series = {{"in use", seconds, mebibytes("bytes")},
                         {"peak so far", seconds, mebibytes("peak_bytes")}};
        body_ += "<div class=\"plots\">\n" + figure(splats);
        body_ += figure(memory) + "</div>\n";
    }

    std::string bar_figure(const Bars& bars, const std::string& head) {
        std::vector<std::vector<std::string>> rows;
        for (std::size_t i = 0; i < bars.names.size(); ++i)
            rows.push_back({bars.names[i], short_number(bars.values[i])});
        Bars shown = bars;
        if (shown.names.size() > kMaxBars) {
            std::vector<std::size_t> order(bars.names.size());
            for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
            std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) {
                return bars.values[a] < bars.values[b];
            });
            shown.title += str(", the ", kMaxBars, " lowest of ", order.size());
            shown.names.clear(), shown.values.clear();
            for (std::size_t i = 0; i < kMaxBars; ++i)
                shown.names.push_back(bars.names[order[i]]),
                    shown.values.push_back(bars.values[order[i]]);
        }
        return str("<figure class=\"card\">\n", bars_svg(shown, str("plot", ++plots_)),
                   "<details><summary>Table: ", escaped(bars.title), "</summary>",
                   html_table(bars.title, {head, bars.unit.empty() ? "value" : bars.unit}, rows),
                   "</details></figure>\n");
    }

    void stages() {
        const auto& members = report_["stages"].members;
        if (members.empty()) return;
        heading("stages", "Time per stage");
        Bars bars{"Time per stage", "seconds", {}, {}};
        for (const auto& [name, seconds] : members)
            bars.names.push_back(name), bars.values.push_back(seconds.number_or(std::nan("")));
        body_ += "<div class=\"plots\">\n" + bar_figure(bars, "stage") + "</div>\n";
    }

    void curves() {
        std::string plots;
        for (const auto& [key, what] : {std::pair("curve", "centres"), {"mesh_curve", "mesh"}}) {
            const JsonValue& curve = report_[key];
            if (curve["tau"].items.size() < 2) continue;
            const std::vector<double> tau = numbers(curve["tau"]);
            Plot plot{str("Precision and recall of the ", what), "threshold", "share"};
            plot.y_from_zero = true;
            plot.series = {{"precision", tau, numbers(curve["precision"])},
                           {"recall", tau, numbers(curve["recall"])}};
            plots += figure(plot);
        }
        if (plots.empty()) return;
        heading("curves", "Precision and recall");
        paragraph(
            "Precision: share of the splat centres or the mesh within the threshold of the true "
            "surface. Recall: share of the true surface within the threshold of a centre or the "
            "mesh.");
        body_ += "<div class=\"plots\">\n" + plots + "</div>\n";
    }

    void views() {
        const auto& views = report_["views"].items;
        if (views.empty()) return;
        heading("views", "Test views");
        Bars bars{"PSNR of each view", "dB", {}, {}}, ssim{"SSIM of each view", "", {}, {}};
        for (const JsonValue& view : views) {
            bars.names.push_back(view["name"].text);
            bars.values.push_back(view["psnr"].number_or(std::nan("")));
            ssim.values.push_back(view["ssim"].number_or(std::nan("")));
        }
        ssim.names = bars.names;
        body_ += "<div class=\"plots\">\n" + bar_figure(bars, "view") + bar_figure(ssim, "view") +
                 "</div>\n";
        const auto& pictures = report_["pictures"].items;
        if (pictures.size() < views.size())
            paragraph(str("Pictures of ", pictures.size(), " of ", views.size(),
                          " views, lowest PSNR first."));
        for (const JsonValue& view : pictures) {
            const std::string name = view["name"].text;
            body_ += str("<section class=\"view\"><h3>", escaped(name), ": ",
                         short_number(view["psnr"].number_or(std::nan(""))), " dB, SSIM ",
                         short_number(view["ssim"].number_or(std::nan("")), 3),
                         "</h3>\n<div class=\"pictures\">\n");
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
        body_ +=
            str("<figure><img src=\"", escaped(image["src"].text), "\" width=\"",
                image["width"].number, "\" height=\"", image["height"].number, "\" alt=\"", title,
                " of view ", escaped(view), "\"><figcaption>", title, "</figcaption></figure>\n");
    }

    /// The page of tvsgs-view, loaded into an iframe on request.
    void view() {
        if (!view_) return;
        heading("view", "View in 3D");
        body_ += str("<figure class=\"viewer card\">\n<img src=\"", view_->poster,
                     "\" alt=\"The splats from the middle camera\">\n<p><button type=\"button\" "
                     "id=\"open-view\">Open the view in 3D</button></p>\n<figcaption>Splats, mesh, "
                     "cameras with photographs; colours by error if the true surface is known.");
        for (const std::string& note : view_->notes) body_ += " " + escaped(note);
        body_ +=
            str("</figcaption>\n</figure>\n<script type=\"application/json\" id=\"view-page\">",
                json_for_page(JsonValue(view_->html)), "</script>\n");
    }

    /// Numbers from the result files of `tvsgs-eval geometry|dtu|tnt`.
    void results() {
        const auto& members = report_["results"].members;
        if (members.empty()) return;
        heading("results", "Evaluations");
        for (const auto& [name, result] : members) {
            std::vector<std::vector<std::string>> rows;
            flatten("", result, rows);
            body_ += html_table(name, {"quantity", "value"}, rows);
        }
    }

    static void flatten(const std::string& prefix,
                        const JsonValue& value,
                        std::vector<std::vector<std::string>>& rows) {
        if (value.is(JsonValue::Kind::list) && value.items.size() > 12) return;  // curves
        for (const auto& [name, member] : value.members)
            flatten(prefix.empty() ? name : prefix + "." + name, member, rows);
        for (std::size_t i = 0; i < value.items.size(); ++i)
            flatten(str(prefix, "[", i, "]"), value.items[i], rows);
        if (value.is(JsonValue::Kind::number))
            rows.push_back({prefix, short_number(value.number, 6)});
        if (value.is(JsonValue::Kind::boolean))
            rows.push_back({prefix, value.number != 0 ? "true" : "false"});
        if (value.is(JsonValue::Kind::text)) rows.push_back({prefix, value.text});
    }

    void settings() {
        heading("settings", "Settings");
        paragraph("Command: " + report_["run"]["command_line"].text_or("unknown"));
        std::vector<std::vector<std::string>> rows;
        flatten("", report_["config"], rows);
        body_ +=
            "<details><summary>All keys of the configuration</summary>" +
            html_table("The resolved configuration", {"key", "value"}, rows, " class=\"words\"") +
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
