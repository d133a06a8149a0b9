#include "apps/common/help_pages.h"

#include <algorithm>
#include <cctype>
#include <set>

#include "core/error.h"
#include "core/version.h"

namespace tvsgs {
namespace {

constexpr std::size_t kLongPage = 26;  // flags; a longer page does not fit on a screen

/// Common flags of all commands, which a long page shows.
const std::set<std::string>& flags_of_most_days() {
    static const std::set<std::string> names{
        "scene", "model",   "images",      "resolution", "eval",      "views",   "num-views",
        "masks", "priors",  "iterations",  "device",     "config",    "set",     "list-keys",
        "plan",  "resume",  "time-budget", "out",        "overwrite", "method",  "voxel-size",
        "faces", "texture", "unbounded",   "bbox",       "depth-max", "version", "help",
        "until", "seed",    "use-masks",   "max-points", "maps",      "preset",  "kind",
        "gt",    "pred",    "help-all"};
    return names;
}

std::vector<const CLI::Option*> flags_of(const CLI::App& app) {
    return app.get_options([](const CLI::Option* o) { return !o->get_group().empty(); });
}

bool takes_value(const CLI::Option& option) {
    return option.get_expected_max() > 0;
}

/// Escapes text for man(7).
std::string roff(const std::string& text) {
    std::string out;
    for (const char c : text) {
        if (c == '\\')
            out += "\\e";
        else if (c == '-')
            out += "\\-";
        else if ((c == '.' || c == '\'') && (out.empty() || out.back() == '\n'))
            out += std::string("\\&") + c;
        else if (c == ',')
            out += ",\\:";  // allows line breaks in long lists of choices
        else
            out += c;
    }
    return out;
}

std::string man_flag(const CLI::Option& option) {
    std::string names;
    const auto add = [&](const std::string& name) {
        names += (names.empty() ? "\\fB" : ", \\fB") + roff(name) + "\\fR";
    };
    for (const std::string& name : option.get_snames()) add("-" + name);
    for (const std::string& name : option.get_lnames()) add("--" + name);
    if (names.empty()) names = "\\fI" + roff(option.get_name()) + "\\fR";
    std::string value;
    if (takes_value(option)) value = " \\fI" + roff(option.get_type_name()) + "\\fR";
    if (takes_value(option) && !option.get_default_str().empty())
        value += roff("=" + option.get_default_str());
    return ".TP\n" + names + value + "\n" + roff(option.get_description()) + "\n";
}

std::string man_flags(const CLI::App& app) {
    std::vector<std::string> groups;
    const auto flags = flags_of(app);
    for (const CLI::Option* flag : flags)
        if (std::ranges::find(groups, flag->get_group()) == groups.end())
            groups.push_back(flag->get_group());
    std::string out;
    for (const std::string& group : groups) {
        if (groups.size() > 1) out += ".SS " + roff(group) + "\n";
        for (const CLI::Option* flag : flags)
            if (flag->get_group() == group) out += man_flag(*flag);
    }
    return out;
}

std::string upper(std::string text) {
    for (char& c : text) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    return text;
}

/// Limits of `INT:INT in [1 - 9]` or `TEXT:{a,b}` without the type before the colon.
std::string short_type(const std::string& type) {
    const std::size_t colon = type.find(':');
    if (colon == type.npos) return type;
    return type[colon + 1] == '>' ? type.substr(0, colon) + " " + type.substr(colon + 1)
                                  : type.substr(colon + 1);
}

class HelpFormat : public CLI::Formatter {
public:
    std::string make_option_name(const CLI::Option* option, bool positional) const override {
        if (positional)
            return upper(option->get_name(true)) +
                   (option->get_snames().empty() ? ""
                                                 : str(", or -", option->get_snames().front(), " ",
                                                       upper(option->get_name(true))));
        std::string names = option->get_name(false, true);
        for (std::size_t at; (at = names.find("{false}")) != names.npos;) names.erase(at, 7);
        return names;
    }
    std::string make_option_opts(const CLI::Option* option) const override {
        if (option->get_positional() || !takes_value(*option)) return "";
        const std::string value = option->get_default_str();
        return str(" ", short_type(option->get_type_name()), value.empty() ? "" : "=" + value,
                   option->get_expected_max() > 1 ? " ..." : "",
                   option->get_required() ? " (required)" : "");
    }
    std::string make_option_usage(const CLI::Option* option) const override {
        const std::string name =
            upper(option->get_name(true)) + (option->get_expected_max() > 1 ? "..." : "");
        return option->get_required() ? name : "[" + name + "]";
    }
    std::string make_option_desc(const CLI::Option* option) const override {
        std::string text = option->get_description();
        for (const CLI::Option* other : option->get_excludes())
            text += (other == *option->get_excludes().begin() ? "; not with " : ", ") +
                    other->get_name();
        return text;
    }
};

/// Help of a subcommand names its command first.
std::string page_of(const CLI::App& app) {
    return app.help(app.get_parent() ? app.get_parent()->get_name() : "");
}

}  // namespace

std::vector<const CLI::App*> subcommands_of(const CLI::App& app) {
    return app.get_subcommands([](const CLI::App*) { return true; });
}

void use_help_format(CLI::App& app) {
    auto format = std::make_shared<HelpFormat>();
    format->column_width(app.get_formatter()->get_column_width());
    app.formatter(format);
}

std::string help_page(CLI::App& app) {
    if (const auto chosen = app.get_subcommands(); !chosen.empty())
        return help_page(*chosen.back());
    if (flags_of(app).size() <= kLongPage) return page_of(app);
    std::vector<std::pair<CLI::Option*, std::string>> hidden;
    for (CLI::Option* option : app.get_options()) {
        const auto& names = option->get_lnames();
        const bool shown = names.empty() || std::ranges::any_of(names, [](auto& name) {
                               return flags_of_most_days().contains(name);
                           });
        if (shown || option->get_group().empty() || option->get_required()) continue;
        hidden.emplace_back(option, option->get_group());
        option->group("");
    }
    const std::string page = page_of(app);
    for (const auto& [option, group] : hidden) option->group(group);
    return str(page, hidden.size(), " more flags: --help-all\n");
}

std::string man_page(const CLI::App& app) {
    const std::string title = upper(app.get_name());
    const auto subcommands = subcommands_of(app);
    std::string out = str(".TH ", roff(title), " 1 \"\" \"", kVersion, "\" \"User Commands\"\n");
    out += ".ad l\n";  // a line of choices has no spaces to stretch
    out += str(".SH NAME\n", roff(app.get_name()), " \\- ", roff(app.get_description()), "\n");
    out += str(".SH SYNOPSIS\n.B ", roff(app.get_name()),
               subcommands.empty() ? "\n[flags]\n" : "\ncommand [flags]\n");
    if (!subcommands.empty()) out += ".SH COMMANDS\n";
    for (const CLI::App* sub : subcommands)
        out +=
            str(".TP\n\\fB", roff(sub->get_name()), "\\fR\n", roff(sub->get_description()), "\n");
    out += ".SH OPTIONS\n" + man_flags(app);
    for (const CLI::App* sub : subcommands)
        if (flags_of(*sub).size() > 1)  // --help alone is not worth a section
            out += str(".SH OPTIONS OF ", roff(sub->get_name()), "\n", man_flags(*sub));
    out +=
        ".SH EXIT STATUS\n0 done; 1 internal error; 2 usage or configuration; 3 input data; 4 out "
        "of memory; 5 no usable device; 6 reading or writing failed; 7 numerical failure; 8 a "
        "required bound was not met; 128 and the signal's number where a signal ended it.\n"
        ".SH SEE ALSO\n.BR tvsgs (1)\n";
    return out;
}

std::string completion_words(const CLI::App& app) {
    std::string out;
    for (const CLI::App* sub : subcommands_of(app)) out += sub->get_name() + "\n";
    for (const CLI::Option* flag : flags_of(app))
        for (const std::string& name : flag->get_lnames()) {
            out += "--" + name;
            if (takes_value(*flag)) {
                const std::string type = flag->get_type_name();
                const std::size_t begin = type.find('{'), end = type.find('}');
                out += '\t';
                if (begin != type.npos && end != type.npos) {
                    std::string choices = type.substr(begin + 1, end - begin - 1);
                    std::ranges::replace(choices, ',', ' ');
                    out += choices;
                }
            }
            out += '\n';
        }
    return out;
}

}  // namespace tvsgs
