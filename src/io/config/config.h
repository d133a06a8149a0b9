// Configurations. An OptionTable flattens options structs (core/options.h) into a table of dotted
// keys. It reads configuration files, TVSGS_* variables and --set, prints help, and writes the
// resolved configuration.
#pragma once

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <map>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "core/options.h"
#include "io/files/json_value.h"

namespace tvsgs {

/// One option: its dotted key, and functions that read and write it as text. The options struct
/// must outlive the Option.
struct Option {
    enum class Kind { boolean, integer, real, text, choice };
    std::string key, help;
    Kind kind;
    Range range{0, 0};                 // integer, real
    std::vector<std::string> choices;  // choice
    std::function<std::string()> get;
    std::function<void(const std::string&)> set;  // already checked against kind, range and choices
    std::string source{};                         // origin of the value; empty: default

    bool is_string() const { return kind == Kind::text || kind == Kind::choice; }
};

/// All options of a program by their dotted keys.
class OptionTable {
public:
    /// Adds every field of `options` with keys "PREFIX.FIELD", or "FIELD" if `prefix` is empty.
    template <class Options>
    void add(const std::string& prefix, Options& options) {
        Collector collector{*this, prefix.empty() ? "" : prefix + "."};
        options.fields(collector);
    }

    /// Sets one key from text, like --set KEY=VALUE; '-' and '_' are equal. Messages name `source`
    /// as the origin of the value. Throws Error(ExitCode::usage) for an unknown key, with the
    /// nearest key, and for a value of a wrong type or out of range.
    void set(std::string_view key, std::string_view value, const std::string& source);

    /// Applies settings of the form KEY=VALUE, like --set.
    void set_all(const std::vector<std::string>& settings);

    /// Applies a JSON configuration file with nested objects or dotted keys. Duplicate keys are
    /// errors. Ignores the key "comment" at every level and "info" at the top level, so that a
    /// run's resolved config.json can be used again. "extends" lists base configurations: a name of
    /// configs/, or NAME.json beside the file. Later ones override earlier ones, and the file
    /// overrides all.
    void read_file(const std::string& path);

    /// The same for the text of such a file. Messages name it `source`. `below`: sets only keys
    /// that have not been set yet.
    void read_text(const std::string& source, const std::string& text, bool below = false);

    /// The option with this key. Throws like set().
    const Option& option(std::string_view key) const;

    /// Applies every TVSGS_<KEY> variable; a double underscore means a dot (TVSGS_TV__K=64).
    /// Warns of a key that only `others` has.
    void read_environment(const OptionTable* others = nullptr);

    /// The resolved configuration as nested JSON, with `info` unless it is null.
    std::string json(const JsonValue& info = {}) const;

    /// One line per option: key, range or choices, default, meaning; grouped by prefix.
    std::string help() const;

    const std::vector<Option>& options() const { return options_; }

private:
    void set(Option& option, std::string_view value, const std::string& source);

    struct Collector {
        OptionTable& table;
        std::string prefix;

        template <class Number>
        void operator()(const char* key, Number& value, Range range, const char* help) {
            add(key, &value, range, help);
        }
        template <class Field>
        void operator()(const char* key, Field& value, const char* help) {
            add(key, &value, {0, 0}, help);
        }
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
        using Value = std::variant<int*, std::int64_t*, float*, bool*, std::string*>;
        void add(const char* key, Value value, Range range, const char* help);
        void add_choice(const char* key,
                        std::vector<std::string> names,
                        std::function<int()> get,
                        std::function<void(int)> set,
                        const char* help);
    };
    std::vector<Option> options_;
};

/// Lists of a JSON object such as splits.json, as text. Skips values that are not lists of names or
/// numbers. Throws Error(ExitCode::input) if the file is not a JSON object.
std::map<std::string, std::vector<std::string>> read_json_lists(const std::string& path);

// The configurations of configs/ are in the program as text.

/// Names of the configurations that the program itself uses.
inline constexpr const char *kAutoConfig = "auto", *kSparseConfig = "pgsr_sparse",
                            *kDenseConfig = "pgsr_dense";

/// Sorted names of all built-in configurations.
std::vector<std::string> built_in_configs();

/// Text of configs/NAME.json. Throws Error(ExitCode::usage) that suggests the nearest name.
const char* built_in_config(std::string_view name);

}  // namespace tvsgs
