// Groups runs into rows of a table: the runs of a row differ only in their seed.
#include <filesystem>
#include <map>
#include <set>
#include <tuple>

#include "io/files/read_file.h"
#include "report/plot.h"
#include "report/table.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxKeys = 3;  // in the name of a configuration

/// Flattens the configuration into keys and values as text.
void flatten(const std::string& prefix,
             const JsonValue& value,
             std::map<std::string, std::string>& leaves) {
    for (const auto& [name, member] : value.members)
        flatten(prefix.empty() ? name : prefix + "." + name, member, leaves);
    if (value.members.empty())
        leaves[prefix] = value.is(JsonValue::Kind::text) ? value.text : json_text(value);
}

using Leaves = std::map<std::string, std::string>;

/// Text of a path that does not depend on its spelling or on the place of the scene.
std::string path_text(const std::string& key, const std::string& path, const fs::path& scene) {
    const auto whole = [](const fs::path& p) {
        std::error_code code;
        const fs::path found = fs::weakly_canonical(fs::absolute(p, code), code);
        const fs::path plain = code ? p.lexically_normal() : found;
        return plain.has_filename() ? plain : plain.parent_path();
    };
    if (path.empty() || scene.empty()) return path;
    std::error_code code;
    const bool in_scene = key == "scene.images" || ((key == "scene.masks" || key == "priors.dir") &&
                                                    fs::is_directory(scene / path, code));
    const fs::path file = whole(in_scene ? scene / path : fs::path(path)),
                   inside = file.lexically_relative(whole(scene));
    return inside.empty() || *inside.begin() == ".." ? file.string() : inside.string();
}

/// Settings of training and scoring, as comparable text.
Leaves leaves_of(const JsonValue& config) {
    Leaves leaves;
    flatten("", config, leaves);
    const std::string scene = config["scene"]["path"].text;
    for (const char* key : {"scene.images", "scene.masks", "scene.train_list", "scene.test_list",
                            "scene.init_ply", "scene.cameras_file", "priors.dir", "eval.gt",
                            "eval.visible_gt", "eval.crop", "tv.fixed_voters", "init.fixed_splats",
                            "loss.photometric.exposure_from", "loss.photometric.sky_from"})
        if (const auto leaf = leaves.find(key); leaf != leaves.end())
            leaf->second = path_text(key, leaf->second, scene);
    // Remove unused keys.
    if (config["scene"]["eval"].number == 0) leaves.erase("scene.test_every");
    if (config["eval"]["gt"].text.empty())
        std::erase_if(leaves, [](const auto& leaf) { return leaf.first.starts_with("eval."); });
    return leaves;
}

/// Whether the key can name a configuration: not the seed or a key of scene or evaluation.
bool names_a_configuration(const std::string& key) {
    return key != "seed" && !key.starts_with("scene.") && !key.starts_with("eval.");
}

/// False for keys in which the runs of a row may differ: the seed, keys of the scene's column,
/// output and reporting, and keys documented not to change results.
bool changes_results(const std::string& key) {
    static const std::set<std::string> kSame{"seed",
                                             "scene.path",
                                             "scene.split",
                                             "scene.views",
                                             "scene.num_views",
                                             "scene.photos",
                                             "scene.photo_folder",
                                             "eval.at",
                                             "eval.every",
                                             "eval.mesh",
                                             "eval.taus",
                                             "photo_bytes",
                                             "tv.lists",
                                             "comm.timeout",
                                             "comm.rendezvous",
                                             "mesh.memory",
                                             "mesh.texture",
                                             "mesh.texture_format"};
    return !kSame.contains(key);
}

/// Orders keys by interest, for names that cannot hold all of them.
bool before(const std::string& a, const std::string& b) {
    const auto rank = [](const std::string& key) {
        return key == "iterations"         ? 0
               : key.starts_with("scene.") ? 1
               : key.starts_with("eval.")  ? 2
                                           : 3;
    };
    return rank(a) != rank(b) ? rank(a) < rank(b) : a < b;
}
using Keys = std::set<std::string, decltype(&before)>;

