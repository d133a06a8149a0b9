#include "mesh/mend/triangle_tree.h"

#include <algorithm>
#include <array>
#include <bit>

#include "core/device/morton.h"
#include "core/device/parallel_lists.h"
#include "core/scene/view_frustum.h"
#include "mesh/mend/mesh_corners.h"

namespace tvsgs {
namespace {

constexpr std::size_t kLeaf = 4;  // most triangles of a leaf
// Most triangles of a node that is cut by area although there are codes.
constexpr std::size_t kCut = 16;
constexpr std::uint32_t kNoFace = ~0u;
constexpr int kBins = 16;               // candidate positions of a cut
constexpr int kBalancedDepth = 48;      // deeper nodes are halved, which bounds the depth
constexpr std::size_t kTask = 1 << 15;  // least triangles of a parallel task

struct Box {
    static constexpr float kFar = std::numeric_limits<float>::infinity();
    Vec3f lower{kFar, kFar, kFar}, upper{-kFar, -kFar, -kFar};

    void add(const Box& other) {
        for (int axis = 0; axis < 3; ++axis) {
            lower[axis] = std::min(lower[axis], other.lower[axis]);
            upper[axis] = std::max(upper[axis], other.upper[axis]);
        }
    }
    double half_area() const {
        const Vec3d d = vec_cast<double>(upper) - vec_cast<double>(lower);
        return d.x * d.y + d.y * d.z + d.z * d.x;
    }
};

/// A triangle during construction.
struct Item {
    Box box;
    std::uint32_t face;
    double middle(int axis) const { return double(box.lower[axis]) + double(box.upper[axis]); }
};

double squared_distance(Vec3d p, Vec3f lower, Vec3f upper) {
    double sum = 0;
    for (int axis = 0; axis < 3; ++axis) {
        const double d =
            std::max({double(lower[axis]) - p[axis], p[axis] - double(upper[axis]), 0.0});
        sum += d * d;
    }
    return sum;
}

}  // namespace

/// Cuts ranges of triangles where the expected number of tests is least, by the surface areas of
/// the two boxes.
struct TriangleTree::Builder {
    std::vector<Item>& items;
    const std::vector<std::uint32_t> codes;  // of the items, ascending; empty: unknown

    /// Partitions items [first, last), whose centres span `middles`, and returns the cut.
    std::size_t cut(std::size_t first, std::size_t last, const Box& middles, int depth) const {
        const auto begin = items.begin() + first, end = items.begin() + last;
        const Vec3f size = middles.upper - middles.lower;
        const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
        const std::size_t half = first + (last - first) / 2;
        if (!(size[axis] > 0)) return half;  // all centres coincide; any order
        const auto by_middle = [axis](const Item& a, const Item& b) {
            const double x = a.middle(axis), y = b.middle(axis);
            return x < y || (x == y && a.face < b.face);
        };
        const auto halve = [&] {
            std::nth_element(begin, items.begin() + half, end, by_middle);
            return half;
        };
        if (depth >= kBalancedDepth) return halve();

        const double from = middles.lower[axis], scale = kBins / double(size[axis]);
        const auto bin_of = [&](const Item& item) {
            const double place = (0.5 * item.middle(axis) - from) * scale;
            return std::clamp(static_cast<int>(place), 0, kBins - 1);
        };
        std::array<Box, kBins> boxes;
        std::array<std::size_t, kBins> counts{};
        for (auto item = begin; item != end; ++item) {
            const auto bin = static_cast<std::size_t>(bin_of(*item));
            boxes[bin].add(item->box);
            ++counts[bin];
        }
        std::array<double, kBins> cost{};  // of a cut behind each bin
        const auto sweep = [&](bool forward) {
            Box box;
            std::size_t count = 0;
            for (std::size_t i = 0; i + 1 < kBins; ++i) {
                const std::size_t bin = forward ? i : kBins - 1 - i;
                box.add(boxes[bin]);
                count += counts[bin];
                cost[forward ? bin : bin - 1] +=
                    count > 0 ? static_cast<double>(count) * box.half_area() : 0;
            }
        };
        sweep(true), sweep(false);
        const auto best = std::min_element(cost.begin(), cost.end() - 1) - cost.begin();
        const auto middle =
            std::partition(begin, end, [&](const Item& item) { return bin_of(item) <= best; });
        return middle == begin || middle == end ? halve() : std::size_t(middle - items.begin());
    }

