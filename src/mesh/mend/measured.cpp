#include <algorithm>
#include <array>
#include <cmath>

#include "core/progress.h"
#include "mesh/draw/mesh_render.h"
#include "mesh/fuse/depth_view.h"
#include "mesh/mend/mend.h"
#include "mesh/mend/mesh_corners.h"

namespace tvsgs {
namespace {

constexpr int kRadius = 2, kSide = 2 * kRadius + 1;  // of a patch, in steps
constexpr float kAlike = 0.3f;      // correlation; noise of two photographs has about 0
constexpr float kMinCosine = 0.1f;  // flatter views do not resolve a patch
constexpr int kSteps = 20;          // of averaging over neighbours: about 5 edges, of a pixel each
constexpr float kEncloses = 0.25f;  // share of measured surface at a pixel that ends open pixels
constexpr float kSingle = 0.25f;    // weight of a vertex that a single view sees: nothing denies it
constexpr std::size_t kMaxSamples = 150'000;  // more change F1 by .001

using Patch = std::array<float, kSide * kSide>;

float dot(const Patch& a, const Patch& b) {
    float sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
    return sum;
}

/// The pixels around a vertex, on its tangent plane.
struct PatchFrame {
    Vec3f centre, x, y;  // x, y: from pixel to pixel
};

/// The spacing is the geometric mean over the views in front: finer patches would be blurred in
/// most views, coarser ones too coarse for noise in all.
PatchFrame frame_of(const std::vector<View>& views, const SurfaceSample& sample) {
    const Vec3f n = (1 / norm(sample.normal)) * sample.normal;
    float sum = 0;
    int count = 0;
    for (const View& view : views) {
        const Camera& c = view.camera;
        const Vec3f to = camera_centre(c) - sample.point;
        if (!(dot(n, to) > kMinCosine * norm(to)) || !is_in_view(c, sample.point)) continue;
        sum += std::log((c.camera_from_world * sample.point).z / c.fx_px), ++count;
    }
    const float step = count > 0 ? std::exp(sum / static_cast<float>(count)) : 0;
    const Vec3f across = cross(n, std::fabs(n.x) < 0.9f ? Vec3f{1, 0, 0} : Vec3f{0, 1, 0});
    const Vec3f x = (step / norm(across)) * across;
    return {sample.point, x, cross(n, x)};
}

float grey_at(const ImageU8& grey, float u, float v) {
    const auto limited = [](float t, int size) {
        return std::fmin(std::fmax(t - 0.5f, 0.0f), static_cast<float>(size - 1));
    };
    const float x = limited(u, grey.width), y = limited(v, grey.height);
    const int i = static_cast<int>(x), j = static_cast<int>(y),
              i1 = std::min(i + 1, grey.width - 1), j1 = std::min(j + 1, grey.height - 1);
    const float a = x - static_cast<float>(i), b = y - static_cast<float>(j);
    const auto mix = [&](int row) {
        return (1 - a) * static_cast<float>(grey.at(i, row)) +
               a * static_cast<float>(grey.at(i1, row));
    };
    return (1 - b) * mix(j) + b * mix(j1);
}

/// The texture of a patch in a photograph: its grey values without their mean and slope, of length
/// 1. A gradient of the sky looks the same at any depth, therefore the slope does not count. 0 if
/// the patch is flat or behind the camera.
Patch texture_of(const Camera& camera, const ImageU8& grey, const PatchFrame& frame) {
    Patch patch{};
    float sum = 0, along_x = 0, along_y = 0, squares = 0;
    for (int j = -kRadius, k = 0; j <= kRadius; ++j)
        for (int i = -kRadius; i <= kRadius; ++i, ++k) {
            const auto a = static_cast<float>(i), b = static_cast<float>(j);
            const Vec3f p = camera.camera_from_world * (frame.centre + a * frame.x + b * frame.y);
            if (!(p.z > 0)) return {};
            const float value = grey_at(grey, camera.fx_px * p.x / p.z + camera.cx_px,
                                        camera.fy_px * p.y / p.z + camera.cy_px);
            patch[k] = value;
            sum += value, along_x += a * value, along_y += b * value, squares += a * a;
        }
    const float mean = sum / (kSide * kSide);
    for (int j = -kRadius, k = 0; j <= kRadius; ++j)
        for (int i = -kRadius; i <= kRadius; ++i, ++k)
            patch[k] -= mean + (static_cast<float>(i) * along_x + static_cast<float>(j) * along_y) /
                                   squares;
    const float length = std::sqrt(dot(patch, patch));
    if (!(length > 1e-2f)) return {};  // rounding, far below one grey level
    for (float& value : patch) value /= length;
    return patch;
}

struct Agreement {
    Patch sum{};  // of the views' textures
    std::uint16_t seen = 0, alike = 0;

