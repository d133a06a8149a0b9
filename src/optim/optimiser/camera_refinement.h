// Refines camera poses during training; stores how far each view has moved from its given pose.
// [docs/method/cameras.md]
#pragma once

#include <algorithm>
#include <optional>
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
        field("refine", refine, "refine the poses of the training views by the photometric term");
        field("start", start, {1, 1e9}, "first iteration of the refinement");
        field("rate", rate, {0, 10},
              "largest step of a pose number per round of all views, pixels; decays to 0");
        field("prior", prior, {0, 1e6},
              "pull to the given poses: half of it times the squared pixels is a loss; 0: none");
        field("bound_px", bound_px, {1e-3, 1e4},
              "largest turn and shift of a view, pixels at the depth of the scene");
    }
};

/// Distance of a view from its given pose.
struct CameraMove {
    double turn_px, shift_px;  // lengths; 1 px moves the image of the scene by one pixel
    double turn_deg;
};

/// Poses of all training views with Adam's moments, on the host; they step once per round of all
/// views. In pixels: a rotation of x moves the image by f x, a translation of x moves points at the
/// scene's depth d by f x / d.
class CameraRefinement {
public:
    CameraRefinement(const Scene& scene, const CameraOptions& options);

    int views() const { return int(given_.size()); }

    /// Takes a step along `gradients` [views kCameraParameters], laid out as CameraGradient; those
    /// of a view count as 0 unless all are finite. Removes the motion that all views share: a
    /// similarity transform of the scene changes no image.
    void step(const std::vector<double>& gradients, double rate);

    const std::vector<Camera>& cameras() const { return cameras_; }
    CameraMove move(int view) const;

    /// All numbers that steps change, for saving and restoring.
    const std::vector<double>& numbers() const { return numbers_; }
    /// Throws Error(ExitCode::input) where the sizes belong to another number of views.
    void restore(std::vector<double> numbers, std::size_t gradients);

private:
    struct PixelScale {
        double f, depth;  // px; world units
    };

    std::size_t parameters() const { return 6 * given_.size(); }
    double* motion(int view) { return numbers_.data() + 6 * view; }
    const double* motion(int view) const { return numbers_.data() + 6 * view; }
    void find_gauge();
    void place();

    CameraOptions options_;
    std::vector<Camera> given_, cameras_;
    std::vector<PixelScale> scale_;
    // Rotation and translation of each view, px; then both their moments; then the number of steps.
    std::vector<double> numbers_;
    std::vector<std::vector<double>> gauge_;  // [6 views] each direction, then its dual
};

/// Camera refinement of a training on `Device`. Holds nothing when switched off.
template <class Device>
class TrainedCameras {
public:
    TrainedCameras(const Scene& scene, const CameraOptions& options) : options_(options) {
        if (!options.refine) return;
        refined_.emplace(scene, options);
        gradients_.resize(std::size_t(kCameraParameters * refined_->views()));
        gradients_.fill_zero();
    }

    /// Buffer for the derivatives by the camera of `view` at that step; empty: none are needed.
    Span<double> gradient_of(int step, int view) {
        if (!active(step)) return {};
        return {gradients_.data() + kCameraParameters * view, kCameraParameters};
    }

    /// Called after each step; the poses take a step after the last step of a round.
    void step_done(int step, int iterations) {
        if (!active(step) || step % refined_->views() != 0 || step >= iterations) return;
        const double all = iterations - options_.start + 1, left = (iterations - step) / all;
        const double reach = 2 * double(options_.bound_px) * refined_->views() / all;
        refined_->step(to_host(gradients_), std::min(double(options_.rate), reach) * left);
        gradients_.fill_zero();
        moved_ = true;
    }

    /// Returns the current cameras once after each change and once at the start; null: unchanged.
    const CameraRefinement* take_changed() {
        const bool moved = moved_ && refined_;
        moved_ = false;
        return moved ? &*refined_ : nullptr;
    }

    /// A resumed run may begin to refine, so a saved state may lack these.
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
    Buffer<double, Device> gradients_;  // [views kCameraParameters] of the round so far
    bool moved_ = true;
};

}  // namespace tvsgs
