// Command-line flags that set configuration keys.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

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

    void add(const char* names, const char* key, const char* help, const char* group) {
        const Option& option = table_.option(key);
        const bool says_default = std::string_view(help).find('[') != std::string_view::npos;
        app_.add_option_function<std::string>(
                names, [this, key](const std::string& v) { given_.emplace_back(key, v); }, help)
            ->type_name(type_name(option))
            ->default_str(says_default ? "" : option.get())
            ->group(group);
    }
    void add_switch(const char* names, const char* key, const char* help, const char* group) {
        app_.add_flag_callback(
                names, [this, key] { given_.emplace_back(key, "true"); }, help)
            ->group(group);
    }

    /// Flags for the photographs of the scene and their selection.
    void add_scene(const char* group = "Scene") {
        add("-s,--scene,--source-path,--data", "scene.path",
            "folder of the scene: photographs and their cameras", group);
        add("--format", "scene.format", "layout of the folder; auto: the first that fits [auto]",
            group);
        add("--images", "scene.images", "folder of the photographs, inside the scene [images]",
            group);
        add("-r,--resolution", "scene.resolution",
            "1, 2, 4, 8: divide the size by it; -1: at most 1600 px wide; other: width in pixels",
            group);
        add("--split", "scene.split",
            "list of splits.json to train on; its list 'test' gives the test views", group);
        add("--train-list", "scene.train_list", "file of training images, one per line", group);
        add("--test-list", "scene.test_list", "file of test images, one per line", group);
        add("--views", "scene.views",
            "training views by index into the sorted images, such as 23,24,33", group);
        add("-n,--num-views", "scene.num_views", "use N evenly spaced photographs; 0: all", group);
        add_switch("--eval", "scene.eval", "make every 8th view a test view (--test-every)", group);
        add("--test-every", "scene.test_every", "with --eval: every Nth view is a test view [8]",
            group);
        add("--masks", "scene.masks", "folder of the masks [mask/, masks/ or the alpha channel]",
            group);
    }

    void set_keys(OptionTable& table) const {
        for (const auto& [key, value] : given_) table.set(key, value, "the command line");
    }

private:
    static std::string type_name(const Option& option) {
        switch (option.kind) {
            case Option::Kind::integer:
                return "INT";
            case Option::Kind::real:
                return "FLOAT";
            case Option::Kind::boolean:
                return "{true,false}";
            case Option::Kind::choice:
                return "{" + CLI::detail::join(option.choices, ",") + "}";
            default:
                return "TEXT";
        }
    }

    CLI::App& app_;
    const OptionTable& table_;
    std::vector<std::pair<std::string, std::string>> given_;
};

}  // namespace tvsgs
