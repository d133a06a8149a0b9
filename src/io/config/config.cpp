#include "io/config/config.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/nearest_name.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// Shortest text that reads back as the same number.
template <class Number>
std::string number_text(Number value) {
    char text[64];
    const auto result = std::to_chars(text, text + sizeof text, value);
    return {text, result.ptr};
}

/// JSON on one line. Replaces bytes that are not UTF-8.
std::string dumped(const Json& json) {
    return json.dump(-1, ' ', false, Json::error_handler_t::replace);
}

bool is_utf8(const std::string& text) {
    return Json::parse(json_text(text)).get<std::string>() == text;  // true if nothing was replaced
}

std::string normalized(std::string_view key) {
    std::string out(trimmed(key));
    std::ranges::replace(out, '-', '_');
    return out;
}

/// Parses JSON without duplicate keys; the library itself would accept them silently.
Json parse_json(const std::string& path, const std::string& text, ExitCode code) {
    std::vector<std::set<std::string>> keys;  // one set per open object
    const auto watch = [&](int depth, Json::parse_event_t event, Json& value) {
        check_json_depth(depth, path);
        if (event == Json::parse_event_t::object_start) keys.emplace_back();
        if (event == Json::parse_event_t::object_end) keys.pop_back();
        if (event == Json::parse_event_t::key &&
            !keys.back().insert(value.get<std::string>()).second)
            throw Error(code, str(path, ": key '", value.get<std::string>(),
                                  "' is given twice in one object; remove one"));
        return true;
    };
    try {
        Json json = Json::parse(text, watch);
        if (!json.is_object())
            throw Error(code, str(path, ": expected a JSON object, {\"key\": value, ...}"));
        return json;
    } catch (const Json::parse_error& error) {
        throw Error(code, str(path, ": ", json_fault(text, error.byte)));
    } catch (const Json::out_of_range&) {  // the library's only other error of a text
        throw Error(code, str(path, ": not valid JSON: a number is too large"));
    }
}

/// Clamps to the limits of float, so that a range such as 1e300 can be compared in float.
float to_float(double value) {
    constexpr double kMax = std::numeric_limits<float>::max();
    return static_cast<float>(std::clamp(value, -kMax, kMax));
}

/// Description of the allowed values, for help and messages.
std::string expectation(const Option& option) {
    using enum Option::Kind;
    const auto [min, max] = option.range;
    if (option.kind == boolean) return "true or false";
    if (option.kind == integer)
        return str("a whole number, ", grouped(static_cast<std::int64_t>(min)), " to ",
                   grouped(static_cast<std::int64_t>(max)));
    if (option.kind == real) return str("a number, ", number_text(min), " to ", number_text(max));
    return option.kind == text ? "text" : str("one of ", joined(option.choices));
}

/// Sets `text` to the text for option.set. Returns false if `value` is not allowed.
bool accepted(const Option& option, std::string_view value, std::string& text) {
    text = trimmed(value);
    switch (option.kind) {
        case Option::Kind::boolean:
            text = lower_case(text);
            for (const char* yes : {"true", "1", "on", "yes"})
                if (text == yes) return text = "true", true;
            for (const char* no : {"false", "0", "off", "no"})
                if (text == no) return text = "false", true;
            return false;
        case Option::Kind::integer: {
            std::int64_t number = 0;
            double real = 0;  // 1e3
            if (!parse_number(text, number)) {
                if (!parse_number(text, real) || !(std::abs(real) <= 9e15) ||
                    real != std::floor(real))
                    return false;
                number = static_cast<std::int64_t>(real);
                text = number_text(number);
            }
            return static_cast<double>(number) >= option.range.min &&
                   static_cast<double>(number) <= option.range.max;
        }
        case Option::Kind::real: {
            // Compares in float, because ranges and values are both written as float literals.
            float number = 0;
            return parse_number(text, number) && std::isfinite(number) &&
                   number >= to_float(option.range.min) && number <= to_float(option.range.max);
        }
        case Option::Kind::text:
            text = value;
            return true;
        case Option::Kind::choice: {
            const auto found = std::ranges::find(option.choices, normalized(text), normalized);
            if (found != option.choices.end()) text = *found;
            return found != option.choices.end();
        }
    }
    return false;
}

/// Some choices are named true and false.
bool json_fits(const Json& value, Option::Kind kind) {
    using enum Option::Kind;
    if (kind == integer || kind == real) return value.is_number();
    return (value.is_boolean() && (kind == boolean || kind == choice)) ||
           (value.is_string() && kind != boolean);
}

template <class Options>
auto find_option(Options& options, const std::string& key) {
    const auto found = std::ranges::find(options, key, &Option::key);
    return found == options.end() ? nullptr : &*found;
}

