#include "apps/bench/stability.h"

#include <algorithm>
#include <cstdio>

#include "apps/bench/stability_measure.h"
#include "core/device/device_choice.h"
#include "io/config/config.h"
#include "io/files/atomic_file.h"
#include "report/plot.h"

namespace tvsgs {
namespace {

std::string json_of(const std::vector<StabilityCurve>& curves, const DeviceChoice& device) {
    std::string lines;
    for (const StabilityCurve& c : curves) {
        std::vector<JsonValue> points;
        for (const StabilityPoint& p : c.points)
            points.push_back(JsonValue()
                                 .add("stress", p.stress)
                                 .add("error", p.error)
                                 .add("bound", p.bound)
                                 .add("share", p.share));
        lines += json_text(JsonValue()
                               .add("bench", "stability")
                               .add("version", kVersion)
                               .add("device", device.description)
                               .add("operation", c.operation)
                               .add("stress", c.stress)
                               .add("bound", c.bound)
                               .add("guard", c.guard)
                               .add("points", points)) +
                 "\n";
    }
    return lines;
}

/// All rows on one page, three beside each other.
std::string page_of(const std::vector<StabilityCurve>& curves, const DeviceChoice& device) {
    constexpr int kColumns = 3, kWidth = 460, kHeight = 390, kTop = 30;
    const int rows = (static_cast<int>(curves.size()) + kColumns - 1) / kColumns;
    std::string page =
        str("<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"plot\" viewBox=\"0 0 ",
            kColumns * kWidth, " ", rows * kHeight + kTop,
            "\">\n<text class=\"title\" x=\"8\" y=\"20\">Error of float32 against "
            "double on ",
            escaped(device.description), "</text>\n");
    for (std::size_t i = 0; i < curves.size(); ++i) {
        const StabilityCurve& c = curves[i];
        Plot plot{c.operation, c.stress, "error", true, true, false, {}, c.guard};
        plot.series = {{"float32", {}, {}, {}, {}, true}, {"bound", {}, {}, {}, {}, false}};
        for (const StabilityPoint& p : c.points)
            for (Series& s : plot.series) {
                s.x.push_back(p.stress);
                s.y.push_back(&s == &plot.series[0] ? p.error : p.bound);
            }
        std::string svg = plot_svg(plot, str("row", i));
        const int column = static_cast<int>(i) % kColumns, row = static_cast<int>(i) / kColumns;
        svg.insert(4, str(" x=\"", column * kWidth, "\" y=\"", row * kHeight + kTop, "\" width=\"",
                          kWidth - 20, "\" height=\"", kHeight - 10, "\""));
        page += svg;
    }
    return standalone_svg(page + "</svg>\n");
}

}  // namespace

StabilityBench::StabilityBench(CLI::App& app)
    : command_(app.add_subcommand("stability", "errors of float formulas on stiff inputs")) {
    command_->add_option("--device", device_, "auto, cpu, cuda or cuda:N")->capture_default_str();
    add_output_flag(*command_, "--json", json_, "file for all curves, one line of JSON per row");
    add_output_flag(*command_, "--plot", plot_, "SVG file for all curves");
}

int StabilityBench::run() const {
    const DeviceChoice device = choose_device(device_);
    const std::vector<StabilityCurve> curves =
        on_device(device, [](auto tag) { return measure_stability(tag); });
    std::printf("float32 on %s against double\n%-44s %-52s %15s %9s %9s %6s\n",
                device.description.c_str(), "operation", "stress", "range", "error", "bound",
                "share");
    bool holds = true;
    for (const StabilityCurve& c : curves) {
        double error = 0, bound = 0;
        for (const StabilityPoint& p : c.points)
            error = std::max(error, p.error), bound = std::max(bound, p.bound);
        const StabilityPoint& worst = c.worst();
        std::printf("%-44s %-52s %7.0e-%7.0e %9.1e %9.1e %6.2f%s\n", c.operation.c_str(),
                    c.stress.c_str(), c.points.front().stress, c.points.back().stress, error, bound,
                    worst.share, worst.share <= 1 ? "" : "  BEYOND ITS BOUND");
        holds = holds && worst.share <= 1;
    }
    if (!json_.empty()) write_text_file(json_, json_of(curves, device));
    if (!plot_.empty()) write_text_file(plot_, page_of(curves, device));
    return static_cast<int>(holds ? ExitCode::done : ExitCode::numerical);
}

}  // namespace tvsgs
