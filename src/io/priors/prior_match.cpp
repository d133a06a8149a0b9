// Assigns prior files to views.
#include <filesystem>
#include <set>

#include "io/files/read_file.h"
#include "io/priors/prior_sources.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// Map that forgets keys with several different values.
class UniqueMap {
public:
    void add(const std::string& key, const std::string& value) {
        if (const auto [at, is_new] = values_.emplace(key, value); !is_new && at->second != value)
            ambiguous_.insert(key);
    }
    const std::string* find(const std::string& key) const {
        const auto at = values_.find(key);
        return at == values_.end() || ambiguous_.contains(key) ? nullptr : &at->second;
    }

private:
    std::map<std::string, std::string> values_;
    std::set<std::string> ambiguous_;
};

std::string number_of(const std::string& stem) {
    int number = 0;
    return parse_number(stem, number) ? str(number) : "";
}

std::string stem_of(const std::string& view, bool whole_names) {
    std::string stem = whole_names ? view : fs::path(view).replace_extension().generic_string();
    if (stem.ends_with("_rgb")) stem.resize(stem.size() - 4);
    return stem;
}

std::string last_part(const std::string& stem) {
    return fs::path(stem).filename().string();
}

}  // namespace

PriorFiles match_priors(const std::string& folder,
                        const std::vector<std::string>& endings,
                        const std::vector<std::string>& views,
                        bool whole_names) {
    std::error_code failure;
    std::vector<std::string> files;  // relative to the folder
    constexpr std::size_t kMostFiles = 1000000;
    for (fs::recursive_directory_iterator entry(folder, failure), end;
         !failure && entry != end && files.size() < kMostFiles; entry.increment(failure)) {
        if (entry.depth() > 8) entry.disable_recursion_pending();
        if (entry->is_regular_file(failure))
            files.push_back(entry->path().lexically_relative(folder).generic_string());
    }
    UniqueMap last_parts, numbers;  // of views: one file must not serve two views
    for (const std::string& view : views) {
        const std::string stem = stem_of(view, whole_names);
        last_parts.add(last_part(stem), view);
        if (const std::string n = number_of(last_part(stem)); !n.empty()) numbers.add(n, view);
    }
    PriorFiles found;
    for (const std::string& ending : endings) {
        UniqueMap by_stem, by_last, by_number;
        for (const std::string& file : files) {
            if (!file.ends_with(ending) || file.size() == ending.size()) continue;
            const std::string stem = file.substr(0, file.size() - ending.size()),
                              last = last_part(stem);
            by_stem.add(stem, file), by_last.add(last, file);
            if (const std::string n = number_of(last); !n.empty()) by_number.add(n, file);
        }
        for (const std::string& view : views) {
            const std::string stem = stem_of(view, whole_names), last = last_part(stem);
            const std::string number = number_of(last);
            const std::string* file = by_stem.find(stem);
            if (!file && last_parts.find(last)) file = by_last.find(last);
            if (!file && !number.empty() && numbers.find(number)) file = by_number.find(number);
            if (file) found.files[view].path = (fs::path(folder) / *file).string();
        }
        if (found.files.empty()) continue;
        found.what = str(fs::path(folder).filename().string(), "/*", ending);
        break;
    }
    return found;
}

}  // namespace tvsgs
