// Selects splats of a run for a smaller file, and measures the loss of quality.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "core/parse_numbers.h"
#include "core/scene/gaussians.h"
#include "core/scene/scene.h"
#include "eval/image_metrics.h"
#include "optim/loop/train.h"
#include "pipeline/run/view_evaluation.h"
#include "render/backbone.h"

namespace tvsgs {

/// Blending weight of each splat, summed over all pixels of all cameras; 0 for a splat that no
/// camera sees. Renders with the backbone of `options`; ignores Gaussians::filter.
template <class Device>
std::vector<double> blend_weight_of_splats(const Gaussians<Cpu>& gaussians,
                                           const std::vector<Camera>& cameras,
                                           const TrainOptions& options) {
    // An image is the sum of weights times colours, so its gradient by a splat's colour is the sum
    // of its weights. All splats are grey, so that no colour is clamped.
    Gaussians<Cpu> grey_host;
    copy(gaussians, grey_host);
    resize(grey_host, gaussians.size(), 0);
    grey_host.sh.fill_zero();
    Gaussians<Device> grey, gradients;
    copy(grey_host, grey);
    resize(gradients, gaussians.size(), 0);
    const auto backbone = make_backbone<Device>(options.backbone, options.render);
    ImageGradients<Device> ones;
    std::vector<double> light(gaussians.means.size(), 0);
    for (const Camera& camera : cameras) {
        const auto& images = backbone->forward(grey, camera, 0, Maps::color);
        copy(std::vector<Vec3f>(images.color.size(), {1, 1, 1}), ones.color);
        fill_zero(gradients);
        backbone->backward(grey, ones, gradients);
        const std::vector<Vec3f> by_color = to_host(gradients.sh);
        for (std::size_t i = 0; i < light.size(); ++i) light[i] += double{by_color[i].x};
    }
    return light;
}

/// Importance of each splat without views: opacity times the two larger standard deviations.
std::vector<double> size_of_splats(const Gaussians<Cpu>& gaussians);

struct SplatSelection {
    std::optional<Box3d> box;      // keeps centres inside, in the frame of the splats
    bool drop_invisible = false;   // drops opacities that 8 bits round to 0
    bool drop_unseen = false;      // drops splats without light
    std::int64_t max_splats = 0;   // keeps those with most light, or the largest; 0: all
    bool sort = false;             // in Morton order, which compresses better
    std::optional<int> sh_degree;  // upper limit
};

struct SelectionReport {
    std::int64_t outside = 0, invisible = 0, unseen = 0, beyond_most = 0;
};

/// Removes splats as selected. `light`: from blend_weight_of_splats(), or empty, which requires
/// `drop_unseen` = false. Of equal splats the first are kept.
SelectionReport select_splats(const SplatSelection& selection,
                              const std::vector<double>& light,
                              Gaussians<Cpu>& gaussians);

/// Mean PSNR over views. Views without any difference are excluded; NaN: all are excluded.
struct RenderScores {
    double before = 0, after = 0;  // against the photographs, of 8-bit renders
    double between = 0;            // between the two renders
};

namespace detail {

struct Render {
    ImageU8 bytes;
    ImageF colors;  // clamped to [0, 1]
};
Render render_of(int width, int height, const std::vector<Vec3f>& colors);

RenderScores mean_scores(const std::vector<RenderScores>& views);

}  // namespace detail

/// Renders both with the backbone and background of `options`, in the views with a photograph.
template <class Device>
RenderScores compare_renders(const Gaussians<Cpu>& before,
                             const Gaussians<Cpu>& after,
                             const std::vector<View>& views,
                             const TrainOptions& options) {
    Gaussians<Device> first, second;
    copy(before, first), copy(after, second);
    const auto backbone = make_backbone<Device>(options.backbone, options.render);
    std::vector<RenderScores> scores;
    for (const View& view : views) {
        const auto render = [&](const Gaussians<Device>& g) {
            const auto& images = backbone->forward(g, view.camera, g.sh_degree, Maps::color);
            return detail::render_of(
                images.width, images.height,
                colors_over_background(options.loss.photometric, view.camera, images));
        };
        const detail::Render a = render(first), b = render(second);
        scores.push_back(
            {psnr(a.bytes, view.photo), psnr(b.bytes, view.photo), psnr(a.colors, b.colors)});
    }
    return detail::mean_scores(scores);
}

}  // namespace tvsgs
