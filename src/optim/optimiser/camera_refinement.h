// Poses that training may improve: how far each view has moved from where it was given.
// [docs/method/cameras.md]
#pragma once

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "core/scene/scene.h"
#include "core/scene/state.h"
#include "render/tiles/camera_math.h"

namespace tvsgs {

struct CameraOptions {
    bool refine = false;
    int start = 1000;
    float rate = 0.1f, prior = 1e-4f, bound_px = 8;

    template <class Visitor>
    void fields(Visitor& field) {
        field("refine", refine, "the training views' poses move along the photometric term");
        field("start", start, {1, 1e9}, "first iteration");
        field("rate", rate, {0, 10},
              "most pixels by which a number of a pose moves in a round of the views; less where "
              "more rounds reach bound_px with it, and falling to 0");
        field("prior", prior, {0, 1e6},
              "pull back to the given poses: half of it times the squared pixels joins the loss");
        field("bound_px", bound_px, {1e-3, 1e4},
              "no view turns or shifts farther than that, pixels at the scene's depth");
    }
};

/// How far a view is from where it was given.
struct CameraMove {
    double turn_px, shift_px;  // lengths; a pixel is what moves the image of the scene by one
    double turn_deg;
};

/// Poses of all training views with Adam's moments, on the host: they are few, and step once in a
/// round, when each view has been looked at. Numbers are in pixels: a turn of x moves what the
/// camera sees by f x pixels, a shift of x what is at the scene's depth d by f x / d.
class CameraRefinement {
public:
    CameraRefinement(const Scene& scene, const CameraOptions& options);

    int views() const { return static_cast<int>(given_.size()); }

    /// From `gradients` [views kCameraNumbers], as CameraGradient has them; those of a view that
    /// are not all finite count as 0. What all views could do together, a similarity of the whole
    /// scene, is taken out: it would change the frame and no image.
    void step(const std::vector<double>& gradients, double rate);

    const std::vector<Camera>& cameras() const { return cameras_; }
    CameraMove move(int view) const;

    /// All that steps change, to be saved and restored.
    const std::vector<double>& numbers() const { return numbers_; }
    /// Throws Error(ExitCode::input) where they, or so many gradients, are those of another number
    /// of views.
    void restore(std::vector<double> numbers, std::size_t gradients);

private:
    struct PixelScale {
        double f, depth;  // px; world units
    };

    std::size_t parameters() const { return 6 * given_.size(); }
    double* motion(int view) { return numbers_.data() + 6 * view; }
    const double* motion(int view) const { return numbers_.data() + 6 * view; }
    void find_gauge();
    void remove_gauge();
    void keep_bounds();
    void place();

    CameraOptions options_;
    std::vector<Camera> given_, cameras_;
    std::vector<PixelScale> scale_;
    // Turn and shift of each view, px; then both moments of these; then the number of steps.
    std::vector<double> numbers_;
    std::vector<std::vector<double>> gauge_;  // [6 views] directions, each before its dual
};

/// The refinement in a training on `Device`. Off: it holds nothing.
template <class Device>
class TrainedCameras {
public:
    TrainedCameras(const Scene& scene, const CameraOptions& options) : options_(options) {
        if (!options.refine) return;
        refined_.emplace(scene, options);
        gradients_.resize(static_cast<std::size_t>(kCameraNumbers * refined_->views()));
        gradients_.fill_zero();
    }

    /// Where the derivatives by the camera of `view` are added at that step; empty: nowhere.
    Span<double> gradient_of(int step, int view) {
        if (!active(step)) return {};
        return {gradients_.data() + kCameraNumbers * view, kCameraNumbers};
    }

    /// After each step; after the last one of a round the poses step.
    void step_done(int step, int iterations) {
        if (!active(step) || step % refined_->views() != 0 || step >= iterations) return;
        const double all = iterations - options_.start + 1, left = (iterations - step) / all;
        const double reach = 2 * static_cast<double>(options_.bound_px) * refined_->views() / all;
        refined_->step(to_host(gradients_),
                       std::min(static_cast<double>(options_.rate), reach) * left);
        gradients_.fill_zero();
        moved_ = true;
    }

    /// Once after each change, and at first: where the cameras are now; null: where they were.
    const CameraRefinement* take_moved() {
        const bool moved = moved_ && refined_;
        moved_ = false;
        return moved ? &*refined_ : nullptr;
    }

    /// A run that goes on may begin to refine.
    void state(StateVisitor<Device>& visit) {
        if (!refined_) return;
        Buffer<double, Device> numbers;
        copy(refined_->numbers(), numbers);
        visit.optional("cameras.numbers", numbers);
        visit.optional("cameras.gradients", gradients_);
        if (visit.loading()) refined_->restore(to_host(numbers), gradients_.size());
    }

private:
    bool active(int step) const { return refined_ && step >= options_.start; }

    CameraOptions options_;
    std::optional<CameraRefinement> refined_;
    Buffer<double, Device> gradients_;  // [views kCameraNumbers] of the round so far
    bool moved_ = true;
};

}  // namespace tvsgs
