// Judges a surface by the views' depth maps: which views see it, and which look through it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"
#include "core/scene/view_frustum.h"

namespace tvsgs {

/// The depth map of a view, on the host.
struct EvidenceView {
    Camera camera;
    std::vector<float> depth;             // [H W] z-depth; 0: unknown
    std::vector<float> weight;            // [H W] of mesh/fuse/pixel_trust.h
    std::vector<std::uint8_t> mask = {};  // [H W] 255: object; empty: everything
};

/// The depth maps of a scene: view(i) for i in [0, count), any number of times.
struct EvidenceSource {
    int count = 0;
    std::function<EvidenceView(int)> view;
};

/// A small surface element.
struct SurfaceSample {
    Vec3f point;
    Vec3f normal;  // out of the surface; its length is the area
};

/// Verdict of a view on a sample. It sees the sample if its depth agrees and the sample faces it.
/// It looks through the sample if its depth is behind the sample and the pixel is trusted, and past
/// it if the pixel is not trusted. Without depth, and outside of the view's mask, the sample is off
/// the object. [docs/method/evidence.md#how-a-view-judges-a-face]
enum class Verdict : std::uint8_t {
    nothing,
    sees,
    sees_surely,
    looks_through,
    looks_past,
    off_object
};

inline bool is_seen(Verdict v) {
    return v == Verdict::sees || v == Verdict::sees_surely;
}
/// Whether the verdict rules out a surface that no view sees.
inline bool contradicts(Verdict v) {
    return v == Verdict::looks_through || v == Verdict::looks_past || v == Verdict::off_object;
}

/// Verdict of a view, and the number of its pixels that the sample covers.
struct Judgement {
    Verdict verdict = Verdict::nothing;
    float pixels = 0;
};
Judgement judge(const EvidenceView& view, const SurfaceSample& sample);

/// Numbers of views.
struct Evidence {
    std::uint16_t sees = 0, surely = 0;  // surely: with a trusted pixel
};
/// Called after each view with its judgements of all samples.
using OnJudged = std::function<void(const std::vector<Judgement>&)>;

/// Gathers the evidence of all views for each sample; without samples it requests no view. Holds
/// one view's map at a time. The result does not depend on the number of threads.
std::vector<Evidence> gather_evidence(const EvidenceSource& source,
                                      const std::vector<SurfaceSample>& samples,
                                      const OnJudged& on_judged = {});

/// Runs of consecutive samples with their bounding boxes: a view of a long scene sees few runs.
class SampleRuns {
public:
    static constexpr std::size_t kSize = 1024;
    explicit SampleRuns(const std::vector<SurfaceSample>& samples);

    int count() const { return static_cast<int>(boxes_.size()); }
    /// First sample of a run, and one past its last.
    std::size_t begin(int run) const { return static_cast<std::size_t>(run) * kSize; }
    std::size_t end(int run) const { return std::min(samples_, begin(run + 1)); }
    /// Whether no sample of the run is in view.
    bool misses(const ViewFrustum& view, int run) const { return view.misses(boxes_[run]); }

private:
    std::size_t samples_;
    std::vector<Box3f> boxes_;
};

/// One sample at the centre of each face.
std::vector<SurfaceSample> face_samples(const TriangleMesh& mesh);

/// Sets mesh.views: for each vertex, the number of views that surely see it, at most 255.
void count_views(TriangleMesh& mesh, const EvidenceSource& source);

}  // namespace tvsgs
