#include <algorithm>
#include <cmath>
#include <optional>

#include "core/device/parallel.h"
#include "core/progress.h"
#include "mesh/draw/mesh_render.h"
#include "mesh/texture/texture_steps.h"

namespace tvsgs::texture {
namespace {

constexpr int kEdge = 2;                 // radius in pixels in which a surface in front matters
constexpr double kMinCosine = 0.2;       // of a view that shows a face completely
constexpr double kMinSeenCosine = 0.05;  // of a view that shows a part of a face
constexpr double kSampleStep_px = 3;     // between the sample points of a face
constexpr int kMaxSamples = 256;         // along a side of a face
constexpr float kEdgeShare = 0.1f;       // factor of the quality if a surface in front is close
constexpr int kFacesPerTask = 1024;
constexpr std::size_t kKeptPixels = std::size_t{1} << 27;  // of depth, 512 MB

Vec3f bilinear(const ImageU8& image, double u, double v) {
    const double x = u - 0.5, y = v - 0.5;
    const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
    const auto fx = static_cast<float>(x - x0), fy = static_cast<float>(y - y0);
    const auto column = [&](int i) { return std::clamp(i, 0, image.width - 1); };
    const auto row = [&](int j) { return std::clamp(j, 0, image.height - 1); };
    const std::uint8_t* const texels[4] = {
        &image.at(column(x0), row(y0)), &image.at(column(x0 + 1), row(y0)),
        &image.at(column(x0), row(y0 + 1)), &image.at(column(x0 + 1), row(y0 + 1))};
    Vec3f out;
    for (int c = 0; c < 3; ++c) {
        const float top = (1 - fx) * texels[0][c] + fx * texels[1][c];
        const float low = (1 - fx) * texels[2][c] + fx * texels[3][c];
        out[c] = ((1 - fy) * top + fy * low) / 255;
    }
    return out;
}

/// The least depth in a square around each pixel; 0 if there is none.
ImageF least_around(const ImageF& depth, int radius) {
    // Ranks 0, no depth, last.
    const auto rank = [](float d) { return d > 0 ? d : INFINITY; };
    ImageF rows(depth.width, depth.height, 1), out(depth.width, depth.height, 1);
    parallel_for_heavy(Cpu{}, depth.height, [&](int y) {
        for (int x = 0; x < depth.width; ++x) {
            float least = INFINITY;
            for (int i = std::max(0, x - radius); i <= std::min(depth.width - 1, x + radius); ++i)
                least = std::min(least, rank(depth.at(i, y)));
            rows.at(x, y) = least;
        }
    });
    parallel_for_heavy(Cpu{}, depth.height, [&](int y) {
        const int first = std::max(0, y - radius), last = std::min(depth.height - 1, y + radius);
        for (int x = 0; x < depth.width; ++x) out.at(x, y) = rows.at(x, first);
        for (int j = first + 1; j <= last; ++j)
            for (int x = 0; x < depth.width; ++x)
                out.at(x, y) = std::min(out.at(x, y), rows.at(x, j));
        for (int x = 0; x < depth.width; ++x)
            if (out.at(x, y) == INFINITY) out.at(x, y) = 0;
    });
    return out;
}

/// Calls look(point) for points spread over a triangle.
template <class Look>
void for_places(const Vec3d (&corners)[3], int n, const Look& look) {
    const auto at = [&](double i, double j) {
        const double b = i / n, c = j / n;
        return corners[0] + b * (corners[1] - corners[0]) + c * (corners[2] - corners[0]);
    };
    constexpr double kThird = 1.0 / 3;
    for (int j = 0; j < n; ++j)  // the centres of its n^2 subtriangles
        for (int i = 0; i + j < n; ++i) {
            look(at(i + kThird, j + kThird));
            if (i + j + 1 < n) look(at(i + 2 * kThird, j + 2 * kThird));
        }
}

double length(double x, double y) {
    return std::sqrt(x * x + y * y);
}

/// Judges faces in one view with its occlusion maps.
struct FaceJudge {
    const PhotoView& view;
    int index;
    const SightMaps& maps;
    const std::vector<Vec3d>& vertices;  // of the mesh, in the camera frame

    struct Found {
        bool seen = false;  // any part of it
        float pixel = 0;    // at its centre
        std::optional<Candidate> all;
    };

