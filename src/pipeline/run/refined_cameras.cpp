#include "pipeline/run/refined_cameras.h"

#include <algorithm>
#include <filesystem>
#include <iomanip>
#include <sstream>

#include "core/error.h"
#include "core/log.h"
#include "core/math/rigid.h"
#include "io/files/atomic_file.h"
#include "io/scene/colmap.h"

namespace tvsgs {
namespace {

std::string folder_of(const std::string& run) {
    return run + "/cameras";
}

}  // namespace

void write_refined_cameras(const std::string& run, const Scene& scene) {
    std::ostringstream cameras, images;
    cameras << std::setprecision(9) << "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n";
    images << std::setprecision(17) << "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n";
    int id = 0;
    for (const View& view : scene.train) {
        const Camera& c = view.camera;
        const Quat<double> q = quaternion(mat_cast<double>(c.camera_from_world.R));
        // Uses the rotation as written: with a distant origin its rounding would cost metres.
        const Vec3d t = vec_cast<double>(c.camera_from_world.t) - rotation(q) * scene.origin;
        cameras << ++id << " PINHOLE " << c.width_px << ' ' << c.height_px << ' ' << c.fx_px << ' '
                << c.fy_px << ' ' << c.cx_px << ' ' << c.cy_px << '\n';
        images << id << ' ' << q.w << ' ' << q.x << ' ' << q.y << ' ' << q.z << ' ' << t.x << ' '
               << t.y << ' ' << t.z << ' ' << id << ' ' << view.name << "\n\n";
    }
    write_text_file(folder_of(run) + "/cameras.txt", cameras.str());
    write_text_file(folder_of(run) + "/images.txt", images.str());
}

void apply_refined_cameras(const std::string& run, Scene& scene) {
    const std::string folder = folder_of(run);
    std::error_code code;
    if (!std::filesystem::is_directory(folder, code)) return;
    const ColmapModel model = read_colmap_model(folder);
    int refined = 0;
    for (View& view : scene.train)
        for (const ColmapImage& image : model.images) {
            if (image.name != view.name) continue;
            const Rigid3d& T = image.camera_from_world;
            view.camera.camera_from_world = {mat_cast<float>(T.R),
                                             vec_cast<float>(T.t + T.R * scene.origin)};
            ++refined;
        }
    spdlog::info("{}: uses refined poses for {} of {} training views", folder, refined,
                 scene.train.size());
}

JsonValue camera_moves_json(const Scene& scene, const CameraRefinement& refined) {
    JsonValue views = JsonValue::object();
    for (int i = 0; i < refined.views(); ++i) {
        const CameraMove move = refined.move(i);
        views.add(scene.train[i].name, JsonValue()
                                           .add("turn_px", move.turn_px)
                                           .add("turn_deg", move.turn_deg)
                                           .add("shift_px", move.shift_px));
    }
    return JsonValue().add("views", views);
}

std::string camera_moves_text(const CameraRefinement& refined) {
    CameraMove sum{}, most{};
    for (int i = 0; i < refined.views(); ++i) {
        const CameraMove move = refined.move(i);
        sum.turn_px += move.turn_px / refined.views();
        sum.shift_px += move.shift_px / refined.views();
        most.turn_px = std::max(most.turn_px, move.turn_px);
        most.shift_px = std::max(most.shift_px, move.shift_px);
    }
    return fmt::format(
        "Refined poses: turned by {:.2f} px (mean; max {:.2f}), shifted by {:.2f} px (max {:.2f})",
        sum.turn_px, most.turn_px, sum.shift_px, most.shift_px);
}

}  // namespace tvsgs