    /// Adds the node of items [first, last) without its children. Returns the first item of the
    /// second child, `last` for a leaf, whose `place` is its first item.
    std::size_t add_node(std::size_t first,
                         std::size_t last,
                         int depth,
                         std::vector<Node>& out) const {
        if (!codes.empty() && last - first > kCut && codes[first] != codes[last - 1]) {
            out.emplace_back();  // add_children() sets the box
            // The cut is where the highest bit changes that differs within the range.
            const std::uint32_t high = std::bit_floor(codes[first] ^ codes[last - 1]),
                                start = (codes[last - 1] & ~(high - 1));
            const auto middle =
                std::lower_bound(codes.begin() + first, codes.begin() + last, start);
            return std::size_t(middle - codes.begin());
        }
        Box box, middles;
        for (std::size_t i = first; i < last; ++i) {
            box.add(items[i].box);
            Vec3f middle;
            for (int axis = 0; axis < 3; ++axis)
                middle[axis] = static_cast<float>(0.5 * items[i].middle(axis));
            middles.add({middle, middle});
        }
        const std::size_t count = last - first;
        out.push_back({box.lower, static_cast<std::uint32_t>(first), box.upper,
                       static_cast<std::uint32_t>(count)});
        return count > kLeaf ? cut(first, last, middles, depth) : last;
    }

    /// Calls the two functions, which add the children of out[at], and makes it their parent.
    template <class First, class Second>
    static void add_children(std::size_t at,
                             std::vector<Node>& out,
                             const First& first,
                             const Second& second) {
        first();
        const std::size_t place = out.size() - at;
        second();
        const Node &a = out[at + 1], &b = out[at + place];
        Box both{a.lower, a.upper};
        both.add({b.lower, b.upper});
        out[at] = {both.lower, static_cast<std::uint32_t>(place), both.upper, 0};
    }

    /// Adds the tree of items [first, last).
    void append(std::size_t first, std::size_t last, int depth, std::vector<Node>& out) const {
        const std::size_t at = out.size(), middle = add_node(first, last, depth, out);
        if (middle == last) return;
        add_children(
            at, out, [&] { append(first, middle, depth + 1, out); },
            [&] { append(middle, last, depth + 1, out); });
    }

    /// A range of items: a whole tree, or one node and two further parts.
    struct Part {
        std::size_t first, last;
        int depth;
        std::size_t children = 0;  // index of the first of two; 0: none
        std::vector<Node> nodes = {};
    };

    void append_part(const std::vector<Part>& parts,
                     std::size_t index,
                     std::vector<Node>& out) const {
        const Part& part = parts[index];
        const std::size_t at = out.size();
        out.insert(out.end(), part.nodes.begin(), part.nodes.end());
        if (part.children == 0) return;
        add_children(
            at, out, [&] { append_part(parts, part.children, out); },
            [&] { append_part(parts, part.children + 1, out); });
    }

