#include "pipeline/scene/mask_use.h"

#include <algorithm>
#include <map>
#include <utility>

#include "core/log.h"
#include "io/files/read_file.h"
#include "optim/growth/init_cloud.h"

namespace tvsgs {
namespace {

/// Whether a point shows on the background, also in all neighbouring pixels.
bool is_background_at(const View& view, Vec3f point) {
    const Camera& c = view.camera;
    if (view.mask.empty() || !is_in_view(c, point)) return false;
    const Vec3f p = c.camera_from_world * point;
    const int x = int(c.fx_px * p.x / p.z + c.cx_px), y = int(c.fy_px * p.y / p.z + c.cy_px);
    for (int j = std::max(0, y - 1); j <= std::min(view.mask.height - 1, y + 1); ++j)
        for (int i = std::max(0, x - 1); i <= std::min(view.mask.width - 1, x + 1); ++i)
            if (view.mask.at(i, j) != 0) return false;
    return true;
}

constexpr double kWrongPose = 0.1;  // widths of a photograph; no refinement mends it
constexpr int kLeastSide = 8;       // px; patches are seven wide
constexpr int kBlankLevels = 2;     // range of the levels of a blank photograph
constexpr int kRows = 64;           // of a photograph that are read at most

/// The bytes of evenly spaced rows.
std::string sample_of(const ImageU8& photo) {
    const std::size_t row = std::size_t(photo.width) * photo.channels;
    std::string sample;
    for (int y = 0; y < photo.height; y += 1 + photo.height / kRows) {
        const std::uint8_t* const from = std::as_const(photo.pixels).data() + y * row;
        sample.append(reinterpret_cast<const char*>(from), row);
    }
    return sample;
}

bool is_blank(const std::string& sample) {
    const auto level = [](char byte) { return static_cast<unsigned char>(byte); };
    const auto [low, high] = std::ranges::minmax_element(sample, {}, level);
    return level(*high) - level(*low) <= kBlankLevels;
}

}  // namespace

void check_photographs(const std::vector<View>& train) {
    std::vector<std::string> blank, repeated;
    std::map<std::string, std::string> first;  // the first photograph with a sample
    for (const View& view : train) {
        const ImageU8& photo = view.photo;
        if (photo.empty()) return;  // read without pixels
        if (std::min(photo.width, photo.height) < kLeastSide)
            throw input_error(view.name, ": ", photo.width, "x", photo.height,
                              " pixels; expected at least ", kLeastSide,
                              " on each side; give larger photographs, or a larger size with -r");
        std::string sample = sample_of(photo);
        if (is_blank(sample)) {
            blank.push_back(view.name);
        } else if (const auto [at, is_new] = first.emplace(std::move(sample), view.name); !is_new) {
            repeated.push_back(str(view.name, " repeats ", at->second));
        }
    }
    if (!train.empty() && blank.size() == train.size())
        throw input_error("all ", blank.size(), " training photographs are blank, such as ",
                          blank.front(), "; give photographs that show the scene");
    if (train.size() > 1 && blank.empty() && repeated.size() == train.size() - 1)
        throw input_error("all ", train.size(), " training photographs have the same pixels (",
                          repeated.front(), "); give photographs from different places");
    if (!blank.empty())
        spdlog::warn("{} of {} training photographs are blank, such as {}; remove them",
                     blank.size(), train.size(), blank.front());
    if (!repeated.empty())
        spdlog::warn("{} of {} training photographs repeat others at another pose: {}; remove them",
                     repeated.size(), train.size(), repeated.front());
}

void check_poses(const std::string& scene, const std::vector<View>& train) {
    const auto wrong = std::ranges::count_if(train, [](const View& view) {
        return view.pose_error_px > kWrongPose * view.camera.width_px;
    });
    if (2 * std::size_t(wrong) <= train.size()) return;
    throw input_error("E_POSES: ", scene, ": poses and points contradict each other: in ", wrong,
                      " of ", train.size(),
                      " training photographs the points lie behind the camera, or far from where "
                      "the photograph shows them"
                      "\n  Expected camera_from_world, x right, y down, z forward, not mirrored "
                      "(docs/guide/input.md#conventions)."
                      "\n  tvsgs-prepare finds new poses from the photographs.");
}

void require_some_object(const MaskLook& look) {
    if (look.masked > 0 && look.empties == look.masked)
        throw input_error("E_MASKS: all ", look.masked, " masks are empty (no pixel of ",
                          int{kObjectMask},
                          " or more); write masks as 0 and 255, or give --mask-use none");
}

void require_masks(const std::string& asked, const std::string& without, const MaskLook& look) {
    if (look.masked == 0)
        throw input_error("E_MASKS: ", asked,
                          ", but no training view has a mask; put mask/ or masks/ beside the "
                          "photographs, use an alpha channel, or give --masks DIR");
    if (!look.empty.empty())
        throw input_error("E_MASKS: ", asked, ", but the mask of ", look.empty,
                          " is empty (no pixel of ", int{kObjectMask},
                          " or more); write masks as 0 and 255, remove the view, or ", without);
}

void check_masks(const PhotometricOptions& options, const std::vector<View>& train) {
    const MaskUse use = options.masks;
    if (use != MaskUse::object &&
        parse_background(options.background).kind == PhotoBackground::Kind::random)
        throw Error(ExitCode::usage, kRandomNeedsObject);
    if (!uses_masks(use)) return;
    const MaskLook look = look_at_masks(train, {});
    const std::string asked =
        str("loss.photometric.masks is ", use == MaskUse::object ? "object" : "ignore");
    require_masks(asked, "use --mask-use none", look);
    if (use == MaskUse::object && look.outside == 0)
        throw input_error("E_MASKS: ", asked,
                          ", but the masks cover the photographs completely; write "
                          "0 outside the object, or give --mask-use ignore");
    if (look.masked < look.views)
        spdlog::warn("{} of {} training views have no mask; they are compared as a whole",
                     look.views - look.masked, look.views);
}

std::size_t drop_background_points(const std::vector<View>& views, PointCloud& cloud) {
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < cloud.positions.size(); ++i)
        if (std::ranges::none_of(views, [&](const View& view) {
                return is_background_at(view, cloud.positions[i]);
            }))
            kept.push_back(i);
    const std::size_t dropped = cloud.positions.size() - kept.size();
    if (dropped > 0) cloud = select_points(cloud, kept);
    return dropped;
}

void limit_to_object(MaskUse use, const std::vector<View>& views, PointCloud& cloud) {
    if (use != MaskUse::object) return;
    if (const std::size_t dropped = drop_background_points(views, cloud))
        spdlog::debug("Dropped {} start points outside the masks", dropped);
}

}  // namespace tvsgs
