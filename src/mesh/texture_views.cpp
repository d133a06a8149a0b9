#include "mesh/texture_views.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "core/parallel.h"
#include "core/progress.h"
#include "core/scene.h"
#include "mesh/mesh_render.h"

namespace tvsgs::texture {
namespace {

constexpr double kLeastCosine = 0.2;  // of a view that shows a face
constexpr double kSampleStep_px = 3;  // between the places of a face that are looked at
constexpr int kMostSamples = 256;     // along a side of a face
constexpr float kEdgeShare = 0.1f;    // of the quality where something in front is close
constexpr int kFacesPerTask = 1024;
constexpr double kOutlier = 3, kLeastDeviation = 0.02;  // deviations; of colours in [0, 1]
constexpr float kDark = 0.05f, kBright = 0.95f;         // beyond, colours say little of exposure
constexpr double kMostGain = 4;
constexpr int kMostCompared = 20000;  // faces, spread over the mesh
constexpr int kMostPartners = 8;      // of a view of a face

float pixel_at(const ImageU8& image, int x, int y, int c) {
    return static_cast<float>(
        image.at(std::clamp(x, 0, image.width - 1), std::clamp(y, 0, image.height - 1), c));
}

Vec3f bilinear(const ImageU8& image, double u, double v) {
    const double x = u - 0.5, y = v - 0.5;
    const int x0 = static_cast<int>(std::floor(x)), y0 = static_cast<int>(std::floor(y));
    const auto fx = static_cast<float>(x - x0), fy = static_cast<float>(y - y0);
    Vec3f out;
    for (int c = 0; c < 3; ++c) {
        const float top =
            (1 - fx) * pixel_at(image, x0, y0, c) + fx * pixel_at(image, x0 + 1, y0, c);
        const float low =
            (1 - fx) * pixel_at(image, x0, y0 + 1, c) + fx * pixel_at(image, x0 + 1, y0 + 1, c);
        out[c] = ((1 - fy) * top + fy * low) / 255;
    }
    return out;
}

/// The least depth in a square around each pixel; 0 where there is none in it.
ImageF least_around(const ImageF& depth, int radius) {
    ImageF out(depth.width, depth.height, 1);
    parallel_for_heavy(Cpu{}, depth.height, [&](int y) {
        for (int x = 0; x < depth.width; ++x) {
            float least = 0;
            for (int j = std::max(0, y - radius); j <= std::min(depth.height - 1, y + radius); ++j)
                for (int i = std::max(0, x - radius); i <= std::min(depth.width - 1, x + radius);
                     ++i)
                    if (const float d = depth.at(i, j); d > 0 && !(least > 0 && least <= d))
                        least = d;
            out.at(x, y) = least;
        }
    });
    return out;
}

/// Calls look(point) for places spread over a face.
template <class Look>
void for_places(const FaceShape& face, int n, const Look& look) {
    const auto at = [&](double i, double j) {
        const double b = i / n, c = j / n;
        return face.corners[0] + b * (face.corners[1] - face.corners[0]) +
               c * (face.corners[2] - face.corners[0]);
    };
    constexpr double kThird = 1.0 / 3;
    for (int j = 0; j < n; ++j)  // the middles of the n^2 triangles that it is cut into
        for (int i = 0; i + j < n; ++i) {
            look(at(i + kThird, j + kThird));
            if (i + j + 1 < n) look(at(i + 2 * kThird, j + 2 * kThird));
        }
}

/// What one view shows of a face; `seen`: whether it shows any of it.
std::optional<Candidate> candidate_of(const FaceShape& face,
                                      const PhotoView& view,
                                      int index,
                                      bool& seen) {
    seen = false;
    const double cosine = face.cosine(view);
    if (!(cosine > 0.05)) return std::nullopt;
    Projection corners[3];
    bool inside = cosine > kLeastCosine;
    const double w = view.camera.width_px, h = view.camera.height_px;
    for (int c = 0; c < 3; ++c) {
        const Projection& p = corners[c] = view.project(face.corners[c]);
        if (!(p.z > 0)) return std::nullopt;
        inside = inside && p.u >= 1 && p.v >= 1 && p.u <= w - 1 && p.v <= h - 1;
    }
    double longest = 0;
    for (int c = 0; c < 3; ++c) {
        const Projection &p = corners[c], &q = corners[(c + 1) % 3];
        longest = std::max(longest, std::hypot(p.u - q.u, p.v - q.v));
    }
    const int n = static_cast<int>(
        std::clamp(std::ceil(longest / kSampleStep_px), 1.0, double{kMostSamples}));
    bool all = true, edge = false;
    Vec3d sum;
    int count = 0;
    for_places(face, n, [&](Vec3d point) {
        const Projection p = view.project(point);
        const Sight sight = sight_of(view, p, p.z / (view.camera.fx_px * std::max(cosine, 0.1)));
        seen = seen || sight != Sight::none;
        all = all && sight != Sight::none, edge = edge || sight == Sight::edge;
        if (inside && all) sum += vec_cast<double>(view.color(p.u, p.v)), ++count;
    });
    if (!inside || !all) return std::nullopt;
    const double area =
        0.5 * std::abs((corners[1].u - corners[0].u) * (corners[2].v - corners[0].v) -
                       (corners[1].v - corners[0].v) * (corners[2].u - corners[0].u));
    const double pixel = view.project(face.centre).z / view.camera.fx_px;
    return Candidate{index, static_cast<float>(area * cosine) * (edge ? kEdgeShare : 1),
                     static_cast<float>(pixel), vec_cast<float>(sum / count)};
}

template <class T>
T median_of(std::vector<T>& values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace

Projection PhotoView::project(Vec3d point) const {
    const Rigid3f& T = camera.camera_from_world;
    const Vec3d p = mat_cast<double>(T.R) * point + vec_cast<double>(T.t);
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

std::vector<PhotoView> photo_views(const TriangleMesh& mesh,
                                   const std::vector<View>& views,
                                   bool masks) {
    std::vector<PhotoView> out;
    Progress progress("texture: depth of the mesh", double(views.size()));
    for (const View& view : views) {
        progress.advance();
        if (view.photo.empty()) continue;
        const ImageU8* const mask = masks && !view.mask.empty() ? &view.mask : nullptr;
        out.push_back({view.camera, &view.photo, mask, render_depth(mesh, view.camera), {}});
        out.back().nearest = least_around(out.back().depth, PhotoView::kEdge);
    }
    return out;
}

Sight sight_of(const PhotoView& view, const Projection& at, double pixel) {
    if (!(at.z > 0) ||
        !(at.u >= 0 && at.v >= 0 && at.u < view.camera.width_px && at.v < view.camera.height_px))
        return Sight::none;
    const int x = static_cast<int>(at.u), y = static_cast<int>(at.v);
    if (view.mask && view.mask->at(x, y) < kObjectMask) return Sight::none;
    const auto hidden = [&](float depth, double margin) {
        return depth > 0 && depth < at.z - margin * pixel;
    };
    if (hidden(view.depth.at(x, y), 2)) return Sight::none;
    return hidden(view.nearest.at(x, y), 4) ? Sight::edge : Sight::clear;
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

Candidates find_candidates(const TriangleMesh& mesh, const std::vector<PhotoView>& views) {
    const int faces = static_cast<int>(mesh.faces.size());
    const int tasks = (faces + kFacesPerTask - 1) / kFacesPerTask;
    Candidates out;
    out.begin.assign(mesh.faces.size() + 1, 0);
    out.seen_pixel.assign(mesh.faces.size(), 0);
    std::vector<std::vector<Candidate>> parts(tasks);
    Progress progress("texture: photographs of the faces", tasks);
    parallel_for_heavy(Cpu{}, tasks, [&](int task) {
        progress.advance();
        for (int f = task * kFacesPerTask; f < std::min(faces, (task + 1) * kFacesPerTask); ++f) {
            const FaceShape face(mesh, f);
            for (std::size_t v = 0; v < views.size(); ++v) {
                bool seen = false;
                const auto found = candidate_of(face, views[v], static_cast<int>(v), seen);
                if (found) parts[task].push_back(*found), ++out.begin[f + 1];
                if (!seen) continue;
                const auto pixel =
                    static_cast<float>(views[v].project(face.centre).z / views[v].camera.fx_px);
                float& finest = out.seen_pixel[f];
                if (pixel > 0 && !(finest > 0 && finest <= pixel)) finest = pixel;
            }
        }
    });
    for (std::size_t f = 0; f < mesh.faces.size(); ++f) out.begin[f + 1] += out.begin[f];
    out.all.reserve(out.begin.back());
    for (const auto& part : parts) out.all.insert(out.all.end(), part.begin(), part.end());
    return out;
}

void level_exposures(Candidates& candidates, std::vector<PhotoView>& views) {
    // 1. Of each pair of views, the logarithms of what one says over what the other says.
    std::map<std::pair<int, int>, std::vector<Vec3f>> ratios;
    const auto tells = [](Vec3f color) {
        return std::min({color.x, color.y, color.z}) > kDark &&
               std::max({color.x, color.y, color.z}) < kBright;
    };
    const int faces = static_cast<int>(candidates.begin.size()) - 1;
    const int step = std::max(1, faces / kMostCompared);
    for (int f = 0; f < faces; f += step) {
        const Span<const Candidate> of = candidates.of(f);
        for (std::size_t i = 0; i < of.count; ++i)
            for (std::size_t j = i + 1; j < std::min(of.count, i + 1 + kMostPartners); ++j) {
                if (!tells(of[i].color) || !tells(of[j].color)) continue;
                Vec3f ratio;
                for (int c = 0; c < 3; ++c) ratio[c] = std::log(of[i].color[c] / of[j].color[c]);
                ratios[{of[i].view, of[j].view}].push_back(ratio);
            }
    }
    // 2. Logarithms of the gains, per channel: gain_i - gain_j = -median, weighted by how often.
    const auto count = static_cast<Eigen::Index>(views.size());
    Eigen::MatrixXd A = Eigen::MatrixXd::Zero(count, count), b = Eigen::MatrixXd::Zero(count, 3);
    for (auto& [pair, list] : ratios) {
        const auto [i, j] = pair;
        const auto weight = static_cast<double>(list.size());
        A(i, i) += weight, A(j, j) += weight, A(i, j) -= weight, A(j, i) -= weight;
        for (int c = 0; c < 3; ++c) {
            std::vector<float> values;
            for (const Vec3f ratio : list) values.push_back(ratio[c]);
            const double median = double{median_of(values)};
            b(i, c) -= weight * median, b(j, c) += weight * median;
        }
    }
    for (Eigen::Index i = 0; i < count; ++i) A(i, i) += 1;  // a view by itself stays as it is
    const Eigen::MatrixXd gains = A.ldlt().solve(b);
    const double most = std::log(kMostGain);
    for (Eigen::Index i = 0; i < count; ++i)
        for (int c = 0; c < 3; ++c)
            views[static_cast<std::size_t>(i)].gain[c] =
                static_cast<float>(std::exp(std::clamp(gains(i, c), -most, most)));
    for (Candidate& candidate : candidates.all)
        candidate.color = views[candidate.view].gain * candidate.color;
}

void drop_outliers(Candidates& candidates) {
    const int faces = static_cast<int>(candidates.begin.size()) - 1;
    std::vector<Candidate> kept;
    kept.reserve(candidates.all.size());
    std::vector<std::size_t> begin{0};
    std::vector<float> values;
    for (int f = 0; f < faces; ++f) {
        const Span<const Candidate> of = candidates.of(f);
        double limit = INFINITY;
        Vec3f middle;
        const auto distance = [&](const Candidate& c) { return double{norm(c.color - middle)}; };
        if (of.count >= 4) {
            for (int c = 0; c < 3; ++c) {
                values.clear();
                for (const Candidate& candidate : of) values.push_back(candidate.color[c]);
                middle[c] = median_of(values);
            }
            values.clear();
            for (const Candidate& c : of) values.push_back(static_cast<float>(distance(c)));
            // 1.4826: of the median to the deviation of normal errors.
            limit = kOutlier * std::max(1.4826 * double{median_of(values)}, kLeastDeviation);
        }
        for (const Candidate& c : of)
            if (distance(c) <= limit) kept.push_back(c);
        begin.push_back(kept.size());
    }
    candidates.all = std::move(kept), candidates.begin = std::move(begin);
}

}  // namespace tvsgs::texture
