// The list of ways from the sums of a view's splats to their parameters: those that Adam's step
// takes where it uses the gradients. Included where a kernel is compiled for each.
#pragma once

#include <variant>

#include "render/ewa/backbone_ewa_splats.h"
#include "render/rade/backbone_rade_splats.h"
#include "render/surfel/backbone_surfel_splats.h"

namespace tvsgs {

struct FusedGradients {
    std::variant<EwaVjp<Channels::color>,
                 EwaVjp<Channels::color_plane>,
                 EwaVjp<Channels::plane>,
                 EwaVjp<Channels::color_ray>,
                 EwaVjp<Channels::ray>,
                 SurfelVjp<false, true>,
                 SurfelVjp<true, true>,
                 SurfelVjp<true, false>,
                 RadeVjp<false, true>,
                 RadeVjp<true, true>,
                 RadeVjp<true, false>>
        vjp;  // a SplatVjp

    /// run(vjp) as the type that it is.
    template <class Run>
    void visit(const Run& run) const {
        std::visit(run, vjp);
    }
};

}  // namespace tvsgs
