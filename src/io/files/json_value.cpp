#include "io/files/json_value.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kNear = 12;  // characters of the text shown in an error

JsonValue from_library(const Json& json) {
    if (json.is_string()) return JsonValue(json.get<std::string>());
    if (json.is_number()) return JsonValue(json.get<double>());
    if (json.is_boolean()) return JsonValue(json.get<bool>());
    JsonValue value;
    if (json.is_array()) {
        value.kind = JsonValue::Kind::list;
        for (const Json& item : json) value.items.push_back(from_library(item));
    } else if (json.is_object()) {
        value.kind = JsonValue::Kind::object;
        for (const auto& [name, member] : json.items())
            value.members.emplace_back(name, from_library(member));
    }
    return value;
}

std::string quoted(const std::string& text) {
    return Json(text).dump(-1, ' ', false, Json::error_handler_t::replace);
}

std::string number_text(double number) {
    char text[40];
    const bool whole = std::trunc(number) == number && std::abs(number) < 9e18;
    const auto end = whole ? std::to_chars(text, text + sizeof text, static_cast<long long>(number))
                           : std::to_chars(text, text + sizeof text, number);
    return {text, end.ptr};
}

}  // namespace

std::string json_fault(std::string_view text, std::size_t bytes) {
    std::size_t at = std::min(bytes > 0 ? bytes - 1 : 0, text.size());
    const auto in_word = [&](std::size_t i) {
        return i < text.size() && std::isalnum(static_cast<unsigned char>(text[i]));
    };
    while (at > 0 && in_word(at) && in_word(at - 1)) --at;
    const std::string_view before = text.substr(0, at);
    const auto line = 1 + std::ranges::count(before, '\n');
    const std::size_t column = at - (before.rfind('\n') + 1) + 1;  // npos + 1 is 0
    const std::string_view rest = text.substr(at);
    const std::string near =
        shown(rest.substr(0, std::min(rest.find_first_of(" \t\r\n,:]}", 1), kNear)));
    return str(
        "line ", line, ", column ", column, ": not valid JSON",
        trimmed(rest).empty() ? ": the text ends here; is it cut off?" : str(" near `", near, "`"));
}

const JsonValue& JsonValue::operator[](std::string_view key) const {
    static const JsonValue null;
    for (const auto& [name, member] : members)
        if (name == key) return member;
    return null;
}

void JsonValue::set(std::string_view key, JsonValue value) {
    for (auto& [name, member] : members)
        if (name == key) {
            member = std::move(value);
            return;
        }
    add(key, std::move(value));
}

JsonValue parse_json_value(std::string_view text, const std::string& where) {
    const auto limit_depth = [&](int depth, Json::parse_event_t, Json&) {
        check_json_depth(depth, where);
        return true;
    };
    try {
        return from_library(Json::parse(text, limit_depth));
    } catch (const Json::parse_error& error) {
        throw Error(ExitCode::input, where, ": ", json_fault(text, error.byte));
    } catch (const Json::out_of_range&) {  // the library's only other error of a text
        throw Error(ExitCode::input, where, ": not valid JSON: a number is too large");
    }
}

std::vector<JsonValue> parse_json_lines(std::string_view text,
                                        const std::string& where,
                                        const std::function<void(const std::string&)>& damaged) {
    std::vector<JsonValue> lines;
    std::size_t number = 0;
    for (std::size_t at = 0, end; (end = text.find('\n', at)) != text.npos; at = end + 1) {
        try {
            lines.push_back(
                parse_json_value(text.substr(at, end - at), str(where, ": line ", ++number)));
        } catch (const Error& error) {
            damaged(error.what());
        }
    }
    return lines;
}

double rounded(double value, int digits) {
    char text[40];
    const auto end =
        std::to_chars(text, text + sizeof text, value, std::chars_format::general, digits);
    std::from_chars(text, end.ptr, value);
    return value;
}

std::string json_text(const JsonValue& value) {
    if (value.is(JsonValue::Kind::null)) return "null";
    if (value.is(JsonValue::Kind::boolean)) return value.number != 0 ? "true" : "false";
    if (value.is(JsonValue::Kind::number)) return number_text(value.number);
    if (value.is(JsonValue::Kind::text)) return quoted(value.text);
    std::string inside;
    const auto add = [&](const std::string& entry) {
        if (!inside.empty()) inside += ", ";
        inside += entry;
    };
    for (const JsonValue& item : value.items) add(json_text(item));
    for (const auto& [name, member] : value.members) add(quoted(name) + ": " + json_text(member));
    return value.is(JsonValue::Kind::list) ? "[" + inside + "]" : "{" + inside + "}";
}

}  // namespace tvsgs