/// Keys that the plan set; another seed, machine or scene may get other values.
std::set<std::string> planned_keys(const JsonValue& report) {
    std::set<std::string> keys;
    for (const JsonValue& decision : report["plan"].items)
        for (const auto& [key, value] : decision["settings"].members)
            if (!key.starts_with("scene.")) keys.insert(key);
    return keys;
}

/// Keys of several runs, and their values.
class KeyValues {
public:
    void add(const Leaves& leaves, const std::set<std::string>& planned) {
        for (const auto& [key, value] : leaves) {
            values_[key].insert(value);
            if (!planned.contains(key)) user_keys_.insert(key);
        }
    }
    /// Adds keys with several values. Skips keys that the plan set in all runs, and keys rejected
    /// by `counts`.
    template <class Counts>
    void add_differing(Keys& keys, const Counts& counts) const {
        for (const auto& [key, found] : values_)
            if (found.size() > 1 && user_keys_.contains(key) && counts(key)) keys.insert(key);
    }

private:
    std::map<std::string, std::set<std::string>> values_;
    std::set<std::string> user_keys_;
};

}  // namespace

void name_configurations(std::vector<TableRun>& runs) {
    // 1. Find the keys in which the runs of a name differ; runs without a name are one group.
    std::vector<Leaves> leaves;
    KeyValues unnamed;
    std::map<std::string, std::map<std::string, KeyValues>> named;  // by name and scene
    for (const TableRun& run : runs) {
        const std::set<std::string> planned = planned_keys(run.report);
        leaves.push_back(leaves_of(run.report["config"]));
        named[run.configuration][run.scene].add(leaves.back(), planned);
        if (run.configuration.empty()) unnamed.add(leaves.back(), planned);
    }
    std::map<std::string, Keys> keys;
    for (const auto& [name, scenes] : named) {
        Keys& differing = keys.emplace(name, Keys(before)).first->second;
        for (const auto& [scene, values] : scenes) values.add_differing(differing, changes_results);
        if (name.empty()) unnamed.add_differing(differing, names_a_configuration);
    }

    // 2. Compose names from keys and values.
    std::map<std::string, int> numbers;  // of names too long to show
    for (std::size_t i = 0; i < runs.size(); ++i) {
        std::string name = runs[i].configuration, whole;
        std::size_t count = 0;
        for (const std::string& key : keys.at(runs[i].configuration)) {
            const auto leaf = leaves[i].find(key);
            const std::string part = key + "=" + (leaf == leaves[i].end() ? "" : leaf->second);
            if (count++ < kMaxKeys) name += (name.empty() ? "" : ", ") + part;
            whole += part + "\n";
        }
        if (count > kMaxKeys) {
            const int number = numbers.emplace(whole, numbers.size() + 1).first->second;
            name += str(", and ", count - kMaxKeys, " more keys, #", number);
        }
        const JsonValue& config = runs[i].report["config"];
        runs[i].configuration = !name.empty()
                                    ? name
                                    : str(config["backbone"].text_or("run"), ", voting ",
                                          config["tv"]["enabled"].number != 0 ? "on" : "off");
    }
}

std::vector<std::string> equal_seeds(const std::vector<TableRun>& runs) {
    std::map<std::tuple<std::string, std::string, double>, std::vector<std::string>> folders;
    for (const TableRun& run : runs)
        folders[{run.configuration, run.scene, run.seed}].push_back(run.folder);
    std::vector<std::string> sentences;
    for (const auto& [row, of_seed] : folders) {
        if (of_seed.size() < 2) continue;
        sentences.push_back(
            str(joined(of_seed), ": all have seed ", short_number(std::get<2>(row), 15),
                ", in row '", std::get<0>(row), "' of ", std::get<1>(row),
                "; give runs of different seeds (tvsgs-train --seed N), or a LABEL for each"));
    }
    return sentences;
}

}  // namespace tvsgs
