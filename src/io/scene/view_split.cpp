#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <ranges>
#include <sstream>

#include "core/log.h"
#include "io/config/config.h"
#include "io/files/read_file.h"
#include "io/scene/scene_reader.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// Finds a view by, in this order: its full name, its name without extension, its base name, its
/// index.
class NameFinder {
public:
    explicit NameFinder(const std::vector<std::string>& names)
        : count_(static_cast<int>(names.size())) {
        for (int i = 0; i < count_; ++i) {
            const fs::path path(names[i]);
            const std::string keys[] = {path.string(), fs::path(path).replace_extension().string(),
                                        path.filename().string(), path.stem().string()};
            for (int rule = 0; rule < 4; ++rule) {
                const auto [entry, is_new] = index_[rule].emplace(keys[rule], i);
                if (!is_new && entry->second != i) entry->second = kAmbiguous;
            }
        }
    }
    int find(const std::string& wanted, const std::string& source) const {
        bool ambiguous = false;
        for (const auto& index : index_) {
            const auto found = index.find(wanted);
            if (found == index.end()) continue;
            if (found->second != kAmbiguous) return found->second;
            ambiguous = true;
        }
        int number = -1;
        if (!ambiguous && parse_number(wanted, number) && number >= 0 && number < count_)
            return number;
        throw input_error(
            "E_SPLIT: ", source, ": '", wanted, "' ",
            ambiguous
                ? "fits several images; give the relative path"
                : str("fits none of the ", count_,
                      " images; expected a relative path, a name without extension or an index"));
    }

private:
    static constexpr int kAmbiguous = -1;
    int count_;
    std::map<std::string, int> index_[4];  // one map per rule
};

std::vector<std::string> read_list(const std::string& path) {
    std::vector<std::string> entries;
    std::istringstream lines(read_text(path));
    for (std::string line; std::getline(lines, line);)
        if (const auto entry = trimmed(line); !entry.empty() && entry[0] != '#')
            entries.emplace_back(entry);
    if (entries.empty())
        throw input_error("E_SPLIT: ", path,
                          ": the list is empty; expected one image name per line");
    return entries;
}

void sort_unique(std::vector<int>& indices) {
    std::ranges::sort(indices);
    indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
}

std::vector<int> parse_indices(std::string_view text) {
    std::vector<int> indices;
    for (std::string_view rest = text; !rest.empty();) {
        const std::size_t comma = std::min(rest.find(','), rest.size());
        int index = -1;
        if (!parse_number(trimmed(rest.substr(0, comma)), index))
            throw Error(ExitCode::usage, "--views ", text,
                        ": expected indices with commas between them, such as 23,24,33");
        indices.push_back(index);
        rest.remove_prefix(std::min(comma + 1, rest.size()));
    }
    return indices;
}

struct NamedLists {
    std::vector<std::string> train, test;
    std::string train_source, test_source;
};

NamedLists lists_of_split(const SceneOptions& options) {
    // splits.json is the format of tvsgs; split.json is PGSR's, with the lists "train" and "test".
    std::string path = (fs::path(options.path) / "splits.json").string();
    if (!fs::exists(path)) path = (fs::path(options.path) / "split.json").string();
    if (!fs::exists(path))
        throw input_error("E_SPLIT: ", options.path, ": --split ", options.split,
                          " needs splits.json (or split.json) in the scene; add it, or use "
                          "--train-list, --views or --eval");
    const auto lists = read_json_lists(path);
    const auto train = lists.find(options.split);
    if (train == lists.end())
        throw input_error("E_SPLIT: ", path, ": no list '", options.split, "'; it has ",
                          lists.empty() ? "no list of names" : joined(std::views::keys(lists)));
    if (train->second.empty())
        throw input_error("E_SPLIT: ", path, ": list '", options.split,
                          "' is empty; expected names of images");
    // large_overlap_train_3 uses the test list large_overlap_test, if there is one.
    std::string test_name = options.split.substr(0, options.split.find("train")) + "test";
    if (options.split.find("train") == std::string::npos || !lists.contains(test_name))
        test_name = "test";
    const auto test = lists.find(test_name);
    if (test == train)
        throw Error(ExitCode::usage, "--split test: 'test' is the list of test views in ", path,
                    "; choose a training list");
    return {train->second, test == lists.end() ? std::vector<std::string>{} : test->second,
            str(path, ": list '", options.split, "'"), str(path, ": list '", test_name, "'")};
}

}  // namespace

