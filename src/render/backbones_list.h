// The list of backbones. It is explicit, so that readers find it and no linker drops an entry. One
// source file per device includes it.
#pragma once

#include <map>

#include "core/error.h"
#include "render/ewa/backbone_ewa.h"
#include "render/rade/backbone_rade.h"
#include "render/surfel/backbone_surfel.h"

namespace tvsgs {

/// Backbones added by add_backbone().
template <class Device>
auto& added_backbones() {
    static std::map<std::string, MakeBackbone<Device>> added;
    return added;
}

template <class Device>
void add_backbone(const std::string& name, MakeBackbone<Device> make) {
    added_backbones<Device>()[name] = std::move(make);
}

/// Throws if the backbone does not support render.depth.
inline void require_depth(const char* backbone,
                          const BackboneOptions& options,
                          bool made,
                          const char* expected) {
    if (options.depth != SurfaceDepth::automatic && !made)
        throw Error(ExitCode::usage, str("render.depth: backbone '", backbone, "' makes ", expected,
                                         "; expected that or auto, or another backbone"));
}

/// Throws for rays off the pixel centres, for a backbone without them.
inline void require_exact_rays(const char* backbone, const BackboneOptions& o) {
    if (o.pixel_center != PixelCenter::exact)
        throw Error(ExitCode::usage,
                    str("render.pixel_center: backbone '", backbone,
                        "' does not go by it; expected its default, or another backbone"));
}

/// Name and constructor of a backbone.
template <class Device>
struct BackboneEntry {
    const char* name;
    std::unique_ptr<Backbone<Device>> (*make)(const BackboneOptions&);
};

template <class Device>
inline constexpr BackboneEntry<Device> kBackbones[] = {
    {"ewa",
     [](const BackboneOptions& o) -> std::unique_ptr<Backbone<Device>> {
         return std::make_unique<EwaBackbone<Device>>(o);
     }},
    {"surfel",
     [](const BackboneOptions& o) -> std::unique_ptr<Backbone<Device>> {
         require_depth("surfel", o, o.depth != SurfaceDepth::plane, "expected and median");
         require_exact_rays("surfel", o);
         return std::make_unique<SurfelBackbone<Device>>(o);
     }},
    {"rade",
     [](const BackboneOptions& o) -> std::unique_ptr<Backbone<Device>> {
         require_depth("rade", o, o.depth != SurfaceDepth::plane, "expected and median");
         require_exact_rays("rade", o);
         return std::make_unique<RadeBackbone<Device>>(o);
     }},
};

template <class Device>
std::unique_ptr<Backbone<Device>> make_backbone(const std::string& name,
                                                const BackboneOptions& options) {
    std::string known;
    for (const auto& entry : kBackbones<Device>) {
        if (entry.name == name) return entry.make(options);
        known += str(known.empty() ? "" : ", ", entry.name);
    }
    for (const auto& [added, make] : added_backbones<Device>()) {
        if (added == name) return make(options);
        known += ", " + added;
    }
    throw Error(ExitCode::usage, str("backbone '", name, "' is not known; there are: ", known));
}

}  // namespace tvsgs
