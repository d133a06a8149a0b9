// Configurations. Options structs (core/options.h) are flattened into a table of dotted keys, which
// reads configuration files, TVSGS_* variables and --set, prints help and writes the resolved
// configuration.
#pragma once

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "core/options.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// One option: its dotted key, and how to read and write it as text. The options struct must
/// outlive it.
struct Option {
    enum class Kind { boolean, integer, real, text, choice };
    std::string key, help;
    Kind kind;
    Range range{0, 0};                 // integer, real
    std::vector<std::string> choices;  // choice
    std::function<std::string()> get;
    std::function<void(const std::string&)> set;  // already checked against kind, range and choices
    std::string source{};  // where the value was set; empty: it is the default
};

class OptionTable {
public:
    /// Adds every field of `options`, keys prefixed with `prefix` and a dot (or bare for an empty
    /// prefix).
    template <class Options>
    void add(const std::string& prefix, Options& options) {
        Collector collector{*this, prefix.empty() ? "" : prefix + "."};
        options.fields(collector);
    }

    /// Sets one key from text, as --set KEY=VALUE does; '-' and '_' are the same. `source` says
    /// where it came from in messages. Unknown keys throw Error(ExitCode::usage) naming the nearest
    /// one; so do values of a wrong type or out of range.
    void set(std::string_view key, std::string_view value, const std::string& source);

    /// Each of `settings` is KEY=VALUE, as given to --set.
    void set_all(const std::vector<std::string>& settings);

    /// Applies a JSON configuration file: nested objects or dotted keys. Duplicate keys are errors.
    /// The key "comment" is ignored at every level, and "info" at the top level, so that a run's
    /// resolved config.json can be fed back. "extends" names the configurations that lie below the
    /// file, later ones above earlier ones: a name of configs/, or NAME.json beside the file.
    void read_file(const std::string& path);

    /// The same for the text of such a file; `source` is what messages call it.
    void read_text(const std::string& source, const std::string& text);

    /// The same, but only for keys that nothing has set.
    void read_text_below(const std::string& source, const std::string& text);

    /// The option of that key. Throws as set() does.
    const Option& option(std::string_view key) const;

    /// Applies every TVSGS_<KEY> variable, dots written as double underscores (TVSGS_TV__K=64).
    void read_environment();

    /// The resolved configuration as nested JSON, `info` added unless it is null.
    std::string json(const JsonValue& info = {}) const;

    /// One line per option: key, range or choices, default, meaning; grouped by prefix.
    std::string help() const;

    const std::vector<Option>& options() const { return options_; }

private:
    void read(const std::string& source, const std::string& text, bool below);
    Option& find(const std::string& key, const std::string& source);
    void set(Option& option, std::string_view value, const std::string& source);

    struct Collector {
        OptionTable& table;
        std::string prefix;

        void operator()(const char* key, int& value, Range range, const char* help);
        void operator()(const char* key, std::int64_t& value, Range range, const char* help);
        void operator()(const char* key, float& value, Range range, const char* help);
        void operator()(const char* key, bool& value, const char* help);
        void operator()(const char* key, std::string& value, const char* help);
        template <class Enum>
        void choice(const char* key,
                    Enum& value,
                    std::initializer_list<const char*> names,
                    const char* help) {
            add_choice(
                key, {names.begin(), names.end()}, [&value] { return static_cast<int>(value); },
                [&value](int i) { value = static_cast<Enum>(i); }, help);
        }
        template <class Group>
        void group(const char* key, Group& group_options, const char* /*help*/) {
            Collector inner{table, prefix + key + "."};
            group_options.fields(inner);
        }

    private:
        void add_choice(const char* key,
                        std::vector<std::string> names,
                        std::function<int()> get,
                        std::function<void(int)> set,
                        const char* help);
    };
    std::vector<Option> options_;
};

/// The lists of a JSON object such as splits.json, as text; values that are no lists of names or
/// numbers are left out. Throws Error(ExitCode::input) when the file is not a JSON object.
std::map<std::string, std::vector<std::string>> read_json_lists(const std::string& path);

}  // namespace tvsgs
