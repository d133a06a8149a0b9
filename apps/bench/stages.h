// tvsgs-bench stages: times of the parts of a training iteration on fixed synthetic views.
#pragma once

#include <string>
#include <vector>

#include "apps/common/command_line.h"
#include "render/backbone.h"

namespace tvsgs {

/// Splats as one view sees them.
struct StageCase {
    enum class Kind { trained, in_view, one_tile, huge, needles, empty, one };

    std::string name;
    Kind kind;
    int splats, width, height;
    double size_px;        // median deviation of a splat in the image
    bool sorted = false;   // by place, as training keeps its splats; else in random order
    bool surface = false;  // on a smooth relief, flat along it, as several views have to agree on
};

/// w540, w1200: half of the splats in view, of some pixels, as on a trained surface, in random
/// order in memory; with _morton: in the order in which training keeps them; c256: a small one for
/// CPUs, all in view and as many over each pixel; and worst cases.
const std::vector<StageCase>& stage_cases();

/// A pure function of its arguments; SH degree 3.
Gaussians<Cpu> make_stage_splats(const StageCase& c);
Camera stage_camera(const StageCase& c);
/// Of a second view, 8 degrees around what the first one looks at.
Camera stage_other_view(const StageCase& c);

class StagesBench {
public:
    /// Adds the subcommand; its flags are read into this object.
    explicit StagesBench(CLI::App& app);

    bool parsed() const { return command_->parsed(); }
    /// Exit code; one line of JSON per case on standard output, tables on standard error.
    int run() const;
    bool quiet() const { return quiet_; }

private:
    CLI::App* command_;
    std::vector<std::string> cases_, configs_, settings_;
    std::string device_ = "auto", channels_ = "color", out_;
    int repetitions_ = 50, warm_up_ = 20;
    double scale_ = 1, splats_scale_ = 1, pixels_scale_ = 1;
    bool quiet_ = false;
};

}  // namespace tvsgs
