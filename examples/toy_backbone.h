// The smallest backbone, from public headers alone: every splat is a round dot with its opacity and
// plain colour, and dots add up.  [docs/develop/add-a-backbone.md]
#pragma once

#include "core/device/parallel.h"
#include "render/backbone.h"

namespace tvsgs::examples {

class ToyBackbone : public Backbone<Cpu> {
public:
    const RenderedImages<Cpu>& forward(const Gaussians<Cpu>& g,
                                       const Camera& camera,
                                       int /*sh_degree*/,
                                       Maps /*maps*/) override {
        const auto pixels = static_cast<std::size_t>(camera.width_px * camera.height_px);
        images_.width = camera.width_px, images_.height = camera.height_px;
        images_.camera = camera;
        images_.color.resize(pixels), images_.transmittance.resize(pixels);
        images_.color.fill_zero(), images_.transmittance.fill_zero();
        statistics_.radii_px.resize(g.means.size());
        statistics_.radii_px.fill_zero();
        dots_.clear();
        for (int i = 0; i < g.size(); ++i) {
            const auto at = static_cast<std::size_t>(i);
            const Vec3f p = camera.camera_from_world * g.means[at];
            if (!(p.z > 0.1f)) continue;
            dots_.push_back({at,
                             {camera.fx_px * p.x / p.z + camera.cx_px,
                              camera.fy_px * p.y / p.z + camera.cy_px}});
            statistics_.radii_px[at] = kRadius;
        }
        for_pixels([&](const Dot& dot, std::size_t pixel, float weight) {
            images_.color[pixel] += weight * opacity(g, dot.splat) * color(g, dot.splat);
        });
        return images_;
    }

    void backward(const Gaussians<Cpu>& g,
                  const ImageGradients<Cpu>& dL_dimages,
                  Gaussians<Cpu>& dL_dgaussians) override {
        statistics_.dL_dmeans2d.resize(g.means.size());
        statistics_.abs_dL_dmeans2d.resize(g.means.size());
        statistics_.front_pixels.resize(g.means.size());
        statistics_.dL_dmeans2d.fill_zero(), statistics_.abs_dL_dmeans2d.fill_zero();
        statistics_.front_pixels.fill_zero();
        for_pixels([&](const Dot& d, std::size_t pixel, float weight) {
            statistics_.front_pixels[d.splat] += 1;
            if (dL_dimages.color.empty()) return;
            const Vec3f dL = weight * dL_dimages.color[pixel];
            const float o = opacity(g, d.splat);
            dL_dgaussians.sh[d.splat] += kShOfColor * o * dL;
            dL_dgaussians.opacity_logits[d.splat] += o * (1 - o) * dot(dL, color(g, d.splat));
        });
    }

    const ScreenStatistics<Cpu>& statistics() const override { return statistics_; }

private:
    static constexpr float kRadius = 2, kShOfColor = 0.28209479f;
    struct Dot {
        std::size_t splat;
        Vec2f centre;  // px
    };

    static float opacity(const Gaussians<Cpu>& g, std::size_t i) {
        return 1 / (1 + std::exp(-g.opacity_logits[i]));
    }
    static Vec3f color(const Gaussians<Cpu>& g, std::size_t i) {
        return kShOfColor * g.sh[i] + Vec3f{0.5f, 0.5f, 0.5f};
    }

    /// visit(dot, pixel, weight of the dot there).
    template <class Visit>
    void for_pixels(const Visit& visit) const {
        constexpr int kReach = 2;
        for (const Dot& dot : dots_) {
            const int left = static_cast<int>(dot.centre.x), top = static_cast<int>(dot.centre.y);
            for (int y = top - kReach; y <= top + kReach; ++y)
                for (int x = left - kReach; x <= left + kReach; ++x) {
                    if (x < 0 || y < 0 || x >= images_.width || y >= images_.height) continue;
                    const float dx = static_cast<float>(x) + 0.5f - dot.centre.x,
                                dy = static_cast<float>(y) + 0.5f - dot.centre.y;
                    visit(dot, static_cast<std::size_t>(y * images_.width + x),
                          std::exp(-(dx * dx + dy * dy) / kRadius));
                }
        }
    }

    RenderedImages<Cpu> images_;
    ScreenStatistics<Cpu> statistics_;
    std::vector<Dot> dots_;
};

}  // namespace tvsgs::examples
