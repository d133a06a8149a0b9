#include "io/scene/load_views.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <map>
#include <set>

#include "core/device/parallel_lists.h"
#include "core/log.h"
#include "core/progress.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "io/scene/scene_reader.h"

namespace tvsgs {
namespace {

/// True if the two sizes are one image at two scales, up to a pixel of rounding.
bool same_shape(int w, int h, int camera_w, int camera_h) {
    return std::abs(static_cast<double>(w) * camera_h / camera_w - h) <= 1 ||
           std::abs(static_cast<double>(h) * camera_w / camera_h - w) <= 1;
}

/// EXIF orientation of a view's photograph.
struct PhotoTurn {
    bool by_reader = false;  // the pixels were turned by it
    int upright_turns = 0;   // see View
};

/// Reads the pixels. Turns them by EXIF if only then they fit the camera; otherwise leaves them as
/// stored, like COLMAP.
ImageU8 read_pixels(const std::string& file, const Intrinsics& camera, PhotoTurn& turn) {
    const auto fits = [&](int width, int height) {
        return same_shape(width, height, camera.width_px, camera.height_px);
    };
    const ImageSize found = read_image_size(file);
    const bool as_stored = fits(found.width, found.height),
               sideways = !as_stored && fits(found.height, found.width);
    const auto wrong = [&](const char* what_to_do) {
        return input_error("E_IMAGE_SIZE: ", file, ": ", found.width, "x", found.height,
                           " pixels; its camera has ", camera.width_px, "x", camera.height_px,
                           what_to_do);
    };
    if (!as_stored && !sideways)
        throw wrong(
            "; give the folder of the images that the cameras were computed from (--images)");
    const std::string bytes = read_bytes(file);
    const int orientation = read_exif(bytes).orientation;
    if (as_stored) {
        turn.upright_turns = upright_turns(orientation);
        return decode_image(file, bytes);
    }
    if (!swaps_sides(orientation))
        throw wrong(
            " (turned by 90 degrees, and the file has lost its EXIF orientation); rotate the "
            "image, or give the folder of the images that the cameras were computed from "
            "(--images)");
    turn.by_reader = true;
    return turned(decode_image(file, bytes), orientation);
}

/// A mask may differ in size from its image, but not in shape.
void check_mask_size(const std::string& file, const ImageU8& mask, const ImageU8& photo) {
    if (same_shape(mask.width, mask.height, photo.width, photo.height)) return;
    throw input_error("E_MASKS: ", file, ": ", mask.width, "x", mask.height,
                      " pixels; its image has ", photo.width, "x", photo.height,
                      "; expected that size or shape: make the masks from these images");
}

void threshold(ImageU8& mask) {
    for (auto& value : mask.pixels) value = value >= kObjectMask ? 255 : 0;
}

/// Side of the grey image: the training size / grey_scale, at most the file's size.
int finer(int size_px, const SceneOptions& options, int file_px) {
    return std::max(size_px, std::min(file_px, static_cast<int>(static_cast<float>(size_px) /
                                                                options.grey_scale)));
}

/// Range of several shares.
struct Shares {
    double least = 1, most = 0;
    void add(double share) { least = std::min(least, share), most = std::max(most, share); }
    /// In per cent; a single number if both ends are equal.
    std::string text() const {
        const double low = std::round(1000 * least) / 10, high = std::round(1000 * most) / 10;
        return low == high ? str(low) : str(low, " to ", high);
    }
};

/// Splits an image [H, W, C] into the photograph and, for C = 4, its alpha channel.
void split_alpha(const ImageU8& image, ImageU8& photo, ImageU8& alpha) {
    const std::size_t count = static_cast<std::size_t>(image.width) * image.height;
    const std::size_t channels = static_cast<std::size_t>(image.channels);
    photo = ImageU8(image.width, image.height, 3);
    for (std::size_t i = 0; i < count; ++i)
        for (std::size_t c = 0; c < 3; ++c)
            photo.pixels[3 * i + c] = image.pixels[channels * i + (channels < 3 ? 0 : c)];
    if (channels != 4) return;
    alpha = ImageU8(image.width, image.height, 1);
    for (std::size_t i = 0; i < count; ++i) alpha.pixels[i] = image.pixels[4 * i + 3];
}

/// True if the mask covers the whole image.
bool is_whole(const ImageU8& mask) {
    return std::ranges::all_of(mask.pixels, [](auto a) { return a == 255; });
}

/// Reads a photograph [H, W, 3] before the removal of lens distortion. `alpha` becomes the alpha
/// channel [H, W, 1], or empty.
ImageU8 read_photo(const ViewSource& source, ImageU8& alpha, PhotoTurn& turn) {
    ImageU8 photo;
    alpha = {};
    split_alpha(read_pixels(source.file, source.intrinsics, turn), photo, alpha);
    if (source.alpha_on_black)
        for (std::size_t i = 0; i < photo.pixels.size() && !alpha.empty(); ++i)
            photo.pixels[i] =
                static_cast<std::uint8_t>(photo.pixels[i] * alpha.pixels[i / 3] / 255);
    return photo;
}

View load_view(const ViewSource& source,
               const SceneOptions& options,
               Vec3d origin,
               std::atomic<int>& turns) {
    // 1. Pixels and masks.
    ImageU8 mask;
    PhotoTurn turn;
    ImageU8 photo = read_photo(source, mask, turn);
    turns += turn.by_reader;
    if (is_whole(mask)) mask = {};
    const PixelSize size = resized_size(options.resolution, photo.width, photo.height);

    // 2. Removal of lens distortion, at the size of the file.
    Intrinsics intrinsics = scaled(source.intrinsics, photo.width, photo.height);
    ImageU8 valid;
    const bool distorted = intrinsics.distortion.kind != Distortion::Kind::none;
    if (source.mask_file) {
        mask = read_image(*source.mask_file, 1);
        check_mask_size(*source.mask_file, mask, photo);
    }
    if (distorted) {
        if (!mask.empty())
            mask = undistorted(intrinsics, resize_nearest(mask, photo.width, photo.height), valid);
        photo = undistorted(intrinsics, photo, valid);
    }

    // 3. Resizing to the training size.
    View view;
    view.name = source.image->name;
    view.upright_turns = turn.upright_turns;
    view.photo = resize_bicubic(photo, size.width_px, size.height_px);
    view.reduction = static_cast<double>(photo.width) / size.width_px;
    if (options.grey_scale < 1)
        view.grey = grey_of(resize_bicubic(photo, finer(size.width_px, options, photo.width),
                                           finer(size.height_px, options, photo.height)));
    if (!mask.empty()) {
        view.mask = source.mask_file ? resize_nearest(mask, size.width_px, size.height_px)
                                     : resize_bicubic(mask, size.width_px, size.height_px);
        threshold(view.mask);
    }
    if (distorted) {
        // Marks pixels whose colour filter reaches beyond the photograph. The filter has negative
        // weights, so the photograph is 128: a missing part makes the result larger or smaller.
        constexpr std::uint8_t kPhoto = 128;
        for (auto& value : valid.pixels) value = value ? kPhoto : 0;
        valid = resize_bicubic(valid, size.width_px, size.height_px);
        if (view.mask.empty()) view.mask = ImageU8(valid.width, valid.height, 1, 255);
        for (std::size_t i = 0; i < valid.pixels.size(); ++i)
            if (valid.pixels[i] != kPhoto) view.mask.pixels[i] = kNoPhoto;
        if (!source.mask_file && is_whole(view.mask)) view.mask = {};
    }

    intrinsics = scaled(intrinsics, size.width_px, size.height_px);
    Camera& camera = view.camera;
    camera.width_px = size.width_px, camera.height_px = size.height_px;
    camera.fx_px = static_cast<float>(intrinsics.fx_px),
    camera.fy_px = static_cast<float>(intrinsics.fy_px);
    camera.cx_px = static_cast<float>(intrinsics.cx_px),
    camera.cy_px = static_cast<float>(intrinsics.cy_px);
    if (options.center_principal_point)
        camera.cx_px = static_cast<float>(size.width_px) / 2,
        camera.cy_px = static_cast<float>(size.height_px) / 2;
    const Rigid3d& pose = source.image->camera_from_world;
    camera.camera_from_world = {mat_cast<float>(pose.R), vec_cast<float>(pose * origin)};
    return view;
}

}  // namespace

std::vector<View> load_views(const std::vector<ViewSource>& sources,
                             const SceneOptions& options,
                             Vec3d origin,
                             PixelFile* file) {
    std::vector<View> views(sources.size());
    std::atomic<int> turns = 0;
    Progress progress("photographs", double(sources.size()));
    parallel_for_throwing(static_cast<int>(sources.size()), [&](std::size_t at) {
        View& view = views[at];
        view = load_view(sources[at], options, origin, turns);
        if (file != nullptr) file->keep(view.photo), file->keep(view.mask), file->keep(view.grey);
        progress.advance();
    });
    if (turns > 0)
        spdlog::info("Turned {} of {} photographs by their EXIF orientation", turns.load(),
                     views.size());
    return views;
}

void log_undistortion(const std::vector<ViewSource>& sources) {
    struct Lens {
        Shares cropped, empty;
    };
    std::map<std::string, Lens> lenses;
    std::set<std::uint32_t> seen;
    for (const ViewSource& source : sources) {
        const Intrinsics& in = source.intrinsics;
        if (in.distortion.kind == Distortion::Kind::none ||
            !seen.insert(source.image->camera_id).second)
            continue;
        const UndistortionLoss loss = undistortion_loss(in);
        lenses[in.model].cropped.add(loss.cropped), lenses[in.model].empty.add(loss.empty);
    }
    for (const auto& [model, lens] : lenses)
        spdlog::info("Undistorted lens {}: cropped {} % of the pixels{}", model,
                     lens.cropped.text(),
                     lens.empty.most >= 0.0005
                         ? str(", ", lens.empty.text(), " % of the views are empty and masked")
                         : "");
}

void warn_of_empty_masks(const std::vector<ViewSource>& sources, const std::vector<View>& views) {
    std::size_t masked = 0, empty = 0;
    const ViewSource* first = nullptr;
    for (std::size_t i = 0; i < views.size(); ++i) {
        if (!sources[i].mask_file) continue;
        const auto& pixels = views[i].mask.pixels;
        ++masked;
        if (std::ranges::any_of(pixels, [](auto value) { return value >= kObjectMask; })) continue;
        ++empty;
        if (!first) first = &sources[i];
    }
    if (!first) return;
    const ImageU8 mask = read_image(*first->mask_file, 1);
    spdlog::warn(
        "{} of {} masks are empty, such as {}: its largest value is {}, and the object needs 128 "
        "to 255; a mesh gets nothing from these photographs",
        empty, masked, *first->mask_file, *std::ranges::max_element(mask.pixels));
}

}  // namespace tvsgs
