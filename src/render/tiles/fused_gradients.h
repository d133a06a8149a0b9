// List of the SplatVjp types. Adam's step calls one of them while it updates the parameters.
// Include it where a kernel is compiled for each type.
#pragma once

#include <variant>

#include "render/ewa/backbone_ewa_splats.h"
#include "render/rade/backbone_rade_splats.h"
#include "render/surfel/backbone_surfel_splats.h"

namespace tvsgs {

/// The SplatVjp of the last blend_backward().
struct FusedGradients {
    std::variant<EwaVjp<Channels::color>,
                 EwaVjp<Channels::color_plane>,
                 EwaVjp<Channels::plane>,
                 SurfelVjp<Channels::color>,
                 SurfelVjp<Channels::color_plane>,
                 SurfelVjp<Channels::plane>,
                 RadeVjp<Channels::color>,
                 RadeVjp<Channels::color_plane>,
                 RadeVjp<Channels::plane>>
        vjp;  // a SplatVjp

    /// Calls run(vjp) with the actual type.
    template <class Run>
    void visit(const Run& run) const {
        std::visit(run, vjp);
    }
};

}  // namespace tvsgs