std::string unknown_key_text(const std::vector<Option>& options,
                             const std::string& key,
                             const std::string& source) {
    std::vector<std::string> keys;
    for (const Option& option : options) keys.push_back(option.key);
    const std::string near = nearest_name(key, keys);
    return str(source, ": unknown key '", key, "'; ",
               near.empty() ? "tvsgs-train --list-keys lists all keys"
                            : str("did you mean '", near, "'?"));
}
template <class Options>
auto& require_option(Options& options, const std::string& key, const std::string& source) {
    if (auto* const found = find_option(options, key)) return *found;
    throw Error(ExitCode::usage, unknown_key_text(options, key, source));
}

/// A key of a configuration and the file that sets it.
struct Leaf {
    std::string key;
    Json value;
    std::string file;
};

/// Appends every leaf below `json` with its dotted key.
void flatten(const Json& json,
             const std::string& prefix,
             const std::string& file,
             std::vector<Leaf>& out) {
    for (const auto& [name, value] : json.items()) {
        if (name == "comment" || (prefix.empty() && (name == "info" || name == "extends")))
            continue;
        const std::string key = prefix + normalized(name);
        if (value.is_object() && !value.empty())
            flatten(value, key + ".", file, out);
        else
            out.push_back({key, value, file});
    }
}

/// The entries of "extends", in order.
std::vector<std::string> bases_of(const Json& json, const std::string& file) {
    const Json bases = json.value("extends", Json::array());
    if (bases.is_string()) return {bases.get<std::string>()};
    const auto is_text = [](const Json& base) { return base.is_string(); };
    if (bases.is_array() && std::ranges::all_of(bases, is_text))
        return bases.get<std::vector<std::string>>();
    throw Error(ExitCode::usage, file, ": extends = ", dumped(bases),
                ": expected a configuration's name, a file, or a list of them");
}

std::string config_text(const std::string& path) {
    try {
        return read_bytes(path, kMaxTextBytes);
    } catch (const Error& error) {
        throw Error(error.code() == ExitCode::input ? ExitCode::usage : error.code(), error.what());
    }
}

/// Appends the keys of the extended configurations, then those of `file`. `extending`: the chain of
/// files that led here, to detect cycles.
void collect(const std::string& file,
             const std::string& text,
             std::vector<std::string> extending,
             std::vector<Leaf>& out) {
    const Json json = parse_json(file, text, ExitCode::usage);
    extending.push_back(file);
    for (const std::string& base : bases_of(json, file)) {
        const bool is_file = base.ends_with(".json");
        const std::string from =
            is_file ? (fs::path(file).parent_path() / base).lexically_normal().string()
                    : str("configs/", base, ".json");
        if (std::ranges::find(extending, from) != extending.end())
            throw Error(ExitCode::usage, file, ": extends '", base,
                        "', which extends this file; remove one of the two");
        with_context(str("reading the base of ", file), [&] {
            collect(from, is_file ? config_text(from) : built_in_config(base), extending, out);
        });
    }
    const std::size_t first = out.size();
    flatten(json, "", file, out);
    std::set<std::string> seen;
    for (std::size_t i = first; i < out.size(); ++i)
        if (!seen.insert(out[i].key).second)
            throw Error(ExitCode::usage, file, ": key '", out[i].key,
                        "' is given twice; remove one");
}

}  // namespace

void OptionTable::set(Option& option, std::string_view value, const std::string& source) {
    std::string text;
    if (!accepted(option, value, text))
        throw Error(ExitCode::usage, source, ": ", option.key, " = '", value, "': expected ",
                    expectation(option));
    option.set(text);
    option.source = source;
}

void OptionTable::set(std::string_view key, std::string_view value, const std::string& source) {
    set(require_option(options_, normalized(key), source), value, source);
}

const Option& OptionTable::option(std::string_view key) const {
    return require_option(options_, normalized(key), "the program");
}

void OptionTable::set_all(const std::vector<std::string>& settings) {
    for (const std::string& setting : settings) {
        const std::size_t equals = setting.find('=');
        if (equals == std::string::npos)
            throw Error(ExitCode::usage, "--set ", setting, ": expected KEY=VALUE");
        set(setting.substr(0, equals), setting.substr(equals + 1), "--set");
    }
}

void OptionTable::read_file(const std::string& path) {
    read_text(path, config_text(path));
}

void OptionTable::read_text(const std::string& source, const std::string& text, bool below) {
    std::vector<Leaf> leaves;
    collect(source, text, {}, leaves);
    if (below) std::ranges::reverse(leaves);  // only the first occurrence sets a key
    for (const auto& [key, value, file] : leaves) {
        const auto in_group = [group = key + "."](const Option& option) {
            return option.key.starts_with(group);
        };
        if (std::ranges::any_of(options_, in_group)) {
            if (value.is_object()) continue;  // an empty group
            throw Error(ExitCode::usage, file, ": ", key,
                        " is a group of keys; expected an object, {...}");
        }
        Option& option = require_option(options_, key, file);
        if (!json_fits(value, option.kind))
            throw Error(ExitCode::usage, file, ": ", key, " = ", dumped(value), ": expected ",
                        expectation(option));
        if (below && !option.source.empty()) continue;
        set(option, value.is_string() ? value.get<std::string>() : value.dump(), file);
        option.source = source;
    }
}

