#include "optim/loop/train_loop.h"

namespace tvsgs {

int iterations_done(const State& state) {
    int done = 0;
    StateVisitor<Cpu>(state).value("iterations", done);
    return done;
}

void check_start(const State& start, const TrainOptions& o) {
    int degree = 0;
    StateVisitor<Cpu>(start).value("sh_degree", degree);
    if (degree != o.model.sh_degree)
        throw Error(ExitCode::usage, "model.sh_degree = ", o.model.sh_degree,
                    ": the checkpoint has ", degree, ", which cannot change; set it to that");
    if (start.find("cameras.numbers") != nullptr && !o.cameras.refine)
        throw Error(ExitCode::usage,
                    "cameras.refine = false: the checkpoint has refined poses; set it to true");
    const StateArray* const open = start.find("densify.open");
    if (grows_in_gaps_only(o.densify) && (open == nullptr || open->count() == 0))
        throw Error(ExitCode::usage,
                    "densify.growth_in_gaps_only = ", o.densify.growth_in_gaps_only,
                    ": the run began without this key; set it to 0");
}

void check_cameras(const TrainOptions& options, bool has_camera_gradient) {
    if (!options.cameras.refine) return;
    if (!has_camera_gradient)
        throw Error(ExitCode::usage, "cameras.refine is true, but backbone '", options.backbone,
                    "' has no camera gradients; set it to false, or choose another backbone");
    if (!(options.loss.photometric.weight > 0))
        throw Error(ExitCode::usage,
                    "cameras.refine needs loss.photometric.weight above 0; set it, or set "
                    "cameras.refine to false");
}

void check_support(const TrainOptions& options, const BackboneTraits& backbone, bool before_plan) {
    const bool parts = options.loss.photometric.geometry < 1;
    if (parts && !backbone.parts_colors)
        throw Error(ExitCode::usage, "loss.photometric.geometry is below 1, but backbone '",
                    options.backbone,
                    "' cannot part the gradients of colours from the others; set it to 1, or "
                    "choose another backbone");
    // The gradient of a camera is that of the splats, so it would have the share as well.
    if (parts && options.cameras.refine)
        throw Error(ExitCode::usage,
                    "loss.photometric.geometry below 1 and cameras.refine exclude each other");
    if ((parts || options.lr.supported > 0) && !options.init.support && !before_plan)
        throw Error(ExitCode::usage,
                    "loss.photometric.geometry below 1 and lr.supported need init.support = true; "
                    "the plan sets it where stereo makes the start points");
}

std::vector<TermOnList> terms_on_list(const LossOptions& options) {
    std::vector<TermOnList> list;
    LossOptions::terms(options, [&]<class Class>(Class, const char* key, const auto& of, auto) {
        list.push_back({key, of.weight, typename Class::template On<Cpu>(of).needs()});
    });
    list.insert(list.end(), added_terms().begin(), added_terms().end());
    return list;
}

LossNeeds needs_of(const LossOptions& options) {
    LossNeeds needs;
    for (const TermOnList& term : terms_on_list(options))
        if (term.weight > 0) needs |= term.needs;
    return needs;
}

template void add_loss<Cpu>(const TermOnList&, MakeLoss<Cpu>);
template Gaussians<Cpu> train<Cpu>(
    const Scene&, const TrainOptions&, const TrainCallbacks&, const AfterStep<Cpu>&, SharedState);

}  // namespace tvsgs
