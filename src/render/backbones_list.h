// The list of backbones. Explicit, so that it can be read and no linker drops an entry; included by
// one file per device.
#pragma once

#include <map>

#include "core/error.h"
#include "render/backbone_ewa.h"
#include "render/backbone_rade.h"
#include "render/backbone_surfel.h"

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

/// Refuses a render.depth that the rasteriser does not make.
inline void require_depth(const char* backbone,
                          const BackboneOptions& options,
                          bool made,
                          const char* expected) {
    if (options.depth != SurfaceDepth::automatic && !made)
        throw Error(ExitCode::usage, str("render.depth: backbone '", backbone, "' makes ", expected,
                                         "; expected that or auto, or another backbone"));
}

/// Refuses an option, off its default, that the rasteriser does not go by.
inline void refuse(const char* backbone, bool changed, const char* key) {
    if (changed)
        throw Error(ExitCode::usage,
                    str("render.", key, ": backbone '", backbone,
                        "' does not go by it; expected its default, or another backbone"));
}
inline void refuse_low_pass(const char* backbone, const BackboneOptions& o) {
    refuse(backbone, o.low_pass_px2 != BackboneOptions{}.low_pass_px2, "low_pass_px2");
}
inline void refuse_pixel_center(const char* backbone, const BackboneOptions& o) {
    refuse(backbone, o.pixel_center != PixelCenter::exact, "pixel_center");
}

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
         refuse_low_pass("surfel", o);
         refuse("surfel", o.exact_clamp_grad, "exact_clamp_grad");
         refuse_pixel_center("surfel", o);
         return std::make_unique<SurfelBackbone<Device>>(o);
     }},
    {"rade",
     [](const BackboneOptions& o) -> std::unique_ptr<Backbone<Device>> {
         require_depth("rade", o, o.depth != SurfaceDepth::plane, "expected and median");
         refuse_low_pass("rade", o);
         refuse_pixel_center("rade", o);
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
