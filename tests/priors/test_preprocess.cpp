// What a network is given of a photograph, and where its output lies in it.
#include <cmath>

#include "apps/priors/preprocess.h"
#include "io/io_test.h"

namespace tvsgs::priors {
namespace {

Recipe sized(int width, int height, Fit fit = Fit::stretch, MapKind kind = MapKind::depth) {
    Recipe recipe;
    recipe.kind = kind, recipe.fit = fit;
    recipe.size = {InputSize::By::both, width, height, 0, 1};
    return recipe;
}

std::array<int, 6> numbers_of(const InputPlace& p) {
    return {p.width, p.height, p.x, p.y, p.photo_width, p.photo_height};
}

TEST(Preprocess, PlacesThePhotograph) {
    using Numbers = std::array<int, 6>;
    EXPECT_EQ(numbers_of(place_photo(sized(384, 256), 1600, 1200)),
              (Numbers{384, 256, 0, 0, 384, 256}));
    EXPECT_EQ(numbers_of(place_photo(sized(1064, 616, Fit::pad), 1600, 1200)),
              (Numbers{1064, 616, 121, 0, 821, 616}));
    EXPECT_EQ(numbers_of(place_photo(sized(64, 64, Fit::pad), 1600, 1200)),
              (Numbers{64, 64, 0, 8, 64, 48}));
    Recipe recipe;
    recipe.size = {InputSize::By::long_side, 0, 0, 518, 14};
    EXPECT_EQ(numbers_of(place_photo(recipe, 1600, 1200)), (Numbers{518, 392, 0, 0, 518, 392}));
    EXPECT_EQ(numbers_of(place_photo(recipe, 1200, 1600)), (Numbers{392, 518, 0, 0, 392, 518}));
    recipe.size.by = InputSize::By::short_side;
    EXPECT_EQ(numbers_of(place_photo(recipe, 1600, 1200)), (Numbers{686, 518, 0, 0, 686, 518}));
    recipe.size = {InputSize::By::long_side, 0, 0, 20, 32};
    EXPECT_EQ(numbers_of(place_photo(recipe, 1600, 100)), (Numbers{32, 32, 0, 0, 32, 32}));
    recipe.size = {InputSize::By::short_side, 0, 0, 518, 1};
    expect_error(ExitCode::usage, "expected 8192 a side at most",
                 [&] { place_photo(recipe, 10000, 100); });
}

/// One colour all over.
ImageU8 plain(int width, int height) {
    ImageU8 photo(width, height, 3);
    for (std::size_t i = 0; i < photo.pixels.size(); ++i)
        photo.pixels[i] = static_cast<std::uint8_t>(100 + 50 * (i % 3));
    return photo;
}

// Scale first, then mean, then deviation; the last two in the network's order of colours.
TEST(Preprocess, NormalisesInOrder) {
    Recipe recipe = sized(4, 2);
    recipe.scale = 0.5, recipe.mean = {1, 2, 3}, recipe.std = {4, 5, 8};
    const InputPlace place = place_photo(recipe, 8, 4);
    for (const bool bgr : {false, true}) {
        recipe.bgr = bgr;
        const std::vector<float> input = input_of(recipe, place, plain(8, 4));
        ASSERT_EQ(input.size(), 24u);
        for (std::size_t i = 0; i < 8; ++i) {
            EXPECT_FLOAT_EQ(input[i], ((bgr ? 100 : 50) - 1) / 4.f);
            EXPECT_FLOAT_EQ(input[8 + i], (75 - 2) / 5.f);
            EXPECT_FLOAT_EQ(input[16 + i], ((bgr ? 50 : 100) - 3) / 8.f);
        }
    }
}

TEST(Preprocess, PadsWithTheMeanColour) {
    for (const bool tall : {false, true}) {
        Recipe recipe = sized(8, 8, Fit::pad);
        recipe.scale = 1;
        const ImageU8 photo = tall ? plain(4, 8) : plain(8, 4);
        const std::vector<float> input =
            input_of(recipe, place_photo(recipe, photo.width, photo.height), photo);
        for (std::size_t i = 0; i < 64; ++i) {
            const std::size_t across = tall ? i % 8 : i / 8;
            const bool inside = across >= 2 && across < 6;
            EXPECT_EQ(input[i], inside ? 100 : 124) << i;
            EXPECT_EQ(input[64 + i], inside ? 150 : 116) << i;
            EXPECT_EQ(input[128 + i], inside ? 200 : 104) << i;
        }
    }
}

// Each place of the photograph comes out of the input where it belongs, to a hundredth of a pixel.
TEST(Preprocess, ResizingKeepsPlaces) {
    ImageU8 ramp(240, 120, 3);
    for (int y = 0; y < ramp.height; ++y)
        for (int x = 0; x < ramp.width; ++x)
            ramp.at(x, y, 0) = static_cast<std::uint8_t>(x),
                          ramp.at(x, y, 1) = static_cast<std::uint8_t>(2 * y);
    Recipe recipe = sized(60, 60);
    recipe.scale = 1;
    const std::vector<float> input = input_of(recipe, place_photo(recipe, 240, 120), ramp);
    for (int y = 4; y < 56; ++y)
        for (int x = 4; x < 56; ++x) {
            const auto at = static_cast<std::size_t>(60 * y + x);
            // Values are of pixel centres, rounded once to whole numbers.
            EXPECT_NEAR(input[at], (x + 0.5) * 4 - 0.5, 0.51) << x;
            EXPECT_NEAR(input[3600 + at], 2 * ((y + 0.5) * 2 - 0.5), 0.51) << y;
        }
}

/// x and y of pixel centres over the output, both from 0 to 1.
Tensor place_ramps(int width, int height) {
    Tensor out{{1, 2, height, width}, {}};
    for (const bool vertical : {false, true})
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                out.numbers.push_back(
                    static_cast<float>(vertical ? (y + 0.5) / height : (x + 0.5) / width));
    return out;
}

// A map made of a stretched, padded or coarse output has each value at its place.
TEST(Preprocess, MapsKeepPlaces) {
    struct Case {
        Fit fit;
        int input_w, input_h, stride, photo_w, photo_h, map_w, map_h;
    };
    for (const Case& c :
         {Case{Fit::stretch, 64, 64, 1, 200, 100, 128, 64},
          Case{Fit::stretch, 64, 64, 1, 100, 200, 64, 128},
          Case{Fit::stretch, 80, 60, 1, 1600, 1200, 80, 60},
          Case{Fit::stretch, 96, 96, 2, 40, 30, 48, 36},
          Case{Fit::pad, 64, 64, 1, 200, 100, 64, 32}, Case{Fit::pad, 64, 64, 4, 200, 100, 16, 8},
          Case{Fit::pad, 64, 64, 2, 100, 200, 16, 32},
          Case{Fit::pad, 50, 90, 1, 300, 300, 50, 50}}) {
        SCOPED_TRACE(str(c.input_w, "x", c.input_h, " of ", c.photo_w, "x", c.photo_h));
        const Recipe recipe = sized(c.input_w, c.input_h, c.fit, MapKind::features);
        const InputPlace place = place_photo(recipe, c.photo_w, c.photo_h);
        const Tensor out = place_ramps(c.input_w / c.stride, c.input_h / c.stride);
        const ImageF map =
            map_of_photo(recipe, place, map_of(recipe, place, out, "net"), c.photo_w, c.photo_h);
        ASSERT_EQ(map.width, c.map_w);
        ASSERT_EQ(map.height, c.map_h);
        // Of the input's width, in which the ramp runs from 0 to 1.
        const double pixel = 1.0 * c.stride / c.input_w, row = 1.0 * c.stride / c.input_h;
        for (int y = 0; y < map.height; ++y)
            for (int x = 0; x < map.width; ++x) {
                const double u = (place.x + (x + 0.5) / map.width * place.photo_width) / c.input_w,
                             v = (place.y + (y + 0.5) / map.height * place.photo_height) /
                                 c.input_h;
                const double left = 1.0 * place.x / c.input_w, right = 1 - left,
                             top = 1.0 * place.y / c.input_h, bottom = 1 - top;
                // At the borders the outermost pixels repeat.
                ASSERT_NEAR(map.at(x, y, 0), std::clamp(u, left + pixel / 2, right - pixel / 2),
                            1e-5)
                    << x;
                ASSERT_NEAR(map.at(x, y, 1), std::clamp(v, top + row / 2, bottom - row / 2), 1e-5)
                    << y;
            }
    }
}

Tensor zeros(std::vector<std::int64_t> shape, float value = 0) {
    std::size_t count = 1;
    for (const std::int64_t n : shape) count *= static_cast<std::size_t>(n);
    return {std::move(shape), std::vector<float>(count, value)};
}

TEST(Preprocess, OutputsThatAreMaps) {
    const Recipe recipe = sized(8, 4);
    const InputPlace place = place_photo(recipe, 8, 4);
    for (const std::vector<std::int64_t>& shape :
         {std::vector<std::int64_t>{1, 1, 4, 8}, {1, 4, 8}, {4, 8}, {1, 4, 8, 1}, {1, 1, 2, 4}}) {
        Tensor out = zeros(shape);
        for (std::size_t i = 0; i < out.numbers.size(); ++i) out.numbers[i] = float(i);
        const ImageF map = map_of(recipe, place, out, "net");
        EXPECT_EQ(map.channels, 1);
        EXPECT_EQ(map.width, 2 * map.height);
        EXPECT_EQ(map.at(1, 1), static_cast<float>(map.width + 1));
    }
}

TEST(Preprocess, NormalsOfEitherLayoutAndRange) {
    for (const bool last : {false, true})
        for (const bool unit : {false, true}) {
            Recipe recipe = sized(8, 4, Fit::stretch, MapKind::normal);
            recipe.unit_range = unit;
            const InputPlace place = place_photo(recipe, 8, 4);
            Tensor out = zeros(last ? std::vector<std::int64_t>{1, 4, 8, 3}
                                    : std::vector<std::int64_t>{1, 3, 4, 8});
            const float n[3] = {0.64f, -0.48f, -0.6f};
            for (std::size_t i = 0; i < 96; ++i) {
                const float v = n[last ? i % 3 : i / 32] * 0.9f;  // not quite unit
                out.numbers[i] = unit ? (v + 1) / 2 : v;
            }
            const ImageF map = map_of(recipe, place, out, "net");
            for (std::size_t i = 0; i < 96; ++i) EXPECT_NEAR(map.pixels[i], n[i % 3], 1e-6f);
            recipe.unit_range = !unit;
            expect_error(ExitCode::input, unit ? "try --range unit" : "try --range signed",
                         [&] { map_of(recipe, place, out, "net"); });
        }
}

// Between two normals there is one, not less of them.
TEST(Preprocess, ResizedNormalsAreUnit) {
    const Recipe recipe = sized(4, 4, Fit::stretch, MapKind::normal);
    const InputPlace place = place_photo(recipe, 80, 40);
    Tensor out{{1, 3, 4, 4}, std::vector<float>(48)};
    const float left[3] = {0.6f, 0, -0.8f}, right[3] = {0, 0.6f, -0.8f};
    for (std::size_t i = 0; i < 48; ++i) out.numbers[i] = (i % 4 < 2 ? left : right)[i / 16];
    const ImageF map = map_of_photo(recipe, place, map_of(recipe, place, out, "net"), 80, 40);
    ASSERT_EQ(map.width, 8);
    for (int x = 0; x < 8; ++x)
        EXPECT_NEAR(std::hypot(map.at(x, 2, 0), map.at(x, 2, 1), map.at(x, 2, 2)), 1, 1e-6);
    // A quarter of the way from one to the other.
    const float scale = 1 / std::hypot(0.45f, 0.15f, 0.8f);
    EXPECT_NEAR(map.at(3, 2, 0), 0.45f * scale, 1e-6f);
    EXPECT_NEAR(map.at(3, 2, 1), 0.15f * scale, 1e-6f);
}

// Tokens lie row by row behind those of the class and of registers.
TEST(Preprocess, TokensBecomeFeatures) {
    Recipe recipe = sized(28, 42, Fit::stretch, MapKind::features);
    recipe.patch = 14;
    const InputPlace place = place_photo(recipe, 28, 42);
    Tensor out = zeros({1, 1 + 6, 5});
    for (std::size_t i = 0; i < out.numbers.size(); ++i) out.numbers[i] = static_cast<float>(i);
    const ImageF map = map_of(recipe, place, out, "net");
    ASSERT_EQ(map.width, 2);
    ASSERT_EQ(map.height, 3);
    ASSERT_EQ(map.channels, 5);
    EXPECT_EQ(map.at(0, 0, 0), 5);
    EXPECT_EQ(map.at(1, 2, 4), 34);
    for (const std::int64_t tokens : {5, 6 + 17})
        expect_error(ExitCode::input, "a token per patch", [&] {
            map_of(recipe, place, zeros({1, tokens, 5}), "net");
        });
}

TEST(Preprocess, OutputsThatAreNoMapsSayWhatTheyAre) {
    const auto expect_no_map = [](const Recipe& recipe, std::vector<std::int64_t> shape,
                                  const std::string& text) {
        const InputPlace place = place_photo(recipe, 16, 8);
        expect_error(ExitCode::input, text,
                     [&] { map_of(recipe, place, zeros(shape), "net.onnx"); });
    };
    const Recipe depth = sized(16, 8), normal = sized(16, 8, Fit::stretch, MapKind::normal),
                 features = sized(16, 8, Fit::stretch, MapKind::features);
    expect_no_map(depth, {1, 3, 8, 16}, "gives an output of shape (1, 3, 8, 16) for an image of");
    expect_no_map(depth, {1, 3, 8, 16}, "expected (1, 1, height, width) for --kind depth");
    expect_no_map(depth, {1, 1000}, "shape (1, 1000)");
    expect_no_map(depth, {1, 1, 8, 8}, "shape (1, 1, 8, 8)");
    expect_no_map(depth, {2, 1, 8, 16}, "shape (2, 1, 8, 16)");
    expect_no_map(normal, {1, 1, 8, 16}, "expected (1, 3, height, width) for --kind normal");
    expect_no_map(normal, {1, 4, 8, 16}, "shape (1, 4, 8, 16)");
    expect_no_map(features, {1, 129, 384}, "or --patch where these are tokens");
    expect_no_map(features, {10}, "shape (10)");
    expect_no_map(features, {}, "shape ()");
}

}  // namespace
}  // namespace tvsgs::priors