    /// How the view shows a face.
    Found judge(Vec3i face) const {
        Found out;
        const Vec3d corners[3] = {vertices[face.x], vertices[face.y], vertices[face.z]};
        const Vec3d centre = (corners[0] + corners[1] + corners[2]) / 3;
        const Vec3d normal = cross(corners[1] - corners[0], corners[2] - corners[0]);
        const double cosine =
            -dot(normal, centre) / std::sqrt(dot(normal, normal) * dot(centre, centre));
        if (!(cosine > kMinSeenCosine)) return out;
        if (!(corners[0].z > 0 && corners[1].z > 0 && corners[2].z > 0)) return out;
        Projection p[3];
        bool inside = cosine > kMinCosine;
        const double w = view.camera.width_px, h = view.camera.height_px;
        for (int c = 0; c < 3; ++c) {
            p[c] = view.project_from_camera(corners[c]);
            inside = inside && p[c].u >= 1 && p[c].v >= 1 && p[c].u <= w - 1 && p[c].v <= h - 1;
        }
        double longest = 0;
        for (int c = 0; c < 3; ++c) {
            const Projection& q = p[(c + 1) % 3];
            longest = std::max(longest, length(p[c].u - q.u, p[c].v - q.v));
        }
        const int n = static_cast<int>(
            std::clamp(std::ceil(longest / kSampleStep_px), 1.0, double{kMaxSamples}));
        const double width = 1 / (view.camera.fx_px * std::max(cosine, 0.1));
        bool all = true, edge = false;
        Vec3d sum;
        int count = 0;
        for_places(corners, n, [&](Vec3d point) {
            const Projection at = view.project_from_camera(point);
            const Sight sight = sight_of(view, maps, at, at.z * width);
            out.seen = out.seen || sight != Sight::none;
            all = all && sight != Sight::none, edge = edge || sight == Sight::edge;
            if (inside && all) sum += vec_cast<double>(view.color(at.u, at.v)), ++count;
        });
        out.pixel = static_cast<float>(centre.z / view.camera.fx_px);
        if (!inside || !all) return out;
        const double area = 0.5 * std::abs((p[1].u - p[0].u) * (p[2].v - p[0].v) -
                                           (p[1].v - p[0].v) * (p[2].u - p[0].u));
        out.all = Candidate{index, static_cast<float>(area * cosine) * (edge ? kEdgeShare : 1),
                            out.pixel, vec_cast<float>(sum / count)};
        return out;
    }
};

struct FaceCandidate {
    int face;
    Candidate candidate;
};

/// Adds the candidates of several views, each sorted by face.
void add(const std::vector<std::vector<FaceCandidate>>& lists, Candidates& to) {
    const int faces = to.faces();
    std::vector<std::size_t> begin(to.begin.size(), 0);
    for (int f = 0; f < faces; ++f) begin[f + 1] = to.of(f).count;
    const auto for_each = [&](const auto& action) {  // a list contains a face at most once
        for (const auto& list : lists)
            parallel_for(Cpu{}, static_cast<int>(list.size()), [&](int i) { action(list[i]); });
    };
    for_each([&](const FaceCandidate& c) { ++begin[c.face + 1]; });
    for (int f = 0; f < faces; ++f) begin[f + 1] += begin[f];
    std::vector<Candidate> all(begin.back());
    std::vector<std::size_t> next(begin.begin(), begin.end() - 1);
    parallel_for(Cpu{}, faces, [&](int f) {
        for (const Candidate& c : to.of(f)) all[next[f]++] = c;
    });
    for_each([&](const FaceCandidate& c) { all[next[c.face]++] = c.candidate; });
    to.begin = std::move(begin), to.all = std::move(all);
}

/// Keeps the best candidates of each face.
void keep_best(Candidates& candidates) {
    std::vector<char> stay(candidates.all.size(), 1);
    parallel_for(Cpu{}, candidates.faces(), [&](int f) {
        const Span<const Candidate> of = candidates.of(f);
        if (of.count <= kMaxCandidates) return;
        std::vector<int> order(of.count);
        for (std::size_t i = 0; i < of.count; ++i) order[i] = static_cast<int>(i);
        std::ranges::stable_sort(order,
                                 [&](int a, int b) { return of[a].quality > of[b].quality; });
        for (std::size_t i = kMaxCandidates; i < of.count; ++i)
            stay[candidates.begin[f] + static_cast<std::size_t>(order[i])] = 0;
    });
    candidates.keep(stay);
}

}  // namespace

Vec3d PhotoView::in_camera(Vec3d point) const {
    const Rigid3f& T = camera.camera_from_world;
    return mat_cast<double>(T.R) * point + vec_cast<double>(T.t);
}

Projection PhotoView::project_from_camera(Vec3d p) const {
    return {camera.fx_px * p.x / p.z + camera.cx_px, camera.fy_px * p.y / p.z + camera.cy_px, p.z};
}

Vec3f PhotoView::color(double u, double v, double footprint) const {
    const int n = std::clamp(static_cast<int>(std::ceil(footprint)), 1, 16);
    Vec3f sum;
    for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
            sum += bilinear(*photo, u + footprint * ((i + 0.5) / n - 0.5),
                            v + footprint * ((j + 0.5) / n - 0.5));
    return gain * (sum / static_cast<float>(n * n));
}

std::vector<PhotoView> photo_views(const std::vector<View>& views, bool masks) {
    std::vector<PhotoView> out;
    for (const View& view : views)
        if (!view.photo.empty())
            out.push_back(
                {view.camera, &view.photo, masks && !view.mask.empty() ? &view.mask : nullptr});
    return out;
}

SightMaps Sights::of(int view) {
    SightMaps maps;
    ImageF& kept = kept_[view];
    maps.depth = kept.empty() ? render_depth(mesh_, views_[view].camera) : kept;
    const std::size_t pixels = maps.depth.pixels.size();
    if (kept.empty() && kept_pixels_ + pixels <= kKeptPixels)
        kept = maps.depth, kept_pixels_ += pixels;
    maps.nearest = least_around(maps.depth, kEdge);
    return maps;
}

Sight sight_of(const PhotoView& view, const SightMaps& maps, const Projection& at, double pixel) {
    if (!(at.z > 0) ||
        !(at.u >= 0 && at.v >= 0 && at.u < view.camera.width_px && at.v < view.camera.height_px))
        return Sight::none;
    const int x = static_cast<int>(at.u), y = static_cast<int>(at.v);
    if (view.mask && view.mask->at(x, y) < kObjectMask) return Sight::none;
    const auto hidden = [&](float depth, double margin) {
        return depth > 0 && depth < at.z - margin * pixel;
    };
    if (hidden(maps.depth.at(x, y), 2)) return Sight::none;
    return hidden(maps.nearest.at(x, y), 4) ? Sight::edge : Sight::clear;
}

FaceShape::FaceShape(const TriangleMesh& mesh, int face) {
    for (int c = 0; c < 3; ++c) corners[c] = vec_cast<double>(mesh.vertices[mesh.faces[face][c]]);
    centre = (corners[0] + corners[1] + corners[2]) / 3;
    const Vec3d twice = cross(corners[1] - corners[0], corners[2] - corners[0]);
    area = 0.5 * norm(twice);
    normal = area > 0 ? twice / norm(twice) : Vec3d{};
}

double FaceShape::cosine(const PhotoView& view) const {
    return dot(normal, normalize(vec_cast<double>(camera_centre(view.camera)) - centre));
}

void Candidates::keep(const std::vector<char>& stay) {
    std::vector<std::size_t> kept(begin.size(), 0);
    parallel_for(Cpu{}, faces(), [&](int f) {
        for (std::size_t i = begin[f]; i < begin[f + 1]; ++i) kept[f + 1] += stay[i] != 0;
    });
    for (int f = 0; f < faces(); ++f) kept[f + 1] += kept[f];
    std::vector<Candidate> out(kept.back());
    parallel_for(Cpu{}, faces(), [&](int f) {
        std::size_t next = kept[f];
        for (std::size_t i = begin[f]; i < begin[f + 1]; ++i)
            if (stay[i]) out[next++] = all[i];
    });
    all = std::move(out), begin = std::move(kept);
}

Candidates find_candidates(const TriangleMesh& mesh,
                           const std::vector<PhotoView>& views,
                           Sights& sights) {
    const int faces = static_cast<int>(mesh.faces.size());
    const int tasks = (faces + kFacesPerTask - 1) / kFacesPerTask;
    Candidates out;
    out.begin.assign(mesh.faces.size() + 1, 0);
    out.seen_pixel.assign(mesh.faces.size(), 0);
    std::vector<Vec3d> vertices(mesh.vertices.size());
    std::vector<std::vector<FaceCandidate>> lists, parts(tasks);
    Progress progress("texture", static_cast<double>(views.size()));
    for (int v = 0; v < static_cast<int>(views.size()); ++v) {
        progress.advance();
        const SightMaps maps = sights.of(v);
        parallel_for(Cpu{}, static_cast<int>(vertices.size()), [&](int i) {
            vertices[i] = views[v].in_camera(vec_cast<double>(mesh.vertices[i]));
        });
        const FaceJudge face_judge{views[v], v, maps, vertices};
        parallel_for_heavy(Cpu{}, tasks, [&](int task) {
            parts[task].clear();
            const int end = std::min(faces, (task + 1) * kFacesPerTask);
            for (int f = task * kFacesPerTask; f < end; ++f) {
                const FaceJudge::Found found = face_judge.judge(mesh.faces[f]);
                if (found.all) parts[task].push_back({f, *found.all});
                float& finest = out.seen_pixel[f];
                if (found.seen && !(finest > 0 && finest <= found.pixel)) finest = found.pixel;
            }
        });
        lists.emplace_back();
        for (const auto& part : parts)
            lists.back().insert(lists.back().end(), part.begin(), part.end());
        if (lists.size() < kMaxCandidates && v + 1 < static_cast<int>(views.size())) continue;
        add(lists, out);
        if (views.size() > kMaxCandidates) keep_best(out);
        lists.clear();
    }
    return out;
}

}  // namespace tvsgs::texture
