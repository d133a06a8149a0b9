#include "pipeline/scene/sky.h"

#include <filesystem>

#include "core/log.h"
#include "io/files/read_file.h"
#include "io/images/image_file.h"
#include "optim/growth/init_cloud.h"
#include "plan/decide.h"

namespace tvsgs {
namespace {

std::string file_of(const std::string& run) {
    return run + "/sky.png";
}

}  // namespace

SkyDetection provide_sky(Configuration& config, Scene& scene, RunPlan* plan) {
    PhotometricOptions& o = config.options.train.loss.photometric;
    const bool decides = plan != nullptr && o.masks != MaskUse::object &&
                         !is_pinned(config.table, "loss.photometric.background");
    if ((!decides && !has_sky(o)) || is_soft(o)) return {};
    SkyDetection look = detect_sky(scene.train, scene.points.positions, uses_masks(o.masks));
    if (decides) plan->apply(decide_sky(look.share), config.table);
    if (!has_sky(o)) return {};
    const std::vector<std::size_t> kept =
        points_outside_sky(scene.train, look, scene.points.positions);
    if (const std::size_t dropped = scene.points.positions.size() - kept.size()) {
        scene.points = select_points(scene.points, kept);
        spdlog::debug("Dropped {} start points in the sky", dropped);
    }
    if (!o.sky_from.empty())
        read_sky(o, o.sky_from);
    else
        o.sky = std::make_shared<const ImageU8>(make_sky(scene.train, look));
    return look;
}

void provide_soft_background(PhotometricOptions& options, const std::vector<View>& views) {
    if (!is_soft(options)) return;
    if (options.sky_from.empty())
        options.sky = std::make_shared<const ImageU8>(make_soft_background(views));
    else
        read_sky(options, options.sky_from);
}

bool has_sky_file(const std::string& run) {
    std::error_code code;
    return std::filesystem::is_regular_file(file_of(run), code);
}

void write_sky(const std::string& run, const PhotometricOptions& options) {
    if (options.sky) write_png(file_of(run), *options.sky);
}

void read_sky(PhotometricOptions& options, const std::string& run) {
    options.sky = nullptr;
    if (!has_sky(options)) return;
    const std::string file = file_of(run);
    if (!has_sky_file(run))
        throw input_error(run,
                          ": no sky.png, which loss.photometric.background=", options.background,
                          " needs; give the complete folder of a run with this background");
    ImageU8 sky = read_image(file, 3);
    if (sky.width != sky.height || sky.width < 2)
        throw input_error(file, ": ", sky.width, "x", sky.height,
                          " pixels; expected the square map of directions that tvsgs-train writes");
    options.sky = std::make_shared<const ImageU8>(std::move(sky));
}

}  // namespace tvsgs
