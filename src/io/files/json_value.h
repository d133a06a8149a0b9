// JSON tree, to read and write the program's own files. For configurations see io/config/config.h.
#pragma once

#include <cmath>
#include <functional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

namespace tvsgs {

struct JsonValue {
    enum class Kind { null, boolean, number, text, list, object };
    Kind kind = Kind::null;
    double number = 0;  // booleans: 0 or 1; integers above 2^53 lose digits
    std::string text;
    std::vector<JsonValue> items;
    std::vector<std::pair<std::string, JsonValue>> members;  // in the order of the file

    JsonValue() = default;
    /// A number that is not finite becomes null.
    template <class Number>
    requires std::is_arithmetic_v<Number> JsonValue(Number value) {
        if (!std::isfinite(static_cast<double>(value))) return;
        kind = std::is_same_v<Number, bool> ? Kind::boolean : Kind::number;
        number = static_cast<double>(value);
    }
    JsonValue(std::string value) : kind(Kind::text), text(std::move(value)) {}
    JsonValue(std::string_view value) : JsonValue(std::string(value)) {}
    JsonValue(const char* value) : JsonValue(std::string(value)) {}
    template <class Value>
    JsonValue(const std::vector<Value>& values)
        : kind(Kind::list), items(values.begin(), values.end()) {}
    static JsonValue list() { return of(Kind::list); }
    static JsonValue object() { return of(Kind::object); }

    bool is(Kind k) const { return kind == k; }
    explicit operator bool() const { return kind != Kind::null; }

    /// The member, or null if there is none, so chains of keys need no checks.
    const JsonValue& operator[](std::string_view key) const;
    void set(std::string_view key, JsonValue value);  // replaces
    /// Appends a new member.
    JsonValue& add(std::string_view key, JsonValue value) {
        kind = Kind::object;
        members.emplace_back(key, std::move(value));
        return *this;
    }

    double number_or(double fallback) const { return is(Kind::number) ? number : fallback; }
    std::string text_or(const std::string& fallback) const {
        return is(Kind::text) ? text : fallback;
    }

private:
    static JsonValue of(Kind k) {
        JsonValue value;
        value.kind = k;
        return value;
    }
};

/// The place and the word at which a parser of `text` stopped after reading `bytes` bytes:
/// "line 1, column 18: not valid JSON near `N`".
std::string json_fault(std::string_view text, std::size_t bytes);

/// Throws Error(ExitCode::input) that names `where`.
JsonValue parse_json_value(std::string_view text, const std::string& where);

/// Parses one value per line. Ignores a last line without a line end, as a killed run leaves it.
/// Skips a line that is not valid and passes the reason to `damaged`.
std::vector<JsonValue> parse_json_lines(std::string_view text,
                                        const std::string& where,
                                        const std::function<void(const std::string&)>& damaged);

/// Rounds to `digits` significant digits, for shorter files.
double rounded(double value, int digits);

/// JSON on one line. Replaces bytes that are not UTF-8.
std::string json_text(const JsonValue& value);

}  // namespace tvsgs
