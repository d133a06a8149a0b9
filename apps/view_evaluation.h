// Renders views, scores them against their photographs, and leaves pictures a person can look at.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "common.h"
#include "io/atomic_file.h"
#include "io/config.h"
#include "io/image_file.h"
#include "optim/train.h"
#include "render/image_metrics.h"
#include "render/map_images.h"

namespace tvsgs {

struct ViewScores {
    double mean_psnr = 0, mean_ssim = 0;
    std::string per_view_json;  // by name
};

/// Scores are on 8-bit renders, rounded half up, by the definitions of 3DGS; views equal to their
/// photograph have an infinite PSNR and stay out of its mean. `on_render(view, render, images)` is
/// called after each view.
template <class Device, class OnRender>
ViewScores score_views(const Gaussians<Device>& gaussians,
                       const std::vector<View>& views,
                       const TrainOptions& options,
                       OnRender&& on_render) {
    auto backbone = make_backbone<Device>(options.backbone, options.core);
    ViewScores scores;
    JsonLine per_view;
    int finite = 0;
    for (const View& view : views) {
        const auto& images =
            backbone->forward(gaussians, view.camera, gaussians.sh_degree, Channels::color_plane);
        const ImageU8 render = color_image(images.width, images.height, to_host(images.color));
        const double view_psnr = psnr(render, view.photo);
        const Ssim view_ssim = ssim(render, view.photo);
        if (std::isfinite(view_psnr)) scores.mean_psnr += view_psnr, ++finite;
        scores.mean_ssim += view_ssim.padded / static_cast<double>(views.size());
        JsonLine line;
        line.add("psnr", view_psnr)
            .add("ssim", view_ssim.padded)
            .add("ssim_valid", view_ssim.valid);
        per_view.add_json(view.name, line.text());
        on_render(view, render, images);
    }
    scores.mean_psnr = finite > 0 ? scores.mean_psnr / finite : std::nan("");
    scores.per_view_json = per_view.text();
    return scores;
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
                          const std::string& run) {
    SignalGuard::check();
    const auto write_pictures = [&](const View& view, const ImageU8& render, const auto& images) {
        const std::string stem = render_stem(run, view.name);
        const int w = images.width, h = images.height;
        write_png(stem + ".png", render);
        write_png(stem + "_normal.png", normal_image(w, h, to_host(images.normal)));
        write_png(stem + "_depth.png", depth_image(w, h, to_host(images.depth)));
        SignalGuard::check();
    };
    ViewScores scores = score_views(gaussians, views, options, write_pictures);
    JsonLine report;
    report.add("psnr", scores.mean_psnr)
        .add("ssim", scores.mean_ssim)
        .add("views", static_cast<int>(views.size()));
    report.add_json("per_view", scores.per_view_json);
    write_text_file(run + "/eval/nvs.json", report.text() + "\n");
    return scores;
}

}  // namespace tvsgs
