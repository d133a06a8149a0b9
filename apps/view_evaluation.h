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
};

/// Writes RUN/test/NAME.png, NAME_normal.png and NAME_depth.png per view and RUN/eval/nvs.json.
/// Scores are on 8-bit renders, rounded half up, by the definitions of 3DGS; views equal to their
/// photograph have an infinite PSNR and stay out of its mean. Gives way to a signal between views.
template <class Device>
ViewScores evaluate_views(const Gaussians<Device>& gaussians,
                          const std::vector<View>& views,
                          const TrainOptions& options,
                          const std::string& run) {
    auto backbone = make_backbone<Device>(options.backbone, options.core);
    ViewScores scores;
    JsonLine per_view;
    int finite = 0;
    for (const View& view : views) {
        SignalGuard::check();
        const auto& images =
            backbone->forward(gaussians, view.camera, gaussians.sh_degree, Channels::color_plane);
        const int w = images.width, h = images.height;
        const ImageU8 render = color_image(w, h, to_host(images.color));
        const double view_psnr = psnr(render, view.photo);
        const Ssim view_ssim = ssim(render, view.photo);
        if (std::isfinite(view_psnr)) scores.mean_psnr += view_psnr, ++finite;
        scores.mean_ssim += view_ssim.padded / static_cast<double>(views.size());
        JsonLine line;
        line.add("psnr", view_psnr)
            .add("ssim", view_ssim.padded)
            .add("ssim_valid", view_ssim.valid);
        per_view.add_json(view.name, line.text());

        const std::string stem =
            run + "/test/" + std::filesystem::path(view.name).replace_extension().string();
        write_png(stem + ".png", render);
        write_png(stem + "_normal.png", normal_image(w, h, to_host(images.normal)));
        write_png(stem + "_depth.png", depth_image(w, h, to_host(images.depth)));
    }
    scores.mean_psnr = finite > 0 ? scores.mean_psnr / finite : std::nan("");
    JsonLine report;
    report.add("psnr", scores.mean_psnr)
        .add("ssim", scores.mean_ssim)
        .add("views", static_cast<int>(views.size()));
    report.add_json("per_view", per_view.text());
    write_text_file(run + "/eval/nvs.json", report.text() + "\n");
    return scores;
}

}  // namespace tvsgs
