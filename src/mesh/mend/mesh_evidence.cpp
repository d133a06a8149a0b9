#include "mesh/mend/mesh_evidence.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/device/parallel.h"
#include "core/progress.h"
#include "mesh/fuse/pixel_trust.h"

namespace tvsgs {

constexpr float kLimitPx = 3;  // between surface and depth, in pixel widths

Judgement judge(const EvidenceView& view, const SurfaceSample& sample) {
    const Camera& camera = view.camera;
    const Vec3f p = camera.camera_from_world * sample.point;
    if (!(p.z > 0)) return {};
    const Vec3f ray{p.x / p.z, p.y / p.z, 1};
    const float u = camera.fx_px * ray.x + camera.cx_px, v = camera.fy_px * ray.y + camera.cy_px;
    if (!(u >= 0 && u < static_cast<float>(camera.width_px) && v >= 0 &&
          v < static_cast<float>(camera.height_px)))
        return {};
    const std::size_t i = static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width_px) +
                          static_cast<std::size_t>(u);
    const float depth = view.depth[i];
    if (!(depth > 0)) {
        const bool off = !view.mask.empty() && view.mask[i] == 0;
        return {off ? Verdict::off_object : Verdict::nothing, 0};
    }
    const Vec3f normal = camera.camera_from_world.R * sample.normal;
    const float toward = -dot(normal, ray);
    const SurfacePixel facing{ray, p.z, toward < 0 ? -normal : normal};
    const float limit = kLimitPx * facing.width(camera.fx_px);
    const bool trusted = view.weight[i] >= kTrustedWeight;
    Judgement out{Verdict::nothing, std::fabs(toward) * camera.fx_px * camera.fy_px / (p.z * p.z)};
    if (p.z < depth - limit) {
        out.verdict = trusted ? Verdict::looks_through : Verdict::looks_past;
    } else if (std::fabs(p.z - depth) <= limit && toward > 0) {
        out.verdict = trusted ? Verdict::sees_surely : Verdict::sees;
    }
    return out;
}

std::vector<Evidence> gather_evidence(const EvidenceSource& source,
                                      const std::vector<SurfaceSample>& samples,
                                      const OnJudged& on_judged) {
    std::vector<Evidence> evidence(samples.size());
    if (samples.empty()) return evidence;
    std::vector<Judgement> judgements(samples.size());
    const SampleRuns runs(samples);
    // Whether a run has no verdict.
    std::vector<char> silent(static_cast<std::size_t>(runs.count()), 1);
    Progress progress("check against views", source.count);
    for (int i = 0; i < source.count; ++i) {
        progress.advance();
        const EvidenceView view = source.view(i);
        const ViewFrustum limits(view.camera);
        parallel_for_heavy(Cpu{}, runs.count(), [&](int run) {
            const bool missed = runs.misses(limits, run),
                       was_silent = std::exchange(silent[run], missed);
            if (missed && was_silent) return;
            for (std::size_t s = runs.begin(run); s < runs.end(run); ++s) {
                judgements[s] = missed ? Judgement{} : judge(view, samples[s]);
                evidence[s].sees += is_seen(judgements[s].verdict);
                evidence[s].surely += judgements[s].verdict == Verdict::sees_surely;
            }
        });
        if (on_judged) on_judged(judgements);
    }
    return evidence;
}

SampleRuns::SampleRuns(const std::vector<SurfaceSample>& samples)
    : samples_(samples.size()), boxes_((samples.size() + kSize - 1) / kSize) {
    parallel_for_heavy(Cpu{}, count(), [&](int run) {
        for (std::size_t s = begin(run); s < end(run); ++s) boxes_[run].add(samples[s].point);
    });
}

std::vector<SurfaceSample> face_samples(const TriangleMesh& mesh) {
    std::vector<SurfaceSample> samples(mesh.faces.size());
    parallel_for(Cpu{}, static_cast<int>(samples.size()), [&](int f) {
        const Vec3i face = mesh.faces[f];
        const Vec3f a = mesh.vertices[face.x], b = mesh.vertices[face.y], c = mesh.vertices[face.z];
        samples[f] = {(1.0f / 3) * (a + b + c), 0.5f * cross(b - a, c - a)};
    });
    return samples;
}

void count_views(TriangleMesh& mesh, const EvidenceSource& source) {
    const std::vector<Vec3f> normals = vertex_normals(mesh);
    std::vector<SurfaceSample> samples(mesh.vertices.size());
    for (std::size_t v = 0; v < samples.size(); ++v) samples[v] = {mesh.vertices[v], normals[v]};
    const std::vector<Evidence> evidence = gather_evidence(source, samples);
    mesh.views.resize(samples.size());
    for (std::size_t v = 0; v < samples.size(); ++v)
        mesh.views[v] = static_cast<std::uint8_t>(std::min<int>(evidence[v].surely, 255));
}

}  // namespace tvsgs
