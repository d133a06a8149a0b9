#include "io/splats/sh_palette.h"

#include <algorithm>
#include <limits>

#include "core/device/parallel.h"

namespace tvsgs {
namespace {

constexpr int kMaxWidth = 256, kSteps = 10;
constexpr std::size_t kSample = 65536;  // enough to find the cells of many more vectors

struct Vectors {
    const float* values;
    std::size_t numbers;

    const float* operator[](int i) const { return values + static_cast<std::size_t>(i) * numbers; }
};

/// Up to kMaxWidth centres, stored component by component, so that distances to all centres
/// vectorise.
struct Centres {
    int count = 0;
    std::vector<float> values{};  // [numbers, count]

    float& at(std::size_t number, int centre) {
        return values[number * static_cast<std::size_t>(count) + static_cast<std::size_t>(centre)];
    }
    int nearest(const float* vector, std::size_t numbers, float* squared) const {
        float distances[kMaxWidth] = {};
        const float* row = values.data();
        for (std::size_t k = 0; k < numbers; ++k, row += count)
            for (int c = 0; c < count; ++c) {
                const float d = row[c] - vector[k];
                distances[c] += d * d;
            }
        const float* const least = std::min_element(distances, distances + count);
        *squared = *least;
        return static_cast<int>(least - distances);
    }
};

/// Partition of a group of vectors by centres.
struct Split {
    Centres centres;
    std::vector<int> labels;       // centre of each member
    std::vector<float> distances;  // squared
};

void assign(const Vectors& vectors, const std::vector<int>& members, Split& split) {
    split.labels.resize(members.size()), split.distances.resize(members.size());
    parallel_for(Cpu{}, static_cast<int>(members.size()), [&](int at) {
        const auto i = static_cast<std::size_t>(at);
        split.labels[i] =
            split.centres.nearest(vectors[members[i]], vectors.numbers, &split.distances[i]);
    });
}

/// Moves centres to the means of their members. A centre without members moves to the vector
/// farthest from its centre.
void move_centres(const Vectors& vectors, const std::vector<int>& members, Split& split) {
    const auto width = static_cast<std::size_t>(split.centres.count);
    std::vector<double> sums(width * vectors.numbers, 0);
    std::vector<int> counts(width, 0);
    for (std::size_t i = 0; i < members.size(); ++i) {
        const auto label = static_cast<std::size_t>(split.labels[i]);
        ++counts[label];
        for (std::size_t k = 0; k < vectors.numbers; ++k)
            sums[label * vectors.numbers + k] += double{vectors[members[i]][k]};
    }
    for (std::size_t c = 0; c < width; ++c) {
        const float* far = nullptr;
        if (counts[c] == 0) {
            const auto at = std::max_element(split.distances.begin(), split.distances.end());
            if (!(*at > 0)) continue;
            *at = 0;
            far = vectors[members[static_cast<std::size_t>(at - split.distances.begin())]];
        }
        for (std::size_t k = 0; k < vectors.numbers; ++k)
            split.centres.at(k, static_cast<int>(c)) =
                far ? far[k] : static_cast<float>(sums[c * vectors.numbers + k] / counts[c]);
    }
}

Split split_group(const Vectors& vectors, const std::vector<int>& members, int width) {
    Split split;
    split.centres.count = width;
    split.centres.values.resize(static_cast<std::size_t>(width) * vectors.numbers);
    for (int c = 0; c < width; ++c) {
        const std::size_t first =
            static_cast<std::size_t>(c) * members.size() / static_cast<std::size_t>(width);
        for (std::size_t k = 0; k < vectors.numbers; ++k)
            split.centres.at(k, c) = vectors[members[first]][k];
    }
    std::vector<int> sample = members;
    if (const std::size_t stride = (members.size() + kSample - 1) / kSample; stride > 1) {
        sample.clear();
        for (std::size_t i = 0; i < members.size(); i += stride) sample.push_back(members[i]);
    }
    for (int step = 0; step < kSteps; ++step) {
        assign(vectors, sample, split);
        move_centres(vectors, sample, split);
    }
    assign(vectors, members, split);
    return split;
}

struct Group {
    std::vector<int> members, labels;  // indices of the vectors; index of the centre of each
    std::vector<float> centres;        // [count, numbers]
    int count = 0;
};

/// Finds up to `count` centres for a group.
void find_centres(const Vectors& vectors, Group& group, int count, int depth) {
    const int size = static_cast<int>(group.members.size());
    constexpr int kMaxDepth = 6;  // nearly equal vectors could recurse without end
    const bool leaf = count <= kMaxWidth || depth == kMaxDepth;
    const Split split = split_group(vectors, group.members, std::min({count, size, kMaxWidth}));
    std::vector<Group> parts(static_cast<std::size_t>(split.centres.count));
    std::vector<float> widest(parts.size(), 0);
    for (std::size_t i = 0; i < group.members.size(); ++i) {
        const auto label = static_cast<std::size_t>(split.labels[i]);
        parts[label].members.push_back(group.members[i]);
        widest[label] = std::max(widest[label], split.distances[i]);
    }
    parallel_for_heavy(Cpu{}, static_cast<int>(parts.size()), [&](int p) {
        const auto at = static_cast<std::size_t>(p);
        Group& part = parts[at];
        if (part.members.empty()) return;
        if (leaf || widest[at] == 0) {
            part.count = 1;
            part.labels.assign(part.members.size(), 0);
            for (std::size_t k = 0; k < vectors.numbers; ++k)
                part.centres.push_back(split.centres.values[k * parts.size() + at]);
            return;
        }
        const auto more = static_cast<std::int64_t>(count - split.centres.count);
        const auto members = static_cast<std::int64_t>(part.members.size());
        find_centres(vectors, part, static_cast<int>(1 + more * members / size), depth + 1);
    });
    group.labels.resize(group.members.size());
    std::vector<std::size_t> next(parts.size(), 0);
    std::vector<int> first(parts.size(), 0);
    for (std::size_t p = 0; p < parts.size(); ++p) {
        first[p] = group.count;
        group.count += parts[p].count;
        group.centres.insert(group.centres.end(), parts[p].centres.begin(), parts[p].centres.end());
    }
    for (std::size_t i = 0; i < group.members.size(); ++i) {
        const auto p = static_cast<std::size_t>(split.labels[i]);
        group.labels[i] = first[p] + parts[p].labels[next[p]++];
    }
}

}  // namespace

ShPalette make_sh_palette(const std::vector<float>& vectors, int numbers, int count) {
    ShPalette out;
    const Vectors view{vectors.data(), static_cast<std::size_t>(numbers)};
    Group all;
    all.members.resize(vectors.size() / view.numbers);
    for (std::size_t i = 0; i < all.members.size(); ++i) all.members[i] = static_cast<int>(i);
    if (all.members.empty()) return out;
    find_centres(view, all, std::clamp(count, 1, 65536), 0);
    out.count = all.count;
    out.centres = std::move(all.centres);
    out.labels.assign(all.labels.begin(), all.labels.end());
    return out;
}

}  // namespace tvsgs
