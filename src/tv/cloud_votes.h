// Tensor voting between the points of a cloud: normals, saliencies, confidence, moved points.
// [docs/guide/vote.md]
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "core/scene/scene.h"

namespace tvsgs {

struct CloudVoteOptions {
    int k = 30;           // nearest points whose votes a point receives
    float radius = 0;     // world units; points farther away do not vote; 0: no limit
    int refine = 0;       // rounds in which points move to their voted places
    bool reject = false;  // drop outliers before all other work
    /// The neighbours of all points stay in memory up to this size; else each pass searches again.
    std::size_t list_bytes = std::size_t{2} << 30;
    int block = 1 << 18;  // points of one block, which follow each other in Morton order
};

/// Neighbours of each point that orient_along_graph() uses.
inline constexpr int kGraphNeighbours = 8;
inline constexpr std::uint32_t kNoPoint = 0xffffffffu;

/// Results, one entry per kept point, in the order of the input.
struct CloudVotes {
    std::vector<std::size_t> kept;       // index in the input
    std::vector<Vec3f> positions;        // moved, with `refine`
    std::vector<Vec3f> normals;          // unit; zero: the votes give no normal
    std::vector<Vec3f> eigenvalues;      // of the summed votes, descending
    std::vector<float> confidences;      // [0, 1]
    std::vector<int> order;              // entries of the points in Morton order
    std::vector<std::uint32_t> nearest;  // [N, kGraphNeighbours] in this order: places in it of the
                                         // nearest points, or kNoPoint

    /// Saliencies as in docs/method/voting.md: votes are tangents.
    float surface(std::size_t i) const { return eigenvalues[i].y - eigenvalues[i].z; }
    float curve(std::size_t i) const { return eigenvalues[i].x - eigenvalues[i].y; }
    float point(std::size_t i) const { return eigenvalues[i].z; }
};

/// Called with the number of points that one more pass has finished.
using CloudProgress = std::function<void(int points)>;
/// The sum of these numbers.
double cloud_vote_steps(const CloudVoteOptions& options, std::size_t points);

/// Votes between the points. Points with a normal vote as sticks, the others as balls and then also
/// as sticks; a confidence in [0, 1] is the strength of a point's votes. A normal keeps the side of
/// the normal in the input. Positions must be finite. With fewer than two points nothing gets a
/// normal. [docs/guide/vote.md#formulas]
template <class Device>
CloudVotes vote_in_cloud(Device,
                         const PointCloud& cloud,
                         const CloudVoteOptions& options,
                         const CloudProgress& progress = {});

void orient_to_viewpoint(CloudVotes& votes, Vec3f viewpoint);

/// Turns neighbouring normals to the same side, the most parallel pairs first, and the normal of
/// the point farthest from the centre of its part outwards.
void orient_along_graph(CloudVotes& votes);

}  // namespace tvsgs
