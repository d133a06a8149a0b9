// Reads prior confidences, normals and features.
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>

#include "core/device/parallel_lists.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/math/quantile.h"
#include "core/scene/prior_maps.h"
#include "io/files/read_file.h"
#include "mvs/priors/prior_fit.h"
#include "pipeline/priors/prior_parts.h"

namespace tvsgs {
namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

struct WithFile {
    PriorView* view;
    const PriorFile* file;
};
std::vector<WithFile> with_files(const PriorFiles& source, std::vector<PriorView>& views) {
    std::vector<WithFile> found;
    for (PriorView& view : views)
        if (const PriorFile* const file = file_of(source, view)) found.push_back({&view, file});
    return found;
}

template <class Body>
void for_each(const std::vector<WithFile>& files, const Body& body) {
    parallel_for_throwing(int(files.size()),
                          [&](int i) { body(std::size_t(i), *files[i].view, *files[i].file); });
}

std::string of_views(std::size_t files, std::size_t views) {
    return files < views ? str(" of ", files, " of ", views, " views") : "";
}

std::string degrees_of(double cosine) {
    const double angle = std::acos(std::clamp(cosine, -1.0, 1.0));
    return str(std::lround(angle * 57.29577951308232), " degrees");
}

ImageF at_photo_size(const PlacedMap& placed, const View& view) {
    return resample_map(placed.map, placed.placement, view, view.photo.width, view.photo.height,
                        MapBlend::linear);
}

/// Reads unit normals in the frame of the file; NaN for unknown.
PlacedMap read_normals(const NormalSource& source, const PriorFile& file, const PriorView& view) {
    PlacedMap placed = read_placed(source, file, view, 3);
    std::vector<float>& numbers = placed.map.pixels;
    float low = 0, high = 0;
    for (const float n : numbers) low = std::min(low, n), high = std::max(high, n);
    const bool picture = std::filesystem::path(file.path).extension() != ".npy" && high > 2;
    const float top = !picture ? 1.f : high > 255 ? 65535.f : 255.f;
    const bool unit = picture || source.range == NumberRange::unit ||
                      (source.range == NumberRange::automatic && low >= 0 && high <= 1);
    std::vector<float> lengths;
    for (std::size_t i = 0; i < numbers.size(); i += 3) {
        Vec3f n{numbers[i] / top, numbers[i + 1] / top, numbers[i + 2] / top};
        if (unit) n = 2.f * n - Vec3f{1, 1, 1};
        const float length = norm(n);
        // Black pixels of a picture decode to (-1, -1, -1): unknown.
        const bool known = length > 0.3f && length < 1.5f;
        if (known) lengths.push_back(length);
        for (std::size_t c = 0; c < 3; ++c) numbers[i + c] = known ? n[int(c)] / length : kNaN;
    }
    if (lengths.empty()) return placed;
    const float middle = middle_of(lengths);
    if (!(middle > 0.8f && middle < 1.2f))
        throw input_error("E_PRIORS: ", file.path, ": median length of the normals ", middle,
                          "; expected 1, as numbers in [-1, 1] or as (n + 1) / 2");
    return placed;
}

std::vector<NormalSample> samples_of(const PlacedMap& placed,
                                     const PriorView& view,
                                     const std::vector<Vec3f>& points,
                                     const std::vector<Vec3f>& surface) {
    std::vector<NormalSample> samples;
    const Rigid3f& pose = view.view->camera.camera_from_world;
    for (const VisiblePoint& p : view.points) {
        const auto index = std::size_t(p.index);
        double u = 0, v = 0;
        Vec3f found;
        if (norm(surface[index]) == 0 || !placed.placement.find(p.x_px, p.y_px, u, v) ||
            !sample_map(placed.map, MapBlend::nearest, u, v, &found.x))
            continue;
        Vec3f expected = pose.R * surface[index];
        if (dot(expected, pose * points[index]) > 0) expected = -expected;
        samples.push_back({vec_cast<double>(found), vec_cast<double>(pose.R * found),
                           vec_cast<double>(expected)});
    }
    return samples;
}

}  // namespace

std::string fill_confidence(const PriorInputs& in, std::vector<PriorView>& views) {
    const ConfidenceSource& source = in.sources.confidence;
    const std::vector<WithFile> files = with_files(source, views);
    for_each(files, [&](std::size_t, PriorView& view, const PriorFile& file) {
        PlacedMap placed = read_placed(source, file, view, 1);
        for (float& value : placed.map.pixels) {
            if (source.from_one && value < 1)
                throw input_error("E_PRIORS: ", file.path, ": confidence ", value,
                                  "; expected 1 or more, or \"range\": \"unit\" in priors.json");
            if (source.from_one) value = 1 - 1 / value;
            if (value > 1.001f || value < -0.001f)
                throw input_error("E_PRIORS: ", file.path, ": confidence ", value,
                                  "; expected 0 to 1, or \"range\": \"ge1\" in priors.json");
            value = std::clamp(value, 0.f, 1.f);
        }
        ImageF sized = at_photo_size(placed, *view.view);
        const std::vector<std::uint8_t> sky = sky_of(in, view);
        for (std::size_t i = 0; i < sized.pixels.size(); ++i)
            if (std::isnan(sized.pixels[i]) || (!sky.empty() && sky[i] != 0)) sized.pixels[i] = 0;
        add_map(*view.view, prior_map::kConfidence, 1, std::move(sized.pixels));
    });
    return "confidences" + of_views(files.size(), views.size());
}

