#include "apps/common/help_pages.h"

#include <algorithm>
#include <set>
#include <vector>

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

std::vector<const CLI::App*> subcommands_of(const CLI::App& app) {
    return app.get_subcommands([](const CLI::App* s) { return !s->get_group().empty(); });
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
        if (std::find(groups.begin(), groups.end(), flag->get_group()) == groups.end())
            groups.push_back(flag->get_group());
    std::string out;
    for (const std::string& group : groups) {
        if (groups.size() > 1) out += ".SS " + roff(group) + "\n";
        for (const CLI::Option* flag : flags)
            if (flag->get_group() == group) out += man_flag(*flag);
    }
    return out;
}

}  // namespace

std::string help_page(CLI::App& app) {
    if (const auto chosen = app.get_subcommands(); !chosen.empty())
        return help_page(*chosen.back());
    if (flags_of(app).size() <= kLongPage) return app.help();
    std::vector<std::pair<CLI::Option*, std::string>> hidden;
    for (CLI::Option* option : app.get_options()) {
        const auto& names = option->get_lnames();
        const bool shown = names.empty() || std::any_of(names.begin(), names.end(), [](auto& name) {
                               return flags_of_most_days().contains(name);
                           });
        if (shown || option->get_group().empty() || option->get_required()) continue;
        hidden.emplace_back(option, option->get_group());
        option->group("");
    }
    const std::string page = app.help();
    for (const auto& [option, group] : hidden) option->group(group);
    return str(page, hidden.size(), " more flags: --help-all\n");
}

std::string man_page(const CLI::App& app) {
    std::string title = app.get_name();
    for (char& c : title) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
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
                    std::replace(choices.begin(), choices.end(), ',', ' ');
                    out += choices;
                }
            }
            out += '\n';
        }
    return out;
}

}  // namespace tvsgs
