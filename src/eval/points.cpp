#include "eval/points.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/math/rng.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

using Cell = std::array<std::int64_t, 3>;

std::vector<std::uint32_t> visiting_order(std::size_t count, std::optional<std::uint64_t> seed) {
    std::vector<std::uint32_t> order(count);
    std::iota(order.begin(), order.end(), 0u);
    if (!seed) return order;
    std::vector<std::uint64_t> key(count);  // random number above, index below: no ties
    parallel_for(Cpu{}, static_cast<int>(count), [&](int i) {
        const Random4 r = random4(*seed, RandomStream::thinning, static_cast<std::uint64_t>(i));
        key[i] = std::uint64_t{r.v[0]} << 32 | static_cast<std::uint32_t>(i);
    });
    std::ranges::sort(key);
    for (std::size_t i = 0; i < count; ++i) order[i] = static_cast<std::uint32_t>(key[i]);
    return order;
}

/// Kept points by cell. Cells are stored in blocks of 4x4x4, so that the 27 cells around a point
/// are in few places of memory.
class KeptPoints {
public:
    explicit KeptPoints(std::size_t count) : next_(count, kNone) {
        table_.assign(std::size_t{1} << 12, kNone);
    }

    /// Calls is_near(index) for the kept points of the 27 surrounding cells until it returns true.
    template <class IsNear>
    bool any_around(const Cell& cell, const IsNear& is_near) const {
        std::array<std::int64_t, 3> first, last;
        for (std::size_t a = 0; a < 3; ++a)
            first[a] = (cell[a] - 1) >> 2, last[a] = (cell[a] + 1) >> 2;
        for (std::int64_t bx = first[0]; bx <= last[0]; ++bx)
            for (std::int64_t by = first[1]; by <= last[1]; ++by)
                for (std::int64_t bz = first[2]; bz <= last[2]; ++bz) {
                    const std::uint32_t block = find({bx, by, bz});
                    if (block != kNone && any_in(blocks_[block], cell, is_near)) return true;
                }
        return false;
    }

    void add(const Cell& cell, std::uint32_t index) {
        const Cell at{cell[0] >> 2, cell[1] >> 2, cell[2] >> 2};
        std::uint32_t block = find(at);
        if (block == kNone) {
            block = static_cast<std::uint32_t>(blocks_.size());
            blocks_.push_back({});
            blocks_.back().at = at;
            blocks_.back().head.fill(kNone);
            if (2 * blocks_.size() > table_.size()) grow();
            insert(block);
        }
        std::uint32_t& head = blocks_[block].head[slot(cell)];
        next_[index] = head, head = index;
        blocks_[block].occupied |= std::uint64_t{1} << slot(cell);
    }

private:
    static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
    struct Block {
        Cell at;
        std::uint64_t occupied = 0;
        std::array<std::uint32_t, 64> head;  // of a list through next_, per cell
    };

    static std::size_t slot(const Cell& cell) {
        return static_cast<std::size_t>((cell[0] & 3) << 4 | (cell[1] & 3) << 2 | (cell[2] & 3));
    }
    static std::size_t hash(const Cell& at) {
        std::uint64_t h = 0;
        for (const std::int64_t c : at)
            h = (h ^ static_cast<std::uint64_t>(c)) * 0x9E3779B97F4A7C15ull, h ^= h >> 32;
        return static_cast<std::size_t>(h);
    }
    template <class IsNear>
    bool any_in(const Block& block, const Cell& cell, const IsNear& is_near) const {
        for (std::uint64_t left = block.occupied; left != 0; left &= left - 1) {
            const int s = __builtin_ctzll(left);
            const Cell at{block.at[0] * 4 + (s >> 4), block.at[1] * 4 + (s >> 2 & 3),
                          block.at[2] * 4 + (s & 3)};
            if (std::abs(at[0] - cell[0]) > 1 || std::abs(at[1] - cell[1]) > 1 ||
                std::abs(at[2] - cell[2]) > 1)
                continue;
            for (std::uint32_t i = block.head[s]; i != kNone; i = next_[i])
                if (is_near(i)) return true;
        }
        return false;
    }
    /// Faster than ==, which calls memcmp.
    static bool equal(const Cell& a, const Cell& b) {
        return ((a[0] ^ b[0]) | (a[1] ^ b[1]) | (a[2] ^ b[2])) == 0;
    }
    std::uint32_t find(const Cell& at) const {
        for (std::size_t i = hash(at) & (table_.size() - 1);; i = (i + 1) & (table_.size() - 1))
            if (table_[i] == kNone || equal(blocks_[table_[i]].at, at)) return table_[i];
    }
    void insert(std::uint32_t block) {
        std::size_t i = hash(blocks_[block].at) & (table_.size() - 1);
        while (table_[i] != kNone) i = (i + 1) & (table_.size() - 1);
        table_[i] = block;
    }
    void grow() {
        table_.assign(2 * table_.size(), kNone);
        for (std::uint32_t block = 0; block + 1 < blocks_.size(); ++block) insert(block);
    }

