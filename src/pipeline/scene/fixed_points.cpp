#include "pipeline/scene/fixed_points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "core/grouped.h"
#include "core/log.h"
#include "core/math/point_tree.h"
#include "core/math/quantile.h"
#include "eval/points.h"
#include "io/files/read_file.h"
#include "io/mesh/mesh_files.h"
#include "io/scene/scene_reader.h"
#include "optim/growth/init_cloud.h"
#include "pipeline/run/run_folder.h"

namespace tvsgs {
namespace {

constexpr std::size_t kSample = 1000;  // gives a share to three percent
constexpr double kPixels = 2, kSpacings = 2;
constexpr double kCoarse = 0.05;  // of the depth: coarser tolerances are meaningless

std::vector<Vec3f> sampled(const std::vector<Vec3f>& points) {
    std::vector<Vec3f> some;
    const std::size_t stride = 1 + points.size() / kSample;
    for (std::size_t i = 0; i < points.size(); i += stride)
        if (is_finite(points[i])) some.push_back(points[i]);
    return some;
}

double median(std::vector<double> values) {
    return values.empty() ? 0 : middle_of(values);
}

/// Inverse of a similarity, which may mirror.
Affine3d inverse_of(const Affine3d& T) {
    Affine3d inverse;
    const double squared = dot(column(T.A, 0), column(T.A, 0));
    for (int r = 0; r < 3; ++r)
        for (int c = 0; c < 3; ++c) inverse.A[r][c] = T.A[c][r] / squared;
    inverse.t = -1.0 * (inverse.A * T.t);
    return inverse;
}

/// Points with a tree and a sample, for nearest-point searches.
struct Searchable {
    std::vector<Vec3f> points, sample;
    PointTree<float> tree;
    double spacing;  // median distance to the nearest other point

    explicit Searchable(const std::vector<Vec3f>& all)
        : points(finite(all)), sample(sampled(points)), tree(points) {
        std::vector<double> distances;
        for (const Vec3f p : sample) {
            std::size_t index[2];
            float squared[2];
            if (tree.nearest(p, 2, index, squared) == 2)
                distances.push_back(std::sqrt(double(squared[1])));
        }
        spacing = median(std::move(distances));
    }
    Searchable(const Searchable&) = delete;
    Searchable& operator=(const Searchable&) = delete;

private:
    static std::vector<Vec3f> finite(std::vector<Vec3f> points) {
        std::erase_if(points, [](Vec3f p) { return !is_finite(p); });
        return points;
    }
};

class Frames {
public:
    explicit Frames(const Scene& scene)
        : fixed_(scene.fixed_voters.positions),
          initial_(scene.points.positions),
          depth_(double(median_depth(scene))) {
        for (const View& view : scene.train) cameras_.push_back(view.camera);
        std::erase_if(initial_.sample, [&](Vec3f p) { return !in_two_views(p); });
        for (int axis = 0; axis < 3; ++axis) {
            low_[axis] = INFINITY, high_[axis] = -INFINITY;
            for (const Vec3f p : fixed_.points)
                low_[axis] = std::min(low_[axis], double(p[axis])),
                high_[axis] = std::max(high_[axis], double(p[axis]));
        }
    }

    double share_in_two_views() const {
        const auto seen =
            std::ranges::count_if(fixed_.sample, [&](Vec3f p) { return in_two_views(p); });
        return double(seen) / std::max(1.0, double(fixed_.sample.size()));
    }

    struct Score {
        int compared = 0;
        double agreeing = 0, tolerance_px = 0;  // 0 px: too few points
        bool meets = false;                     // a tenth of the points can be compared
    };

    /// Score after moving the measured points by T: the worse of both directions of comparison,
    /// where spacings are fine enough.
    Score of(const Affine3d& scene_from_file) const {
        const auto onto = one_way(scene_from_file, true), back = one_way(scene_from_file, false);
        if (!onto || !back) return onto ? *onto : back.value_or(Score{});
        return back->agreeing < onto->agreeing ? *back : *onto;
    }

