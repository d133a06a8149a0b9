#include "pipeline/blocks_seams.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "core/eigen.h"
#include "core/error.h"
#include "core/point_tree.h"
#include "core/quantile.h"
#include "core/sigmoid.h"
#include "io/json_value.h"

namespace tvsgs {
namespace {

constexpr std::size_t kNeighbours = 8;
constexpr int kLeast = 20;  // splats; fewer say nothing

using Side = std::vector<SurfaceSplat>;

std::vector<Vec3<double>> means_of(const Side& side) {
    std::vector<Vec3<double>> means;
    for (const SurfaceSplat& splat : side) means.push_back(splat.mean);
    return means;
}

double along(Vec2<double> p, int axis) {
    return axis == 0 ? p.x : p.y;
}

/// Median distance to the nearest other splat.
double spacing_of(const Side& side) {
    const auto means = means_of(side);
    const PointTree<double, double> tree(means);
    std::vector<double> distances;
    for (const auto& mean : means) {
        std::size_t index[2];
        double squared[2];
        if (tree.nearest(mean, 2, index, squared) == 2) distances.push_back(std::sqrt(squared[1]));
    }
    return quantile(distances, 0.5);
}

/// Where two sides are held against each other.
struct Cut {
    int axis = 0;
    double at = 0, reach = 0;  // splats nearer than that are looked at