    bool is_measured() const { return alike >= 2 && 2 * alike >= seen; }
    float weight() const { return seen > 1 ? 1 : seen == 1 ? kSingle : 0; }
};

/// Compares each view's texture with the sum of the other ones.
std::vector<Agreement> compare_views(const EvidenceSource& source,
                                     const std::vector<View>& views,
                                     const std::vector<SurfaceSample>& samples) {
    std::vector<Agreement> found(samples.size());
    std::vector<PatchFrame> frames(samples.size());
    parallel_for(Cpu{}, static_cast<int>(samples.size()),
                 [&](int s) { frames[s] = frame_of(views, samples[s]); });
    const SampleRuns runs(samples);
    Progress progress("check against photographs", 2.0 * source.count);
    for (const bool compares : {false, true})
        for (int i = 0; i < source.count; ++i) {
            progress.advance();
            const View& own = views[i];
            if (own.photo.empty()) continue;
            const EvidenceView view = source.view(i);
            const ImageU8 grey = grey_of(own.photo);
            const ViewFrustum limits(view.camera);
            const Vec3f eye = camera_centre(view.camera);
            parallel_for_heavy(Cpu{}, runs.count(), [&](int run) {
                if (runs.misses(limits, run)) return;
                for (std::size_t s = runs.begin(run); s < runs.end(run); ++s) {
                    const Vec3f to = eye - samples[s].point;
                    if (!(dot(samples[s].normal, to) >
                          kMinCosine * norm(to) * norm(samples[s].normal)) ||
                        !is_seen(judge(view, samples[s]).verdict))
                        continue;
                    Patch patch = texture_of(view.camera, grey, frames[s]);
                    Agreement& all = found[s];
                    if (!compares) {
                        ++all.seen;
                        for (std::size_t k = 0; k < patch.size(); ++k) all.sum[k] += patch[k];
                    } else {
                        Patch others = all.sum;
                        for (std::size_t k = 0; k < patch.size(); ++k) others[k] -= patch[k];
                        // Of two views, both count or none.
                        all.alike += dot(others, patch) > kAlike * std::sqrt(dot(others, others));
                    }
                }
            });
        }
    return found;
}

/// The mean around each vertex; a vertex of weight 0 takes that of its neighbours. 0: no weight
/// around.
std::vector<float> averaged(const TriangleMesh& mesh, std::vector<Vec2f> sum_and_weight) {
    const Corners corners(mesh);
    std::vector<Vec2f> next(sum_and_weight.size());
    const int vertices = static_cast<int>(next.size());
    for (int step = 0; step < kSteps; ++step) {
        parallel_for(Cpu{}, vertices, [&](int v) {
            Vec2f sum = sum_and_weight[v];
            float count = 1;
            corners.for_each(v, [&](std::uint32_t f, int k) {
                for (const int other : {(k + 1) % 3, (k + 2) % 3}) {
                    const Vec2f near = sum_and_weight[mesh.faces[f][other]];
                    sum = {sum.x + 0.5f * near.x, sum.y + 0.5f * near.y};
                }
                ++count;
            });
            next[v] = {sum.x / count, sum.y / count};
        });
        next.swap(sum_and_weight);
    }
    std::vector<float> mean(next.size());
    parallel_for(Cpu{}, vertices, [&](int v) {
        const Vec2f at = sum_and_weight[v];
        mean[v] = at.y > 1e-6f ? at.x / at.y : 0;
    });
    return mean;
}

double area_of(const TriangleMesh& mesh, Vec3i face) {
    const Vec3f a = mesh.vertices[face.x];
    return 0.5 * double(norm(cross(mesh.vertices[face.y] - a, mesh.vertices[face.z] - a)));
}

/// Whether each pixel of a view is open: pixels without measured surface connect it to the border.
std::vector<char> open_pixels(int width, int height, const std::vector<char>& measured) {
    std::vector<char> open(measured.size());
    std::vector<int> reached;
    const auto reach = [&](int x, int y) {
        if (x < 0 || y < 0 || x >= width || y >= height) return;
        const int i = y * width + x;
        if (measured[i] || open[i]) return;
        open[i] = 1;
        reached.push_back(i);
    };
    for (int x = 0; x < width; ++x) reach(x, 0), reach(x, height - 1);
    for (int y = 0; y < height; ++y) reach(0, y), reach(width - 1, y);
    while (!reached.empty()) {
        const int x = reached.back() % width, y = reached.back() / width;
        reached.pop_back();
        reach(x - 1, y), reach(x + 1, y), reach(x, y - 1), reach(x, y + 1);
    }
    return open;
}

/// The share of open pixels around each vertex, over all views. `measured`: the share of measured
/// surface around it.
std::vector<float> open_around(const TriangleMesh& mesh,
                               const std::vector<View>& views,
                               const std::vector<float>& measured) {
    std::vector<Vec2f> open_and_all(mesh.vertices.size());
    for (const View& view : views) {
        const Image<int> faces = render_faces(mesh, view.camera);
        std::vector<char> ends(faces.pixels.size());
        for (std::size_t i = 0; i < ends.size(); ++i)
            if (faces.pixels[i] >= 0) {
                const Vec3i face = mesh.faces[faces.pixels[i]];
                ends[i] = measured[face.x] + measured[face.y] + measured[face.z] >= 3 * kEncloses;
            }
        const std::vector<char> open = open_pixels(faces.width, faces.height, ends);
        for (std::size_t i = 0; i < open.size(); ++i)
            if (faces.pixels[i] >= 0)
                for (int k = 0; k < 3; ++k) {
                    Vec2f& at = open_and_all[mesh.faces[faces.pixels[i]][k]];
                    at.x += open[i], at.y += 1;
                }
    }
    return averaged(mesh, std::move(open_and_all));
}

}  // namespace

MeasuredReport keep_measured_faces(TriangleMesh& mesh,
                                   const EvidenceSource& source,
                                   const std::vector<View>& views,
                                   float share) {
    const auto photos =
        std::ranges::count_if(views, [](const View& v) { return !v.photo.empty(); });
    if (photos < 2 || mesh.faces.empty()) return {};
    const std::vector<Vec3f> normals = vertex_normals(mesh);
    const std::size_t stride = (mesh.vertices.size() + kMaxSamples - 1) / kMaxSamples;
    std::vector<SurfaceSample> samples;
    for (std::size_t v = 0; v < mesh.vertices.size(); v += stride)
        samples.push_back({mesh.vertices[v], normals[v]});
    std::vector<Vec2f> measured(mesh.vertices.size());  // weight of measured, and of all
    {
        const std::vector<Agreement> found = compare_views(source, views, samples);
        for (std::size_t s = 0; s < found.size(); ++s)
            measured[s * stride] = {found[s].is_measured() ? 1.0f : 0.0f, found[s].weight()};
    }
    const std::vector<float> mean = averaged(mesh, std::move(measured));
    const std::vector<float> open = open_around(mesh, views, mean);
    std::vector<char> keep(mesh.faces.size());
    for (std::size_t f = 0; f < keep.size(); ++f) {
        const Vec3i face = mesh.faces[f];
        float proven = 3;  // measured or enclosed, of the corners' surroundings
        for (int k = 0; k < 3; ++k) proven += mean[face[k]] - open[face[k]];
        keep[f] = proven >= 3 * share;
    }
    double area = 0, removed = 0;
    for (std::size_t f = 0; f < keep.size(); ++f) {
        const double size = area_of(mesh, mesh.faces[f]);
        area += size, removed += keep[f] ? 0 : size;
    }
    MeasuredReport report;
    report.removed_faces = static_cast<std::size_t>(std::ranges::count(keep, 0));
    report.removed_area = area > 0 ? removed / area : 0;
    if (report.removed_faces > 0) filter_faces(mesh, keep);
    return report;
}

}  // namespace tvsgs
