#include "optim/photo/sky.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "core/device/parallel.h"
#include "core/math/quantile.h"
#include "core/scene/photo_light.h"
#include "core/scene/sky_map.h"
#include "optim/views/matchable.h"
#include "optim/views/view_pairs.h"

namespace tvsgs {
namespace {

constexpr int kWidth = 200;  // blocks at most
constexpr int kReach = 3;    // half width of a window, blocks
constexpr int kOthers = 8;   // views that each view is compared with
constexpr double kMove = 3;  // blocks by which far points must move between two compared views
constexpr double kFarPoints = 0.9;   // quantile of a view's depths that counts as far
constexpr double kLeastSeen = 0.01;  // smallest comparable share of the blocks
// Least deviation, least correlation, largest difference of grey levels (0 to 1, full light).
constexpr double kTextured = 0.02, kAlike = 0.85, kSame = 0.06;

/// A view reduced to the means of blocks of pixels.
struct Small {
    int block = 1, width = 0, height = 0;
    double light;                  // PhotoLight::share
    Camera camera;                 // of the blocks
    std::vector<float> grey;       // 0 to 1
    std::vector<std::uint8_t> is;  // whether the block is used

    Small(const View& view, bool masks)
        : block((view.camera.width_px + kWidth - 1) / kWidth),
          width(view.camera.width_px / block),
          height(view.camera.height_px / block),
          light(measure_light(view.photo).share),
          camera(view.camera),
          grey(std::size_t(width) * height),
          is(grey.size(), 1) {
        const auto by = float(block);
        camera.width_px = width, camera.height_px = height;
        camera.fx_px /= by, camera.fy_px /= by, camera.cx_px /= by, camera.cy_px /= by;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) fill(view, masks, x, y);
    }

private:
    void fill(const View& view, bool masks, int x, int y) {
        const auto i = std::size_t(y * width + x);
        int sum = 0;
        for (int v = y * block; v < (y + 1) * block; ++v)
            for (int u = x * block; u < (x + 1) * block; ++u) {
                sum += grey_of(&view.photo.at(u, v));
                if (view.mask.empty()) continue;
                const int mask = view.mask.at(u, v);
                if (mask == kNoPhoto || (masks && mask < kObjectMask)) is[i] = 0;
            }
        grey[i] = float(sum) / float(255 * block * block);
    }
};

/// Sums over windows around places of an image, clipped at its edges.
class WindowSums {
public:
    WindowSums(int width, int height)
        : width_(width), height_(height), sums_(std::size_t(width + 1) * std::size_t(height + 1)) {}

    template <class Value>
    void fill(const Value& value) {
        for (int y = 0; y < height_; ++y) {
            double row = 0;
            for (int x = 0; x < width_; ++x) {
                row += value(std::size_t(y * width_ + x));
                at(x + 1, y + 1) = at(x + 1, y) + row;
            }
        }
    }
    double around(int x, int y) {
        const int x0 = std::max(0, x - kReach), x1 = std::min(width_, x + kReach + 1),
                  y0 = std::max(0, y - kReach), y1 = std::min(height_, y + kReach + 1);
        return at(x1, y1) - at(x0, y1) - at(x1, y0) + at(x0, y0);
    }

private:
    double& at(int x, int y) { return sums_[y * (width_ + 1) + x]; }

