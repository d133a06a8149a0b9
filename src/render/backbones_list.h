// The list of backbones. Explicit, so that it can be read and no linker drops an entry; included by
// one file per device.
#pragma once

#include "core/error.h"
#include "render/backbone_ewa.h"

namespace tvsgs {

template <class Device>
std::unique_ptr<Backbone<Device>> make_backbone(const std::string& name,
                                                const BackboneOptions& options) {
    if (name == "3dgs" || name == "pgsr") return std::make_unique<EwaBackbone<Device>>(options);
    throw Error(ExitCode::usage,
                str("backbone '", name, "' is not known; there are 3dgs and pgsr"));
}

}  // namespace tvsgs
