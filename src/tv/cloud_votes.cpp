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
            flip = flip != flips_[i];
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

private:
    std::vector<std::uint32_t> parents_;
    std::vector<bool> flips_;  // relative to the parent
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
    const auto has_normal = [&](std::size_t i) {
        return dot(votes.normals[i], votes.normals[i]) > 0;
    };
    // One pass per class of angles needs less memory than a sorted list of all pairs.
    constexpr std::uint8_t kClasses = 32, kNone = 255;
    std::vector<std::uint8_t> angles(votes.nearest.size(), kNone), opposite(angles.size());
    parallel_for(Cpu{}, static_cast<int>(count), [&](int i) {
        for (std::size_t r = 0; r < kGraphNeighbours && has_normal(i); ++r) {
            const std::size_t e = std::size_t(i) * kGraphNeighbours + r;
            const std::uint32_t j = votes.nearest[e];
            if (j == kNoPoint || !has_normal(j)) continue;
            const float cosine = dot(votes.normals[i], votes.normals[j]),
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
    std::vector<Vec3d> sums(count);
    std::vector<double> sizes(count), farthest(count, -1);
    std::vector<bool> flip_part(count);
    for (std::size_t i = 0; i < count; ++i) {
        const std::uint32_t root = forest.root(std::uint32_t(i)).index;
        sums[root] += vec_cast<double>(votes.positions[i]), sizes[root] += 1;
    }
    for (std::size_t i = 0; i < count; ++i) {
        const auto [root, flip] = forest.root(std::uint32_t(i));
        const Vec3d outwards = vec_cast<double>(votes.positions[i]) - sums[root] / sizes[root];
        const double distance = norm(outwards);
        if (!has_normal(i) || !(distance > farthest[root])) continue;
        farthest[root] = distance;
        flip_part[root] = (dot(vec_cast<double>(votes.normals[i]), outwards) < 0) != flip;
    }
    for (std::size_t i = 0; i < count; ++i) {
        const auto [root, flip] = forest.root(std::uint32_t(i));
        if (flip != flip_part[root]) votes.normals[i] = -votes.normals[i];
    }
}

}  // namespace tvsgs
