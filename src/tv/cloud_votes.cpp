#include "tv/cloud_votes.h"

#include <numeric>

#include "tv/internal/cloud_votes_impl.h"

namespace tvsgs {
namespace {

/// Points in connected parts; each knows whether it is flipped relative to the root of its part.
class FlipForest {
public:
    explicit FlipForest(std::size_t count) : parents_(count), flips_(count, false) {
        std::iota(parents_.begin(), parents_.end(), std::uint32_t{0});
    }
    struct Root {
        std::uint32_t index;
        bool flip;
    };
    Root root(std::uint32_t i) {
        bool flip = false;
        while (parents_[i] != i) {
            const std::uint32_t parent = parents_[i];  // halves the path
            flips_[i] = flips_[i] != flips_[parent];
            parents_[i] = parents_[parent];
            flip = flip != (flips_[i] != 0);
            i = parents_[i];
        }
        return {i, flip};
    }
    /// Joins two parts so that i and j are on opposite sides if `opposite`.
    void join(std::uint32_t i, std::uint32_t j, bool opposite) {
        const Root a = root(i), b = root(j);
        if (a.index == b.index) return;
        const std::uint32_t low = std::min(a.index, b.index), high = std::max(a.index, b.index);
        parents_[high] = low;
        flips_[high] = (a.flip != b.flip) != opposite;
    }
    /// The root of a point, after flatten().
    Root parent(std::size_t i) const { return {parents_[i], flips_[i] != 0}; }
    /// Makes every point a child of its root.
    void flatten() {
        for (std::size_t i = 0; i < parents_.size(); ++i) {  // parents come before their children
            const std::uint32_t parent = parents_[i];
            if (parents_[parent] == parent) continue;
            flips_[i] = flips_[i] != flips_[parent], parents_[i] = parents_[parent];
        }
    }

private:
    std::vector<std::uint32_t> parents_;
    std::vector<std::uint8_t> flips_;  // relative to the parent
};

}  // namespace

double cloud_vote_steps(const CloudVoteOptions& options, std::size_t points) {
    const int rounds = std::max(options.refine, detail::kNoisyRounds);
    // Scales, balls, two passes per round, normals, saliencies and support. Outliers: scales,
    // balls, twice support.
    const int outliers = 2 + 2 * (2 + detail::kOutlierHops);
    return double(points) *
           (4 + detail::kStickRounds + 2 * rounds + (options.reject ? outliers : 0));
}

template CloudVotes vote_in_cloud(Cpu,
                                  const PointCloud&,
                                  const CloudVoteOptions&,
                                  const CloudProgress&);

void orient_to_viewpoint(CloudVotes& votes, Vec3f viewpoint) {
    for (std::size_t i = 0; i < votes.normals.size(); ++i)
        if (dot(votes.normals[i], viewpoint - votes.positions[i]) < 0)
            votes.normals[i] = -votes.normals[i];
}

void orient_along_graph(CloudVotes& votes) {
    const std::size_t count = votes.normals.size();
    const auto for_each_point = [&](auto&& body) {
        parallel_for(Cpu{}, static_cast<int>(count), [&](int i) { body(std::size_t(i)); });
    };
    std::vector<Vec3f> normals(count);  // in Morton order, as all that refers to `nearest`
    for_each_point([&](std::size_t r) { normals[r] = votes.normals[std::size_t(votes.order[r])]; });
    const auto has_normal = [](Vec3f n) { return dot(n, n) > 0; };
    // One pass per class of angles needs less memory than a sorted list of all pairs.
    constexpr std::uint8_t kClasses = 32, kNone = 255;
    std::vector<std::uint8_t> angles(votes.nearest.size(), kNone), opposite(angles.size());
    for_each_point([&](std::size_t r) {
        for (std::size_t e = r * kGraphNeighbours; e < (r + 1) * kGraphNeighbours; ++e) {
            const std::uint32_t near = votes.nearest[e];
            if (near == kNoPoint || !has_normal(normals[r]) || !has_normal(normals[near])) continue;
            const float cosine = dot(normals[r], normals[near]),
                        sine2 = std::max(0.0f, 1 - cosine * cosine);
            angles[e] = std::uint8_t(kClasses * std::sqrt(sine2)), opposite[e] = cosine < 0;
        }
    });
    FlipForest forest(count);
    for (int angle = 0; angle <= kClasses; ++angle)
        for (std::size_t e = 0; e < angles.size(); ++e)
            if (angles[e] == angle)
                forest.join(std::uint32_t(e / kGraphNeighbours), votes.nearest[e],
                            opposite[e] != 0);
    forest.flatten();
    std::vector<FlipForest::Root> roots(count);  // in the order of the entries, as all below
    for_each_point([&](std::size_t r) { roots[std::size_t(votes.order[r])] = forest.parent(r); });
    std::vector<Vec3d> sums(count);
    std::vector<double> sizes(count), farthest(count, -1);
    std::vector<bool> flip_part(count);
    for (std::size_t i = 0; i < count; ++i)
        sums[roots[i].index] += vec_cast<double>(votes.positions[i]), sizes[roots[i].index] += 1;
    for (std::size_t i = 0; i < count; ++i) {
        const auto [root, flip] = roots[i];
        const Vec3d outwards = vec_cast<double>(votes.positions[i]) - sums[root] / sizes[root];
        const double distance = norm(outwards);
        if (!has_normal(votes.normals[i]) || !(distance > farthest[root])) continue;
        farthest[root] = distance;
        flip_part[root] = (dot(vec_cast<double>(votes.normals[i]), outwards) < 0) != flip;
    }
    for_each_point([&](std::size_t i) {
        if (roots[i].flip != flip_part[roots[i].index]) votes.normals[i] = -votes.normals[i];
    });
}

}  // namespace tvsgs
