// Renders views, scores them against their photographs, and leaves pictures a person can look at.
#pragma once

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "common.h"
#include "io/atomic_file.h"
#include "io/config.h"
#include "io/image_file.h"
#include "mesh/lpips.h"
#include "optim/train.h"
#include "render/image_metrics.h"
#include "render/map_images.h"

namespace tvsgs {

/// How renders are scored; the default is what 3DGS does.
struct ViewScoring {
    enum class Quantize { round, trunc, none };
    Quantize quantize = Quantize::round;  // of renders to 8 bits
    bool masked = false;                  // score the object on white as well
    const LpipsWeights* lpips = nullptr;  // none: not computed
    LpipsRange lpips_range = LpipsRange::zero_one;
};

/// NaN: not computed, or undefined.
struct ImageScores {
    double psnr = std::nan(""), ssim = std::nan(""), ssim_valid = std::nan(""),
           lpips = std::nan("");
};

struct ViewScores {
    double mean_psnr = 0, mean_ssim = 0;
    ImageScores mean, mean_masked;  // mean of psnr and ssim: the two above
    std::string per_view_json;      // by name
};

/// Gathers the scores of views one by one; views equal to their photograph have an infinite PSNR
/// and stay out of its mean.
class ViewScorer {
public:
    explicit ViewScorer(const ViewScoring& scoring) : scoring_(scoring) {}

    /// `colors` [H W] as rendered, `render` the same in 8 bits. Throws Error(ExitCode::input) when
    /// a mask is asked for and missing.
    void add(const View& view, const ImageU8& render, const std::vector<Vec3f>& colors);
    ViewScores scores() const;

private:
    ViewScoring scoring_;
    std::vector<ImageScores> whole_, masked_;
    JsonLine per_view_;
};

/// "psnr", "ssim", "ssim_valid" (windows inside of the image only) and "lpips", each with `suffix`;
/// null where not computed.
void add_scores(JsonLine& line, const ImageScores& scores, const std::string& suffix = "");

/// `on_render(view, render, images)` is called after each view.
template <class Device, class OnRender>
ViewScores score_views(const Gaussians<Device>& gaussians,
                       const std::vector<View>& views,
                       const TrainOptions& options,
                       OnRender&& on_render,
                       const ViewScoring& scoring = {}) {
    auto backbone = make_backbone<Device>(options.backbone, options.core);
    ViewScorer scorer(scoring);
    for (const View& view : views) {
        const auto& images = backbone->forward(gaussians, view.camera, gaussians.sh_degree,
                                               Maps::color | kGeometryMaps);
        const std::vector<Vec3f> colors = to_host(images.color);
        const ImageU8 render = color_image(images.width, images.height, colors);
        scorer.add(view, render, colors);
        on_render(view, render, images);
    }
    return scorer.scores();
}

/// Where the render of a view is, without the suffix.
inline std::string render_stem(const std::string& run, const std::string& view_name) {
    return run + "/test/" + std::filesystem::path(view_name).replace_extension().string();
}

/// Means and scores per view as RUN/eval/nvs.json holds them.
JsonLine view_scores_json(const ViewScores& scores, std::size_t views, const ViewScoring& scoring);

/// Writes RUN/test/NAME.png, NAME_normal.png and NAME_depth.png per view and RUN/eval/nvs.json.
/// Gives way to a signal between views.
template <class Device>
ViewScores evaluate_views(const Gaussians<Device>& gaussians,
                          const std::vector<View>& views,
                          const TrainOptions& options,
                          const std::string& run,
                          const ViewScoring& scoring = {}) {
    SignalGuard::check();
    const auto write_pictures = [&](const View& view, const ImageU8& render, const auto& images) {
        const std::string stem = render_stem(run, view.name);
        const int w = images.width, h = images.height;
        write_png(stem + ".png", render);
        write_png(stem + "_normal.png", normal_image(w, h, to_host(images.normal)));
        write_png(stem + "_depth.png", depth_image(w, h, to_host(images.depth)));
        SignalGuard::check();
    };
    ViewScores scores = score_views(gaussians, views, options, write_pictures, scoring);
    JsonLine json = view_scores_json(scores, views.size(), scoring);
    json.add_json("per_view", scores.per_view_json);
    write_text_file(run + "/eval/nvs.json", json.text() + "\n");
    return scores;
}

}  // namespace tvsgs
