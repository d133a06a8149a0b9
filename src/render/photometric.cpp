#include "render/photometric.h"

#include "core/parallel.h"

namespace tvsgs {

void photometric_loss(Span<const Vec3f> color,
                      Span<const std::uint8_t> photo,
                      int width,
                      int height,
                      PhotometricWeights weights,
                      PhotometricScratch<Cpu>& scratch,
                      Span<Vec3f> dL_dcolor,
                      Span<float> pixel_loss,
                      Cpu) {
    const auto at = [&](int x, int y) {
        return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
               static_cast<std::size_t>(x);
    };
    const float per_value = 1.0f / (3.0f * static_cast<float>(width) * static_cast<float>(height));
    const std::size_t pixels = at(0, height);
    scratch.dS_dx.resize(pixels), scratch.dS_dxx.resize(pixels), scratch.dS_dxy.resize(pixels);

    // A window is separable: rows of vertical sums, then horizontal ones. Outside of the image
    // everything is 0.
    const auto window = [&](int center, int size, auto&& visit) {
        const int low = std::max(0, center - kSsimRadius),
                  high = std::min(size - 1, center + kSsimRadius);
        for (int i = low; i <= high; ++i) visit(i, ssim_weight<float>(i - center));
    };
    parallel_for_heavy(Cpu{}, height, [&](int y) {
        std::vector<detail::MomentRow> columns(static_cast<std::size_t>(width));
        window(y, height, [&](int j, float w) {
            for (int x = 0; x < width; ++x)
                add_pixel(columns[static_cast<std::size_t>(x)], w, color[at(x, j)],
                          detail::photo_pixel(photo.data, at(x, j)));
        });
        for (int x = 0; x < width; ++x) {
            detail::MomentRow m{};
            window(x, width,
                   [&](int i, float w) { add_row(m, w, columns[static_cast<std::size_t>(i)]); });
            const std::size_t p = at(x, y);
            const auto s = detail::pixel_ssim(m, color[p], detail::photo_pixel(photo.data, p),
                                              weights, per_value);
            pixel_loss[p] = s.loss;
            scratch.dS_dx[p] = s.dS_dx, scratch.dS_dxx[p] = s.dS_dxx, scratch.dS_dxy[p] = s.dS_dxy;
        }
    });
    struct Sums {
        Vec3f dx, dxx, dxy;
    };
    const auto add = [](Sums& s, float w, Vec3f dx, Vec3f dxx, Vec3f dxy) {
        s.dx += w * dx, s.dxx += w * dxx, s.dxy += w * dxy;
    };
    parallel_for_heavy(Cpu{}, height, [&](int y) {
        std::vector<Sums> columns(static_cast<std::size_t>(width));
        window(y, height, [&](int j, float w) {
            for (int x = 0; x < width; ++x)
                add(columns[static_cast<std::size_t>(x)], w, scratch.dS_dx[at(x, j)],
                    scratch.dS_dxx[at(x, j)], scratch.dS_dxy[at(x, j)]);
        });
        for (int x = 0; x < width; ++x) {
            Sums s{};
            window(x, width, [&](int i, float w) {
                const Sums& c = columns[static_cast<std::size_t>(i)];
                add(s, w, c.dx, c.dxx, c.dxy);
            });
            const std::size_t p = at(x, y);
            dL_dcolor[p] +=
                detail::photometric_gradient(color[p], detail::photo_pixel(photo.data, p), s.dx,
                                             s.dxx, s.dxy, weights, per_value);
        }
    });
}

}  // namespace tvsgs
