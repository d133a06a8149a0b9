// What the views' depth maps say of a surface: which views see it there, and which look through it.
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/mesh.h"
#include "core/scene/sight_limits.h"

namespace tvsgs {

/// The depth map of a view, on the host.
struct EvidenceView {
    Camera camera;
    std::vector<float> depth;             // [H W] z-depth; 0: nothing known
    std::vector<float> weight;            // [H W] of mesh/fuse/pixel_trust.h
    std::vector<std::uint8_t> mask = {};  // [H W] 255: object; empty: everything
};

/// The depth maps of a scene: view(i) for i in [0, count), any number of times.
struct EvidenceSource {
    int count = 0;
    std::function<EvidenceView(int)> view;
};

/// A small piece of surface.
struct SurfaceSample {
    Vec3f point;
    Vec3f normal;  // out of the surface, as long as the piece has area
};

/// What a view says of a sample. It sees it if its depth there agrees and it faces the view, and it
/// looks through it if its depth is behind it and the pixel trusted; else it looks past it. What
/// has no depth and is outside of its mask is off the object.
/// [docs/method/evidence.md#how-a-view-judges-a-face]
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
/// Whether a surface that nothing else speaks for cannot be there.
inline bool contradicts(Verdict v) {
    return v == Verdict::looks_through || v == Verdict::looks_past || v == Verdict::off_object;
}

/// Verdict of a view, and pixels of its image that the sample covers.
struct Judgement {
    Verdict verdict = Verdict::nothing;
    float pixels = 0;
};
Judgement judge(const EvidenceView& view, const SurfaceSample& sample);

/// Numbers of views.
struct Evidence {
    std::uint16_t sees = 0, surely = 0;  // the latter with a trusted pixel
};
/// Called after each view with its judgements of all samples.
using OnJudged = std::function<void(const std::vector<Judgement>&)>;

/// What all views say of each sample; without samples no view is asked for. One view's map at a
/// time is in memory; the number of threads does not matter.
std::vector<Evidence> gather_evidence(const EvidenceSource& source,
                                      const std::vector<SurfaceSample>& samples,
                                      const OnJudged& on_judged = {});

/// Runs of samples that follow each other, with the boxes that they lie in: a view of a long scene
/// sees few of them.
class SampleRuns {
public:
    static constexpr std::size_t kSize = 1024;
    explicit SampleRuns(const std::vector<SurfaceSample>& samples);

    int count() const { return static_cast<int>(boxes_.size()); }
    /// Of a run: its first sample, and one past its last.
    std::size_t begin(int run) const { return static_cast<std::size_t>(run) * kSize; }
    std::size_t end(int run) const { return std::min(samples_, begin(run + 1)); }
    /// Whether the view has nothing to say of any sample of the run.
    bool misses(const SightLimits& view, int run) const {
        return view.misses(boxes_[static_cast<std::size_t>(run)]);
    }

private:
    std::size_t samples_;
    std::vector<Box3f> boxes_;
};

/// A sample in the middle of each face.
std::vector<SurfaceSample> face_samples(const TriangleMesh& mesh);

/// Sets mesh.views: of each vertex, the number of views that surely see it, at most 255.
void count_views(TriangleMesh& mesh, const EvidenceSource& source);

}  // namespace tvsgs
