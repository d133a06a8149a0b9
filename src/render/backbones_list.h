// The list of backbones. It is explicit, so that readers find it and no linker drops an entry. One
// source file per device includes it.
#pragma once

#include <map>

#include "core/error.h"
#include "render/ewa/backbone_ewa.h"
#include "render/rade/backbone_rade.h"
#include "render/surfel/backbone_surfel.h"

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
struct BackboneEntry {
    const char* name;
    std::unique_ptr<Backbone<Device>> (*make)(const BackboneOptions&);
    bool has_planes = false;  // depth is that of blended planes; else mean or median, exact rays
};

template <template <class> class Made, class Device>
std::unique_ptr<Backbone<Device>> make(const BackboneOptions& options) {
    return std::make_unique<Made<Device>>(options);
}

template <class Device>
inline constexpr BackboneEntry<Device> kBackbones[] = {
    {"ewa", make<EwaBackbone, Device>, true},
    {"surfel", make<SurfelBackbone, Device>},
    {"rade", make<RadeBackbone, Device>},
};

/// Throws for depths and rays that the backbone does not make.
template <class Device>
void check_depth(const BackboneEntry<Device>& backbone, const BackboneOptions& o) {
    if (o.depth != SurfaceDepth::automatic &&
        backbone.has_planes != (o.depth == SurfaceDepth::plane))
        throw Error(ExitCode::usage, "render.depth: backbone '", backbone.name, "' makes ",
                    backbone.has_planes ? "plane" : "expected and median",
                    "; expected that or auto, or another backbone");
    if (!backbone.has_planes && o.pixel_center != PixelCenter::exact)
        throw Error(ExitCode::usage, "render.pixel_center: backbone '", backbone.name,
                    "' does not go by it; expected its default, or another backbone");
}

template <class Device>
std::unique_ptr<Backbone<Device>> make_backbone(const std::string& name,
                                                const BackboneOptions& options) {
    std::string known;
    for (const auto& entry : kBackbones<Device>) {
        if (entry.name == name) return check_depth(entry, options), entry.make(options);
        known += str(known.empty() ? "" : ", ", entry.name);
    }
    for (const auto& [added, make] : added_backbones<Device>()) {
        if (added == name) return make(options);
        known += ", " + added;
    }
    throw Error(ExitCode::usage, "backbone '", name, "' is not known; there are: ", known);
}

}  // namespace tvsgs
