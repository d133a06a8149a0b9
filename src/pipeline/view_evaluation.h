// Renders views, scores them against their photographs, and leaves pictures a person can look at.
#pragma once

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "eval/view_scores.h"
#include "io/atomic_file.h"
#include "io/config.h"
#include "io/image_file.h"
#include "optim/train.h"
#include "pipeline/signals.h"
#include "render/backbone.h"
#include "render/map_images.h"

namespace tvsgs {

/// Whether renders can be scored inside of the views' masks.
inline bool have_masks(const std::vector<View>& views) {
    const auto lacks = [](const View& view) { return view.mask.empty(); };
    return !views.empty() && std::none_of(views.begin(), views.end(), lacks);
}

/// `on_render(view, render, images)` is called after each view.
template <class Device, class OnRender>
ViewScores score_views(const Gaussians<Device>& gaussians,
                       const std::vector<View>& views,
                       const TrainOptions& options,
                       OnRender&& on_render,
                       const ViewScoring& scoring = {}) {
    auto backbone = make_backbone<Device>(options.backbone, options.render);
    const PhotoBackground behind = parse_background(options.loss.photometric.background);
    ViewScorer scorer(scoring);
    for (const View& view : views) {
        const auto& images = backbone->forward(gaussians, view.camera, gaussians.sh_degree,
                                               Maps::color | kGeometryMaps);
        std::vector<Vec3f> colors = to_host(images.color);
        if (behind.kind == PhotoBackground::Kind::constant && !behind.black()) {
            const std::vector<float> T = to_host(images.transmittance);
            for (std::size_t i = 0; i < colors.size(); ++i) colors[i] += T[i] * behind.linear();
        }
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