    std::vector<Block> blocks_;
    std::vector<std::uint32_t> table_, next_;
};

}  // namespace

PointBounds bounds_of(const Points& points) {
    PointBounds box{points[0], points[0]};
    for (const Vec3d p : points)
        for (int a = 0; a < 3; ++a) {
            box.lower[a] = std::min(box.lower[a], p[a]);
            box.upper[a] = std::max(box.upper[a], p[a]);
        }
    return box;
}

std::string point_text(Vec3d p) {
    return str("(", p.x, ", ", p.y, ", ", p.z, ")");
}

std::vector<std::uint32_t> thin_points(const Points& points,
                                       double radius,
                                       std::optional<std::uint64_t> seed) {
    std::vector<std::uint32_t> kept;
    if (points.empty()) return kept;
    const Vec3d lower = bounds_of(points).lower;
    // Cells slightly larger than the radius, so that rounding cannot put two points at exactly that
    // distance two cells apart.
    const double inverse = 1 / (radius * (1 + 1e-9));
    KeptPoints grid(points.size());
    for (const std::uint32_t i : visiting_order(points.size(), seed)) {
        const Vec3d p = points[i];
        Cell cell;
        for (int a = 0; a < 3; ++a)
            cell[a] = static_cast<std::int64_t>(std::floor((p[a] - lower[a]) * inverse));
        const bool taken = grid.any_around(cell, [&](std::uint32_t j) {
            const Vec3d d = points[j] - p;
            return dot(d, d) <= radius * radius;
        });
        if (taken) continue;
        grid.add(cell, i);
        kept.push_back(i);
    }
    std::ranges::sort(kept);
    return kept;
}

Points voxel_means(const Points& points, double voxel) {
    if (points.empty()) return {};
    const Vec3d half{0.5 * voxel, 0.5 * voxel, 0.5 * voxel},
        origin = bounds_of(points).lower - half;
    struct Entry {
        std::uint64_t voxel;
        std::uint32_t point;
        auto operator<=>(const Entry&) const = default;
    };
    std::vector<Entry> entries(points.size());
    constexpr double kMaxVoxels = 1 << 21;
    for (std::size_t i = 0; i < points.size(); ++i) {
        std::uint64_t key = 0;
        for (int a = 0; a < 3; ++a) {
            const double index = std::floor((points[i][a] - origin[a]) / voxel);
            if (!(index >= 0 && index < kMaxVoxels))
                throw input_error(
                    "voxels of ", voxel, " are too small for a cloud ", points[i][a] - origin[a],
                    " long (limit 2^21 voxels a side); crop the cloud, or check its units");
            key = key << 21 | static_cast<std::uint64_t>(index);
        }
        entries[i] = {key, static_cast<std::uint32_t>(i)};
    }
    std::ranges::sort(entries);
    Points means;
    for (std::size_t begin = 0, end = 0; begin < entries.size(); begin = end) {
        Vec3d sum{};
        for (; end < entries.size() && entries[end].voxel == entries[begin].voxel; ++end)
            sum += points[entries[end].point];
        means.push_back(sum / static_cast<double>(end - begin));
    }
    return means;
}

}  // namespace tvsgs
