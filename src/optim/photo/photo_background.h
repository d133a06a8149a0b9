// Masks of the render and its photograph, and the background.  [docs/method/masks.md]
#pragma once

#include <charconv>
#include <cstdint>
#include <string>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/math/rng.h"
#include "core/scene/prior_maps.h"
#include "core/scene/scene.h"
#include "core/scene/sky_map.h"

namespace tvsgs {

/// Use of masks. object: nothing exists outside of them. ignore: pixels outside are not compared.
/// automatic: the plan decides; without a plan like `none`.
enum class MaskUse { automatic, object, ignore, none };

inline bool uses_masks(MaskUse use) {
    return use == MaskUse::object || use == MaskUse::ignore;
}

/// The background behind the splats.
struct PhotoBackground {
    enum class Kind { none, constant, random, sky } kind = Kind::none;
    std::uint8_t color[3] = {0, 0, 0};

    /// The background of a step: `color`, or a random one; black where there is none, or for a sky.
    PhotoBackground at(std::uint64_t seed, int step) const {
        PhotoBackground here = *this;
        if (kind != Kind::random) return here;
        const Random4 r = random4(seed, RandomStream::background, std::uint64_t(step));
        for (int c = 0; c < 3; ++c) here.color[c] = std::uint8_t(r.v[c] >> 24);
        return here;
    }
    /// Colour from 0 to 1, in the same encoding as photographs.
    Vec3f linear() const {
        return {float(color[0]) / 255, float(color[1]) / 255, float(color[2]) / 255};
    }
    bool black() const { return color[0] == 0 && color[1] == 0 && color[2] == 0; }
};

/// A sky of blurred photographs.
inline constexpr const char* kSoftBackground = "soft";

/// Throws Error(ExitCode::usage).
inline PhotoBackground parse_background(const std::string& text) {
    using enum PhotoBackground::Kind;
    if (text == "none") return {};
    if (text == "black") return {constant, {0, 0, 0}};
    if (text == "white") return {constant, {255, 255, 255}};
    if (text == "random") return {random, {0, 0, 0}};
    if (text == "sky" || text == kSoftBackground) return {sky, {0, 0, 0}};
    PhotoBackground given{constant, {0, 0, 0}};
    const char *at = text.data(), *const end = at + text.size();
    for (int c = 0; c < 3; ++c) {
        const auto [next, error] = std::from_chars(at, end, given.color[c]);
        const bool last = c == 2, good = error == std::errc{} &&
                                         (last ? next == end : next != end && *next == ',');
        if (!good)
            throw Error(
                ExitCode::usage, "loss.photometric.background: '", text,
                "'; expected none, black, white, random, sky, soft, or R,G,B from 0 to 255");
        at = next + (last ? 0 : 1);
    }
    return given;
}

inline constexpr const char* kRandomNeedsObject =
    "loss.photometric.background is random, which needs object masks; give --mask-use object, or "
    "the colour of the background";

inline constexpr const char* kSkyNeedsMap =
    "loss.photometric.background is sky, but no sky map is set (PhotometricOptions::sky)";

/// Whether a mask's pixel counts as inside, or as background; see View::mask.
TVSGS_HD inline bool is_inside(float mask) {
    return mask >= kObjectMask / 255.0f;
}
TVSGS_HD inline bool is_background(float mask) {
    return mask == 0;
}

/// The background behind the splats of a view, per pixel.
struct Behind {
    Vec3f color;  // 0 to 1; unused if there is a sky
    SkyMap sky{};
    Camera camera{};

    TVSGS_HD Vec3f at(int i) const {
        if (sky.empty()) return color;
        return sky.at(world_direction(camera, i % camera.width_px, i / camera.width_px));
    }
};

/// How the pixels of a view are compared.
struct MaskedPhoto {
    Span<const float> mask;  // [H W] of the view, 0 to 1; empty: all pixels are inside
    Behind background;
    bool fills;             // the photograph gets the background where the mask says background
    float coverage_weight;  // cost of a covered pixel there
    /// [H W] prior_map::kConfidence, or empty, and the cost of an open pixel that stereo measured:
    /// in front of a background like themselves splats would lose their opacity.
    Span<const float> confidence{};
    float open_weight = 0;

    TVSGS_HD bool inside(int i) const { return mask.empty() || is_inside(mask[i]); }
    TVSGS_HD bool filled(int i) const { return fills && is_background(mask[i]); }
};

/// Writes the two images that are compared; both are black where nothing is compared.
struct MaskPhotoBody {
    MaskedPhoto by;
    Span<const Vec3f> color;
    Span<const float> transmittance;
    const std::uint8_t* photo;
    Span<Vec3f> compared_color;    // [H W] overwritten
    std::uint8_t* compared_photo;  // [H W 3] overwritten
    std::uint8_t background[3];    // as in `by`

    TVSGS_HD void operator()(int i) const {
        const bool inside = by.inside(i), shown = inside || by.filled(i);
        compared_color[i] = shown ? color[i] + transmittance[i] * by.background.at(i) : Vec3f{};
        for (int c = 0; c < 3; ++c)
            compared_photo[3 * i + c] = inside ? photo[3 * i + c] : shown ? background[c] : 0;
    }
};

/// Maps dL/d of the compared render to the render; adds the costs of coverage outside of the object
/// and of open pixels.
struct MaskPhotoVjpBody {
    MaskedPhoto by;
    Span<const float> transmittance;
    Span<const Vec3f> dL_dcompared;
    Span<Vec3f> dL_dcolor;          // added to
    Span<float> dL_dtransmittance;  // added to; empty where no cost depends on it
    Span<float> pixel_loss;         // added to

    TVSGS_HD void operator()(int i) const {
        if (by.inside(i) || by.filled(i)) {
            dL_dcolor[i] += dL_dcompared[i];
            if (!dL_dtransmittance.empty())
                dL_dtransmittance[i] += dot(dL_dcompared[i], by.background.at(i));
        }
        if (!by.confidence.empty() && is_measured(by.confidence[i])) {
            pixel_loss[i] += by.open_weight * transmittance[i];
            dL_dtransmittance[i] += by.open_weight;
        }
        if (!(by.coverage_weight > 0) || by.mask.empty() || !is_background(by.mask[i])) return;
        pixel_loss[i] += by.coverage_weight * (1 - transmittance[i]);
        dL_dtransmittance[i] -= by.coverage_weight;
    }
};

}  // namespace tvsgs
