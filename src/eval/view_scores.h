// Scores rendered views against their photographs.
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "core/scene/scene.h"
#include "eval/image_metrics.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// Options of scoring; the defaults are those of 3DGS.
struct ViewScoring {
    enum class Quantize { round, trunc, none };
    Quantize quantize = Quantize::round;  // rounding of renders to 8 bits
    bool masked = false;                  // also score the object on white
    const LpipsWeights* lpips = nullptr;  // null: not computed
    LpipsRange lpips_range = LpipsRange::zero_one;
    const std::vector<View>* trained = nullptr;  // null: views are not parted into near and far
};

/// Largest angle between the optical axes of a near view and of a training view.
inline constexpr double kNearDeg = 15;

/// Smallest angle between the optical axes of a camera and of views, degrees; 180 without views.
double nearest_axis_deg(const Camera& camera, const std::vector<View>& views);

/// NaN: not computed, or undefined.
struct ImageScores {
    double psnr = std::nan(""), ssim = std::nan(""), ssim_valid = std::nan(""),
           lpips = std::nan("");
};

struct ViewScores {
    double mean_psnr = 0, mean_ssim = 0;
    ImageScores mean, mean_masked;  // mean of psnr and ssim of both
    ImageScores mean_near, mean_far;
    std::size_t near_views = 0, far_views = 0;
    JsonValue per_view;  // by name
};

/// Collects the scores of views one by one. The mean PSNR excludes views equal to their photograph,
/// which have an infinite PSNR.
class ViewScorer {
public:
    explicit ViewScorer(const ViewScoring& scoring) : scoring_(scoring) {}

    /// `colors` [H W] as rendered; `render`: the same in 8 bits. Throws Error(ExitCode::input) when
    /// a mask is required and missing.
    void add(const View& view, const ImageU8& render, const std::vector<Vec3f>& colors);
    ViewScores scores() const;

private:
    ViewScoring scoring_;
    std::vector<ImageScores> whole_, masked_, near_, far_;
    JsonValue per_view_ = JsonValue::object();
};

/// Adds "psnr", "ssim", "ssim_valid" (only windows inside the image) and "lpips", each with
/// `suffix`; null where not computed.
void add_scores(JsonValue& line, const ImageScores& scores, const std::string& suffix = "");

/// Means and scores per view, in the format of RUN/eval/nvs.json.
JsonValue view_scores_json(const ViewScores& scores, std::size_t views, const ViewScoring& scoring);

}  // namespace tvsgs