    int width_, height_;
    std::vector<double> sums_;
};

/// `other` as seen from `view` if all pixels were infinitely far away; NaN: outside its image.
std::vector<float> seen_far_away(const Small& view, const Small& other) {
    std::vector<float> grey(view.grey.size(), NAN);
    for (int y = 0; y < view.height; ++y)
        for (int x = 0; x < view.width; ++x) {
            const Camera& c = other.camera;
            const Vec3f d = c.camera_from_world.R * world_direction(view.camera, x, y);
            if (!(d.z > 0)) continue;
            const float u = c.fx_px * d.x / d.z + c.cx_px - 0.5f,
                        v = c.fy_px * d.y / d.z + c.cy_px - 0.5f;
            if (!(u >= 0) || !(v >= 0) || !(u < float(other.width - 1)) ||
                !(v < float(other.height - 1)))
                continue;
            const int left = int(u), top = int(v);
            const float right = u - float(left), below = v - float(top);
            float sum = 0;
            for (int i = 0; i < 4; ++i) {
                const auto at = std::size_t((top + i / 2) * other.width + left + i % 2);
                sum += (i % 2 ? right : 1 - right) * (i / 2 ? below : 1 - below) *
                       (other.is[at] ? other.grey[at] : NAN);
            }
            grey[y * view.width + x] = sum;
        }
    return grey;
}

/// Compares a view with other views and labels its blocks.
class Comparison {
public:
    explicit Comparison(const Small& view)
        : view_(view),
          count_(view.width, view.height),
          a_(count_),
          b_(count_),
          aa_(count_),
          bb_(count_),
          ab_(count_),
          apart_(count_),
          seen_(view.grey.size()),
          same_(seen_),
          far_(seen_),
          textured_(seen_) {
        const auto own = [&](std::size_t i) { return view.is[i] ? double{view.grey[i]} : 0; };
        count_.fill([&](std::size_t i) { return 1.0 * view.is[i]; });
        a_.fill(own);
        aa_.fill([&](std::size_t i) { return own(i) * own(i); });
        for_blocks([&](std::size_t i, int x, int y) {
            const double n = count_.around(x, y);
            textured_[i] =
                view.is[i] && n > 0 && deviation(a_, aa_, n, x, y) >= kTextured * view.light;
        });
    }

    void add(const std::vector<float>& other) {
        const auto is = [&](std::size_t i) { return view_.is[i] && !std::isnan(other[i]); };
        const auto filled = [&](WindowSums& sums, const auto& value) {
            sums.fill([&](std::size_t i) {
                return is(i) ? value(double{view_.grey[i]}, double{other[i]}) : 0.0;
            });
        };
        filled(count_, [](double, double) { return 1.0; });
        filled(a_, [](double a, double) { return a; });
        filled(b_, [](double, double b) { return b; });
        filled(aa_, [](double a, double) { return a * a; });
        filled(bb_, [](double, double b) { return b * b; });
        filled(ab_, [](double a, double b) { return a * b; });
        filled(apart_, [](double a, double b) { return std::abs(a - b); });
        for_blocks([&](std::size_t i, int x, int y) {
            const double n = count_.around(x, y);
            if (!is(i) || n < kReach * kReach) return;
            seen_[i] = 1;
            if (!(apart_.around(x, y) / n < kSame * view_.light)) return;
            same_[i] = 1;
            const double a = deviation(a_, aa_, n, x, y), b = deviation(b_, bb_, n, x, y),
                         covariance =
                             ab_.around(x, y) / n - a_.around(x, y) / n * b_.around(x, y) / n;
            if (textured_[i] && b >= kTextured * view_.light && covariance > kAlike * a * b)
                far_[i] = 1;
        });
    }

    /// Clears far blocks whose neighbours are not far: they match by chance.
    void drop_isolated() {
        count_.fill([&](std::size_t i) { return 1.0 * (textured_[i] && seen_[i]); });
        a_.fill([&](std::size_t i) { return 1.0 * far_[i]; });
        for_blocks([&](std::size_t i, int x, int y) {
            if (a_.around(x, y) < 0.5 * count_.around(x, y)) far_[i] = 0;
        });
    }

    /// `near_point`: per block, whether a point lies in or beside it.
    FarPixels result(const std::vector<std::uint8_t>& near_point) const {
        FarPixels out{view_.block, view_.width, view_.height, {}};
        out.labels.assign(far_.size(), FarPixels::unknown);
        for (std::size_t i = 0; i < far_.size(); ++i) {
            const bool open = !seen_[i] || (same_[i] && !textured_[i]);
            if (far_[i])
                out.labels[i] = FarPixels::far;
            else if (view_.is[i] && open && !near_point[i])
                out.labels[i] = FarPixels::open;
        }
        return out;
    }
    /// Numbers of blocks: all, textured ones that another view would see if far, far ones.
    std::array<std::ptrdiff_t, 3> counts() const {
        std::array<std::ptrdiff_t, 3> out{std::ssize(far_), 0, 0};
        for (std::size_t i = 0; i < far_.size(); ++i)
            out[1] += textured_[i] && seen_[i], out[2] += far_[i];
        return out;
    }

private:
    template <class Visit>
    void for_blocks(const Visit& visit) const {
        for (int y = 0; y < view_.height; ++y)
            for (int x = 0; x < view_.width; ++x) visit(std::size_t(y * view_.width + x), x, y);
    }
    static double deviation(WindowSums& sum, WindowSums& squares, double n, int x, int y) {
        const double mean = sum.around(x, y) / n;
        return std::sqrt(std::max(0.0, squares.around(x, y) / n - mean * mean));
    }

