// The list of backbones. Explicit, so that it can be read and no linker drops an entry; included by
// one file per device.
#pragma once

#include <map>

#include "core/error.h"
#include "render/backbone_ewa.h"

namespace tvsgs {

template <class Device>
auto& added_backbones() {
    static std::map<std::string, MakeBackbone<Device>> added;
    return added;
}

template <class Device>
void add_backbone(const std::string& name, MakeBackbone<Device> make) {
    added_backbones<Device>()[name] = std::move(make);
}

template <class Device>
std::unique_ptr<Backbone<Device>> make_backbone(const std::string& name,
                                                const BackboneOptions& options) {
    if (name == "3dgs" || name == "pgsr") return std::make_unique<EwaBackbone<Device>>(options);
    std::string known = "3dgs and pgsr";
    for (const auto& [added, make] : added_backbones<Device>()) {
        if (added == name) return make(options);
        known = added + ", " + known;
    }
    throw Error(ExitCode::usage, str("backbone '", name, "' is not known; there are ", known));
}

}  // namespace tvsgs
