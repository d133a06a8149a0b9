// Scores renders of views against their photographs.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "eval/image_metrics.h"
#include "eval/lpips.h"
#include "io/files/json_value.h"

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
    JsonValue per_view;             // by name
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
    JsonValue per_view_ = JsonValue::object();
};

/// "psnr", "ssim", "ssim_valid" (windows inside of the image only) and "lpips", each with `suffix`;
/// null where not computed.
void add_scores(JsonValue& line, const ImageScores& scores, const std::string& suffix = "");

/// Means and scores per view as RUN/eval/nvs.json holds them.
JsonValue view_scores_json(const ViewScores& scores, std::size_t views, const ViewScoring& scoring);

}  // namespace tvsgs
