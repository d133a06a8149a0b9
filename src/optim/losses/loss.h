// The interface of a loss term, the options of all terms, and the list to which programs add terms.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/options.h"
#include "core/scene/prior_maps.h"
#include "core/scene/state.h"
#include "optim/views/device_view.h"
#include "optim/views/neighbour_views.h"
#include "render/backbone.h"
#include "tv/voting.h"

namespace tvsgs {

/// Reads the terms of a sum from an array.
struct ReadValue {
    Span<const float> values;
    TVSGS_HD float operator()(int i) const { return values[i]; }
};

/// Counts the numbers above 0: returns 1 for such a number, else 0.
struct CountPositive {
    Span<const float> values;
    TVSGS_HD int operator()(int i) const { return values[i] > 0; }
};

/// Sum of the terms and its derivatives.
template <class Device>
struct Objective {
    ImageGradients<Device> dL_dimages;
    Gaussians<Device> dL_dgaussians;
    Buffer<double, Device> values;   // [terms] weighted
    int term = 0;                    // index of the term that adds now
    Buffer<double, Device> partial;  // scratch of add_sum
    Buffer<double, Device> count;    // [1] scratch: divisor of a mean

    /// The value of the current term, in device memory.
    double* value() { return values.data() + term; }
    /// Adds the sum of the numbers to the value of the current term.
    void add(const Buffer<float, Device>& numbers) {
        add_sum(Device{}, int(numbers.size()), ReadValue{numbers.span()}, 1, partial.span(),
                value());
    }
    /// Sets `count` to the sum of n terms.
    template <class Term>
    void count_of(int n, const Term& counted) {
        count.fill_zero();
        add_sum(Device{}, n, counted, 1, partial.span(), count.data());
    }
};

template <class Device>
struct LossInputs {
    const Gaussians<Device>& gaussians;
    const RenderedImages<Device>& images;
    const DeviceView<Device>& view;
    const TensorField<Device>& field;
    Span<const float> radii_px;  // [N] > 0: visible in this view
    int step;
    NeighbourViews<Device>* others = nullptr;  // null: the view has no neighbour view
};

/// Inputs that a term needs besides the rendered colours.
struct LossNeeds {
    Maps maps = Maps::none;  // maps of the view's render
    /// The term gets at most `neighbour_views` neighbour views, and does not act for a view that
    /// has none. The first `rendered_views` of them are rendered and compared.
    int neighbour_views = 0, rendered_views = 0;
    bool edges = false;            // DeviceView::edge_min and edge_max of the photographs
    bool grey = false;             // DeviceView::grey of the photographs
    MapNames view_maps{};          // DeviceView::map(); a view may lack them
    bool targets = false;          // TensorField::targets
    bool splat_gradients = false;  // writes to Objective::dL_dgaussians, which has geometry only
    bool thickness = false;        // splats must have a thickness; see BackboneTraits::flat
    int kept_per_pixel = 0;        // floats that the term stores per pixel of each view
};
inline LossNeeds& operator|=(LossNeeds& a, const LossNeeds& b) {
    a.maps |= b.maps;
    a.neighbour_views = std::max(a.neighbour_views, b.neighbour_views);
    a.rendered_views = std::max(a.rendered_views, b.rendered_views);
    a.edges |= b.edges, a.grey |= b.grey;
    a.view_maps.insert(b.view_maps.begin(), b.view_maps.end());
    a.targets |= b.targets, a.splat_gradients |= b.splat_gradients, a.thickness |= b.thickness;
    a.kept_per_pixel += b.kept_per_pixel;
    return a;
}

/// A and B of each view, see optim/photo/exposure.h.
inline constexpr int kExposureValues = 2;
using HeldExposures = std::vector<std::array<float, kExposureValues>>;

/// One term of the objective. It holds its weight and schedule, and declares its inputs.
template <class Device>
class Loss {
public:
    virtual ~Loss() = default;

    // make_losses() sets these:
    std::string key;  // name of the term in the list
    int start = 1;    // first iteration

    /// Whether the term acts at `step`; add_to() is called only if it does.
    virtual bool active(int step) const { return step >= start; }

