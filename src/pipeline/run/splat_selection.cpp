#include "pipeline/run/splat_selection.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/error.h"
#include "core/math/sigmoid.h"
#include "core/scene/splat_lists.h"
#include "optim/growth/splat_order.h"
#include "render/depth/map_images.h"

namespace tvsgs {
namespace {

/// Drops the indices for which is_out is true; returns their number.
template <class IsOut>
std::int64_t drop(std::vector<int>& places, const IsOut& is_out) {
    return std::int64_t(std::erase_if(places, [&](int i) { return is_out(std::size_t(i)); }));
}

}  // namespace

std::vector<double> size_of_splats(const Gaussians<Cpu>& g) {
    std::vector<double> sizes(g.means.size());
    for (std::size_t i = 0; i < sizes.size(); ++i) {
        const Vec3f s = g.log_scales[i];
        const double two =
            double{s.x} + double{s.y} + double{s.z} - double{std::min({s.x, s.y, s.z})};
        sizes[i] = double{sigmoid(g.opacity_logits[i])} * std::exp(two);
    }
    return sizes;
}

SelectionReport select_splats(const SplatSelection& selection,
                              const std::vector<double>& light,
                              Gaussians<Cpu>& g) {
    if (selection.drop_unseen && light.empty() && g.size() > 0)
        throw Error(ExitCode::internal, "no light to drop unseen splats by");
    SelectionReport report;
    std::vector<int> places(g.means.size());
    std::iota(places.begin(), places.end(), 0);
    if (selection.box)
        report.outside = drop(places, [&](std::size_t i) {
            const Vec3d p = vec_cast<double>(g.means[i]);
            for (int c = 0; c < 3; ++c)
                if (!(p[c] >= selection.box->low[c] && p[c] <= selection.box->high[c])) return true;
            return false;
        });
    if (selection.drop_invisible)
        report.invisible = drop(
            places, [&](std::size_t i) { return !(sigmoid(g.opacity_logits[i]) >= 0.5f / 255); });
    if (selection.drop_unseen)
        report.unseen = drop(places, [&](std::size_t i) { return !(light[i] > 0); });
    const auto most = std::size_t(selection.max_splats);
    if (most > 0 && places.size() > most) {
        const std::vector<double> weights = light.empty() ? size_of_splats(g) : light;
        std::vector<int> best = places;
        std::ranges::stable_sort(best, [&](int a, int b) { return weights[a] > weights[b]; });
        report.beyond_most = std::int64_t(places.size() - most);
        best.resize(most);
        std::ranges::sort(best);
        places = std::move(best);
    }
    if (places.size() < g.means.size()) keep_splats(places, g);
    if (selection.sort) sort_by_place(g);
    if (selection.sh_degree && *selection.sh_degree < g.sh_degree) {
        g.sh_degree = *selection.sh_degree;
        g.sh.resize(std::size_t(sh_count(g.sh_degree)) * g.means.size());
    }
    return report;
}

namespace detail {

Render render_of(int width, int height, const std::vector<Vec3f>& colors) {
    Render out{color_image(width, height, colors), ImageF(width, height, 3)};
    for (std::size_t i = 0; i < colors.size(); ++i)
        for (int c = 0; c < 3; ++c)  // NaN becomes 0
            out.colors.pixels[3 * i + std::size_t(c)] =
                std::min(std::max(0.0f, colors[i][c]), 1.0f);
    return out;
}

RenderScores mean_scores(const std::vector<RenderScores>& views) {
    const auto mean = [&](double RenderScores::*score) {
        double sum = 0;
        int count = 0;
        for (const RenderScores& view : views)
            if (std::isfinite(view.*score)) sum += view.*score, ++count;
        return count > 0 ? sum / count : std::nan("");
    };
    return {mean(&RenderScores::before), mean(&RenderScores::after), mean(&RenderScores::between)};
}

}  // namespace detail
}  // namespace tvsgs
