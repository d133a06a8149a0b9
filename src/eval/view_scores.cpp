#include "eval/view_scores.h"

#include <algorithm>
#include <numbers>

#include "core/error.h"
#include "core/scene/camera.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

ImageF unit_image(const ImageU8& image) {
    ImageF out(image.width, image.height, image.channels);
    for (std::size_t i = 0; i < out.pixels.size(); ++i)
        out.pixels[i] = static_cast<float>(image.pixels[i]) / 255;
    return out;
}
const ImageF& unit_image(const ImageF& image) {
    return image;
}

template <class T>
ImageScores score(const Image<T>& render, const Image<T>& photo, const ViewScoring& scoring) {
    ImageScores scores;
    scores.psnr = psnr(render, photo);
    const Ssim similarity = ssim(render, photo);
    scores.ssim = similarity.padded, scores.ssim_valid = similarity.valid;
    if (scoring.lpips)
        scores.lpips =
            lpips(unit_image(render), unit_image(photo), *scoring.lpips, scoring.lpips_range);
    return scores;
}

/// PSNR over the object's pixels; other scores over the object on white.  [FatesGS, metrics_dtu.py]
template <class T>
ImageScores score_object(const Image<T>& render,
                         const Image<T>& photo,
                         const ImageU8& mask,
                         const ViewScoring& scoring) {
    const T white = std::is_same_v<T, float> ? T(1) : T(255);
    Image<T> masked_render = render, masked_photo = photo;
    std::size_t inside = 0;
    for (std::size_t i = 0; i < mask.pixels.size(); ++i) {
        if (mask.pixels[i] >= kObjectMask) {
            ++inside;
            continue;
        }
        for (std::size_t c = 0; c < 3; ++c)
            masked_render.pixels[3 * i + c] = masked_photo.pixels[3 * i + c] = white;
    }
    ImageScores scores = score(masked_render, masked_photo, scoring);
    // Both images are white outside, so only the number of pixels differs.
    scores.psnr +=
        10 * std::log10(static_cast<double>(inside) / static_cast<double>(mask.pixels.size()));
    if (inside == 0) scores.psnr = std::nan("");
    return scores;
}

/// Calls action(render, photo) on images of the type that the quantisation requires.
template <class Action>
ImageScores quantized(const ViewScoring& scoring,
                      const View& view,
                      const ImageU8& render,
                      const std::vector<Vec3f>& colors,
                      const Action& action) {
    if (scoring.quantize == ViewScoring::Quantize::round) return action(render, view.photo);
    ImageF exact(render.width, render.height, 3);
    for (std::size_t i = 0; i < colors.size(); ++i)
        for (int c = 0; c < 3; ++c)  // NaN becomes 0
            exact.pixels[3 * i + c] = std::min(std::max(0.0f, colors[i][c]), 1.0f);
    if (scoring.quantize == ViewScoring::Quantize::none)
        return action(exact, unit_image(view.photo));
    ImageU8 truncated = render;
    for (std::size_t i = 0; i < exact.pixels.size(); ++i)
        truncated.pixels[i] = static_cast<std::uint8_t>(exact.pixels[i] * 255);
    return action(truncated, view.photo);
}

ImageScores mean_of(const std::vector<ImageScores>& views) {
    const auto mean = [&](double ImageScores::*score) {
        double sum = 0;
        int count = 0;
        for (const ImageScores& view : views)
            if (std::isfinite(view.*score)) sum += view.*score, ++count;
        return count > 0 ? sum / count : std::nan("");
    };
    return {mean(&ImageScores::psnr), mean(&ImageScores::ssim), mean(&ImageScores::ssim_valid),
            mean(&ImageScores::lpips)};
}

}  // namespace

double nearest_axis_deg(const Camera& camera, const std::vector<View>& views) {
    double cosine = -1;
    for (const View& view : views)
        cosine = std::max(cosine, dot(optical_axis(camera), optical_axis(view.camera)));
    return std::acos(std::clamp(cosine, -1.0, 1.0)) * 180 / std::numbers::pi;
}

void ViewScorer::add(const View& view, const ImageU8& render, const std::vector<Vec3f>& colors) {
    JsonValue line;
    whole_.push_back(quantized(scoring_, view, render, colors, [&](const auto& a, const auto& b) {
        return score(a, b, scoring_);
    }));
    add_scores(line, whole_.back());
    if (scoring_.trained != nullptr) {
        const double angle_deg = nearest_axis_deg(view.camera, *scoring_.trained);
        (angle_deg <= kNearDeg ? near_ : far_).push_back(whole_.back());
        line.add("angle_deg", angle_deg);
    }
    if (scoring_.masked) {
        if (view.mask.empty())
            throw input_error("--masked: view ", view.name,
                              " has no mask; put masks into the scene, or give --masks DIR");
        masked_.push_back(quantized(
            scoring_, view, render, colors,
            [&](const auto& a, const auto& b) { return score_object(a, b, view.mask, scoring_); }));
        add_scores(line, masked_.back(), "_masked");
    }
    per_view_.add(view.name, line);
}

ViewScores ViewScorer::scores() const {
    ViewScores scores;
    scores.mean = mean_of(whole_), scores.mean_masked = mean_of(masked_);
    scores.mean_near = mean_of(near_), scores.mean_far = mean_of(far_);
    scores.near_views = near_.size(), scores.far_views = far_.size();
    scores.mean_psnr = scores.mean.psnr, scores.mean_ssim = scores.mean.ssim;
    scores.per_view = per_view_;
    return scores;
}

void add_scores(JsonValue& line, const ImageScores& scores, const std::string& suffix) {
    line.add("psnr" + suffix, scores.psnr)
        .add("ssim" + suffix, scores.ssim)
        .add("ssim_valid" + suffix, scores.ssim_valid)
        .add("lpips" + suffix, scores.lpips);
}

JsonValue view_scores_json(const ViewScores& scores,
                           std::size_t views,
                           const ViewScoring& scoring) {
    JsonValue json;
    add_scores(json, scores.mean);
    if (scoring.masked) add_scores(json, scores.mean_masked, "_masked");
    if (scoring.trained != nullptr) {
        add_scores(json, scores.mean_near, "_near");
        add_scores(json, scores.mean_far, "_far");
        json.add("views_near", scores.near_views).add("views_far", scores.far_views);
    }
    json.add("views", views);
    json.add("lpips_by",
             !scoring.lpips
                 ? "not computed: no weights given"
                 : str(scoring.lpips->net == LpipsNet::vgg ? "VGG" : "AlexNet", " on values in ",
                       scoring.lpips_range == LpipsRange::zero_one ? "[0, 1]" : "[-1, 1]"));
    constexpr const char* kNames[] = {"round", "trunc", "none"};
    return json.add("quantize", kNames[static_cast<int>(scoring.quantize)]);
}

}  // namespace tvsgs
