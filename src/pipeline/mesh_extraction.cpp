#include "pipeline/mesh_extraction.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>

#include "core/error.h"
#include "core/log.h"
#include "core/parse_numbers.h"
#include "mesh/mesh_holes.h"
#include "mesh/mesh_rims.h"
#include "mesh/mesh_sound.h"

namespace tvsgs {
namespace {

constexpr int kTeethRounds = 3;
constexpr double kShareOfFreeMemory = 0.8;  // the rest is for images and the mesh itself

void parse_box(const std::string& text, Vec3d origin, DepthRules& rules) {
    double numbers[6];
    const char* at = text.data();
    const char* const end = at + text.size();
    bool good = true;
    for (int i = 0; i < 6 && good; ++i) {
        const auto [rest, code] = std::from_chars(at, end, numbers[i]);
        good = code == std::errc{} && std::isfinite(numbers[i]) &&
               (i < 5 ? rest != end && *rest == ',' : rest == end);
        at = rest + 1;
    }
    if (!good || !(numbers[0] < numbers[3] && numbers[1] < numbers[4] && numbers[2] < numbers[5]))
        throw Error(
            ExitCode::usage,
            str("--bbox ", text, ": expected x0,y0,z0,x1,y1,z1 with x0 < x1, y0 < y1, z0 < z1"));
    rules.has_box = true;
    rules.box_min = vec_cast<float>(Vec3d{numbers[0], numbers[1], numbers[2]} - origin);
    rules.box_max = vec_cast<float>(Vec3d{numbers[3], numbers[4], numbers[5]} - origin);
}

}  // namespace

DepthRules depth_rules(const MeshOptions& options, Vec3d origin) {
    DepthRules rules;
    rules.depth_max = options.depth_max, rules.alpha_min = options.alpha_min;
    rules.depth_step = options.depth_step;
    if (options.max_angle < 90)
        rules.min_cosine = std::cos(options.max_angle * static_cast<float>(M_PI / 180));
    if (!options.box.empty()) parse_box(options.box, origin, rules);
    return rules;
}

void check_mesh_options(const MeshOptions& options) {
    make_mesher<Cpu>(options.method, options.meshers);
    depth_rules(options);
    if (!options.memory.empty()) parse_bytes("--memory", options.memory);
}

namespace detail {

std::vector<Camera> cameras_of(const std::vector<View>& views) {
    std::vector<Camera> cameras;
    for (const View& view : views) cameras.push_back(view.camera);
    return cameras;
}

MeshRegion mesh_region(const MeshOptions& options, const Focus& focus, DepthRules& rules) {
    const float radius =
        options.unbounded && options.radius > 0 ? options.radius : static_cast<float>(focus.radius);
    if ((options.unbounded || rules.depth_max == 0) && !(radius > 0))
        throw Error(ExitCode::input,
                    str("the size of the scene cannot be found: a camera lies in the point that "
                        "all look at; give ",
                        options.unbounded ? "--set mesh.radius=R" : "--depth-max"));
    if (rules.depth_max == 0)
        rules.depth_max = options.unbounded ? std::numeric_limits<float>::max() : 2 * radius;
    return {options.unbounded, vec_cast<float>(focus.point), radius};
}

std::int64_t memory_of_mesher(const MeshOptions& options, std::int64_t free_bytes) {
    return !options.memory.empty()
               ? parse_bytes("--memory", options.memory)
               : static_cast<std::int64_t>(kShareOfFreeMemory * static_cast<double>(free_bytes));
}

std::string clean_mesh(TriangleMesh& mesh,
                       const MeshOptions& options,
                       const EvidenceSource& evidence,
                       spdlog::level::level_enum level) {
    if (options.evidence && !mesh.faces.empty()) {
        const EvidenceReport seen = keep_seen_components(mesh, evidence);
        const std::size_t small =
            seen.components - seen.kept_components - seen.looked_through - seen.lonely;
        const std::string dropped =
            str(seen.looked_through, " that a view looks through, ", seen.lonely,
                " that one view alone sees, ", small, " of less than 20 pixels in every view");
        spdlog::log(level, "{} faces at rims that no view sees; of {} components {} stay, not {}",
                    seen.peeled_faces, seen.components, seen.kept_components, dropped);
        if (mesh.faces.empty())
            return str("the views bear out none of its ", seen.components, " components: ", dropped,
                       "; give more views, or --set mesh.evidence=false");
    }
    if (options.evidence && options.clusters == 0) return {};
    const CleanReport cleaned = keep_largest_components(mesh, options.clusters);
    spdlog::log(level, "{} components, {} kept; {} faces and {} vertices removed",
                cleaned.components, cleaned.kept_components, cleaned.removed_faces,
                cleaned.removed_vertices);
    if (!mesh.faces.empty() || cleaned.components == 0) return {};
    return str("all ", cleaned.components,
               " components have fewer than 50 faces; lower --voxel-size, or pass --clusters 0");
}

void mend_mesh(TriangleMesh& mesh,
               const std::vector<Camera>& cameras,
               const MeshOptions& options,
               const EvidenceSource& evidence,
               spdlog::level::level_enum level) {
    if (mesh.faces.empty() || !(options.holes > 0 || options.rims > 0)) return;
    const SoundReport sound = make_sound(mesh);
    if (sound.dropped_faces > 0 || sound.split_vertices > 0)
        spdlog::log(level, "{} faces were none or there twice, {} vertices split where sheets met",
                    sound.dropped_faces, sound.split_vertices);
    const HoleReport holes = close_holes(mesh, cameras, evidence, options.holes);
    if (options.holes > 0)
        spdlog::log(level,
                    "of {} loops of rims {} holes of up to {} pixels are closed with {} faces, not "
                    "{} that a view contradicts, {} that nothing fits",
                    holes.loops, holes.closed, options.holes, holes.faces, holes.contradicted,
                    holes.unfit);
    if (!(options.rims > 0)) return;
    const std::size_t teeth = drop_teeth(mesh, kTeethRounds);
    const std::size_t moved = smooth_rims(mesh, cameras, options.rims);
    spdlog::log(level, "{} teeth of rims are off, {} vertices at rims moved", teeth, moved);
}

}  // namespace detail
}  // namespace tvsgs
