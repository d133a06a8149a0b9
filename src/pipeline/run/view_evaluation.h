// Renders views, scores them against their photographs, and writes pictures.
#pragma once

#include <algorithm>
#include <filesystem>
#include <future>
#include <string>
#include <vector>

#include "core/device/threads.h"
#include "core/progress.h"
#include "eval/view_scores.h"
#include "io/files/atomic_file.h"
#include "io/files/json_value.h"
#include "io/images/image_file.h"
#include "optim/loop/train.h"
#include "optim/losses/losses_list.h"
#include "pipeline/run/signals.h"
#include "render/backbone.h"
#include "render/depth/map_images.h"

namespace tvsgs {

/// Whether all views have masks, so that renders can be scored inside of them.
inline bool have_masks(const std::vector<View>& views) {
    const auto lacks = [](const View& view) { return view.mask.empty(); };
    return !views.empty() && std::ranges::none_of(views, lacks);
}

/// Whether any mask has a pixel of the object.
inline bool has_object(const std::vector<View>& views) {
    return std::ranges::any_of(views, [](const View& view) {
        return std::ranges::any_of(view.mask.pixels,
                                   [](std::uint8_t value) { return value >= kObjectMask; });
    });
}

/// [H W] The colours of `images`, which have a transmittance, over the background; a random
/// background counts as black.
template <class Images>
std::vector<Vec3f> colors_over_background(const PhotometricOptions& options,
                                          const Camera& camera,
                                          const Images& images) {
    std::vector<Vec3f> colors = to_host(images.color);
    const PhotoBackground background = parse_background(options.background);
    const bool is_sky = background.kind == PhotoBackground::Kind::sky;
    if (is_sky && !options.sky) throw Error(ExitCode::usage, kSkyNeedsMap);
    if (background.black() && !is_sky) return colors;
    const Behind behind{background.linear(),
                        is_sky ? SkyMap{options.sky->pixels.data(), options.sky->width} : SkyMap{},
                        camera};
    const std::vector<float> T = to_host(images.transmittance);
    parallel_for(Cpu{}, int(colors.size()), [&](int i) { colors[i] += T[i] * behind.at(i); });
    return colors;
}

/// Calls `on_render(view, render, images)` after each view.
template <class Device, class OnRender>
ViewScores score_views(const Gaussians<Device>& gaussians,
                       const std::vector<View>& views,
                       const TrainOptions& options,
                       OnRender&& on_render,
                       const ViewScoring& scoring = {}) {
    auto backbone = make_backbone<Device>(options.backbone, options.render);
    ViewScorer scorer(scoring);
    Progress progress("scores of the test views", double(views.size()));
    for (const View& view : views) {
        const auto& images = backbone->forward(gaussians, view.camera, gaussians.sh_degree,
                                               Maps::color | kGeometryMaps);
        const std::vector<Vec3f> colors =
            colors_over_background(options.loss.photometric, view.camera, images);
        const ImageU8 render = color_image(images.width, images.height, colors);
        scorer.add(view, render, colors);
        on_render(view, render, images);
        progress.advance();
    }
    return scorer.scores();
}

/// Path of a view's render, without the suffix.
inline std::string render_stem(const std::string& run, const std::string& view_name) {
    return run + "/test/" + std::filesystem::path(view_name).replace_extension().string();
}

/// Writes RUN/test/NAME.png, NAME_normal.png and NAME_depth.png per test view, while the next view
/// is rendered, and RUN/eval/nvs.json. Checks for signals between views.
template <class Device>
ViewScores evaluate_views(const Gaussians<Device>& gaussians,
                          const Scene& scene,
                          const TrainOptions& options,
                          const std::string& run,
                          ViewScoring scoring = {}) {
    scoring.trained = &scene.train;
    SignalGuard::check();
    std::future<void> writing;  // the pictures of a view
    const auto write_pictures = [&](const View& view, const ImageU8& render, const auto& images) {
        if (writing.valid()) writing.get();
        const int w = images.width, h = images.height;
        writing = std::async(
            std::launch::async, [w, h, stem = render_stem(run, view.name), render,
                                 normals = to_host(images.normal), depths = to_host(images.depth)] {
                run_chunks(3, [&](int picture, int /*slot*/) {
                    if (picture == 0) write_png(stem + ".png", render);
                    if (picture == 1) write_png(stem + "_normal.png", normal_image(w, h, normals));
                    if (picture == 2) write_png(stem + "_depth.png", depth_image(w, h, depths));
                });
            });
        SignalGuard::check();
    };
    ViewScores scores = score_views(gaussians, scene.test, options, write_pictures, scoring);
    if (writing.valid()) writing.get();
    JsonValue json = view_scores_json(scores, scene.test.size(), scoring);
    json.add("per_view", scores.per_view);
    write_text_file(run + "/eval/nvs.json", json_text(json) + "\n");
    return scores;
}

}  // namespace tvsgs
