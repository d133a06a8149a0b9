#include "io/scene/trajectory.h"

#include <cmath>
#include <filesystem>
#include <map>

#include "io/files/read_file.h"
#include "io/scene/colmap.h"

namespace tvsgs {
namespace {

/// Words of a file with their line numbers.
class Words {
public:
    Words(const std::string& path, const char* code)
        : path_(path), code_(code), bytes_(read_text(path)), rest_(bytes_) {}

    bool at_end() const { return trimmed(rest_).empty(); }

    template <class Number>
    Number next(const char* what) {
        std::string_view before = rest_;
        const std::string_view word = next_word(rest_);
        for (const char& c : before.substr(0, before.size() - rest_.size())) line_ += c == '\n';
        Number value{};
        if (word.empty()) throw wrong("the file ends, expected ", what);
        if (!parse_number(word, value)) throw wrong("'", shown(word), "' is not a valid ", what);
        return value;
    }

    Affine3d matrix() {
        double m[4][4];
        for (auto& row : m)
            for (double& entry : row) {
                entry = next<double>("matrix entry");
                if (!std::isfinite(entry)) throw wrong("a matrix entry is not finite");
            }
        if (m[3][0] != 0 || m[3][1] != 0 || m[3][2] != 0 || m[3][3] != 1)
            throw wrong("the last row of the matrix is ", m[3][0], " ", m[3][1], " ", m[3][2], " ",
                        m[3][3], ", expected 0 0 0 1");
        Affine3d T;
        for (int i = 0; i < 3; ++i) {
            for (int j = 0; j < 3; ++j) T.A[i][j] = m[i][j];
            T.t[i] = m[i][3];
        }
        return T;
    }
    template <class... Parts>
    Error wrong(const Parts&... what) const {
        return input_error(code_, ": ", path_, ": line ", line_, ": ", what...);
    }

private:
    std::string path_, code_, bytes_;
    std::string_view rest_;
    int line_ = 1;
};

/// One camera of a trajectory.
struct Centre {
    int index;  // of its image in the official log, to match by index
    bool registered;
    Vec3d position;
};

std::vector<Centre> read_centres(const std::string& path) {
    std::vector<Centre> centres;
    if (!std::filesystem::is_directory(path)) {
        for (const TrajectoryPose& pose : read_trajectory_log(path))
            centres.push_back({pose.index, pose.registered, pose.world_from_camera.t});
        return centres;
    }
    const std::string below = (std::filesystem::path(path) / "sparse/0").string();
    for (const ColmapImage& image :
         read_colmap_model(missing_colmap_files(path).empty() ? path : below).images) {
        std::string digits = std::filesystem::path(image.name).stem().string();
        digits.erase(0, digits.find_last_not_of("0123456789") + 1);
        int number = 0;
        const bool numbered = parse_number(digits, number);
        centres.push_back({numbered ? number - 1 : -1, true, inverse(image.camera_from_world).t});
    }
    return centres;
}

}  // namespace

std::vector<TrajectoryPose> read_trajectory_log(const std::string& path) {
    Words words(path, "E_TNT_TRAJ");
    std::vector<TrajectoryPose> poses;
    while (!words.at_end()) {
        TrajectoryPose pose;
        pose.index = words.next<int>("image index");
        pose.registered = words.next<int>("image index") != -1;
        words.next<int>("number");
        pose.world_from_camera = words.matrix();
        poses.push_back(pose);
    }
    if (poses.empty()) throw words.wrong("no pose; expected three integers and a 4x4 matrix each");
    return poses;
}

CentrePairs pair_trajectories(const std::string& trajectory, const std::string& log) {
    const std::vector<Centre> from = read_centres(trajectory), to = read_centres(log);
    CentrePairs pairs;
    pairs.poses = from.size(), pairs.log_poses = to.size();
    const auto add = [&](const Centre& a, const Centre& b) {
        if (!a.registered || !b.registered) return;
        pairs.from.push_back(a.position), pairs.to.push_back(b.position);
    };
    if (from.size() == to.size()) {
        pairs.matched_by = "row";
        for (std::size_t i = 0; i < from.size(); ++i) add(from[i], to[i]);
    } else {
        pairs.matched_by = "image index";
        std::map<int, const Centre*> by_index;
        for (const Centre& b : to) by_index.emplace(b.index, &b);
        for (const Centre& a : from)
            if (const auto b = by_index.find(a.index); b != by_index.end()) add(a, *b->second);
    }
    if (pairs.from.size() < 6)
        throw input_error("E_TNT_TRAJ: ", trajectory, ": ", from.size(), " cameras, of which ",
                          pairs.from.size(), " match the ", to.size(), " of ", log, " by ",
                          pairs.matched_by,
                          "; expected at least 6: give the trajectory of the training");
    return pairs;
}

Affine3d read_transform(const std::string& path) {
    Words words(path, "E_TNT_TRANS");
    const Affine3d T = words.matrix();
    if (!words.at_end()) throw words.wrong("text after the 4x4 matrix");
    if (!(determinant(T.A) > 0))
        throw words.wrong("the matrix has determinant ", determinant(T.A),
                          ", expected a similarity: rotation times a positive scale");
    return T;
}

}  // namespace tvsgs
