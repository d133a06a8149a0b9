#include "pipeline/scene/mask_use.h"

#include <algorithm>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "optim/growth/init_cloud.h"

namespace tvsgs {
namespace {

/// Whether a point shows on the background, also in all neighbouring pixels.
bool is_background_at(const View& view, Vec3f point) {
    const Camera& c = view.camera;
    if (view.mask.empty() || !is_in_view(c, point)) return false;
    const Vec3f p = c.camera_from_world * point;
    const int x = static_cast<int>(c.fx_px * p.x / p.z + c.cx_px),
              y = static_cast<int>(c.fy_px * p.y / p.z + c.cy_px);
    for (int j = std::max(0, y - 1); j <= std::min(view.mask.height - 1, y + 1); ++j)
        for (int i = std::max(0, x - 1); i <= std::min(view.mask.width - 1, x + 1); ++i)
            if (view.mask.at(i, j) != 0) return false;
    return true;
}

}  // namespace

void require_masks(const std::string& asked, const std::string& without, const MaskLook& look) {
    if (look.masked == 0)
        throw Error(ExitCode::input,
                    str("E_MASKS: ", asked,
                        ", but no training view has a mask; put mask/ or masks/ beside the "
                        "photographs, use an alpha channel, or give --masks DIR"));
    if (!look.empty.empty())
        throw Error(ExitCode::input,
                    str("E_MASKS: ", asked, ", but the mask of ", look.empty,
                        " is empty (no pixel of ", int{kObjectMask},
                        " or more); write masks as 0 and 255, remove the view, or ", without));
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
        throw Error(ExitCode::input, str("E_MASKS: ", asked,
                                         ", but the masks cover the photographs completely; write "
                                         "0 outside the object, or give --mask-use ignore"));
    if (look.masked < look.views)
        spdlog::warn("{} of {} training views have no mask; they are compared as a whole",
                     look.views - look.masked, look.views);
}

std::size_t drop_background_points(const std::vector<View>& views, PointCloud& cloud) {
    std::vector<std::size_t> kept;
    for (std::size_t i = 0; i < cloud.positions.size(); ++i)
        if (std::none_of(views.begin(), views.end(), [&](const View& view) {
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
