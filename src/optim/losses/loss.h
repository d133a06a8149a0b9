// The interface of a loss term, the options of all terms, and the list to which programs add terms.
#pragma once

#include <algorithm>
#include <array>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/device/parallel.h"
#include "core/options.h"
#include "core/scene/state.h"
#include "optim/views/device_view.h"
#include "optim/views/neighbour_views.h"
#include "render/backbone.h"
#include "tv/voting.h"

namespace tvsgs {

/// Sum of the terms and its derivatives.
template <class Device>
struct Objective {
    ImageGradients<Device> dL_dimages;
    Gaussians<Device> dL_dgaussians;
    Buffer<double, Device> values;   // [terms] weighted
    Buffer<double, Device> partial;  // scratch of add_sum
    Buffer<double, Device> count;    // [1] scratch: divisor of a mean
};

template <class Device>
struct LossInputs {
    const Gaussians<Device>& gaussians;
    const RenderedImages<Device>& images;
    const DeviceView<Device>& view;
    const TensorField<Device>& field;
    Span<const float> radii_px;  // [N] > 0: visible in this view
    int step;
    NeighbourViews<Device>* others =
        nullptr;  // at least one neighbour view; null: the view has none
};

/// Inputs that a term needs besides the rendered colours.
struct LossNeeds {
    Maps maps = Maps::none;  // of the view's render
    /// The term gets at most `neighbour_views` neighbour views, and does not act for a view without
    /// any. The first `rendered_views` of them are rendered and compared.
    int neighbour_views = 0, rendered_views = 0;
    bool edges = false;            // of photographs: DeviceView::edge_min, edge_max
    bool grey = false;             // of photographs: DeviceView::grey
    MapNames view_maps{};          // DeviceView::map(); a view may lack them
    bool targets = false;          // TensorField::targets
    bool splat_gradients = false;  // writes to Objective::dL_dgaussians, which has geometry only
    bool thickness = false;        // the splats must have one; see BackboneTraits::flat
    int kept_per_pixel = 0;        // floats that the term stores per pixel of each view
};
inline LossNeeds& operator|=(LossNeeds& a, const LossNeeds& b) {
    a.maps |= b.maps;
    a.neighbour_views = std::max(a.neighbour_views, b.neighbour_views);
    a.rendered_views = std::max(a.rendered_views, b.rendered_views);
    a.edges |= b.edges, a.grey |= b.grey;
    for (const std::string_view name : b.view_maps) a.view_maps.add(name);
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

    std::string key;  // in the list; make_losses() sets it

    /// Whether the term acts at `step`; add_to() is only called then.
    virtual bool active(int step) const = 0;

    virtual LossNeeds needs() const = 0;

    /// Whether the derivatives by its render refine cameras. It has to be the first term, as terms
    /// after it add to the same buffers.
    virtual bool has_camera_gradient() const { return false; }

    /// Needs at one step with one view; a subset of needs(). For terms that do not use neighbour
    /// views at every step.
    virtual LossNeeds needs_at(int /*step*/, int /*view*/) const { return needs(); }

    /// Adds weight * L to *value and its derivatives to `objective`; never overwrites.
    virtual void add_to(Objective<Device>& objective,
                        double* value,
                        const LossInputs<Device>& in) = 0;

    /// A term that keeps state between steps has to visit it here; else checkpoints lack the state,
    /// and resumed runs differ.
    virtual void state(StateVisitor<Device>& /*visit*/) {}

    /// Exposures of the photographs, fitted or held; empty: none.
    virtual HeldExposures exposures() const { return {}; }
};

/// Reads the terms of a sum from an array.
struct ReadValue {
    Span<const float> values;
    TVSGS_HD float operator()(int i) const { return values[i]; }
};

enum class Reduction { mean, sum, visible_mean };

/// World units that count as length 1 in terms that measure lengths (flatten, tv_position). The
/// published weights suit scenes normalised to about a unit sphere; with plain world units a scene
/// in millimetres would get other weights than one in metres.
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

/// Options that several terms share.
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

/// A term of the list, in use or not.
struct TermOnList {
    std::string key;
    float weight;
    LossNeeds needs;
};

/// Adds a term, defined by a program that links this library, to every training that starts
/// afterwards. losses_list.h has the library's own terms.
template <class Device>
using MakeLoss = std::function<std::unique_ptr<Loss<Device>>(const LossContext&)>;
template <class Device>
void add_loss(const TermOnList& term, MakeLoss<Device> make);

}  // namespace tvsgs