    const Small& view_;
    WindowSums count_, a_, b_, aa_, bb_, ab_, apart_;
    std::vector<std::uint8_t> seen_, same_, far_, textured_;  // of each block
};

std::vector<std::uint8_t> blocks_near_points(const Small& view, const std::vector<Sighting>& seen) {
    std::vector<std::uint8_t> beside(view.grey.size());
    for (const Sighting& s : seen) {
        const int x = s.x / view.block, y = s.y / view.block;
        for (int v = std::max(0, y - kReach); v <= std::min(view.height - 1, y + kReach); ++v)
            for (int u = std::max(0, x - kReach); u <= std::min(view.width - 1, x + kReach); ++u)
                beside[v * view.width + u] = 1;
    }
    return beside;
}

/// The views with the most similar direction among the views far enough away from `v`.
std::vector<std::size_t> others_of(std::size_t v, const std::vector<Small>& views, double depth) {
    std::vector<std::pair<double, std::size_t>> found;
    const Camera& own = views[v].camera;
    const Vec3d axis = optical_axis(own);
    for (std::size_t o = 0; o < views.size() && depth > 0; ++o) {
        const Vec3d along = vec_cast<double>(camera_centre(views[o].camera) - camera_centre(own));
        const Vec3d across = along - dot(along, axis) * axis;
        if (double{own.fx_px} * norm(across) / depth < kMove) continue;
        found.emplace_back(-dot(axis, optical_axis(views[o].camera)), o);
    }
    std::ranges::sort(found);
    std::vector<std::size_t> others;
    for (std::size_t i = 0; i < std::min<std::size_t>(found.size(), kOthers); ++i)
        others.push_back(found[i].second);
    return others;
}

/// A weighted colour and its weight.
struct Texel {
    Vec3f color;
    float weight = 0;
};

/// Fills texels below full weight from around. [Gortler et al. 1996, The Lumigraph, 3.4]
void fill_gaps(std::vector<Texel>& texels, int size) {
    if (size == 1) return;
    const int half = size / 2;
    std::vector<Texel> coarse(std::size_t(half) * half);
    parallel_for_heavy(Cpu{}, half, [&](int y) {
        for (int x = 0; x < half; ++x) {
            Texel sum;
            for (int i = 0; i < 4; ++i) {
                const Texel& t = texels[std::size_t(2 * y + i / 2) * size + 2 * x + i % 2];
                sum.color += t.color, sum.weight += t.weight;
            }
            const float share = sum.weight > 1 ? 1 / sum.weight : 1;
            coarse[std::size_t(y) * half + x] = {share * sum.color, share * sum.weight};
        }
    });
    fill_gaps(coarse, half);
    parallel_for_heavy(Cpu{}, size, [&](int y) {
        for (int x = 0; x < size; ++x) {
            Texel& t = texels[std::size_t(y) * size + x];
            if (!(t.weight < 1)) continue;
            // Three quarters of the texel of the parent, one quarter of its neighbours.
            Texel around;
            for (int i = 0; i < 4; ++i) {
                const int u = x / 2 + (i % 2 ? (x % 2 ? 1 : -1) : 0),
                          v = y / 2 + (i / 2 ? (y % 2 ? 1 : -1) : 0);
                const float w = (i % 2 ? 0.25f : 0.75f) * (i / 2 ? 0.25f : 0.75f);
                const Texel& c = coarse[texel_index(u, v, half)];
                around.color += w * c.color, around.weight += w * c.weight;
            }
            const float rest = 1 - t.weight;
            t.color += rest * around.color, t.weight += rest * around.weight;
        }
    });
}

/// The smallest power of two with a texel per pixel; limited, as the map is in memory.
int sky_size(const std::vector<View>& views) {
    constexpr int kLeast = 64, kMost = 2048;
    std::vector<double> focal;
    for (const View& view : views) focal.push_back(view.camera.fx_px);
    const double wanted = std::sqrt(4 * M_PI) * lower_median(focal);
    int size = kLeast;
    while (size < kMost && size < wanted) size *= 2;
    return size;
}

}  // namespace