    double distance(const SurfaceSplat& splat) const { return along(splat.place, axis) - at; }
};

/// Of the 8 points nearest to a place.
struct Plane {
    Vec3d mean, normal;
    double farthest = 0;  // of these
};

/// Nothing where there are too few, or where they lie about an edge or a line.
std::optional<Plane> plane_at(const std::vector<Vec3<double>>& points,
                              const PointTree<double, double>& tree,
                              Vec3d place) {
    std::size_t index[kNeighbours];
    double squared[kNeighbours];
    if (points.size() < kNeighbours ||
        tree.nearest(place, kNeighbours, index, squared) < kNeighbours)
        return std::nullopt;
    Plane plane;
    for (const std::size_t i : index) plane.mean += points[i] / double{kNeighbours};
    Sym3<double> scatter;
    for (const std::size_t i : index) {
        const Vec3d d = points[i] - plane.mean;
        scatter.xx += d.x * d.x, scatter.xy += d.x * d.y, scatter.xz += d.x * d.z;
        scatter.yy += d.y * d.y, scatter.yz += d.y * d.z, scatter.zz += d.z * d.z;
    }
    const auto axes = sym_eigen(scatter);
    if (!(axes.values[1] > 4 * axes.values[2])) return std::nullopt;
    plane.normal = column(axes.vectors, 2);
    plane.farthest = std::sqrt(squared[kNeighbours - 1]);
    return plane;
}

/// The splats of `a` next to the cut against the planes of `b`.
void compare(const Cut& cut,
             const Side& a,
             const Side& b,
             std::vector<double>& offsets,
             std::vector<double>& angles) {
    const auto own = means_of(a), others = means_of(b);
    const PointTree<double, double> own_tree(own), other_tree(others);
    for (const SurfaceSplat& splat : a) {
        if (!(std::abs(cut.distance(splat)) <= cut.reach)) continue;
        const auto here = plane_at(own, own_tree, splat.mean),
                   beyond = plane_at(others, other_tree, splat.mean);
        if (!here || !beyond || !(beyond->farthest <= 4 * cut.reach)) continue;
        offsets.push_back(std::abs(dot(splat.mean - beyond->mean, beyond->normal)));
        const double cosine = std::min(1.0, std::abs(dot(here->normal, beyond->normal)));
        angles.push_back(std::acos(cosine) * 57.29577951308232);
    }
}

/// Splats of `of` on either side, as far as planes may reach; along the seam they lie on it.
void sides_of_cut(const Side& of, const Seam& seam, const Cut& cut, Side& below, Side& above) {
    for (const SurfaceSplat& splat : of) {
        const double d = cut.distance(splat), other = along(splat.place, 1 - cut.axis);
        if (other < seam.from || other >= seam.to || !(std::abs(d) <= 4 * cut.reach)) continue;
        (d < 0 ? below : above).push_back(splat);
    }
}

SeamNumbers numbers_of(std::vector<double> offsets, std::vector<double> angles) {
    return {static_cast<int>(offsets.size()), quantile(offsets, 0.5), quantile(offsets, 0.95),
            quantile(angles, 0.5)};
}

JsonValue numbers_json(const SeamNumbers& n) {
    return JsonValue()
        .add("splats", n.compared)
        .add("median_offset", n.median_offset)
        .add("offset_95", n.offset_95)
        .add("median_angle_deg", n.median_angle);
}

}  // namespace

std::vector<SurfaceSplat> surface_splats(const BlocksManifest& manifest,
                                         const Gaussians<Cpu>& splats) {
    std::vector<SurfaceSplat> surface;
    for (std::size_t i = 0; i < splats.means.size(); ++i) {
        if (sigmoid(splats.opacity_logits[i]) < 0.5f) continue;
        SurfaceSplat s;
        s.mean = vec_cast<double>(splats.means[i]);
        s.place = manifest.frame.on_ground(s.mean);
        s.block = manifest.block_of(s.mean);
        surface.push_back(s);
    }
    return surface;
}

std::vector<SurfaceSplat> surface_of_block(const BlocksManifest& manifest,
                                           const Gaussians<Cpu>& splats,
                                           int block) {
    std::vector<SurfaceSplat> own = surface_splats(manifest, splats);
    std::erase_if(own, [block](const SurfaceSplat& s) { return s.block != block; });
    return own;
}

PointCloud seam_voters(const BlocksManifest& manifest,
                       int block,
                       const std::vector<SurfaceSplat>& splats) {
    const GroundCell& cell = manifest.cells[static_cast<std::size_t>(block - 1)];
    PointCloud voters;
    for (const SurfaceSplat& s : splats) {
        if (s.block == 0 || s.block == block || !(cell.distance(s.place) < 2 * manifest.vote_reach))
            continue;
        voters.positions.push_back(vec_cast<float>(s.mean));
    }
    return voters;
}

bool is_good_seam(const SeamNumbers& across, const SeamNumbers& inside) {
    return across.median_offset <= 1.25 * inside.median_offset &&
           across.offset_95 <= 1.5 * inside.offset_95 &&
           across.median_angle <= inside.median_angle + 2;
}

std::vector<SeamReport> test_seams(const std::vector<GroundCell>& cells,
                                   const std::vector<std::pair<int, int>>& neighbours,
                                   const std::vector<SurfaceSplat>& splats) {
    std::vector<Side> of(cells.size());
    for (const SurfaceSplat& splat : splats)
        if (splat.block > 0) of[static_cast<std::size_t>(splat.block - 1)].push_back(splat);
    std::vector<SeamReport> reports;
    for (const auto& [i, j] : neighbours) {
        SeamReport report;
        report.seam = seam_of(cells, i, j);
        const Seam& seam = report.seam;
        const Side &a = of[static_cast<std::size_t>(seam.a)],
                   &b = of[static_cast<std::size_t>(seam.b)];
        const double spacing_a = spacing_of(a), spacing_b = spacing_of(b);
        report.spacing = std::max(spacing_a, spacing_b);

        std::vector<double> offsets, angles;
        const Cut cut{seam.axis, seam.at, 2 * report.spacing};
        Side below, above, none;
        sides_of_cut(a, seam, cut, below, none);
        sides_of_cut(b, seam, cut, none, above);
        compare(cut, below, above, offsets, angles);
        compare(cut, above, below, offsets, angles);
        report.across = numbers_of(offsets, angles);

        offsets.clear(), angles.clear();
        for (const Side* side : {&a, &b}) {
            std::vector<double> beside;  // what of the block lies along the seam
            for (const SurfaceSplat& splat : *side)
                if (const double other = along(splat.place, 1 - seam.axis);
                    other >= seam.from && other < seam.to)
                    beside.push_back(along(splat.place, seam.axis));
            const Cut middle{seam.axis, quantile(beside, 0.5), cut.reach};
            Side low, high;
            sides_of_cut(*side, seam, middle, low, high);
            compare(middle, low, high, offsets, angles);
            compare(middle, high, low, offsets, angles);
        }
        report.inside = numbers_of(offsets, angles);
        report.judged = report.across.compared >= kLeast && report.inside.compared >= kLeast;
        report.good = !report.judged || is_good_seam(report.across, report.inside);
        reports.push_back(report);
    }
    return reports;
}

std::string seams_json(const std::vector<SeamReport>& seams) {
    std::string list;
    for (const SeamReport& r : seams)
        list += str(list.empty() ? "\n  " : ",\n  ",
                    json_text(JsonValue()
                                  .add("a", r.seam.a + 1)
                                  .add("b", r.seam.b + 1)
                                  .add("axis", r.seam.axis)
                                  .add("at", r.seam.at)
                                  .add("spacing", r.spacing)
                                  .add("across", numbers_json(r.across))
                                  .add("inside", numbers_json(r.inside))
                                  .add("judged", r.judged)
                                  .add("good", r.good)));
    return "{\"seams\": [" + list + "\n]}\n";
}

}  // namespace tvsgs
