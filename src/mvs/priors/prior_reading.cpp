// Detection of the meaning of prior depth maps by the reading that fits the points.
#include <algorithm>
#include <cmath>

#include "core/error.h"
#include "core/math/quantile.h"
#include "mvs/priors/prior_fit.h"

namespace tvsgs {
namespace {

constexpr std::size_t kFewestToTest = 20;  // points in a view
constexpr PriorAlignment kAlignments[] = {PriorAlignment::metric, PriorAlignment::scale,
                                          PriorAlignment::affine};  // by number of unknowns

/// A reading and its residuals in the tested views.
struct Tested {
    PriorReading reading;
    std::vector<double> residuals{};
    double residual = std::numeric_limits<double>::infinity();
};

Tested test_reading(const PriorReading& reading, const std::vector<const PriorSamples*>& views) {
    Tested tested{reading};
    for (const PriorSamples* samples : views)
        tested.residuals.push_back(fit_prior(*samples, reading).residual);
    std::vector<double> sorted = tested.residuals;
    tested.residual = middle_of(sorted);
    return tested;
}

int unknowns(PriorAlignment alignment) {
    return alignment == PriorAlignment::affine ? 2 : alignment == PriorAlignment::scale ? 1 : 0;
}

/// True if the residual is smaller by more than noise: by a fifth, by at least a thousandth of the
/// depth, and in seven of ten views. With more unknowns it must be half.
bool is_clearly_better(const Tested& a, const Tested& b) {
    const double share = unknowns(a.reading.alignment) > unknowns(b.reading.alignment) ? 0.5 : 0.8;
    if (!(a.residual < share * b.residual && a.residual < b.residual - 1e-3)) return false;
    std::size_t wins = 0;
    for (std::size_t i = 0; i < a.residuals.size(); ++i) wins += a.residuals[i] < b.residuals[i];
    return 10 * wins >= 7 * a.residuals.size();
}

const Tested& best_of(const std::vector<Tested>& tested) {
    return *std::ranges::min_element(tested, {}, &Tested::residual);
}

std::string percent(double share) {
    if (!(share < 100)) return "not at all";
    return str("to ", std::round(share * 1e4) / 100, " %");
}

std::string table_of(const std::vector<Tested>& tested) {
    std::string text;
    for (const Tested& t : tested)
        text += str("\n  ", text_of(t.reading), " (", name_of(t.reading.alignment), ") fits ",
                    percent(t.residual));
    return text;
}

/// Agreement of values and depth with the order that a quantity implies: rank correlation, median
/// over the views.
double agreement(const std::vector<const PriorSamples*>& views, PriorQuantity quantity) {
    std::vector<double> all;
    for (const PriorSamples* samples : views) all.push_back(rank_correlation(*samples));
    return (quantity == PriorQuantity::inverse_depth ? -1 : 1) * middle_of(all);
}

/// All readings with the alignment of the convention or with more unknowns.
std::vector<PriorReading> readings(PriorAlignment least) {
    std::vector<PriorReading> all;
    for (const PriorAlignment alignment : kAlignments)
        for (const auto quantity :
             {PriorQuantity::depth, PriorQuantity::inverse_depth, PriorQuantity::log_depth})
            for (const auto geometry : {PriorGeometry::z, PriorGeometry::ray})
                if (unknowns(alignment) >= unknowns(least))
                    all.push_back({quantity, geometry, alignment});
    return all;
}

/// Tests only the order.
PriorReading choose_order(const std::vector<const PriorSamples*>& views,
                          const DepthConvention& convention,
                          PriorReading usual,
                          const std::string& who) {
    const double rho = agreement(views, usual.quantity);
    if (rho >= -0.3) return usual;
    const PriorQuantity other = usual.quantity == PriorQuantity::inverse_depth
                                    ? PriorQuantity::depth
                                    : PriorQuantity::inverse_depth;
    if (convention.quantity != PriorQuantity::unknown)
        throw Error(ExitCode::input, "E_PRIORS: ", who, " have the reverse order of ",
                    text_of(usual), " (rank correlation ", std::round(100 * rho) / 100,
                    "); set priors.quantity to ", name_of(other));
    usual.quantity = other;
    return usual;
}

}  // namespace

std::string text_of(const PriorReading& reading) {
    const char* const quantity = reading.quantity == PriorQuantity::inverse_depth ? "inverse depth"
                                 : reading.quantity == PriorQuantity::log_depth   ? "log depth"
                                                                                  : "depth";
    return str(quantity, reading.geometry == PriorGeometry::ray ? " along the ray" : "");
}

ReadingChoice choose_reading(const std::vector<PriorSamples>& views,
                             const DepthConvention& convention,
                             double max_residual) {
    const bool declared = !convention.declared_by.empty();
    ReadingChoice choice;
    PriorReading& usual = choice.reading;
    usual.alignment = convention.alignment;
    if (convention.quantity != PriorQuantity::unknown) usual.quantity = convention.quantity;
    if (convention.geometry != PriorGeometry::unknown) usual.geometry = convention.geometry;

    std::vector<const PriorSamples*> used;
    std::size_t points = 0;
    for (const PriorSamples& samples : views)
        if (samples.size() >= kFewestToTest) used.push_back(&samples), points += samples.size();
    choice.tested_views = static_cast<int>(used.size());
    if (used.empty()) return choice;
    const std::string against =
        str(" against ", points, " points in ", used.size(), used.size() == 1 ? " view" : " views");
    const std::string where = declared ? convention.declared_by : "the depth maps";
    if (usual.alignment == PriorAlignment::rank) {
        usual = choose_order(used, convention, usual, str(where, ": the numbers", against));
        return choice;
    }

    // 1. Tests all readings. Those that `convention` excludes help to explain an error.
    std::vector<Tested> tested;
    for (const PriorReading& reading : readings(usual.alignment))
        tested.push_back(test_reading(reading, used));
    const auto may_be_taken = [&](const PriorReading& r) {
        return !declared || (r.alignment == usual.alignment &&
                             (convention.quantity == PriorQuantity::unknown ||
                              r.quantity == convention.quantity) &&
                             (convention.geometry == PriorGeometry::unknown ||
                              r.geometry == convention.geometry));
    };
    // 2. Keeps the assumed reading unless another is clearly better; fewest unknowns first.
    Tested chosen = *std::ranges::find_if(tested, [&](const Tested& t) {
        return t.reading.quantity == usual.quantity && t.reading.geometry == usual.geometry &&
               t.reading.alignment == usual.alignment;
    });
    for (const PriorAlignment alignment : kAlignments) {
        std::vector<Tested> open;
        for (const Tested& t : tested)
            if (t.reading.alignment == alignment && may_be_taken(t.reading)) open.push_back(t);
        if (open.empty() || !is_clearly_better(best_of(open), chosen)) continue;
        chosen = best_of(open);
    }

    // 3. Reports contradictions.
    std::vector<Tested> alike;
    for (const Tested& t : tested)
        if (t.reading.alignment == usual.alignment) alike.push_back(t);
    const Tested& rival = best_of(alike);
    if (rival.residual <= max_residual && is_clearly_better(rival, chosen))
        throw Error(ExitCode::input, "E_PRIORS: ", where, ": ", text_of(chosen.reading), against,
                    " fits ", percent(chosen.residual), ", ", text_of(rival.reading), " fits ",
                    percent(rival.residual), "; set the quantity (priors.quantity) to ",
                    name_of(rival.reading.quantity), " and the geometry to ",
                    name_of(rival.reading.geometry));
    if (!(chosen.residual <= max_residual))
        throw Error(
            ExitCode::input, "E_PRIORS: ", where, ": the numbers", against,
            " do not fit within priors.max_residual = ", max_residual, ":", table_of(tested),
            "\n  Are they the maps of these photographs, in the frame of this scene? To ignore "
            "them give priors.source=stereo");
    choice.reading = chosen.reading;
    choice.residual = chosen.residual;
    return choice;
}

}  // namespace tvsgs