    virtual LossNeeds needs() const = 0;

    /// Whether the term's image gradients refine cameras; only the first term may return true.
    virtual bool has_camera_gradient() const { return false; }

    /// The inputs, a subset of needs(), that the term uses at one step with one view.
    virtual LossNeeds needs_at(int /*step*/, int /*view*/) const { return needs(); }

    /// Adds weight * L to the value and its derivatives to `objective`; never overwrites.
    virtual void add_to(Objective<Device>& objective, const LossInputs<Device>& in) = 0;

    /// A term that keeps state between steps has to visit it here; else resumed runs differ.
    virtual void state(StateVisitor<Device>& /*visit*/) {}

    /// Exposures of the photographs, fitted or held; empty: none.
    virtual HeldExposures exposures() const { return {}; }
};

/// Returns a prior map of a view, [height width channels]; empty if the view has no such map.
/// Throws Error(ExitCode::input) if the map's size differs from the photograph's.
template <class Device>
Span<const float> prior_values(const DeviceView<Device>& view,
                               std::string_view name,
                               int channels = 1) {
    const DeviceMap<Device>* const map = view.map(name);
    if (map == nullptr) return {};
    const Camera& c = view.camera;
    if (map->width_px != c.width_px || map->height_px != c.height_px || map->channels != channels)
        throw Error(ExitCode::input, "prior map '", name, "' of view ", view.index, " has ",
                    map->width_px, " x ", map->height_px, " pixels of ", map->channels,
                    " values; expected the photograph's ", c.width_px, " x ", c.height_px, " of ",
                    channels);
    return map->values.span();
}

/// Whether the value is finite.
TVSGS_HD inline bool is_number(float value) {
    return value * 0 == 0;
}

/// Returns the confidence at a pixel; 1 if the view has no confidence map.
TVSGS_HD inline float confidence_at(Span<const float> confidence, int at) {
    return confidence.empty() ? 1.0f : confidence[at];
}

enum class Reduction { mean, sum, visible_mean };

/// Unit of terms that measure lengths (flatten, tv_position). The published weights suit scenes
/// normalised to about a unit sphere.
enum class LengthUnit { world, depth };

/// Options of terms that need only a weight and a first iteration.
struct ScheduledOptions {
    float weight = 0;
    int start = 1;

    template <class Visitor>
    void fields(Visitor& field) {
        field("weight", weight, {0, 1e6}, "weight of the term; 0: off");
        field("start", start, {1, 1e9}, "first iteration of the term");
    }
    template <class Options, class Visit>
    static void first_iterations(Options& o, const Visit& visit) {
        visit("start", o.start);
    }
};

struct SharedLossOptions {
    ViewPairOptions multi_view;
    Reduction tv_reduction = Reduction::mean;
    LengthUnit length_unit = LengthUnit::world;

    template <class Visitor>
    void fields(Visitor& field) {
        field.group("multi_view", multi_view, "neighbour views, for the terms that compare views");
        field.choice("tv_reduction", tv_reduction, {"mean", "sum", "visible_mean"},
                     "sum of the two voting terms over splats");
        field.choice("length_unit", length_unit, {"world", "depth"},
                     "unit of lengths in flatten and tv_position; world: world units; depth: a "
                     "third of the median depth of the start cloud");
    }
};

/// Properties of the training that terms depend on.
struct LossContext {
    float length_unit = 1;  // length of a unit, world units
    int views = 1;          // number of training views
    std::uint64_t seed = 0;
    PixelCenter pixel_center = PixelCenter::exact;
    SharedLossOptions shared{};
};

/// A term of the list; a training uses it if its weight is above 0.
struct TermOnList {
    std::string key;
    float weight;
    LossNeeds needs;
};

/// Adds a program's own term to the list; every training that starts afterwards can use it.
template <class Device>
using MakeLoss = std::function<std::unique_ptr<Loss<Device>>(const LossContext&)>;
template <class Device>
void add_loss(const TermOnList& term, MakeLoss<Device> make);

}  // namespace tvsgs