    /// Aligns the measured points with the initial cloud by ICP, first with a large reach.
    Affine3d pulled() const {
        const bool onto_initial = fixed_.spacing > initial_.spacing;
        std::vector<Vec3d> from, to;
        for (const Vec3f p : (onto_initial ? fixed_ : initial_).sample)
            if (onto_initial ? in_two_views(p) : in_box(vec_cast<double>(p), kReach * depth_))
                from.push_back(vec_cast<double>(p));
        const std::vector<Vec3f>& onto = (onto_initial ? initial_ : fixed_).points;
        const std::size_t stride = 1 + onto.size() / 200000;
        for (std::size_t i = 0; i < onto.size(); i += stride)
            to.push_back(vec_cast<double>(onto[i]));
        Affine3d T;
        for (const double reach : {kReach, kReach / 3}) {
            IcpOptions options;
            options.max_distance = reach * depth_, options.rmse_change = 1e-6 * depth_;
            options.max_iterations = 100;  // surfaces slide along each other slowly
            T = icp(transformed(from, T), to, options).target_from_source * T;
        }
        return onto_initial ? T : inverse_of(T);
    }

private:
    /// Returns nothing where the spacing is too coarse for the depth.
    std::optional<Score> one_way(const Affine3d& scene_from_file, bool onto_initial) const {
        const double scale = norm(column(scene_from_file.A, 0));
        const double slack = kSpacings * (onto_initial ? initial_.spacing : scale * fixed_.spacing);
        if (!(slack < kCoarse * depth_)) return std::nullopt;
        const Affine3d back = inverse_of(scene_from_file);
        const std::vector<Vec3f>& asked = (onto_initial ? fixed_ : initial_).sample;
        const PointTree<float>& tree = (onto_initial ? initial_ : fixed_).tree;
        std::vector<double> tolerances;
        int agreeing = 0;
        for (const Vec3f p : asked) {
            const Vec3d other = (onto_initial ? scene_from_file : back) * vec_cast<double>(p);
            const Vec3f in_scene = onto_initial ? vec_cast<float>(other) : p;
            if (onto_initial ? !in_two_views(in_scene) : !in_box(other, slack / scale)) continue;
            const double pixel = double(finest_pixel(cameras_, in_scene)),
                         tolerance = std::max(slack, kPixels * pixel),
                         reach = onto_initial ? tolerance : tolerance / scale;
            tolerances.push_back(tolerance / pixel);
            std::size_t index;
            float squared;
            agreeing +=
                tree.nearest_within(vec_cast<float>(other), float(reach * reach), &index, &squared);
        }
        const std::size_t compared = tolerances.size();
        Score score{int(compared), 0, 0};
        if (compared >= kLeast) {
            score.agreeing = double(agreeing) / double(compared);
            score.tolerance_px = median(std::move(tolerances));
        }
        score.meets = compared * 10 >= asked.size();
        return score;
    }

    static constexpr std::size_t kLeast = 20;  // smallest number of points for a share
    static constexpr double kReach = 0.1;      // relative to the depth

    bool in_two_views(Vec3f p) const {
        int seen = 0;
        for (const Camera& camera : cameras_)
            if (is_in_view(camera, p) && ++seen == 2) return true;
        return false;
    }
    bool in_box(Vec3d p, double margin) const {
        for (int axis = 0; axis < 3; ++axis)
            if (p[axis] < low_[axis] - margin || p[axis] > high_[axis] + margin) return false;
        return true;
    }