void OptionTable::read_environment(const OptionTable* others) {
    std::map<std::string, std::string> variables;  // sorted, so that messages have a fixed order
    for (char** entry = environ; entry && *entry; ++entry) {
        const std::string_view text = *entry;
        const std::size_t equals = text.find('=');
        if (text.starts_with("TVSGS_") && equals != std::string_view::npos)
            variables.emplace(text.substr(0, equals), text.substr(equals + 1));
    }
    for (const auto& [name, value] : variables) {
        std::string key = name.substr(6);
        for (std::size_t at; (at = key.find("__")) != std::string::npos;)
            key[at] = '.', key.erase(at + 1, 1);
        key = lower_case(key);
        const std::string source = str("environment variable ", name);
        if (find_option(options_, key))
            set(key, value, source);
        else if (others && find_option(others->options_, key))
            spdlog::warn("{}: this command has no key {}; ignored", name, key);
        else  // perhaps of another program
            spdlog::warn("Ignored {}", unknown_key_text(options_, key, source));
    }
}

std::string OptionTable::json(const JsonValue& info) const {
    Json out = Json::object();
    for (const Option& option : options_) {
        Json* place = &out;
        std::size_t begin = 0;
        for (std::size_t dot; (dot = option.key.find('.', begin)) != std::string::npos;
             begin = dot + 1)
            place = &(*place)[option.key.substr(begin, dot - begin)];
        Json& value = (*place)[option.key.substr(begin)];
        const bool is_string = option.is_string();
        value = is_string ? Json(option.get()) : Json::parse(option.get());
        if (is_string && !is_utf8(option.get()))
            spdlog::warn(
                "{} '{}' is not UTF-8, so config.json cannot hold it; rename it, or give the flag "
                "again to every command that reads the run",
                option.key, option.get());
    }
    if (info) out["info"] = Json::parse(json_text(info));
    return out.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

std::string OptionTable::help() const {
    std::string out, last_group = "-";
    std::size_t width = 0;
    for (const Option& option : options_) width = std::max(width, option.key.size());
    for (const Option& option : options_) {
        const std::size_t dot = option.key.rfind('.');
        const std::string group = dot == std::string::npos ? "" : option.key.substr(0, dot);
        if (group != last_group)
            out += str(out.empty() ? "" : "\n", group.empty() ? "" : group + ":\n");
        last_group = group;
        out += str("  ", option.key, std::string(width - option.key.size() + 2, ' '), option.help,
                   " (", expectation(option), "; default ",
                   option.is_string() ? json_text(option.get()) : option.get(), ")\n");
    }
    return out;
}

void OptionTable::Collector::add(const char* key, Value value, Range range, const char* help) {
    Option option{prefix + key, help, Option::Kind::text, range, {}, {}, {}};
    const auto describe = [&](auto* at) {
        using T = std::remove_pointer_t<decltype(at)>;
        if constexpr (std::is_same_v<T, std::string>) {
            option.get = [at] { return *at; };
            option.set = [at](const std::string& text) { *at = text; };
        } else if constexpr (std::is_same_v<T, bool>) {
            option.kind = Option::Kind::boolean;
            option.get = [at] { return *at ? "true" : "false"; };
            option.set = [at](const std::string& text) { *at = text == "true"; };
        } else {
            option.kind = std::is_integral_v<T> ? Option::Kind::integer : Option::Kind::real;
            if constexpr (std::is_integral_v<T>)
                option.range = {std::max(range.min, double(std::numeric_limits<T>::min())),
                                std::min(range.max, double(std::numeric_limits<T>::max()))};
            option.get = [at] { return number_text(*at); };
            option.set = [at](const std::string& text) { parse_number(text, *at); };
        }
    };
    std::visit(describe, value);
    table.options_.push_back(std::move(option));
}
void OptionTable::Collector::add_choice(const char* key,
                                        std::vector<std::string> names,
                                        std::function<int()> get,
                                        std::function<void(int)> set,
                                        const char* help) {
    auto name_of = [names, get] { return names.at(static_cast<std::size_t>(get())); };
    auto set_name = [names, set](const std::string& text) {
        set(static_cast<int>(std::ranges::find(names, text) - names.begin()));
    };
    table.options_.push_back(
        {str(prefix, key), help, Option::Kind::choice, {0, 0}, names, name_of, set_name});
}

std::map<std::string, std::vector<std::string>> read_json_lists(const std::string& path) {
    std::map<std::string, std::vector<std::string>> lists;
    const Json json = parse_json(path, read_bytes(path), ExitCode::input);
    for (const auto& [name, value] : json.items()) {
        if (!value.is_array()) continue;
        std::vector<std::string> list;
        for (const Json& entry : value)
            if (entry.is_string() || entry.is_number_integer())
                list.push_back(entry.is_string() ? entry.get<std::string>() : entry.dump());
        if (list.size() == value.size()) lists.emplace(name, std::move(list));
    }
    return lists;
}

}  // namespace tvsgs