std::string fill_normals(const PriorInputs& in, std::vector<PriorView>& views) {
    const NormalSource& source = in.sources.normal;
    const std::vector<WithFile> files = with_files(source, views);
    const std::vector<Vec3f> surface = cloud_normals(in.points);
    std::vector<std::vector<NormalSample>> found(files.size());
    std::vector<char> empty(files.size());
    for_each(files, [&](std::size_t i, PriorView& view, const PriorFile& file) {
        const PlacedMap placed = read_normals(source, file, view);
        empty[i] = std::ranges::all_of(placed.map.pixels, [](float n) { return std::isnan(n); });
        found[i] = samples_of(placed, view, in.points, surface);
    });
    std::vector<std::string> empty_maps;
    for (std::size_t i = 0; i < files.size(); ++i)
        if (empty[i]) empty_maps.push_back(files[i].view->view->name);
    report_empty_maps("normal", source, empty_maps, files.size());
    std::vector<NormalSample> samples;
    for (const auto& of_view : found) samples.insert(samples.end(), of_view.begin(), of_view.end());
    const NormalChoice choice = choose_normals(samples, source.convention);
    std::vector<std::string> bad;
    std::vector<bool> left_out(files.size());
    for (std::size_t i = 0; i < files.size(); ++i) {
        const PriorAgreement agreement = agreement_of(found[i], choice.reading);
        left_out[i] = is_uninformative(agreement);
        if (left_out[i])
            bad.push_back(str(files[i].view->view->name, " (", degrees_of(agreement.cosine),
                              ", constant normal ", degrees_of(agreement.cosine_of_constant), ")"));
    }
    if (2 * bad.size() > files.size())
        throw input_error(
            "E_PRIORS: ", source.what, ": normals of ", bad.size(), " of ", files.size(),
            " views fit the points hardly better than a constant normal: ", listed(bad),
            "; are they the maps of these photographs?");
    if (!bad.empty())
        spdlog::warn(
            "Priors: ignores the normals of {} views, which fit the points hardly better than a "
            "constant normal: {}",
            bad.size(), listed(bad));

    for_each(files, [&](std::size_t i, PriorView& view, const PriorFile& file) {
        if (left_out[i] || empty[i]) return;
        ImageF sized = at_photo_size(read_normals(source, file, view), *view.view);
        const std::vector<std::uint8_t> sky = sky_of(in, view);
        const Camera& camera = view.view->camera;
        for (std::size_t at = 0; at < sized.pixels.size() / 3; ++at) {
            float* const pixel = &sized.pixels[3 * at];
            Vec3f n{pixel[0], pixel[1], pixel[2]};
            if (choice.reading.world) n = camera.camera_from_world.R * n;
            n = choice.reading.signs * n;
            const Vec3f ray = pixel_ray(camera, int(at) % sized.width, int(at) / sized.width);
            const float length = norm(n);
            const bool is_sky = !sky.empty() && sky[at] != 0;
            // A surface that faces away is invisible: an error of the map, usually at edges.
            const bool known = length > 0.3f && dot(n, ray) < 0 && !is_sky;
            for (int c = 0; c < 3; ++c) pixel[c] = known ? n[c] / length : 0;
        }
        add_map(*view.view, prior_map::kNormal, 3, std::move(sized.pixels));
    });
    const std::string tested = choice.cosine != 0 ? str(", within ", degrees_of(choice.cosine),
                                                        " of ", grouped(choice.samples), " points")
                                                  : ", not checked: too few points";
    return str("normals", of_views(files.size() - bad.size() - empty_maps.size(), views.size()),
               " (", source.what, ": ", text_of(choice.reading), tested, ")");
}

std::string fill_features(const PriorInputs& in, std::vector<PriorView>& views) {
    const PriorFiles& source = in.sources.features;
    const std::vector<WithFile> files = with_files(source, views);
    std::vector<int> channels(files.size());
    for_each(files, [&](std::size_t i, PriorView& view, const PriorFile& file) {
        PlacedMap placed = read_placed(source, file, view, 0);
        ImageF map = view.camera
                         ? resample_map(placed.map, placed.placement, *view.view, placed.map.width,
                                        placed.map.height, MapBlend::linear)
                         : std::move(placed.map);
        channels[i] = map.channels;
        const auto count = std::size_t(map.channels);
        for (std::size_t p = 0; p < map.pixels.size(); p += count)
            if (std::any_of(&map.pixels[p], &map.pixels[p] + count,
                            [](float n) { return std::isnan(n); }))
                std::fill_n(&map.pixels[p], count, 0.f);
        if (in.coarse_features && map.width > 1 && map.height > 1) {
            ImageF half(map.width / 2, map.height / 2, map.channels);
            for (int y = 0; y < half.height; ++y)
                for (int x = 0; x < half.width; ++x)
                    for (int c = 0; c < half.channels; ++c)
                        half.at(x, y, c) =
                            (map.at(2 * x, 2 * y, c) + map.at(2 * x + 1, 2 * y, c) +
                             map.at(2 * x, 2 * y + 1, c) + map.at(2 * x + 1, 2 * y + 1, c)) /
                            4;
            view.view->maps.push_back({std::string(prior_map::kCoarseFeatures), half.width,
                                       half.height, half.channels, std::move(half.pixels)});
        }
        if (in.features)
            view.view->maps.push_back({std::string(prior_map::kFeatures), map.width, map.height,
                                       map.channels, std::move(map.pixels)});
    });
    for (std::size_t i = 0; i < files.size(); ++i)
        if (channels[i] != channels[0])
            throw input_error("E_PRIORS: ", files[i].file->path, ": ", channels[i],
                              " channels, but ", files[0].file->path, " has ", channels[0],
                              "; expected the same number");
    return str("features", of_views(files.size(), views.size()), " (", source.what, ": ",
               channels[0], " channels)");
}

}  // namespace tvsgs