    /// The tree of all items. Threads cut the large ranges of a level, and then build the parts.
    std::vector<Node> build() const {
        constexpr int kLevels = 7;
        std::vector<Part> parts{{0, items.size(), 0}};
        std::size_t begin = 0;
        for (int level = 0; level < kLevels; ++level) {
            const std::size_t end = parts.size();
            std::vector<std::size_t> middles(end - begin);
            parallel_for_heavy(Cpu{}, static_cast<int>(end - begin), [&](int at) {
                Part& part = parts[begin + at];
                middles[at] = part.last - part.first > kTask
                                  ? add_node(part.first, part.last, part.depth, part.nodes)
                                  : part.last;
            });
            for (std::size_t i = begin; i < end; ++i) {
                const std::size_t first = parts[i].first, last = parts[i].last,
                                  middle = middles[i - begin];
                if (middle == last) continue;
                parts[i].children = parts.size();
                parts.push_back({first, middle, parts[i].depth + 1});
                parts.push_back({middle, last, parts[i].depth + 1});
            }
            begin = end;
        }
        parallel_for_heavy(Cpu{}, static_cast<int>(parts.size()), [&](int i) {
            Part& part = parts[i];
            if (part.children == 0) append(part.first, part.last, part.depth, part.nodes);
        });
        std::vector<Node> out;
        append_part(parts, 0, out);
        return out;
    }
};

SpatialOrder spatial_order(const std::vector<Vec3f>& points) {
    constexpr float kCells = 1 << 10;  // along an axis
    Box3f box;
    for (const Vec3f& p : points) box.add(p);
    const Vec3f size = box.high - box.low;
    const float extent = std::max({0.0f, size.x, size.y, size.z});
    const float scale = extent > 0 ? kCells / extent : 0;
    std::vector<std::pair<std::uint32_t, int>> keyed(points.size());
    parallel_for(Cpu{}, static_cast<int>(points.size()), [&](int i) {
        std::uint32_t key = 0;
        for (int axis = 0; axis < 3; ++axis) {
            const float cell = scale * (points[i][axis] - box.low[axis]);
            const auto bits = static_cast<std::uint64_t>(cell < kCells - 1 ? cell : kCells - 1);
            key |= static_cast<std::uint32_t>(spread_bits(bits)) << axis;
        }
        keyed[i] = {key, i};
    });
    sort_in_parallel(keyed, std::less<>());
    SpatialOrder order;
    for (const auto& [key, place] : keyed)
        order.places.push_back(place), order.codes.push_back(key);
    return order;
}

TriangleTree::TriangleTree(const TriangleMesh& mesh, const SpatialOrder& order) {
    check_indices(mesh);
    std::vector<Item> items(mesh.faces.size());
    parallel_for(Cpu{}, static_cast<int>(items.size()), [&](int i) {
        const int f = order.places.empty() ? i : order.places[i];
        Item& item = items[i];
        item.face = static_cast<std::uint32_t>(f);
        for (int k = 0; k < 3; ++k) {
            const Vec3f p = mesh.vertices[mesh.faces[f][k]];
            if (!is_finite(p)) item.face = kNoFace;
            item.box.add({p, p});
        }
    });
    left_out_ = std::erase_if(items, [](const Item& item) { return item.face == kNoFace; });
    if (items.empty()) return;
    nodes_ = Builder{items, left_out_ > 0 ? std::vector<std::uint32_t>() : order.codes}.build();
    triangles_.resize(items.size());
    parallel_for(Cpu{}, static_cast<int>(items.size()), [&](int at) {
        const Vec3i face = mesh.faces[items[at].face];
        triangles_[at] = {mesh.vertices[face.x], mesh.vertices[face.y], mesh.vertices[face.z],
                          items[at].face};
    });
}

double TriangleTree::distance(Vec3d p, double limit, std::size_t* start) const {
    if (empty()) return std::numeric_limits<double>::infinity();
    double best = limit * limit;
    bool found = false;
    const auto look_at = [&](std::size_t t) {
        const Vec3d q = closest_on_triangle(p, vec_cast<double>(triangles_[t].a),
                                            vec_cast<double>(triangles_[t].b),
                                            vec_cast<double>(triangles_[t].c));
        const double squared = dot(p - q, p - q);
        if (squared < best) best = squared, found = true, *start = t;
    };
    look_at(*start);
    struct Entry {
        std::uint32_t node;
        double squared;
    };
    Entry stack[kMaxDepth];
    int height = 0;
    stack[height++] = {0, squared_distance(p, nodes_[0].lower, nodes_[0].upper)};
    while (height > 0) {
        const Entry entry = stack[--height];
        // Rounding must not skip the triangle that decides.
        if (entry.squared * (1 - 1e-14) >= best) continue;
        const Node& node = nodes_[entry.node];
        if (node.count > 0) {
            for (std::uint32_t t = node.place; t < node.place + node.count; ++t) look_at(t);
            continue;
        }
        const std::uint32_t children[2] = {entry.node + 1, entry.node + node.place};
        const double squared[2] = {
            squared_distance(p, nodes_[children[0]].lower, nodes_[children[0]].upper),
            squared_distance(p, nodes_[children[1]].lower, nodes_[children[1]].upper)};
        const int far = squared[0] <= squared[1] ? 1 : 0;
        stack[height++] = {children[far], squared[far]};
        stack[height++] = {children[1 - far], squared[1 - far]};
    }
    return found ? std::sqrt(best) : std::numeric_limits<double>::infinity();
}

bool TriangleTree::meets(Vec3d lower, Vec3d upper) const {
    if (empty()) return false;
    bool found = false;
    const auto enters = [&](const Node& node) {
        bool inside = true, outside = false;
        for (int axis = 0; axis < 3; ++axis) {
            const double from = node.lower[axis], to = node.upper[axis];
            outside = outside || from > upper[axis] || to < lower[axis];
            inside = inside && from >= lower[axis] && to <= upper[axis];
        }
        found = found || inside;
        return !found && !outside;
    };
    walk(enters, [&](Vec3d a, Vec3d b, Vec3d c) {
        return found = found || reaches_into(a, b, c, lower, upper);
    });
    return found;
}

std::vector<double> TriangleTree::distances(const std::vector<Vec3d>& points, double limit) const {
    std::vector<double> out(points.size(), std::numeric_limits<double>::infinity());
    if (empty()) return out;
    constexpr std::size_t kChunk = 1024;
    const std::size_t chunks = (points.size() + kChunk - 1) / kChunk;
    parallel_for_heavy(Cpu{}, static_cast<int>(chunks), [&](int chunk) {
        const std::size_t first = std::size_t(chunk) * kChunk;
        std::size_t start = 0;
        for (std::size_t i = first; i < std::min(points.size(), first + kChunk); ++i)
            out[i] = distance(points[i], limit, &start);
    });
    return out;
}

}  // namespace tvsgs
