#include "io/splats/codebook.h"

#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"

namespace tvsgs {
namespace {

/// Centres whose density follows the cube root of the density of `values` (sorted). This is optimal
/// for many codes and a good start for Lloyd's algorithm.  [Gersho and Gray, Vector Quantization,
/// 5.6]
std::array<double, Codebook{}.size()> first_centres(const std::vector<float>& values) {
    std::array<double, Codebook{}.size()> centres;
    const std::size_t last = values.size() - 1, parts = std::min<std::size_t>(last, 4096);
    const auto edge = [&](std::size_t part) { return double{values[part * last / parts]}; };
    std::vector<double> codes(parts + 1, 0);  // cumulative, not normalised
    for (std::size_t i = 0; i < parts; ++i)
        codes[i + 1] = codes[i] + std::pow(edge(i + 1) - edge(i), 2.0 / 3);
    std::size_t part = 0;
    for (std::size_t c = 0; c < centres.size(); ++c) {
        const double wanted =
            (static_cast<double>(c) + 0.5) / static_cast<double>(centres.size()) * codes[parts];
        while (part + 1 < parts && codes[part + 1] < wanted) ++part;
        const double width = codes[part + 1] - codes[part];
        const double within = width > 0 ? (wanted - codes[part]) / width : 0;
        centres[c] = edge(part) + within * (edge(part + 1) - edge(part));
    }
    return centres;
}

constexpr int kMaxWidth = 256, kRounds = 10;
constexpr std::size_t kSample = 65536;  // enough to find the cells of many more vectors

struct Vectors {
    const float* values;
    std::size_t numbers;

    const float* operator[](int i) const { return values + i * numbers; }
};

/// Up to kMaxWidth centres, stored component by component, so that distances to all centres
/// vectorise.
struct Centres {
    int count = 0;
    std::vector<float> values{};  // [numbers, count]

    float& at(std::size_t number, int centre) { return values[number * count + centre]; }
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
    parallel_for(Cpu{}, static_cast<int>(members.size()), [&](std::size_t i) {
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
            const auto at = std::ranges::max_element(split.distances);
            if (!(*at > 0)) continue;
            *at = 0;
            far = vectors[members[at - split.distances.begin()]];
        }
        for (std::size_t k = 0; k < vectors.numbers; ++k)
            split.centres.at(k, static_cast<int>(c)) =
                far ? far[k] : static_cast<float>(sums[c * vectors.numbers + k] / counts[c]);
    }
}

Split split_group(const Vectors& vectors, const std::vector<int>& members, int width) {
    Split split;
    split.centres.count = width;
    split.centres.values.resize(width * vectors.numbers);
    for (int c = 0; c < width; ++c) {
        const std::size_t first = c * members.size() / width;
        for (std::size_t k = 0; k < vectors.numbers; ++k)
            split.centres.at(k, static_cast<int>(c)) = vectors[members[first]][k];
    }
    std::vector<int> sample = members;
    if (const std::size_t stride = (members.size() + kSample - 1) / kSample; stride > 1) {
        sample.clear();
        for (std::size_t i = 0; i < members.size(); i += stride) sample.push_back(members[i]);
    }
    for (int round = 0; round < kRounds; ++round) {
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
    parallel_for_heavy(Cpu{}, static_cast<int>(parts.size()), [&](std::size_t at) {
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

Codebook make_codebook(std::vector<float> values) {
    Codebook codes{};
    constexpr std::size_t kCodes = codes.size(), kMost = std::size_t{1} << 20;
    if (values.empty()) return codes;
    if (const std::size_t stride = (values.size() + kMost - 1) / kMost; stride > 1) {
        for (std::size_t i = 0; i * stride < values.size(); ++i) values[i] = values[i * stride];
        values.resize((values.size() + stride - 1) / stride);
    }
    std::ranges::sort(values);
    std::vector<float> different;
    for (const float v : values) {
        if (different.empty() || v != different.back()) different.push_back(v);
        if (different.size() > kCodes) break;
    }
    if (different.size() <= kCodes) {
        for (std::size_t c = 0; c < kCodes; ++c)
            codes[c] = different[std::min(c, different.size() - 1)];
        return codes;
    }
    const std::size_t count = values.size();
    std::vector<double> sums(count + 1, 0);  // prefix sums: the sum of a cell is a difference
    for (std::size_t i = 0; i < count; ++i) sums[i + 1] = sums[i] + double{values[i]};
    std::array<double, kCodes> centres = first_centres(values);
    constexpr int kSteps = 100;  // a step takes microseconds
    for (int step = 0; step < kSteps; ++step) {
        bool moved = false;
        std::size_t begin = 0;
        for (std::size_t c = 0; c < kCodes; ++c) {
            std::size_t end = count;
            if (c + 1 < kCodes) {
                const double border = (centres[c] + centres[c + 1]) / 2;
                end = static_cast<std::size_t>(
                    std::upper_bound(values.begin() + static_cast<std::ptrdiff_t>(begin),
                                     values.end(), border,
                                     [](double b, float v) { return b < double{v}; }) -
                    values.begin());
            }
            if (end > begin) {
                const double mean = (sums[end] - sums[begin]) / static_cast<double>(end - begin);
                moved = moved || mean != centres[c];
                centres[c] = mean;
            }
            begin = end;
        }
        if (!moved) break;
    }
    std::ranges::sort(centres);
    std::transform(centres.begin(), centres.end(), codes.begin(),
                   [](double v) { return static_cast<float>(v); });
    return codes;
}

std::uint8_t nearest_code(const Codebook& codes, float value) {
    const auto above = std::ranges::lower_bound(codes, value);
    if (above == codes.begin()) return 0;
    const auto at = above - codes.begin();
    const bool lower = above == codes.end() || value - above[-1] <= above[0] - value;
    return static_cast<std::uint8_t>(lower ? at - 1 : at);
}

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
