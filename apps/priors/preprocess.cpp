#include "apps/priors/preprocess.h"

#include <algorithm>
#include <cmath>

#include "io/image_file.h"
#include "io/read_file.h"

namespace tvsgs::priors {
namespace {

constexpr std::uint8_t kPadding[3] = {124, 116, 104};  // ImageNet's mean colour, as Metric3D pads
constexpr int kMaxSide = 8192;  // a larger input is a slip, and its network takes all memory

int rounded(double length, int multiple) {
    return std::max(1, static_cast<int>(std::lround(length / multiple))) * multiple;
}

/// Size of the input by one side of the photograph.
void size_by_side(const Recipe& recipe, int photo_width, int photo_height, InputPlace& place) {
    const InputSize& size = recipe.size;
    const int side = size.by == InputSize::By::long_side ? std::max(photo_width, photo_height)
                                                         : std::min(photo_width, photo_height);
    const double factor = static_cast<double>(size.side) / side;
    place.width = rounded(photo_width * factor, size.multiple);
    place.height = rounded(photo_height * factor, size.multiple);
}

void fill_channels(const Recipe& recipe,
                   const std::uint8_t* pixel,
                   std::size_t plane,
                   float* first) {
    for (std::size_t c = 0; c < 3; ++c)
        first[c * plane] = static_cast<float>(
            (recipe.scale * pixel[recipe.bgr ? 2 - c : c] - recipe.mean[c]) / recipe.std[c]);
}

Error no_map(const Recipe& recipe,
             const InputPlace& place,
             const Tensor& output,
             const std::string& path) {
    const char* const expected = recipe.kind == MapKind::depth    ? "(1, 1, height, width)"
                                 : recipe.kind == MapKind::normal ? "(1, 3, height, width)"
                                 : recipe.patch > 0 ? "(1, tokens, channels) with a token per patch"
                                                    : "(1, channels, height, width)";
    return input_error(
        "E_ONNX: ", path, ": gives an output of shape ", text_of(output.shape), " for an image of ",
        place.width, "x", place.height, " pixels, which is no map of it; expected ", expected,
        " for --kind ", name_of(recipe.kind),
        ", height and width in the image's proportion: ", "name another --output or --kind",
        recipe.kind == MapKind::features ? ", or --patch where these are tokens" : "");
}

/// channels, height and width of the output, and whether channels come last; false: no map.
struct Axes {
    std::int64_t channels = 0, height = 0, width = 0;
    bool last = false;
    std::int64_t skipped = 0;  // tokens before the patches
};
bool find_axes(const Recipe& recipe, const InputPlace& place, const Tensor& output, Axes& axes) {
    std::vector<std::int64_t> shape = output.shape;
    while (shape.size() > 3 && shape.front() == 1) shape.erase(shape.begin());
    if (recipe.kind == MapKind::features && recipe.patch > 0) {
        if (shape.size() != 3 || shape[0] != 1) return false;
        axes = {shape[2], place.height / recipe.patch, place.width / recipe.patch, true, 0};
        axes.skipped = shape[1] - axes.height * axes.width;
        return axes.skipped >= 0 && axes.skipped <= 16 && axes.height > 0 && axes.width > 0;
    }
    if (shape.size() == 2) shape.insert(shape.begin(), 1);
    if (shape.size() != 3) return false;
    const std::int64_t wanted = recipe.kind == MapKind::depth    ? 1
                                : recipe.kind == MapKind::normal ? 3
                                                                 : 0;
    if (wanted == 0 || shape[0] == wanted)
        axes = {shape[0], shape[1], shape[2], false, 0};
    else if (shape[2] == wanted)
        axes = {wanted, shape[0], shape[1], true, 0};
    else
        return false;
    // One stride in both directions, up to rounding.
    return axes.height > 0 && axes.width > 0 &&
           std::abs(static_cast<double>(axes.width) * place.height / place.width -
                    static_cast<double>(axes.height)) <= 1;
}

float length_of(const float* n) {
    return std::sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
}

/// Unit; what is hardly a vector is none.
void make_unit(float* n) {
    const float length = length_of(n);
    for (int c = 0; c < 3; ++c) n[c] = length > 0.3f ? n[c] / length : 0;
}

/// Numbers become unit vectors; those that were none on the whole are another output or range.
void make_normals(const Recipe& recipe, ImageF& map, const std::string& path) {
    const float low = *std::min_element(map.pixels.begin(), map.pixels.end());
    std::vector<float> lengths;
    for (std::size_t i = 0; i < map.pixels.size(); i += 3) {
        float* const n = &map.pixels[i];
        for (int c = 0; c < 3 && recipe.unit_range; ++c) n[c] = 2 * n[c] - 1;
        if (length_of(n) > 0.3f) lengths.push_back(length_of(n));
        make_unit(n);
    }
    const auto middle = lengths.begin() + std::ssize(lengths) / 2;
    std::nth_element(lengths.begin(), middle, lengths.end());
    const float median = lengths.empty() ? 0 : *middle;
    // Normals that face a camera have numbers of both signs, and (n + 1) / 2 has none below 0.
    const bool in_range = recipe.unit_range ? low > -0.05f : low < 0;
    if (!in_range || !(median > 0.8f && median < 1.2f))
        throw input_error("E_ONNX: ", path, ": gives vectors of a median length of ", median,
                          recipe.unit_range ? ", taken for (n + 1) / 2," : ",",
                          " and its lowest number is ", low,
                          "; expected unit normals: try --range ",
                          recipe.unit_range ? "signed" : "unit", ", or name another --output");
}

}  // namespace

InputPlace place_photo(const Recipe& recipe, int photo_width, int photo_height) {
    InputPlace place;
    place.width = recipe.size.width, place.height = recipe.size.height;
    if (recipe.size.by != InputSize::By::both)
        size_by_side(recipe, photo_width, photo_height, place);
    if (place.width > kMaxSide || place.height > kMaxSide)
        throw Error(ExitCode::usage,
                    str("an input of ", place.width, "x", place.height, " pixels; expected ",
                        kMaxSide, " a side at most: give a smaller size"));
    place.photo_width = place.width, place.photo_height = place.height;
    if (recipe.fit == Fit::stretch) return place;
    const double factor = std::min(static_cast<double>(place.width) / photo_width,
                                   static_cast<double>(place.height) / photo_height);
    place.photo_width = std::min(place.width, rounded(photo_width * factor, 1));
    place.photo_height = std::min(place.height, rounded(photo_height * factor, 1));
    place.x = (place.width - place.photo_width) / 2;
    place.y = (place.height - place.photo_height) / 2;
    return place;
}

std::vector<float> input_of(const Recipe& recipe, const InputPlace& place, const ImageU8& photo) {
    const ImageU8 resized = resize_bicubic(photo, place.photo_width, place.photo_height);
    const auto plane = static_cast<std::size_t>(place.width) * place.height;
    std::vector<float> input(3 * plane);
    for (int y = 0; y < place.height; ++y)
        for (int x = 0; x < place.width; ++x) {
            const int px = x - place.x, py = y - place.y;
            const bool inside = px >= 0 && py >= 0 && px < resized.width && py < resized.height;
            fill_channels(recipe, inside ? &resized.at(px, py) : kPadding, plane,
                          &input[static_cast<std::size_t>(y) * place.width + x]);
        }
    return input;
}

ImageF map_of(const Recipe& recipe,
              const InputPlace& place,
              const Tensor& output,
              const std::string& path) {
    Axes axes;
    if (!find_axes(recipe, place, output, axes)) throw no_map(recipe, place, output, path);
    ImageF map(static_cast<int>(axes.width), static_cast<int>(axes.height),
               static_cast<int>(axes.channels));
    const auto channels = static_cast<std::size_t>(axes.channels),
               pixels = static_cast<std::size_t>(axes.width * axes.height),
               skipped = static_cast<std::size_t>(axes.skipped) * channels;
    for (std::size_t p = 0; p < pixels; ++p)
        for (std::size_t c = 0; c < channels; ++c)
            map.pixels[p * channels + c] =
                output.numbers[axes.last ? skipped + p * channels + c : c * pixels + p];
    if (recipe.kind == MapKind::normal) make_normals(recipe, map, path);
    return map;
}

ImageF map_of_photo(const Recipe& recipe,
                    const InputPlace& place,
                    const ImageF& map,
                    int photo_width,
                    int photo_height) {
    // 1. The window, in pixels of the map.
    const double step_x = static_cast<double>(map.width) / place.width,
                 step_y = static_cast<double>(map.height) / place.height;
    const double left = place.x * step_x, width = place.photo_width * step_x,
                 top = place.y * step_y, height = place.photo_height * step_y;

    // 2. The size.
    const bool whole = place.photo_width == place.width && place.photo_height == place.height;
    if (whole &&
        std::abs(width * photo_height / photo_width - height) <= std::max(1., height / 100))
        return map;
    const double by_width = width / photo_width, by_height = height / photo_height;
    const double factor =
        std::min(std::max(by_width, by_height), std::max(1.0, std::min(by_width, by_height)));
    ImageF out(rounded(photo_width * factor, 1), rounded(photo_height * factor, 1), map.channels);

    // 3. Between the pixels of the window, of which the outermost repeat.
    const auto channels = static_cast<std::size_t>(map.channels);
    const auto place_in = [](double at, double first, double length, int limit) {
        return std::clamp(std::clamp(at - 0.5, first, std::max(first, first + length - 1)), 0.,
                          limit - 1.);
    };
    for (int y = 0; y < out.height; ++y) {
        const double v = place_in(top + (y + 0.5) * height / out.height, top, height, map.height);
        const int y0 = static_cast<int>(v), y1 = std::min(y0 + 1, map.height - 1);
        const auto b = static_cast<float>(v - y0);
        for (int x = 0; x < out.width; ++x) {
            const double u = place_in(left + (x + 0.5) * width / out.width, left, width, map.width);
            const int x0 = static_cast<int>(u), x1 = std::min(x0 + 1, map.width - 1);
            const auto a = static_cast<float>(u - x0);
            const float *p00 = &map.at(x0, y0), *p10 = &map.at(x1, y0), *p01 = &map.at(x0, y1),
                        *p11 = &map.at(x1, y1);
            float* const to = &out.at(x, y);
            for (std::size_t c = 0; c < channels; ++c)
                to[c] =
                    (1 - b) * ((1 - a) * p00[c] + a * p10[c]) + b * ((1 - a) * p01[c] + a * p11[c]);
            if (recipe.kind == MapKind::normal) make_unit(to);
        }
    }
    return out;
}

}  // namespace tvsgs::priors
