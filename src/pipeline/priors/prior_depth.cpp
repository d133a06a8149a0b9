// Reads prior depth: interprets its numbers, fits scale and shift per view, and makes maps.
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "core/device/parallel_lists.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/math/quantile.h"
#include "core/scene/prior_maps.h"
#include "io/files/read_file.h"
#include "mvs/priors/prior_fit.h"
#include "pipeline/priors/prior_parts.h"

namespace tvsgs {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

/// Reads a file with its scale and shift; NaN for unknown.
PlacedMap read_depth(const DepthSource& source, const PriorFile& file, const PriorView& view) {
    PlacedMap placed = read_placed(source, file, view, 1);
    const bool positive = source.convention.alignment == PriorAlignment::metric ||
                          source.convention.alignment == PriorAlignment::scale;
    for (float& value : placed.map.pixels) {
        const auto number = double(value);
        const bool none = std::ranges::find(source.invalid, number) != source.invalid.end() ||
                          (positive && source.convention.quantity != PriorQuantity::log_depth &&
                           !file.unreliable && !(number * file.scale + file.shift > 0));
        value = none ? kNaN : float(number * file.scale + file.shift);
    }
    return placed;
}

PriorSamples samples_of(const PlacedMap& placed, const PriorView& view) {
    PriorSamples samples;
    for (const VisiblePoint& p : view.points) {
        double u = 0, v = 0;
        float value = 0;
        if (placed.placement.find(p.x_px, p.y_px, u, v) &&
            sample_map(placed.map, MapBlend::linear, u, v, &value))
            samples.push_back({double(value), p.depth, p.distance});
    }
    return samples;
}

/// Samples, interpretation and fit of a view's map.
struct FittedView {
    const PriorFile* file = nullptr;  // null: none, or without a valid number
    PriorSamples samples;
    PriorReading reading;
    PriorFit fit;
    bool left_out = false;
};

/// Fitted depths are only valid near the depths of the points that determined the shift.
struct DepthRange {
    double near = 0, far = std::numeric_limits<double>::infinity();
};
DepthRange range_of(const FittedView& fitted) {
    if (fitted.reading.alignment != PriorAlignment::affine || fitted.samples.empty()) return {};
    constexpr double kBeyond = 4;
    std::vector<double> depths;
    for (const PriorSample& s : fitted.samples) depths.push_back(s.depth);
    std::ranges::sort(depths);
    const std::size_t rare = depths.size() / 100;
    return {depths[rare] / kBeyond, depths[depths.size() - 1 - rare] * kBeyond};
}

/// Maps the 2nd and 98th percentiles to 0 and 1; sets all values to 0 if they are equal. Returns
/// false without values.
bool stretch(std::vector<float>& values) {
    std::vector<float> sorted;
    std::ranges::copy_if(values, std::back_inserter(sorted),
                         [](float v) { return !std::isnan(v); });
    if (sorted.empty()) return false;
    const float low = percentile(sorted, 2), high = percentile(sorted, 98);
    const float spread = high > low ? high - low : 1;
    for (float& value : values) value = (value - low) / spread;
    return true;
}

void make_maps(const PriorInputs& in, const FittedView& fitted, PriorView& prior_view) {
    View& view = *prior_view.view;
    const PlacedMap placed = read_depth(in.sources.depth, *fitted.file, prior_view);
    const PriorReading& reading = fitted.reading;
    const bool planes_are_straight = reading.quantity == PriorQuantity::depth &&
                                     reading.alignment != PriorAlignment::affine &&
                                     reading.alignment != PriorAlignment::rank;
    const ImageF numbers =
        resample_map(placed.map, placed.placement, view, view.photo.width, view.photo.height,
                     planes_are_straight ? MapBlend::inverse : MapBlend::linear);
    const std::vector<std::uint8_t> sky = sky_of(in, prior_view);
    const DepthRange range = range_of(fitted);
    std::vector<float> depth(numbers.pixels.size()), order(numbers.pixels.size(), kNaN);
    for (std::size_t i = 0; i < depth.size(); ++i) {
        const double value = double(numbers.pixels[i]);
        if (std::isnan(value) || (!sky.empty() && sky[i] != 0)) continue;
        if (!fitted.fit.found) {
            order[i] = float(reading.quantity == PriorQuantity::inverse_depth ? -value : value);
            continue;
        }
        const int x = int(i) % view.photo.width, y = int(i) / view.photo.width;
        const double cosine = 1 / norm(vec_cast<double>(pixel_ray(view.camera, x, y)));
        const double z = prior_depth(value, fitted.fit, reading, cosine);
        if (z >= range.near && z <= range.far && z > 0) depth[i] = float(z);
        // Inverse depths below 0 are farther than all others.
        const double known = z > 0                                              ? z
                             : reading.quantity == PriorQuantity::inverse_depth ? range.far
                                                                                : range.near;
        const double clamped = std::clamp(known, range.near, range.far);
        if (std::isfinite(clamped)) order[i] = float(clamped);
    }
    if (in.order && stretch(order)) add_map(view, prior_map::kDepthOrder, 1, std::move(order));
    if (in.depth && fitted.fit.found) add_map(view, prior_map::kDepth, 1, std::move(depth));
}

double median_residual(const std::vector<FittedView>& views) {
    std::vector<double> residuals;
    for (const FittedView& v : views)
        if (v.fit.found && !v.left_out && !v.samples.empty()) residuals.push_back(v.fit.residual);
    return residuals.empty() ? 0 : middle_of(residuals);
}

std::string percent(double share) {
    return str(std::round(share * 1e4) / 100, " %");
}

const char* text_of(PriorAlignment alignment) {
    return alignment == PriorAlignment::metric   ? "in scene units"
           : alignment == PriorAlignment::scale  ? "up to scale"
           : alignment == PriorAlignment::affine ? "relative"
                                                 : "relative order";
}

void fit_view(const ReadingChoice& choice, float max_residual, FittedView& view) {
    view.reading = choice.reading;
    if (view.file->unreliable) view.reading.alignment = PriorAlignment::affine;
    if (view.reading.alignment == PriorAlignment::rank) return;
    view.fit = fit_prior(view.samples, view.reading);
    if (view.reading.alignment == PriorAlignment::metric && !view.fit.found)
        view.fit = {true, 1, 0, 0};  // its numbers are depths, although no points confirm it
    view.left_out = is_uninformative(view.fit) ||
                    (view.fit.found && !(view.fit.residual <= double(max_residual)));
}

/// Logs the views without depth, and the reason.
void warn_of_views(const std::vector<FittedView>& fitted, const std::vector<PriorView>& views) {
    std::vector<std::string> bad, few;
    for (std::size_t i = 0; i < fitted.size(); ++i) {
        const std::string& name = views[i].view->name;
        const PriorFit& fit = fitted[i].fit;
        if (fitted[i].left_out)
            bad.push_back(str(name, " (", percent(fit.residual), ", constant depth ",
                              percent(fit.residual_of_constant), ")"));
        else if (fitted[i].file && !fitted[i].fit.found &&
                 fitted[i].reading.alignment != PriorAlignment::rank)
            few.push_back(str(name, " (", fitted[i].samples.size(), ")"));
    }
    if (!bad.empty())
        spdlog::warn(
            "Priors: ignores the depth maps of {} views, which fit the points worse than "
            "priors.max_residual or hardly better than a constant depth: {}",
            bad.size(), listed(bad));
    if (!few.empty())
        spdlog::warn(
            "Priors: uses only the order of depths in {} views with too few points to fit scale "
            "and shift: {}",
            few.size(), listed(few));
}

}  // namespace

