#include "plan/background.h"

#include <cmath>

#include "core/error.h"
#include "mesh/fuse/focus.h"
#include "plan/figures.h"

namespace tvsgs {

double share_beyond(const std::vector<Camera>& cameras, const std::vector<Vec3f>& points) {
    const std::optional<Focus> focus = find_focus(cameras);
    if (!focus || !(focus->radius > 0)) return NAN;
    constexpr std::size_t kSample = 4000;
    const double limit = kDepthLimit * focus->radius;
    int seen = 0, beyond = 0;
    for (std::size_t i = 0; i < points.size(); i += 1 + points.size() / kSample) {
        int views = 0;
        bool far = true;
        for (const Camera& camera : cameras) {
            if (!is_in_view(camera, points[i])) continue;
            ++views;
            far = far && static_cast<double>((camera.camera_from_world * points[i]).z) >= limit;
        }
        if (views < 2) continue;
        ++seen, beyond += far;
    }
    return seen > 0 ? static_cast<double>(beyond) / seen : NAN;
}

Decision decide_background(double share_beyond, bool masked) {
    constexpr double kMuch = 0.05;
    const bool meshed = share_beyond >= kMuch;
    return {"mesh bounds",
            meshed ? "unbounded" : "twice the object's distance",
            std::isnan(share_beyond)
                ? std::string("the distance of the points is not known")
                : str(percent(share_beyond), " of the points", masked ? " inside the masks" : "",
                      " lie farther, unbounded from ", percent(kMuch), " on"),
            share_beyond,
            kMuch,
            {{"mesh.unbounded", meshed ? "true" : "false"}}};
}

}  // namespace tvsgs
