// tvsgs-vote: normals, saliencies and confidence of any point cloud, by tensor voting.
#include <cmath>

#include "apps/common/command_line.h"
#include "core/device/device_choice.h"
#include "core/grouped.h"
#include "core/math/sigmoid.h"
#include "core/progress.h"
#include "core/scene/scene.h"
#include "io/files/read_file.h"
#include "io/scene/scene_reader.h"
#include "io/splats/ply.h"
#include "pipeline/run/run_folder.h"
#include "render/ewa/projection_math.h"
#include "render/tiles/sh_math.h"
#include "tv/cloud_votes.h"

namespace tvsgs {
namespace {

struct Arguments {
    std::string input, output, device = "auto";
    std::vector<double> viewpoint;
    CloudVoteOptions votes;
};

Arguments parse(int argc, char** argv) {
    Arguments a;
    CLI::App app{"Finds the surface in a point cloud by tensor voting.", "tvsgs-vote"};
    app.get_formatter()->column_width(46);
    app.add_option("cloud", a.input, "points or splats (.ply)")->required();
    app.add_option("output", a.output, "cloud to write (.ply)")->required();
    add_number(app, "--k", a.votes.k, 3, 512, "nearest points that vote for each point [30]");
    app.add_option("--radius", a.votes.radius,
                   "largest distance of these points, world units [any]")
        ->check(kPositive);
    add_number(app, "--refine", a.votes.refine, 0, 100,
               "rounds in which points move along their normals to the voted surface [0]");
    app.add_flag("--reject", a.votes.reject, "drop points that the votes find off the surface");
    app.add_option("--orient", a.viewpoint,
                   "X,Y,Z: turn normals to this point [along the surface, outwards]")
        ->delimiter(',')
        ->expected(3);
    app.add_option("--device", a.device, "auto, cpu, cuda or cuda:N");
    add_log_flags(app);
    parse_command_line(app, argc, argv);
    for (const double x : a.viewpoint)
        if (!std::isfinite(x)) throw usage_error("--orient: expected finite numbers");
    return a;
}

/// Splats as points with a normal, the axis of the smallest scale.
PointCloud points_of(const Gaussians<Cpu>& splats) {
    PointCloud points;
    const std::size_t count = splats.means.size();
    for (std::size_t i = 0; i < count; ++i) {
        const int axis = smallest_axis(splats.log_scales[i]);
        points.positions.push_back(splats.means[i]);
        points.normals.push_back(column(rotation(normalize(splats.quats[i])), axis));
        points.colors.push_back(Vec3f{0.5f, 0.5f, 0.5f} + float(kShC0) * splats.sh[i]);
        points.confidences.push_back(sigmoid(splats.opacity_logits[i]));
    }
    return points;
}

/// A cloud far from zero gets an origin near it.
struct Input {
    PointCloud points;
    Vec3d origin;
    bool has_sides = false;  // its normals have a meaningful side
};

Input read_input(const std::string& path) {
    Input in;
    const PlyContents contents = read_ply(path);
    std::vector<Vec3d> places;
    for (const Vec3f p : contents.points.positions)
        if (is_finite(p)) places.push_back(vec_cast<double>(p));
    in.origin = local_origin(places);
    if (contents.is_splats) {
        in.points = points_of(read_splat_ply(path, in.origin));
    } else {
        in.points = norm(in.origin) > 0 ? read_ply(path, in.origin).points : contents.points;
        in.has_sides = !in.points.normals.empty();
    }
    drop_invalid_points(in.points, path);
    if (in.points.positions.size() < 3)
        throw input_error(path, ": ", in.points.positions.size(),
                          " usable points; votes need at least 3");
    return in;
}

/// The kept points with the attributes of the input.
PointCloud voted_cloud(const PointCloud& input, const CloudVotes& votes) {
    PointCloud out;
    out.positions = votes.positions;
    out.normals = votes.normals;
    out.confidences = votes.confidences;
    if (!input.colors.empty())
        for (const std::size_t i : votes.kept) out.colors.push_back(input.colors[i]);
    return out;
}

}  // namespace

int command(int argc, char** argv) {
    const Arguments a = parse(argc, argv);
    require_output(a.output, {".ply"}, {});
    const DeviceChoice device = choose_device(a.device);
    const Input in = read_input(a.input);
    const std::size_t count = in.points.positions.size();
    spdlog::info("{}: {}{}; {}", a.input, counted(count, "point"),
                 in.points.normals.empty() ? "" : " with normals", device.description);

    Progress progress("Votes", cloud_vote_steps(a.votes, count));
    CloudVotes votes = on_device(device, [&](auto tag) {
        return vote_in_cloud(tag, in.points, a.votes,
                             [&](int points) { progress.advance(points); });
    });
    std::size_t without = 0;
    double confidence = 0;
    for (const Vec3f n : votes.normals) without += dot(n, n) > 0 ? 0 : 1;
    for (const float c : votes.confidences) confidence += c;
    if (without == votes.normals.size())
        throw Error(ExitCode::numerical, a.input,
                    ": no point lies on a surface; are all points in one "
                    "place or on one line, or is --radius too small?");
    if (!a.viewpoint.empty())
        orient_to_viewpoint(
            votes,
            vec_cast<float>(Vec3d{a.viewpoint[0], a.viewpoint[1], a.viewpoint[2]} - in.origin));
    else if (!in.has_sides)
        orient_along_graph(votes);

    std::vector<float> surface, curve, point;
    for (std::size_t i = 0; i < votes.kept.size(); ++i) {
        surface.push_back(votes.surface(i));
        curve.push_back(votes.curve(i));
        point.push_back(votes.point(i));
    }
    write_cloud_ply(a.output, voted_cloud(in.points, votes), in.origin,
                    {{"surface", surface}, {"curve", curve}, {"point", point}});
    if (a.votes.reject)
        spdlog::info("Dropped {} off the surface", counted(count - votes.kept.size(), "point"));
    if (without > 0) spdlog::info("{} without a normal", counted(without, "point"));
    spdlog::info("Cloud: {}, mean confidence {:.2f}", a.output,
                 confidence / double(votes.kept.size()));
    return 0;
}

}  // namespace tvsgs
