// Options of votes from text.
#pragma once

#include <algorithm>
#include <charconv>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "core/error.h"
#include "core/nearest_name.h"
#include "tv/voting.h"

namespace tvsgs {

/// Visitor of TvOptions::fields() that sets the field `key`.
class OptionSetter {
public:
    OptionSetter(std::string_view key, std::string_view value) : key_(key), value_(value) {}

    template <class Number>
    void operator()(const char* name, Number& field, Range range, const char* /*help*/) {
        if (!is_key(name)) return;
        Number number{};
        const auto [end, error] =
            std::from_chars(value_.data(), value_.data() + value_.size(), number);
        // The range is compared in float, because both are written as float literals.
        if (error != std::errc{} || end != value_.data() + value_.size() ||
            !(float(number) >= float(range.min) && float(number) <= float(range.max)))
            refuse(str("a number, ", range.min, " to ", range.max));
        field = number;
    }
    void operator()(const char* name, bool& field, const char* help) {
        choice(name, field, {"false", "true"}, help);
    }
    void operator()(const char* /*name*/, std::string& /*file*/, const char* /*help*/) {}
    template <class Choice>
    void choice(const char* name,
                Choice& field,
                std::initializer_list<const char*> names,
                const char* /*help*/) {
        if (!is_key(name)) return;
        const auto found = std::find(names.begin(), names.end(), value_);
        std::string expected;
        for (const char* known : names) expected += str(expected.empty() ? "" : " or ", known);
        if (found == names.end()) refuse(expected);
        field = static_cast<Choice>(found - names.begin());
    }

    /// Throws Error(ExitCode::usage) if no field has the key.
    void check_found() const {
        if (found_) return;
        const std::string near = nearest_name(key_, known_);
        throw Error(ExitCode::usage, "option '", key_, "': unknown",
                    near.empty() ? "" : str("; did you mean '", near, "'?"));
    }

private:
    bool is_key(std::string_view name) {
        // The caller has the schedule, and there are no fixed voters.
        for (const char* other : {"enabled", "start", "vote_every", "refresh_every", "fixed_voters",
                                  "fixed_weight", "fixed_check"})
            if (name == other) return false;
        known_.emplace_back(name);
        found_ = found_ || name == key_;
        return name == key_;
    }
    [[noreturn]] void refuse(const std::string& expected) const {
        throw Error(ExitCode::usage, "option '", key_, "': '", value_, "'; expected ", expected);
    }

    std::string_view key_, value_;
    std::vector<std::string> known_;
    bool found_ = false;
};

/// `text`: "KEY=VALUE" with spaces between. Throws Error(ExitCode::usage).
inline TvOptions options_from(std::string_view text) {
    TvOptions options;
    while (!text.empty()) {
        const std::string_view word = text.substr(0, text.find(' '));
        text.remove_prefix(std::min(text.size(), word.size() + 1));
        if (word.empty()) continue;
        const std::size_t equals = std::min(word.find('='), word.size());
        OptionSetter setter(word.substr(0, equals), word.substr(std::min(equals + 1, word.size())));
        options.fields(setter);
        setter.check_found();
    }
    return options;
}

}  // namespace tvsgs