std::string fill_depth(const PriorInputs& in, std::vector<PriorView>& views) {
    const DepthSource& source = in.sources.depth;
    DepthConvention convention = source.convention;
    if (in.options.quantity != PriorQuantity::unknown)
        convention.quantity = in.options.quantity, convention.declared_by = "priors.quantity";
    const int count = int(views.size());

    // 1. Sample the maps at the scene's points.
    std::vector<FittedView> fitted(views.size());
    parallel_for_throwing(count, [&](int i) {
        const PriorView& from = views[i];
        const PriorFile* const file = file_of(source, from);
        if (file == nullptr) return;
        const PlacedMap placed = read_depth(source, *file, from);
        if (std::ranges::all_of(placed.map.pixels, [](float v) { return std::isnan(v); })) return;
        fitted[i].file = file, fitted[i].samples = samples_of(placed, from);
    });
    std::vector<std::string> empty_maps;
    std::size_t maps = 0;
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (file_of(source, views[i]) == nullptr) continue;
        ++maps;
        if (!fitted[i].file) empty_maps.push_back(views[i].view->name);
    }
    report_empty_maps("depth", source, empty_maps, maps);

    // 2. Choose the interpretation, and fit scale and shift of each view.
    std::vector<PriorSamples> reliable;
    for (const FittedView& view : fitted)
        if (view.file && !view.file->unreliable) reliable.push_back(view.samples);
    const ReadingChoice choice =
        choose_reading(reliable, convention, double(in.options.max_residual));
    parallel_for_heavy(Cpu{}, count, [&](int i) {
        FittedView& view = fitted[i];
        if (view.file) fit_view(choice, in.options.max_residual, view);
    });

    // 3. Compute the maps.
    parallel_for_throwing(count, [&](int i) {
        const FittedView& view = fitted[i];
        if (view.file && !view.left_out) make_maps(in, view, views[i]);
    });
    warn_of_views(fitted, views);
    const auto empty =
        std::ranges::count_if(fitted, [](const FittedView& v) { return is_uninformative(v.fit); });
    const auto tested =
        std::ranges::count_if(fitted, [](const FittedView& v) { return v.fit.found; });
    if (2 * empty > tested)
        throw input_error("E_PRIORS: ", source.what, ": ", empty, " of ", tested,
                          " depth maps fit the points hardly better than a constant depth; are "
                          "they the maps of these photographs?");

    std::set<int> points;
    int used = 0;
    for (std::size_t i = 0; i < fitted.size(); ++i) {
        if (!fitted[i].file || fitted[i].left_out) continue;
        ++used;
        if (fitted[i].fit.found && !fitted[i].samples.empty())
            for (const VisiblePoint& p : views[i].points) points.insert(p.index);
    }
    const std::string files = used < count ? str(" of ", count, " views") : "";
    const std::string what = str(used, " depth maps", files, " (", source.what, ": ",
                                 text_of(choice.reading.alignment), " ", text_of(choice.reading));
    if (choice.tested_views == 0)
        return str(what, ", not checked: too few points; set priors.quantity if it is wrong)");
    if (choice.reading.alignment == PriorAlignment::rank) return what + ")";
    return str(what, "), fitted to ", grouped(points.size()), " points, median error ",
               percent(median_residual(fitted)));
}

}  // namespace tvsgs
