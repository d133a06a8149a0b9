// Command-line flags that set configuration keys.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "apps/common/command_line.h"
#include "io/config/config.h"

namespace tvsgs {

/// Stores values while the command line is parsed, to set them after files and the environment.
/// Must outlive the parsing.
class KeyFlags {
public:
    /// `table` gives types and defaults for help; an unknown key is an error.
    KeyFlags(CLI::App& app, const OptionTable& table) : app_(app), table_(table) {}
    KeyFlags(const KeyFlags&) = delete;
    KeyFlags& operator=(const KeyFlags&) = delete;

    /// A flag that sets a key. `help`: in place of the key's own.
    void add(const char* names, const char* key, std::string help = "") {
        const Option& option = table_.option(key);
        if (help.empty()) help = option.help;
        const auto set = [this, key](const std::string& v) { given_.emplace_back(key, v); };
        if (option.kind == Option::Kind::boolean) {
            app_.add_flag_callback(
                names, [set] { set("true"); }, help);
            return;
        }
        const bool says_default = help.find('[') != help.npos;
        app_.add_option_function<std::string>(names, set, help)
            ->type_name(type_name(option))
            ->default_str(says_default ? "" : option.get());
    }

    /// -c,--config and --set.
    void add_config(const std::string& help = "JSON file of keys; later files win") {
        add_repeated(app_, "-c,--config", files_, help);
        add_set();
    }
    void add_set() { add_repeated(app_, "--set", settings_, "KEY=VALUE of the configuration"); }

    /// Flags for the photographs of the scene and their selection.
    void add_scene(const char* group = "Scene") {
        start_group(app_, group);
        add("-s,--scene,--source-path,--data", "scene.path");
        add("--format", "scene.format");
        add("--images", "scene.images");
        add("-r,--resolution", "scene.resolution");
        add("--split", "scene.split");
        add("--train-list", "scene.train_list");
        add("--test-list", "scene.test_list");
        add("--views", "scene.views");
        add("-n,--num-views", "scene.num_views");
        add("--eval", "scene.eval", "make every 8th view a test view (--test-every)");
        add("--test-every", "scene.test_every");
        add("--masks", "scene.masks");
    }

    bool has_files() const { return !files_.empty(); }
    /// Sets the keys that have flags of their own.
    void set_keys(OptionTable& table) const {
        for (const auto& [key, value] : given_) table.set(key, value, "the command line");
    }
    /// Files, environment and flags, in this order. `known`: as in OptionTable::read_environment().
    void set_all(OptionTable& table, const OptionTable* known = nullptr) const {
        for (const std::string& file : files_) table.read_file(file);
        table.read_environment(known);
        set_keys(table);
        table.set_all(settings_);
    }

private:
    static std::string type_name(const Option& option) {
        if (option.kind == Option::Kind::integer) return "INT";
        if (option.kind == Option::Kind::real) return "FLOAT";
        if (option.kind != Option::Kind::choice) return "TEXT";
        return "{" + CLI::detail::join(option.choices, ",") + "}";
    }

    CLI::App& app_;
    const OptionTable& table_;
    std::vector<std::pair<std::string, std::string>> given_;
    std::vector<std::string> files_, settings_;
};

}  // namespace tvsgs