SkyDetection detect_sky(const std::vector<View>& views,
                        const std::vector<Vec3f>& points,
                        bool masks) {
    std::vector<Small> small;
    for (const View& view : views) small.emplace_back(view, masks);
    SkyDetection look;
    look.views.resize(views.size());
    std::vector<std::array<std::ptrdiff_t, 3>> counts(views.size());
    parallel_for_heavy(Cpu{}, int(views.size()), [&](int v) {
        const std::vector<Sighting> seen = sightings(views[v].camera, points, 1);
        std::vector<double> depths;
        for (const Sighting& s : seen) depths.push_back(s.depth);
        Comparison compared(small[v]);
        const std::vector<std::size_t> others = others_of(v, small, quantile(depths, kFarPoints));
        for (const std::size_t o : others) compared.add(seen_far_away(small[v], small[o]));
        compared.drop_isolated();
        look.views[v] = compared.result(blocks_near_points(small[v], seen));
        counts[v] = compared.counts();
    });
    std::array<double, 3> sums{};
    for (const auto& of : counts)
        for (std::size_t i = 0; i < 3; ++i) sums[i] += double(of[i]);
    if (sums[1] >= kLeastSeen * sums[0]) look.share = sums[2] / sums[1];
    return look;
}

std::vector<std::size_t> points_outside_sky(const std::vector<View>& views,
                                            const SkyDetection& look,
                                            const std::vector<Vec3f>& points) {
    std::vector<std::uint8_t> before(points.size(), 1);
    for (std::size_t v = 0; v < views.size(); ++v) {
        const FarPixels& far = look.views[v];
        const int last_x = views[v].camera.width_px - 1, last_y = views[v].camera.height_px - 1;
        for (const Sighting& s : sightings(views[v].camera, points, 1)) {
            const int reach = kReach * far.block_px;  // far windows extend across silhouettes
            bool all = true;
            for (int j = -reach; j <= reach; j += reach)
                for (int i = -reach; i <= reach; i += reach)
                    all = all && far.is_far(std::clamp(s.x + i, 0, last_x),
                                            std::clamp(s.y + j, 0, last_y));
            if (all) before[s.point] = 0;
        }
    }
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < points.size(); ++i)
        if (before[i]) kept.push_back(i);
    return kept;
}

ImageU8 make_sky(const std::vector<View>& views, const SkyDetection& look) {
    constexpr double kSamples = 5e7;  // number of pixels read
    const int size = sky_size(views);
    std::vector<Texel> texels(std::size_t(size) * size);
    double pixels = 0;
    for (const View& view : views) pixels += double(view.camera.width_px) * view.camera.height_px;
    const int step = std::max(1, int(std::ceil(std::sqrt(pixels / kSamples))));
    std::vector<std::uint8_t> known(texels.size());
    const auto add = [&](const View& view, int x, int y) {
        Vec3f color;
        for (int c = 0; c < 3; ++c) color[c] = float(view.photo.at(x, y, c));
        const SkyTexels around = texels_around(world_direction(view.camera, x, y), size);
        for (int i = 0; i < 4; ++i) {
            const auto at = std::size_t(around.index[i]);
            if (known[at]) continue;
            texels[at].color += around.weight[i] * color;
            texels[at].weight += around.weight[i];
        }
    };
    for (const FarPixels::Label label : {FarPixels::far, FarPixels::open}) {
        for (std::size_t v = 0; v < views.size(); ++v)
            for (int y = 0; y < views[v].camera.height_px; y += step)
                for (int x = 0; x < views[v].camera.width_px; x += step)
                    if (look.views[v].at(x, y) == label) add(views[v], x, y);
        for (std::size_t i = 0; i < texels.size(); ++i) known[i] = texels[i].weight > 0;
    }
    for (Texel& t : texels)
        if (t.weight > 1) t.color = t.color / t.weight, t.weight = 1;
    fill_gaps(texels, size);
    ImageU8 sky(size, size, 3);
    for (std::size_t i = 0; i < texels.size(); ++i)
        for (int c = 0; c < 3; ++c)
            sky.pixels[3 * i + std::size_t(c)] =
                std::uint8_t(std::clamp(texels[i].color[c] + 0.5f, 0.0f, 255.0f));
    return sky;
}

}  // namespace tvsgs