    Searchable fixed_, initial_;
    double depth_;
    std::vector<Camera> cameras_;
    Vec3d low_, high_;  // of the measured points
};

struct Frame {
    std::string words;
    Affine3d scene_from_file;
};

/// Frames with swapped, rotated and mirrored axes, and other units. `origin`: of the scene's frame,
/// see Scene.
std::vector<Frame> candidate_frames(Vec3d origin) {
    std::vector<Frame> frames;
    const auto add = [&](std::string words, const Mat3<double>& A) {
        frames.push_back({std::move(words), {A, A * origin - origin}});
    };
    std::array<int, 3> axes{0, 1, 2};
    do {
        for (int signs = 0; signs < 8; ++signs) {
            Mat3<double> A{};
            std::string words;
            for (int r = 0; r < 3; ++r) {
                const bool minus = (signs >> r & 1) != 0;
                const auto axis = std::size_t(axes[r]);
                A[r][int(axis)] = minus ? -1 : 1;
                words += str(r > 0 ? ", " : "", minus ? "-" : "", "xyz"[axis]);
            }
            if (words != "x, y, z") add(str("with (", words, ") for its (x, y, z)"), A);
        }
    } while (std::next_permutation(axes.begin(), axes.end()));
    for (const double scale :
         {1000.0, 100.0, 10.0, 39.37, 3.2808, 0.3048, 0.0254, 0.1, 0.01, 0.001})
        add(str("multiplied by ", scale), {{{scale, 0, 0}, {0, scale, 0}, {0, 0, scale}}});
    return frames;
}

std::string number(double value) {
    return fmt::format("{:.3g}", value);
}
double percent(double share) {
    return std::round(1000 * share) / 10;
}

}  // namespace

void read_fixed_points(const RunOptions& options, Scene& scene) {
    const TvOptions& tv = options.train.tv;
    if (tv.fixed_voters.empty()) return;
    if (!tv.enabled)
        throw Error(ExitCode::usage, tv.fixed_voters,
                    ": measured points need tv.enabled=true; set it, or remove --fixed-points");
    scene.fixed_voters = read_mesh(tv.fixed_voters, scene.origin, false).points;
    // Validate before the run exists, and with the file's point numbers.
    make_fixed_voters(scene.fixed_voters, tv);
    if (drop_invalid_points(scene.fixed_voters, tv.fixed_voters) > 0)
        make_fixed_voters(scene.fixed_voters, tv);
}

void read_fixed_splats(const RunOptions& options, Scene& scene) {
    const std::string& file = options.train.init.fixed_splats;
    if (file.empty()) return;
    scene.fixed_splats = with_context("reading init.fixed_splats", [&] {
        Gaussians<Cpu> splats = read_splats(file, scene.origin, options.train);
        splats.uncertainty.resize(0);  // they do not train
        return std::make_shared<const Gaussians<Cpu>>(std::move(splats));
    });
    spdlog::info("{}: draws {} fixed splats", file, grouped(scene.fixed_splats->size()));
}

FixedPointsAgreement compare_fixed_points(const Scene& scene) {
    const Frames frames(scene);
    const Frames::Score here = frames.of({});
    FixedPointsAgreement look{frames.share_in_two_views(), here.compared, here.agreeing,
                              here.tolerance_px,           here.agreeing, ""};
    const auto consider = [&](Frame frame, double margin) {
        const double scale = norm(column(frame.scene_from_file.A, 0));
        // Where half of them agree, the unit is right: a shrunk cloud always fits onto the ground.
        if (look.agreeing >= 0.5 && std::abs(std::log(scale)) > 0.2) return;
        const Frames::Score score = frames.of(frame.scene_from_file);
        if (score.meets && score.agreeing > look.better + margin)
            look.better = score.agreeing, look.frame = std::move(frame.words);
    };
    for (Frame& frame : candidate_frames(scene.origin)) consider(std::move(frame), 0);
    const Affine3d pulled = frames.pulled();
    consider({str("scaled by ", number(std::cbrt(std::abs(determinant(pulled.A)))),
                  ", turned as its nearest points ask for, and then moved by (", number(pulled.t.x),
                  ", ", number(pulled.t.y), ", ", number(pulled.t.z), ")"),
              pulled},
             0.05);
    return look;
}

void check_fixed_points(const FixedPointsAgreement& look,
                        std::size_t points,
                        const std::string& path) {
    constexpr double kSeen = 0.01, kAgreeing = 0.15, kBetter = 0.08;
    const double chance = 1 / std::sqrt(std::max(100.0, double(look.compared)));
    const bool elsewhere = look.better > look.agreeing + kBetter + chance;
    const std::string what_to_do =
        str(elsewhere ? str("; ", look.frame, " ", percent(look.better), " % would") : "",
            ": move it into the frame of the scene, with the same units and axes; "
            "tv.fixed_check=false skips this check");
    if (look.in_two_views < kSeen)
        throw input_error(path, ": ", percent(look.in_two_views), " % of its ", grouped(points),
                          " points are visible in two training views; expected at least ",
                          percent(kSeen), " %", what_to_do);
    if (look.tolerance_px == 0)
        throw input_error(path, ": ", look.compared, " of its ", grouped(points),
                          " points could be compared with the start cloud; expected "
                          "at least 20, closer together than 1/40 of the depth",
                          what_to_do);
    if (look.agreeing < kAgreeing || elsewhere)
        throw input_error(path, ": ", percent(look.agreeing), " % of ", grouped(look.compared),
                          " points agree with the start cloud within ",
                          std::round(10 * look.tolerance_px) / 10, " pixels; expected at least ",
                          percent(kAgreeing), " %, and no other frame that fits clearly better",
                          what_to_do);
}

std::size_t fill_with_fixed_points(Scene& scene) {
    const std::vector<Vec3f> fixed = scene.fixed_voters.positions;
    if (fixed.empty()) return 0;
    PointCloud& cloud = scene.points;
    const Searchable initial(cloud.positions);
    const std::vector<float> own = mean_squared_neighbour_distance(fixed, 3);
    const auto empty = float(9 * initial.spacing * initial.spacing);
    std::size_t added = 0;
    for (std::size_t i = 0; i < fixed.size(); ++i) {
        std::size_t index;
        float squared;
        if (!is_finite(fixed[i]) ||
            initial.tree.nearest_within(fixed[i], std::max(own[i], empty), &index, &squared))
            continue;
        Vec3f color;
        int seen = 0;
        for (const View& view : scene.train) {
            if (!is_in_view(view.camera, fixed[i])) continue;
            const Camera& c = view.camera;
            const Vec3f p = c.camera_from_world * fixed[i];
            const int x = int(c.fx_px * p.x / p.z + c.cx_px),
                      y = int(c.fy_px * p.y / p.z + c.cy_px);
            for (int k = 0; k < 3; ++k) color[k] += float(view.photo.at(x, y, k)) / 255;
            ++seen;
        }
        if (seen == 0) continue;
        ++added;
        cloud.positions.push_back(fixed[i]);
        const auto& normals = scene.fixed_voters.normals;
        if (!cloud.colors.empty()) cloud.colors.push_back(color / float(seen));
        if (!cloud.normals.empty()) cloud.normals.push_back(normals.empty() ? Vec3f{} : normals[i]);
        if (!cloud.confidences.empty()) cloud.confidences.push_back(1);
    }
    return added;
}

}  // namespace tvsgs