ViewSplit split_views(const SceneOptions& options,
                      const std::vector<std::string>& names,
                      const std::vector<bool>& exists,
                      const std::vector<std::string>& own_train,
                      const std::vector<std::string>& own_test) {
    const int count = static_cast<int>(names.size());
    const bool has_lists = !options.train_list.empty() || !options.test_list.empty();
    if (has_lists + !options.split.empty() + options.eval > 1)
        throw Error(ExitCode::usage,
                    "--split, --train-list/--test-list and --eval exclude each other; give one");
    if (!options.views.empty() && options.num_views > 0)
        throw Error(ExitCode::usage, "--views and --num-views exclude each other; give one");

    // 1. The rule that gives both lists.
    ViewSplit split;
    bool train_was_listed = false;
    if (has_lists || !options.split.empty() || !own_train.empty()) {
        const bool own = !has_lists && options.split.empty();
        constexpr const char* kOwn = "the scene's own split";
        NamedLists lists;
        if (own) lists = {own_train, own_test, kOwn, kOwn};
        if (!options.split.empty()) lists = lists_of_split(options);
        if (!options.train_list.empty())
            lists.train = read_list(lists.train_source = options.train_list);
        if (!options.test_list.empty())
            lists.test = read_list(lists.test_source = options.test_list);
        const NameFinder finder(names);
        for (const auto& name : lists.train)
            split.train.push_back(finder.find(name, lists.train_source));
        for (const auto& name : lists.test)
            split.test.push_back(finder.find(name, lists.test_source));
        sort_unique(split.train), sort_unique(split.test);
        train_was_listed = !own && !lists.train.empty();
        if (lists.train.empty())
            for (int i = 0; i < count; ++i)
                if (!std::ranges::binary_search(split.test, i)) split.train.push_back(i);
    } else {
        if (options.eval && options.test_every < 2)
            throw Error(ExitCode::usage, "--test-every ", options.test_every,
                        ": expected 2 or more");
        for (int i = 0; i < count; ++i)
            (options.eval && i % options.test_every == 0 ? split.test : split.train).push_back(i);
    }
    const auto overlap = std::erase_if(
        split.test, [&](int i) { return std::ranges::binary_search(split.train, i); });
    if (overlap > 0)
        spdlog::warn("{} views are in both lists; they are used for training only", overlap);

    // 2. The chosen training views.
    if (!options.views.empty()) {
        const std::vector<int> chosen = parse_indices(options.views);
        for (const int i : chosen) {
            if (i < 0 || i >= count)
                throw Error(ExitCode::usage, "--views ", i, ": expected 0 to ", count - 1);
            if (!std::ranges::binary_search(split.train, i))
                throw Error(ExitCode::usage, "--views ", i, ": '", names[i],
                            "' is not a training view of the split");
        }
        split.train = chosen;
        sort_unique(split.train);
        train_was_listed = true;
    }

    // 3. Missing images.
    const auto missing = [&](int i) { return !exists[i]; };
    if (train_was_listed)
        for (const int i : split.train)
            if (missing(i))
                throw input_error(
                    "E_MISSING_IMAGE: training view '", names[i], "' is not in ",
                    (fs::path(options.path) / options.images).string(),
                    "; copy it there, give its folder with --images, or remove it from the list");
    std::erase_if(split.train, missing);
    std::erase_if(split.test, missing);

    if (options.num_views > 0) {
        const int available = static_cast<int>(split.train.size()), wanted = options.num_views;
        if (wanted > available)
            spdlog::warn("--num-views {}: the scene has {} training views; all are used", wanted,
                         available);
        if (wanted < available) {
            std::vector<int> chosen;  // evenly spaced from first to last
            for (int i = 0; i < wanted; ++i) {
                const double at =
                    wanted == 1 ? 0 : static_cast<double>(i) * (available - 1) / (wanted - 1);
                chosen.push_back(split.train[static_cast<std::size_t>(std::lround(at))]);
            }
            split.train = chosen;
        }
    }
    if (static_cast<int>(split.train.size()) < options.min_train_views)
        throw input_error("E_TOO_FEW_VIEWS: ", options.path, ": ", split.train.size(),
                          " training views; expected at least ", options.min_train_views,
                          ". Check --split, --views and the folder of images");
    return split;
}

}  // namespace tvsgs
