#include "pipeline/run/live_snapshots.h"

#include <chrono>
#include <filesystem>

#include "core/error.h"
#include "core/log.h"
#include "core/math/smoothing_filter.h"
#include "io/files/atomic_file.h"
#include "io/files/json_value.h"
#include "io/splats/splat_files.h"

namespace tvsgs {
namespace {

/// Applies the smoothing filter to scales and opacities, as in files.
void apply_filter(Gaussians<Cpu>& g) {
    if (g.filter.empty()) return;
    for (std::size_t i = 0; i < g.means.size(); ++i) {
        const SmoothedSplat<double> smooth =
            smoothed(vec_cast<double>(g.log_scales[i]), double(g.filter[i]));
        const double opacity = smooth.dimming / (1 + std::exp(-double(g.opacity_logits[i])));
        for (int k = 0; k < 3; ++k) g.log_scales[i][k] = float(std::log(smooth.scales[k]));
        g.opacity_logits[i] = float(std::clamp(std::log(opacity / (1 - opacity)), -30.0, 30.0));
    }
    g.filter.resize(0);
}

void write_snapshot(const std::string& folder, const std::string& state, Gaussians<Cpu>& g) {
    apply_filter(g);
    g.sh_degree = 0;
    g.sh.resize(g.means.size());  // coefficient major: keeps the base colours
    write_splat_file(folder + "/splats.spz", g, {.frame = SplatFrame::rdf});
    write_text_file(folder + "/state.json", state + "\n");
}

}  // namespace

bool LiveSnapshots::due() {
    if (!(every_ > 0) || steady_seconds() - last_ < every_) return false;
    return !writing_.valid() ||
           writing_.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
}

void LiveSnapshots::write(int iteration, int iterations, double seconds, Gaussians<Cpu>&& splats) {
    last_ = steady_seconds();
    if (splats.size() == 0) return;
    try {
        if (writing_.valid()) writing_.get();
    } catch (const std::exception& error) {
        spdlog::warn("{}; tvsgs-view gets no more snapshots of this training", error.what());
        every_ = 0;
        return;
    }
    JsonValue state;
    state.add("iteration", iteration).add("iterations", iterations).add("seconds", seconds);
    state.add("gaussians", splats.size())
        .add("origin", std::vector{origin_.x, origin_.y, origin_.z});
    written_ = true;
    writing_ = std::async(std::launch::async,
                          [folder = run_ + "/live", text = json_text(state),
                           g = std::move(splats)]() mutable { write_snapshot(folder, text, g); });
}

void LiveSnapshots::finish() {
    if (writing_.valid()) {
        try {
            writing_.get();
        } catch (const std::exception& error) {
            spdlog::warn("{}; tvsgs-view lacks the last snapshot", error.what());
        }
    }
    if (written_) remove_files();
    written_ = false;
}

void LiveSnapshots::remove_files() const {
    const std::filesystem::path folder = run_ + "/live";
    std::error_code code;
    for (const char* name : {"state.json", "splats.spz"})
        std::filesystem::remove(folder / name, code);
    if (std::filesystem::is_directory(folder, code)) std::filesystem::remove(folder, code);
}

}  // namespace tvsgs
